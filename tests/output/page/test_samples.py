"""Rows are spread over the time, the same for the same capture; of connections, the gravest are kept."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.output.page import gathered as room
from dissect.output.page.data import Data
from dissect.output.page.samples import Ranked, Samples, mixed
from dissect.wire.build import COMPILED
from tests.meaning.report.support import WORD, begun, read, saved
from tests.output.page.support import gathered_of, page_of
from tests.properties import messages
from tests.properties.messages import dt
from tests.properties.packets import EPOCH_NS, MS, Flow

SECOND = 1_000_000_000


def kept(times: list[int], most: int) -> list[int]:
    """Return the numbers of the times that are kept."""
    samples = Samples(most)
    for number, time_ns in enumerate(times):
        if samples.wants(time_ns, mixed(number)):
            samples.add(time_ns, mixed(number), number)
    assert samples.total == len(times)
    found: list[int] = samples.rows()
    assert len(found) == len(samples) <= most
    return found


@given(st.lists(st.integers(0, 10**13), max_size=300), st.integers(1, 40))
def test_as_many_are_kept_as_there_is_room_for(times: list[int], most: int) -> None:
    found = kept(times, most)
    assert len(set(found)) == len(found)
    assert [times[number] for number in found] == sorted([times[number] for number in found])
    if len(times) <= most:
        assert sorted(found) == list(range(len(times)))
    assert found == kept(times, most)


def test_a_burst_leaves_room_for_the_rest_of_the_time() -> None:
    """50,000 in the first second, one in each of the 300 seconds behind it: the 300 stay, and the burst is not emptied."""
    times = [EPOCH_NS + number * 20_000 for number in range(50_000)]
    times += [EPOCH_NS + second * SECOND for second in range(1, 301)]
    found = kept(times, 500)
    late = [number for number in found if number >= 50_000]
    assert len(late) >= 290
    assert 100 < len(found) - len(late) < 300
    halves = [number < 25_000 for number in found if number < 50_000]
    assert 0.3 < sum(halves) / len(halves) < 0.7  # not only its beginning


@given(st.lists(st.integers(0, 1000), unique=True, max_size=100), st.integers(1, 20))
def test_those_of_the_least_rank_are_kept_however_they_come(ranks: list[int], most: int) -> None:
    ranked = Ranked(most)
    for rank in ranks:
        if ranked.wants((rank % 7, -rank)):
            ranked.add((rank % 7, -rank), rank)
    assert ranked.total == len(ranks)
    assert ranked.rows() == sorted(ranks, key=lambda rank: (rank % 7, -rank))[:most]


@pytest.mark.skipif(COMPILED, reason="compiled constants cannot be changed")
def test_failures_are_listed_from_all_of_the_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """And the first of them, of which the verdict tells; the page counts them all by time."""
    monkeypatch.setattr(room, "MAX_FAILED", 60)
    talk = begun()
    for ref in range(1, 200):
        read(talk, ref, WORD, 0x0A)
    path = saved(tmp_path / "a.pcapng", talk.packets(step_ns=10 * MS))
    session = Data(gathered_of([path]), "").as_dict()
    (failed,) = [table for table in session["tables"] if table["name"] == "failed"]
    times = [row["cells"][1] for row in failed["rows"]]
    assert (len(times), failed["total"]) == (60, 199)
    assert times[0] < session["span"] * 0.05
    assert len({int(time / session["span"] * 10) for time in times}) == 10
    assert sum([count for _, count in failed["counts"]["bins"]]) == 199
    assert page_of(path) == page_of(path)


@pytest.mark.skipif(COMPILED, reason="compiled constants cannot be changed")
def test_connections_with_findings_come_before_those_with_traffic(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One that stops the PLC, one with an error, then those with most traffic; the rest has no room."""
    monkeypatch.setattr(room, "MAX_CONNECTIONS", 4)
    packets = []
    for number in range(12):
        talk = begun(Flow(ports=(40000 + number, 102)))
        for ref in range(1, 3 + number):
            read(talk, ref, WORD, 0x0A if number == 3 else b"\0\1")
        if number == 2:
            stop = bytes.fromhex("32010000000900100000 29 0000000000 09 505f50524f4752414d".replace(" ", ""))
            talk.send(0, dt(stop)).send(1, dt(bytes.fromhex("320300000009000100000000 29".replace(" ", ""))))
        packets += talk.close().packets(start_ns=EPOCH_NS + number * SECOND)
    found = gathered_of([saved(tmp_path / "a.pcapng", packets)])
    (table,) = [one for one in Data(found, "").as_dict()["tables"] if one["name"] == "connections"]
    assert (table["total"], [row["cells"][0] for row in table["rows"]]) == (12, [3, 4, 12, 11])
    columns = [name for name, _ in table["columns"]]
    assert [row["cells"][columns.index("gravest finding")] for row in table["rows"]][:2] == ["error", "warning"]
    assert sum([count for _, count in table["counts"]["bins"]]) == sum([one for _, one in table["ended"]["bins"]]) == 12


@pytest.mark.parametrize(("after_s", "idle"), [(0.05, False), (600, True)])
def test_a_gap_before_an_idle_time_is_no_band(tmp_path: Path, after_s: float, idle: bool) -> None:
    """One answer is missing; what shows it comes at once, or after ten minutes in which nothing was sent."""
    talk = begun()
    for ref in range(1, 20):
        read(talk, ref, WORD)
    talk.send(0, dt(messages.read_job(20, [WORD])))
    before = len(talk.packets())
    talk.skip(1, 27)
    read(talk, 21, WORD)
    packets = talk.packets(step_ns=10 * MS)
    late = [packet._replace(time_ns=packet.time_ns + int(after_s * SECOND)) for packet in packets[before:]]
    (gap,) = gathered_of([saved(tmp_path / "a.pcapng", [*packets[:before], *late])]).gaps
    assert gap.idle is idle


def test_a_time_that_is_lost_while_polling_goes_on_is_a_band(tmp_path: Path) -> None:
    """Ten minutes are missing, and with them as many bytes as such a time has."""
    talk = begun()
    for ref in range(1, 40):
        read(talk, ref, WORD)
    before = len(talk.packets())
    talk.skip(0, 31 * 3000).skip(1, 27 * 3000)
    for ref in range(41, 45):
        read(talk, ref, WORD)
    packets = talk.packets(step_ns=100 * MS)
    late = [packet._replace(time_ns=packet.time_ns + 600 * SECOND) for packet in packets[before:]]
    found = gathered_of([saved(tmp_path / "a.pcapng", [*packets[:before], *late])]).gaps
    assert found
    assert not any([gap.idle for gap in found])


def test_an_idle_time_with_acknowledgements_only_is_no_band(tmp_path: Path) -> None:
    """An answer is missing; then nothing but acknowledgements for ten minutes, until a message shows the gap."""
    talk = begun()
    for ref in range(1, 20):
        read(talk, ref, WORD)
    talk.skip(1, 27)
    quiet = len(talk.packets())
    for _ in range(60):
        talk.ack(0)
    read(talk, 21, WORD)
    packets = talk.packets(step_ns=10 * MS)
    waits = [(number + 1) * 10 * SECOND for number in range(len(packets) - quiet)]
    late = [one._replace(time_ns=one.time_ns + wait) for one, wait in zip(packets[quiet:], waits, strict=True)]
    found = gathered_of([saved(tmp_path / "a.pcapng", [*packets[:quiet], *late])]).gaps
    assert [(gap.idle, gap.end_ns - gap.begin_ns > 9 * SECOND) for gap in found] == [(True, True)]
