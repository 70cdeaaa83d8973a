"""The link under TCP changes nothing that is told: twins of captures over everyday links, and over one of the slow path."""

from __future__ import annotations

import json
import re
from ipaddress import IPv4Address, IPv6Address
from pathlib import Path
from random import Random
from typing import Any, Final

import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.links import KINDS, twin
from benchmarks.multiply import ip_offset
from benchmarks.readers import read_capture
from benchmarks.writers import ETHERNET, CaptureWriter
from dissect import analyze
from dissect import open as events
from dissect.engine.transactions.transaction import Transaction
from tests.properties.books import Result, facts
from tests.properties.packets import LINUX_SLL, LINUX_SLL2, NULL, RAW, Flow, Packet, captured
from tests.properties.traffic import conversation, segments

ROOT: Final = Path(__file__).parents[2] / "captures"
#: An address of an IPv6 twin, where a port follows and elsewhere.
_SIX: Final = re.compile(r"\[(fd53:3700::ffff:[0-9a-f:]+)\]|fd53:3700::ffff:[0-9a-f]{1,4}:[0-9a-f]{1,4}")
#: What is said of the link: the VLAN, and the size of a packet that was cut.
_LINK: Final = re.compile(r" in VLAN [\d.]+|\d+ of \d+ bytes kept|(?<=\"vlan\": )\[[^]]*\]")


def _four(found: re.Match[str]) -> str:
    return str(IPv4Address(IPv6Address(found[1] or found[0]).packed[12:]))


def _less_link(text: str) -> str:
    return _LINK.sub("", _SIX.sub(_four, text))


def told(path: Path) -> tuple[str, str]:
    """Return what `analyze` and `transactions` say of a capture, less the facts of its link."""
    report = analyze(path).as_dict()
    files: Any = report["files"]
    report["files"] = [{**file, "name": "", "octets": 0} for file in files]
    shown = json.dumps(report, default=str, indent=1)
    rows = "\n".join([repr(facts(one)) for one in events(path) if isinstance(one, Transaction)])
    return _less_link(shown), _less_link(rows)


def on_slow_path(source: Path, out: Path) -> None:
    """Write the IPv4 packets of an Ethernet capture with an option of IP that does nothing, which no fast path takes."""
    _, packets = read_capture(source)
    with out.open("wb") as file:
        writer = CaptureWriter(file, "pcap-ns", ETHERNET)
        for time_ns, frame, wire in packets:
            at = ip_offset(ETHERNET, frame)
            if at < 0 or frame[at - 2 : at] != b"\x08\x00":
                continue
            size = int.from_bytes(frame[at + 2 : at + 4], "big") + 4
            if frame[at] != 0x45 or size == 4:
                raise ValueError(f"{source} has options of IP itself, or packets that do not say how long they are")
            head = (
                bytes((frame[at] + 1, frame[at + 1])) + size.to_bytes(2, "big") + frame[at + 4 : at + 20] + b"\1\1\1\1"
            )
            made = frame[:12] + b"\x08\x00" + head + frame[at + 20 :]
            writer.write(time_ns, made, wire - len(frame) + len(made))
        writer.flush()


def _has_fragments(source: Path) -> bool:
    _, packets = read_capture(source)
    places = [(frame, ip_offset(ETHERNET, frame)) for _, frame, _ in packets]
    return any([at > 0 and frame[at] >> 4 == 4 and (frame[at + 6] & 0x3F or frame[at + 7]) for frame, at in places])


def compare(source: Path, folder: Path) -> int:
    """Hold the twins of a capture to the plain one; return how many there are."""
    right: tuple[str, str] | None = None
    twins = 0
    for kind in KINDS:  # the plain one first
        out = folder / kind
        try:
            twin(source, kind, out)
            if kind == "ipv6" and _has_fragments(source):
                continue
        except (ValueError, OverflowError):  # not Ethernet alone, or IP whose length IPv6 cannot have
            continue
        found = told(out)
        if right is None:
            right = found
        assert found == right, (source, kind)
        twins += 1
    return twins


OWN: Final = sorted(path for path in ROOT.glob("**/*.pcap*") if path.stat().st_size < 400_000)


@pytest.mark.parametrize("part", range(4))
def test_our_captures_are_read_alike_over_every_link(part: int, tmp_path: Path) -> None:
    assert sum([compare(path, tmp_path) for path in OWN[part::4]]) > 20 * len(KINDS)


@pytest.mark.parametrize("part", range(2))
def test_our_captures_are_read_on_the_slow_path_as_on_the_fast_one(part: int, tmp_path: Path) -> None:
    read = 0
    for path in OWN[part::2]:
        try:
            on_slow_path(path, tmp_path / "slow")
            twin(path, "plain", tmp_path / "plain")
        except ValueError:
            continue
        assert told(tmp_path / "slow") == told(tmp_path / "plain"), path
        read += 1
    assert read > 40


def test_shared_captures_are_read_alike_over_every_link(corpus: Path, tmp_path: Path) -> None:
    found = [path for path in corpus.glob("**/*.pcap*") if path.stat().st_size < 30_000]
    assert sum([compare(path, tmp_path) for path in found]) > len(found) * len(KINDS) / 2


FLOWS: Final = [
    Flow(*addresses, vlans=vlans, link=link)
    for addresses in (("10.0.0.1", "10.0.0.2"), ("fd00::1", "fd00::2"))
    for vlans, link in (
        ((), ETHERNET), ((5,), ETHERNET), ((7, 5), ETHERNET), ((), LINUX_SLL), ((), LINUX_SLL2), ((), RAW), ((), NULL),
    )
]  # fmt: skip
TALKS: Final = [captured(segments(conversation(Random(3), flow, 4))) for flow in FLOWS]


@given(
    st.sampled_from(TALKS),
    st.integers(0, 12),
    st.lists(st.tuples(st.integers(0, 100), st.integers(0, 255)), max_size=3),
    st.integers(0, 30),
)
def test_a_frame_with_any_octets_is_taken_on_the_fast_path_as_on_the_slow_one(
    talk: list[Packet], at: int, changes: list[tuple[int, int]], cut: int
) -> None:
    packet = talk[at % len(talk)]
    frame = bytearray(packet.octets)
    for place, octet in changes:
        frame[place % len(frame)] = octet
    whole = len(frame)
    octets = b"x" + bytes(frame[: whole - cut])
    found = []
    for way in ("_packet", "_slow_frame"):
        result = Result(talk[: at % len(talk)], finish=False)
        pipeline = result.pipeline
        pipeline.counters.frames += 1
        category = getattr(pipeline, way)(octets, 1, len(octets), packet.link_type)
        pipeline.finish()
        connections = [
            (str(one.tcp.ends), one.tcp.packets, one.ending and one.ending.how) for one in result.record.closed
        ]
        told = [facts(one) for one in result.transactions]
        found.append((category, told, connections, result.counts, pipeline.counters.octets.as_dict()))
    assert found[0] == found[1]
