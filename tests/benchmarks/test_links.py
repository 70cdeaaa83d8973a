"""Twins of a capture over other links: the same segments, with right checksums, and nothing else about them differs."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from benchmarks.generate import generate
from benchmarks.links import COOKED, COOKED_2, KINDS, RAW, main, twin
from benchmarks.multiply import ip_offset
from benchmarks.readers import read_capture
from benchmarks.writers import ETHERNET
from dissect import analyze

PACKETS = 1500


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("links") / "source.pcap"
    generate(path, PACKETS, seed=4, stations=12)
    return path


def _bodies(path: Path) -> list[tuple[int, bytes]]:
    """Return time and what follows the IP header up to its length, less the checksum, of each packet."""
    link, packets = read_capture(path)
    found = []
    for time_ns, frame, _ in packets:
        at = ip_offset(link, frame)
        if at < 0:
            continue
        if frame[at] >> 4 == 4:
            head, end, protocol = 4 * (frame[at] & 15), int.from_bytes(frame[at + 2 : at + 4], "big"), frame[at + 9]
        else:
            head, end, protocol = 40, 40 + int.from_bytes(frame[at + 4 : at + 6], "big"), frame[at + 6]
        body = bytearray(frame[at + head : at + end])
        place = {6: 16, 17: 6}[protocol]
        body[place : place + 2] = b"\0\0"
        found.append((time_ns, bytes(body)))
    return found


def _sum_is_right(link: int, frame: bytes) -> bool:
    """Add up pseudo header and body as RFC 1071 does."""
    at = ip_offset(link, frame)
    if frame[at] >> 4 == 4:
        head, size, protocol = 4 * (frame[at] & 15), int.from_bytes(frame[at + 2 : at + 4], "big"), frame[at + 9]
        addresses, body = frame[at + 12 : at + 20], frame[at + head : at + size]
    else:
        size, protocol = int.from_bytes(frame[at + 4 : at + 6], "big"), frame[at + 6]
        addresses, body = frame[at + 8 : at + 40], frame[at + 40 : at + 40 + size]
    if protocol == 17 and body[6:8] == b"\0\0":  # not computed
        return True
    octets = addresses + len(body).to_bytes(4, "big") + bytes((0, 0, 0, protocol)) + body + bytes(len(body) & 1)
    total = sum(int.from_bytes(octets[place : place + 2], "big") for place in range(0, len(octets), 2))
    return total % 0xFFFF == 0


@pytest.mark.parametrize("kind", KINDS)
def test_a_twin_has_the_same_segments_over_its_link(kind: str, source: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    expected = _bodies(source)
    assert twin(source, kind, out) == len(expected) > PACKETS * 0.9
    link, packets = read_capture(out)
    assert link == {"cooked": COOKED, "cooked_2": COOKED_2, "raw": RAW}.get(kind, ETHERNET)
    assert _bodies(out) == expected
    assert all(_sum_is_right(link, frame) for _, frame, _ in packets)
    tags = {"vlan": [b"\x81\x00"], "qinq": [b"\x88\xa8", b"\x81\x00"]}.get(kind, [])
    assert all([frame[12 + 4 * at : 14 + 4 * at] for at in range(len(tags))] == tags for _, frame, _ in packets)


def test_the_analysis_of_all_twins_is_the_same(source: Path, tmp_path: Path) -> None:
    told = set()
    for kind in KINDS:
        out = tmp_path / kind
        twin(source, kind, out)
        report = analyze(out).as_dict()
        told.add(json.dumps([report[name] for name in ("transactions", "latency_ns", "functions")], sort_keys=True))
    assert len(told) == 1


def test_what_cannot_be_made_is_said_in_a_line(
    source: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    raw = tmp_path / "raw"
    assert main(["raw", str(source), str(raw)]) == 0
    assert main(["vlan", str(raw), str(tmp_path / "out")]) == 2
    assert "link type 101; twins are made of Ethernet captures" in capsys.readouterr().err
    assert main(["vlan", str(tmp_path / "absent"), str(tmp_path / "out")]) == 2
