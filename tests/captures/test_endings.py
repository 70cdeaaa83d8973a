"""How every connection of our captures and the public ones ended, held to the TCP flags that tshark shows."""

from __future__ import annotations

import bisect
import itertools
import shutil
import subprocess
from collections import defaultdict
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Final

import pytest

import dissect
from dissect.engine.transactions.ending import FIN, RESET
from tests.testing.golden.tshark_view import ports_of
from tests.tshark import ask

ROOT: Final = Path(__file__).resolve().parents[2]
OWN: Final = sorted((ROOT / "captures").glob("*.pcapng"))

pytestmark = pytest.mark.skipif(shutil.which("tshark") is None, reason="tshark is not installed")

_FIN_BIT: Final = 1
_RESET_BIT: Final = 4
#: Packet, sender and receiver ("address:port"), FIN, RST.
Flags = tuple[int, str, str, bool, bool]


def flags_shown(path: Path) -> Iterator[Flags]:
    """Give the packets with FIN or RST that tshark shows of a capture of ours, which other tests ask about too."""
    for layers in ask(path, ports_of(path)).packets:
        tcp = layers.get("tcp")
        if isinstance(tcp, dict) and (flags := int(tcp["tcp.flags"], 0)) & (_FIN_BIT | _RESET_BIT):
            host = layers["ip"]["ip.src"] if "ip" in layers else f"[{layers['ipv6']['ipv6.src']}]"
            far = layers["ip"]["ip.dst"] if "ip" in layers else f"[{layers['ipv6']['ipv6.dst']}]"
            ends = f"{host}:{tcp['tcp.srcport']}", f"{far}:{tcp['tcp.dstport']}"
            yield int(layers["frame"]["frame.number"]), *ends, bool(flags & _FIN_BIT), bool(flags & _RESET_BIT)


def flags_asked(paths: list[Path], folder: Path) -> dict[Path, list[Flags]]:
    """Ask tshark for the packets with FIN or RST of captures joined into one: to start it takes longer than to read them."""
    joined = folder / "joined.pcapng"
    said("mergecap", "-a", "-w", joined, *paths)
    counts = [int(line.rsplit(",", 1)[1]) for line in said("capinfos", "-M", "-T", "-m", "-r", "-c", *paths)]
    # The packet before the first of each: tshark counts on from capture to capture.
    before = list(itertools.accumulate(counts, initial=0))
    found: dict[Path, list[Flags]] = {path: [] for path in paths}
    names = ("frame.number", "ip.src", "ipv6.src", "tcp.srcport", "ip.dst", "ipv6.dst", "tcp.dstport", "tcp.flags.fin")
    asked = [part for name in (*names, "tcp.flags.reset") for part in ("-e", name)]
    only = ["-Y", "tcp.flags.fin == 1 or tcp.flags.reset == 1", "-T", "fields", "-E", "occurrence=l"]
    for line in said("tshark", "-n", "-r", joined, *only, *asked):
        frame, src4, src6, src_port, dst4, dst6, dst_port, fin, reset = line.split("\t")
        ends = [f"[{six}]:{port}" if six else f"{four}:{port}" for four, six, port in
                ((src4, src6, src_port), (dst4, dst6, dst_port))]  # fmt: skip
        at = bisect.bisect_left(before, int(frame)) - 1
        found[paths[at]].append((int(frame) - before[at], ends[0], ends[1], fin == "1", reset == "1"))
    return found


def said(*command: str | Path) -> list[str]:
    """Run a program of Wireshark, return the lines it prints."""
    return subprocess.run(command, capture_output=True, text=True, check=True, timeout=120).stdout.splitlines()


def held(path: Path, packets: Iterable[Flags]) -> int:
    """Hold the endings of a capture to its packets with FIN or RST; return how many ended by one."""
    flags: dict[frozenset[str], list[tuple[int, str, bool, bool]]] = defaultdict(list)
    for frame, sender, receiver, fin, reset in packets:
        flags[frozenset((sender, receiver))].append((frame, sender, fin, reset))
    analysis = dissect.analyze(str(path))
    count = 0
    for connection in analysis.connections:
        ending = connection.ending
        assert ending is not None
        ends = connection.tcp.ends
        shown = {frame: (sender, fin, reset) for frame, sender, fin, reset in flags[frozenset(map(str, ends))]}
        where = f"{path.name}, connection {connection.number}"
        if ending.how in {FIN, RESET}:
            count += 1
            sender, fin, reset = shown[int(ending.frame)]
            assert sender == str(ends[ending.side]), where
            assert (fin and not reset) if ending.how == FIN else reset, where
            own = [frame for frame in shown if connection.tcp.first_frame <= frame <= connection.tcp.last_frame]
            assert int(ending.frame) == min(own), f"{where}: not the first packet that ended it"
        if ending.reset_frame:
            sender, _, reset = shown[int(ending.reset_frame)]
            assert (sender, reset) == (str(ends[ending.reset_side]), True), where
            assert ending.reset_frame > ending.frame, where
        elif ending.how == FIN:
            last = connection.tcp.last_frame
            later = [frame for frame, (_, _, reset) in shown.items() if reset and ending.frame < frame <= last]
            assert not later, f"{where}: RST in packets {later} not told"
    return count


@pytest.mark.parametrize("path", OWN, ids=[path.stem for path in OWN])
def test_endings_of_our_captures(path: Path) -> None:
    held(path, flags_shown(path))


def test_endings_of_the_public_captures(corpus: Path, tmp_path: Path) -> None:
    paths = sorted(
        path
        for path in corpus.rglob("*.pcap*")
        if path.suffix in {".pcap", ".pcapng"} and path.stat().st_size < 2_000_000
    )
    flags = flags_asked(paths, tmp_path)
    counts = {path.name: held(path, flags[path]) for path in paths}
    assert sum(counts.values()) > 0
