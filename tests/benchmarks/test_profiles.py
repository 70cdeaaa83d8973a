"""Memory on the endless streams, and a flood of malformed PDUs: the reduced form of what `benchmarks.growth` measures.

What the README claims comes from there, and all about time: that is judged here by counted work (`tests.growth`).
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from benchmarks.growth import MOST_MB, MOST_REPORT_MB, feed, packets_of
from benchmarks.profiles import Extent, write_profile
from benchmarks.streams import ENDLESS, FLOOD_FAULTS, NAMES, SMALL, flood_packets
from dissect.wire.build import COMPILED
from tests.cases import RELEASE

#: How much of a stream there is, in GiB: at the half of it every bound of the engine that it touches was reached. Of half TPKTs
#: there is more: with them the memory goes up and down by two steps of 1.2 MB without end, at the half or at the last.
GIB = dict.fromkeys(NAMES, 0.02) | (
    {"neverclose": 0.12, "halftpkt": 0.08} if RELEASE else {"neverclose": 0.05, "halftpkt": 0.05}
)
#: Less for each GiB than what `benchmarks.growth` allows, 5 % in the last three quarters of 0.05 GiB.
MOST_GROWTH = 1.3


@pytest.mark.measured
@pytest.mark.skipif(not COMPILED, reason="memory is promised for the compiled build")
@pytest.mark.parametrize("name", NAMES)
def test_memory_stays_flat(name: str, tmp_path: Path, record_property: Callable[[str, object], None]) -> None:
    """Time is for `benchmarks.growth`: no test may depend on how fast the machine is."""
    packets = packets_of(name, GIB[name], SMALL)
    told = feed([sys.executable], dict(os.environ), name, packets, SMALL, tmp_path)
    _, half, _, last = told["resident_kb"]
    figures = f"memory {half} -> {last} KiB"
    record_property("figures", figures)
    assert told["build"] == "compiled"
    assert told["accounted"] == told["packets"] == packets
    if name in ENDLESS:  # the flood is promised to be counted in a short report
        assert last <= (1 + MOST_GROWTH * GIB[name] / 2) * half, figures
    assert told["peak_kb"] * 1024 <= MOST_MB * 1e6, figures


#: Rounds of malformed PDUs in the two floods.
ROUNDS = (250, 2_500)


@pytest.fixture(scope="module")
def floods(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """The two floods as captures."""
    paths = [tmp_path_factory.mktemp("floods") / f"{rounds}.pcap" for rounds in ROUNDS]
    for path, rounds in zip(paths, ROUNDS, strict=True):
        with path.open("wb") as file:
            write_profile(file, "badpdu", Extent(packets=flood_packets(rounds)))
    return paths


def test_a_flood_of_malformed_pdus_is_counted_exactly(floods: list[Path], s7dissect: Any) -> None:
    counts: list[dict[str, int]] = []
    for number, path in zip(ROUNDS, floods, strict=True):
        done = s7dissect("analyze", "-T", "json", path)
        assert done.returncode == 0
        assert len(done.stdout) <= MOST_REPORT_MB * 1e6
        told = json.loads(done.stdout)
        assert told["packets"]["read"] == flood_packets(number)
        counts.append(told["findings"])
    few, many = counts
    # Each round brings the same faults, and they are counted long after nothing is detailed any more.
    assert few["s7.malformed"] >= 8 / 10 * FLOOD_FAULTS * ROUNDS[0]
    assert few["s7.malformed"] % ROUNDS[0] == 0
    assert many["s7.malformed"] == 10 * few["s7.malformed"]
    # What hangs on requests left open differs by a few at the beginning and at the end.
    assert many.keys() == few.keys()
    for slug, count in many.items():
        if slug == "transaction.unanswered":
            continue  # what explains requests at fault is remembered for so many of them only
        assert abs(count - 10 * few[slug]) <= 0.02 * count + 100, slug


def test_the_report_on_a_flood_stays_short(floods: list[Path], s7dissect: Any) -> None:
    done = s7dissect("analyze", floods[-1])
    assert done.returncode == 0
    assert 1_000 < len(done.stdout) <= MOST_REPORT_MB * 1e6
