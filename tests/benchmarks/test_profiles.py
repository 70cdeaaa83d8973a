"""Memory and time on the endless streams, and a flood of malformed PDUs: the reduced form of what `benchmarks.growth` measures.

What the README claims comes from there; the bounds on time here are wide, because the machine may be busy with other things.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from benchmarks.growth import MOST_GROWTH, MOST_MB, MOST_REPORT_MB, feed, packets_of
from benchmarks.profiles import Extent, write_profile
from benchmarks.streams import ENDLESS, FLOOD_FAULTS, NAMES, SMALL, flood_packets
from dissect.wire.build import COMPILED

GIB = 0.05
MOST_TIME = 3.0
MOST_PACKET_MS = 200
#: Runs of which one has to keep the bounds on time; a process that is too slow misses them each time.
ATTEMPTS = 5


@pytest.mark.measured
@pytest.mark.skipif(not COMPILED, reason="memory and time are promised for the compiled build")
@pytest.mark.parametrize("name", NAMES)
def test_memory_and_time_stay_flat(name: str, tmp_path: Path, record_property: Callable[[str, object], None]) -> None:
    packets = packets_of(name, GIB, SMALL)
    attempt = 0
    while True:
        attempt += 1
        folder = tmp_path / str(attempt)
        folder.mkdir()
        told = feed([sys.executable], dict(os.environ), name, packets, SMALL, folder)
        time = told["cpu_ns"]["all"] / told["cpu_ns"]["half"]
        worst_ms = told["worst_ns"] / 1e6
        if attempt == ATTEMPTS or (time <= MOST_TIME and worst_ms <= MOST_PACKET_MS):
            break
    first, *_, last = told["resident_kb"]
    figures = (
        f"memory {first} -> {last} KiB, twice the packets {time:.2f} times the time, worst packet {worst_ms:.1f} ms"
    )
    record_property("figures", figures)
    print(f"{name}: {figures}")
    assert told["build"] == "compiled"
    assert told["accounted"] == told["packets"] == packets
    if name in ENDLESS:  # the flood is promised to be counted in linear time and a short report
        assert last <= MOST_GROWTH * first, figures
    assert told["peak_kb"] * 1024 <= MOST_MB * 1e6, figures
    assert time <= MOST_TIME, figures
    assert worst_ms <= MOST_PACKET_MS, figures


def _flood(path: Path, rounds: int) -> Path:
    with path.open("wb") as file:
        write_profile(file, "badpdu", Extent(packets=flood_packets(rounds)))
    return path


def test_a_flood_of_malformed_pdus_is_counted_exactly(tmp_path: Path, s7dissect: Any) -> None:
    counts: list[dict[str, int]] = []
    rounds = (250, 2_500)
    for number in rounds:
        done = s7dissect("analyze", "-T", "json", _flood(tmp_path / "flood.pcap", number))
        assert done.returncode == 0
        assert len(done.stdout) <= MOST_REPORT_MB * 1e6
        told = json.loads(done.stdout)
        assert told["packets"]["read"] == flood_packets(number)
        counts.append(told["findings"])
    few, many = counts
    # Each round brings the same faults, and they are counted long after nothing is detailed any more.
    assert few["s7.malformed"] >= 8 / 10 * FLOOD_FAULTS * rounds[0]
    assert few["s7.malformed"] % rounds[0] == 0
    assert many["s7.malformed"] == 10 * few["s7.malformed"]
    # What hangs on requests left open differs by a few at the beginning and at the end.
    assert many.keys() == few.keys()
    for slug, count in many.items():
        assert abs(count - 10 * few[slug]) <= 0.02 * count + 100, slug


def test_the_report_on_a_flood_stays_short(tmp_path: Path, s7dissect: Any) -> None:
    done = s7dissect("analyze", _flood(tmp_path / "flood.pcap", 2_500))
    assert done.returncode == 0
    assert 1_000 < len(done.stdout) <= MOST_REPORT_MB * 1e6
