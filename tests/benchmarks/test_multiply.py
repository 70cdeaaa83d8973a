"""A multiplied capture: the same conversations between other hosts, with checksums as right as they were."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.generate import generate
from benchmarks.multiply import main, multiply
from benchmarks.readers import read_capture
from benchmarks.writers import CaptureWriter
from tests.benchmarks.independent import checksums_right, count

COPIES = 3


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("multiply") / "source.pcap"
    generate(path, 2_000, seed=8, stations=12)
    return path


def test_everything_is_there_once_a_copy(source: Path, tmp_path: Path) -> None:
    out = tmp_path / "out.pcap"
    assert multiply(source, COPIES, out) == COPIES * 2_000
    one, all_copies = count(source), count(out)
    assert all_copies["connections"] == COPIES * one["connections"]  # type: ignore[operator]
    for name in ("tpdus", "rosctr", "transactions"):
        whole, part = all_copies[name], one[name]
        assert isinstance(whole, dict)
        assert isinstance(part, dict)
        assert whole == {key: COPIES * value for key, value in part.items()}


def test_copies_share_no_host_and_no_client_port(source: Path, tmp_path: Path) -> None:
    out = tmp_path / "out.pcap"
    multiply(source, COPIES, out, apart_ns=10**15)
    _, packets = read_capture(out)
    hosts: list[set[bytes]] = []
    flows: list[set[bytes]] = []
    for copy in range(COPIES):
        part = [
            frame
            for _, frame, _ in packets[copy * 2_000 : (copy + 1) * 2_000]
            if frame[12:14] == b"\x08\x00" and frame[23] == 6
        ]
        hosts.append({frame[26:30] for frame in part})
        flows.append({frame[34:38] for frame in part})
        assert all(b"\x00\x66" in (frame[34:36], frame[36:38]) for frame in part)
    assert not hosts[0] & hosts[1]
    assert not hosts[1] & hosts[2]
    assert len(flows[0]) == len(flows[1])
    assert flows[0] != flows[1]


def test_checksums_stay_right(source: Path, tmp_path: Path) -> None:
    out = tmp_path / "out.pcap"
    multiply(source, 40, out)
    _, packets = read_capture(out)
    assert all(checksums_right(frame) for _, frame, _ in packets)


def test_wrong_checksums_stay_wrong(source: Path, tmp_path: Path) -> None:
    _, packets = read_capture(source)
    time_ns, frame, _ = next(packet for packet in packets if packet[1][12:14] == b"\x08\x00" and packet[1][23] == 6)
    bad = frame[:50] + bytes((frame[50] ^ 0x55,)) + frame[51:]
    path, out = tmp_path / "bad.pcap", tmp_path / "out.pcap"
    with path.open("wb") as file:
        writer = CaptureWriter(file)
        writer.write(time_ns, bad)
        writer.flush()
    multiply(path, 2, out)
    assert not any(checksums_right(octets) for _, octets, _ in read_capture(out)[1])


def test_times_are_shifted_and_rise(source: Path, tmp_path: Path) -> None:
    out = tmp_path / "out.pcap"
    multiply(source, COPIES, out, apart_ns=7_000)
    times = [time_ns for time_ns, _, _ in read_capture(out)[1]]
    expected = [time_ns + copy * 7_000 for time_ns, _, _ in read_capture(source)[1] for copy in range(COPIES)]
    assert times == sorted(times) == sorted(expected)


@pytest.mark.parametrize(
    "name", ["plc4x_manual_test_tpdu_nr.pcapng", "s7comm_and_s7commplus_sll.pcap", "rdp-proprietary-encryption.pcap"]
)
def test_real_captures_of_other_links_and_formats(name: str, corpus: Path, tmp_path: Path) -> None:
    link_type, packets = read_capture(corpus / name)
    out = tmp_path / "out.pcap"
    multiply(corpus / name, 5, out)
    link_out, copies = read_capture(out)
    assert link_out == link_type
    assert len(copies) == 5 * len(packets)
    assert sorted(len(frame) for _, frame, _ in copies) == sorted(5 * [len(frame) for _, frame, _ in packets])


def test_what_cannot_be_multiplied_is_said_in_a_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "text.pcap"
    path.write_bytes(b"no capture at all, but long enough")
    assert main([str(path), "2", str(tmp_path / "out.pcap")]) == 2
    assert "text.pcap" in capsys.readouterr().err
    assert main([str(tmp_path / "absent.pcap"), "2", str(tmp_path / "out.pcap")]) == 2
