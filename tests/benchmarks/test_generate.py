"""The made captures: the same from the same seed, sound, and in truth what their truth file says."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

from benchmarks.generate import generate, parse_count, truth_path
from benchmarks.readers import read_capture
from tests.benchmarks.independent import checksums_right, count

PACKETS = 6_000


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    path = tmp_path_factory.mktemp("made") / "made.pcap"
    # Few stations: more of what happens on a connection in few packets.
    generate(path, PACKETS, seed=5, stations=14)
    return path, json.loads(truth_path(path).read_text())


def test_same_seed_same_octets(tmp_path: Path) -> None:
    first, second, third = (tmp_path / name for name in ("first", "second", "third"))
    generate(first, 2_000, seed=9)
    generate(second, 2_000, seed=9)
    generate(third, 2_000, seed=10)
    assert first.read_bytes() == second.read_bytes()
    assert truth_path(first).read_bytes() == truth_path(second).read_bytes()
    assert first.read_bytes() != third.read_bytes()


def test_an_independent_count_finds_the_truth(made: tuple[Path, dict[str, Any]]) -> None:
    path, truth = made
    told = count(path)
    assert told == {
        "packets": PACKETS,
        "empty_segments": truth["empty_segments"],
        "connections": truth["connections"],
        "tpdus": truth["tpdus"],
        "rosctr": truth["s7"]["rosctr"],
        "transactions": {name: n for name, n in truth["transactions"].items() if name != "with_errors"},
        "items": truth["items"],
    }


def test_the_truth_also_holds_with_many_losses(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        "benchmarks.traffic.MISHAPS", ((0.05, "lost"), (0.05, "swapped"), (0.05, "duplicated"), (0.02, "retransmitted"))
    )
    path = tmp_path / "lossy.pcap"
    truth: dict[str, Any] = generate(path, PACKETS, seed=6, stations=14)
    assert truth["lost"]["segments"] > 20
    assert truth["transactions"]["orphan_answers"] > 3
    told = count(path)
    assert told["tpdus"] == truth["tpdus"]
    assert told["rosctr"] == truth["s7"]["rosctr"]
    assert told["transactions"] == {name: n for name, n in truth["transactions"].items() if name != "with_errors"}


def test_every_checksum_is_right(made: tuple[Path, dict[str, Any]]) -> None:
    _, packets = read_capture(made[0])
    assert all(checksums_right(frame) for _, frame, _ in packets)


def test_it_is_like_real_traffic(made: tuple[Path, dict[str, Any]]) -> None:
    _, truth = made
    variables = (truth["s7"]["functions"]["0x04"] + truth["s7"]["functions"]["0x05"]) / 2
    assert 0.2 < truth["empty_segments"] / PACKETS < 0.4
    assert 2.5 < truth["items"] / variables < 5
    assert {"split", "swapped", "duplicated"} <= set(truth["events"])
    assert truth["item_refusals"] > 0
    assert 20_000 <= truth["latency_ns"]["median"] < 50_000_000


def test_times_rise_but_for_nothing(made: tuple[Path, dict[str, Any]]) -> None:
    _, packets = read_capture(made[0])
    times = [time_ns for time_ns, _, _ in packets]
    assert times == sorted(times)
    assert all(time_ns % 1000 == 0 for time_ns in times)


@pytest.mark.parametrize("kind", ["pcap-ns", "pcapng"])
def test_formats_hold_the_same_frames(tmp_path: Path, kind: str) -> None:
    plain, other = tmp_path / "plain", tmp_path / "other"
    generate(plain, 1_000, seed=3)
    generate(other, 1_000, seed=3, kind=kind)
    _, expected = read_capture(plain)
    _, packets = read_capture(other)
    # Stamps in TCP options and the order of what happens in the same microsecond follow the finer clock.
    assert len(packets) == 1_000
    assert sorted(len(frame) for _, frame, _ in packets) == sorted(len(frame) for _, frame, _ in expected)
    assert any(time_ns % 1000 for time_ns, _, _ in packets)


def test_tshark_sees_every_pdu_where_nothing_is_lost(tmp_path: Path) -> None:
    if shutil.which("tshark") is None:
        pytest.skip("tshark is not installed")
    path = tmp_path / "whole.pcap"
    truth: dict[str, Any] = generate(path, PACKETS, seed=4, without=frozenset({"lost"}))
    shown = subprocess.run(
        ["tshark", "-o", "tcp.reassemble_out_of_order:TRUE", "-r", str(path), "-Y", "s7comm",
         "-T", "fields", "-e", "s7comm.header.rosctr"],
        capture_output=True, text=True, check=True,
    ).stdout  # fmt: skip
    seen: dict[str, int] = {}
    for rosctr in shown.replace("\n", ",").split(",")[:-1]:
        seen[rosctr] = seen.get(rosctr, 0) + 1
    assert seen == truth["s7"]["rosctr"]


@pytest.mark.parametrize(("text", "packets"), [("100k", 100_000), ("5M", 5_000_000), ("20000", 20_000)])
def test_counts_as_people_write_them(text: str, packets: int) -> None:
    assert parse_count(text) == packets


@pytest.mark.parametrize("text", ["", "k", "0", "-1", "1.5M", "5G"])
def test_no_counts(text: str) -> None:
    with pytest.raises(Exception, match="no number of packets"):
        parse_count(text)
