"""Connections with reads of their own: as many packets as asked for, nothing wrong with them, no block known from before."""

from __future__ import annotations

from pathlib import Path

from benchmarks.many_connections import many_connections
from benchmarks.readers import read_capture
from dissect import analyze
from tests.benchmarks.independent import checksums_right, count


def test_each_connection_is_whole_and_reads_its_own(tmp_path: Path) -> None:
    out = tmp_path / "out.pcap"
    assert many_connections(out, 1350, 30) == 1350
    _, packets = read_capture(out)
    assert all(checksums_right(frame) for _, frame, _ in packets)
    assert [time_ns for time_ns, _, _ in packets] == sorted(time_ns for time_ns, _, _ in packets)
    counted = count(out)
    assert counted["connections"] == 30
    report = analyze(out)
    assert len(report.connections) == 30
    assert report.as_dict()["findings"] == {}
    asked: list[set[bytes]] = [set() for _ in range(30)]
    for place, (_, frame, _) in enumerate(packets):
        at = frame.find(b"\x32\x01")
        if at > 0 and frame[at + 10] == 4:
            asked[place * 30 // len(packets)].add(frame[at + 10 :])
    assert all(3 <= len(blocks) <= 11 for blocks in asked)
    assert sum(map(len, asked)) == len(set().union(*asked))
