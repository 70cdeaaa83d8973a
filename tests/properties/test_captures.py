"""Every packet and every octet of every capture is accounted for, also of every damaged one (promises G3, G4, G5, G13).

``S7DISSECT_MUTATIONS=all`` tries every octet of every shared capture of at most 64 KiB with every value, and every length;
otherwise a sample drawn from a fixed seed is tried, a larger one before a release.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from functools import partial
from itertools import islice
from pathlib import Path
from random import Random
from typing import Final

import pytest

import dissect
from dissect.packets.source.packet import PacketSink
from dissect.packets.tcp import stream
from dissect.protocols.iso import tpkt
from dissect.protocols.s7 import parameters
from dissect.wire.build import COMPILED
from tests.cases import RELEASE, each
from tests.growth import UNCOUNTED, lines
from tests.properties.books import Result, check_books, facts
from tests.properties.captures import PATHS, PLAIN, ROOT, SHARED, analyze, name_of, reader_of
from tests.properties.packets import Packet

LARGEST: Final = 64 * 1024
SAMPLES: Final = [path for path in sorted(SHARED.glob("*.pcap*")) if path.stat().st_size <= LARGEST]
ALL: Final = os.environ.get("S7DISSECT_MUTATIONS") == "all"
#: Lists that many objects share while they have nothing of their kind.
EMPTY: Final[list[Sequence[object]]] = [
    tpkt._NO_PLACES, tpkt._NO_PACKETS, tpkt._NO_FAULTS, stream._NOTHING, parameters._NO_ITEMS, parameters._NOTHING_WRONG,
]  # fmt: skip
#: How much less is tried with every change than before a release.
LESS: Final = 1 if RELEASE else 4
#: Packets that all samples together may take to try.
BUDGET: Final = (2_000_000 if COMPILED else 400_000) // LESS


class Collector(PacketSink):
    """Keeps the packets of a file."""

    def __init__(self) -> None:
        self.packets: list[Packet] = []

    def frame(self, time_ns: int, buf: bytes, start: int, end: int, wire_length: int, link_type: int) -> None:
        self.packets.append(Packet(time_ns, buf[start:end], wire_length, link_type))


def packets_of(path: Path) -> list[Packet]:
    collector = Collector()
    reader = reader_of(path.read_bytes())
    if reader is not None:
        while reader.step(collector):
            pass
    return collector.packets


def test_the_shared_captures_are_there(corpus: Path) -> None:
    assert len(SAMPLES) >= 15
    assert len(PATHS) > 50


@each("path", PATHS)
def test_every_packet_and_octet_is_accounted_for(path: Path) -> None:
    analysis = dissect.analyze(str(path))
    assert analysis.pipeline is not None
    check_books(analysis.pipeline)
    counted = analysis.as_dict()["packets"]
    assert isinstance(counted, dict)
    assert counted["read"] == sum(counted["used"].values()) + sum(counted["ignored"].values())
    assert counted["read"] == sum([file.packets for file in analysis.files])


@each("path", PLAIN)
def test_every_prefix_is_accounted_for(path: Path) -> None:
    packets = packets_of(path)
    whole = Result(packets)
    check_books(whole.pipeline, whole.record)
    told = [facts(one) for one in whole.transactions]
    # The work grows with the square of the packets: of long captures only some prefixes are tried.
    step = max(1, LESS * len(packets) ** 2 // (60_000 if COMPILED else 6_000))
    for size in range(0, len(packets), step):
        part = Result(packets[:size])
        check_books(part.pipeline, part.record)
        assert [facts(one) for one in part.transactions[: part.before_the_end]] == told[: part.before_the_end]


def values(octet: int) -> set[int]:
    """Return what an octet is replaced by."""
    return {0, 1, 0x7F, 0x80, 0xFF, octet ^ 1, octet ^ 0x80, (octet + 1) & 0xFF} - {octet}


def mutations(octets: bytes) -> Iterator[bytes]:
    """Give every capture that differs in one octet, and every length."""
    for at, octet in enumerate(octets):
        for value in sorted(values(octet)):
            yield octets[:at] + bytes((value,)) + octets[at + 1 :]
    for size in range(len(octets)):
        yield octets[:size]


def sampled(octets: bytes, packets: int, seed: str) -> Iterator[bytes]:
    """Give a sample of them, at least fifty of each kind."""
    rng = Random(seed)
    runs = max(50, BUDGET // len(SAMPLES) // (packets + 10))
    for _ in range(runs):
        at = rng.randrange(len(octets))
        yield octets[:at] + bytes((rng.choice(sorted(values(octets[at]))),)) + octets[at + 1 :]
    for _ in range(max(50, runs // 8)):
        yield octets[: rng.randrange(len(octets))]


@pytest.mark.parametrize("path", SAMPLES, ids=name_of)
def test_no_damage_raises_or_is_lost(path: Path) -> None:
    octets = path.read_bytes()
    packets = len(packets_of(path))
    tried = 0
    for spoilt in mutations(octets) if ALL else sampled(octets, packets, path.name):
        analyze(spoilt)
        tried += 1
    assert tried >= 100
    assert not any(map(len, EMPTY)), "what is shared while it is empty was written to"


@pytest.mark.skipif(COMPILED, reason=UNCOUNTED)
@pytest.mark.parametrize("path", SAMPLES, ids=name_of)
def test_damage_makes_no_work(path: Path) -> None:
    """At most twice the work of the sound capture, whatever is damaged (promise G2)."""
    octets = path.read_bytes()
    sound = lines(lambda: analyze(octets))
    for spoilt in islice(sampled(octets, len(packets_of(path)), path.name), 0, None, 40):
        assert lines(partial(analyze, spoilt)) <= 2 * sound


@pytest.mark.parametrize("seed", ["0", "1", "random"])
def test_the_same_input_gives_the_same_output(seed: str, tmp_path: Path) -> None:
    """Promise G13: what is told does not depend on the hash seed, the time zone, the language or the folder."""
    paths = [path for path in PLAIN if path.stat().st_size < LARGEST][::4]
    code = "import dissect, json, sys\nfor path in sys.argv[1:]: print(json.dumps(dissect.analyze(path).as_dict()))\n"
    environment = {**os.environ, "PYTHONHASHSEED": seed, "TZ": "Asia/Kathmandu", "LC_ALL": "C", "LANG": "tr_TR.UTF-8"}
    if Path(dissect.__file__).resolve().parent.parent == ROOT:
        environment["PYTHONPATH"] = str(ROOT)
    arguments = [sys.executable, "-c", code, *map(str, paths)]
    ran = subprocess.run(arguments, env=environment, cwd=tmp_path, capture_output=True, text=True, check=True)
    assert ran.stdout == "".join([json.dumps(dissect.analyze(str(path)).as_dict()) + "\n" for path in paths])
