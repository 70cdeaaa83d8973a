"""How often a client comes, and how many distinct values a variable has."""

from __future__ import annotations

import json
from collections.abc import Iterable
from itertools import pairwise
from typing import Any

import pytest

from dissect.meaning.report.words import Places
from dissect.output.variables.choosing import Known, choose
from dissect.output.variables.collector import ValueCollector
from dissect.output.variables.model import SharedValue
from dissect.output.variables.statistics import MAX_DISTINCT, Pace, Statistics
from dissect.output.variables.summary import Summary, csv_rows, json_lines, text_lines
from dissect.wire.text import Clock
from tests.meaning.report.support import begun
from tests.output.variables.support import BYTE, WORD, collected, db, reads, writes
from tests.output.variables.test_shortcuts import busy, facts, of_rows


@pytest.mark.parametrize(
    ("times", "period", "jitter"),
    [
        ([], None, None),
        ([5], None, None),
        ([5, 5], 0, None),
        ([0, 100, 300], 150, 50),
        ([0, 100, 300, -5000, -4900, -4700], 150, 50),  # the clock of the capture was set back
        ([0, 100, 300, -5000, -4850], 150, 41),
        ([300, 200, 100], None, None),
    ],
)
def test_a_period_is_of_times_that_the_clock_tells(times: list[int], period: int | None, jitter: int | None) -> None:
    pace = Pace()
    for time_ns in times:
        pace.add(time_ns)
    assert (pace.count, pace.period_ns, pace.jitter_ns) == (len(times), period, jitter)


def summary_of(numbers: Iterable[int]) -> Summary:
    """The summary of a word that has these values, one after another."""
    talk = begun()
    for ref, number in enumerate(numbers, 1):
        reads(talk, ref, (db(WORD, 0), number.to_bytes(2, "big")))
    return Summary(collected(ValueCollector(sums=True), talk.packets()))


@pytest.mark.parametrize(
    ("numbers", "count", "more"),
    [
        (range(1), 1, False),
        (range(MAX_DISTINCT - 1), MAX_DISTINCT - 1, False),
        (range(MAX_DISTINCT), MAX_DISTINCT, False),
        ([*range(MAX_DISTINCT), *range(MAX_DISTINCT)], MAX_DISTINCT, False),  # each of them again
        ([*range(MAX_DISTINCT), 0, MAX_DISTINCT - 1, 0], MAX_DISTINCT, False),
        (range(MAX_DISTINCT + 1), MAX_DISTINCT, True),
        ([*range(MAX_DISTINCT + 1), 0, 1], MAX_DISTINCT, True),  # nothing takes it back
        (range(3 * MAX_DISTINCT), MAX_DISTINCT, True),
    ],
)
def test_of_many_distinct_values_it_is_known_that_there_are_more(
    numbers: Iterable[int], count: int, more: bool
) -> None:
    """Told wherever the summary is: as a number with a plus, and as a truth value."""
    summary = summary_of(numbers)
    (variable,) = summary.variables
    found = variable.statistics
    assert found is not None
    assert (found.distinct_count, found.more_distinct) == (count, more)
    said = json.loads(json_lines(summary)[0])
    assert (said["distinct"], said["distinct_more"]) == (count, more)
    names, cells = csv_rows(summary)
    row = dict(zip(names, cells, strict=True))
    assert (row["distinct"], row["distinct_more"]) == (str(count), str(more).lower())
    heads, line = [one.text.split() for one in text_lines(summary, Clock(), Places([], False))[1:]]
    assert f"{MAX_DISTINCT}+" in line if more else str(count) in line
    assert (f"{count}+" in line) == more
    assert "distinct" in heads


def test_twenty_distinct_values_are_counted() -> None:
    """The bound that the documentation names."""
    for count, said in ((20, "20"), (21, "20+")):
        lines = text_lines(summary_of(range(count)), Clock(), Places([], False))
        assert "trend" not in lines[1].text  # unless it is asked for
        assert said in lines[2].text.split()


@pytest.mark.parametrize(
    "numbers",
    [
        [2**53 + 1, 2**53], [2**53, 2**53 + 1], [-(2**53), -(2**53) - 1], [2**63 - 1, 2**63 - 2, 2**63 - 3], [5], [5, 5],
        [1, 3, 2], [3, 1, 2], [2, 3, 1], [0, -1, 1], [7, 2**62, 2**62 + 1, -(2**62), -(2**62) - 1],
    ],
)  # fmt: skip
def test_extremes_are_exact_where_a_double_is_not(numbers: list[int]) -> None:
    talk = begun()
    for ref, number in enumerate(numbers, 1):
        reads(talk, ref, (db(BYTE, 0, 8), number.to_bytes(8, "big", signed=True)))
    collector = ValueCollector(choose(["DB1:0:LINT"], Known(None)), sums=True)
    (variable,) = collected(collector, talk.packets()).variables
    found = variable.statistics
    assert found is not None
    assert (found.least, found.most, found.count, found.numbers) == (
        min(numbers), max(numbers), len(numbers), len(numbers),
    )  # fmt: skip
    assert found.total == sum(map(float, numbers))
    assert (found.first, found.last, found.changes) == (
        numbers[0], numbers[-1], sum(one != other for one, other in pairwise(numbers)),
    )  # fmt: skip


def test_two_values_of_a_writer_are_a_period_where_nobody_reads() -> None:
    for count, period in ((1, None), (2, 2_000_000)):
        talk = begun()
        for ref in range(1, count + 1):
            writes(talk, ref, (db(WORD, 0), b"\0\1", 0xFF))
        (variable,) = collected(ValueCollector(sums=True), talk.packets()).variables
        assert variable.statistics is not None
        pace = variable.statistics.pace
        assert (pace.period_ns if pace is not None else None) == period


def test_two_values_of_a_reader_are_a_period() -> None:
    for count, period in ((1, None), (2, 2_000_000), (3, 2_000_000)):
        (variable,) = summary_of([7] * count).variables
        assert variable.statistics is not None
        pace = variable.statistics.pace
        assert (pace.period_ns if pace is not None else None) == period
        assert (pace.jitter_ns if pace is not None else None) == (0 if count == 3 else None)


@pytest.mark.parametrize(
    "options", [{"changes": True}, {"every_ns": 5_000_000}, {"changes": True, "every_ns": 7_000_000}]
)
def test_sums_of_what_is_left_over_are_those_of_its_rows(options: dict[str, Any]) -> None:
    """What is left out as a row is left out of the summary."""
    packets = busy(4).packets()
    rows = collected(ValueCollector(**options), packets).take()
    sums = collected(ValueCollector(sums=True, **options), packets)
    assert not sums.take()
    told = {(one.address, one.type): facts(one.statistics) for one in sums.variables if one.statistics is not None}
    assert told == {(one.address, one.type): facts(found) for one, found in of_rows(rows).items()}
    assert 20 < len(rows) < len(collected(ValueCollector(), packets).take())


def test_a_trend_has_a_point_for_each_millisecond_at_first() -> None:
    """48 points; then each has twice the time, and takes the later one of two numbers."""
    talk = begun()
    reads(talk, 1, (db(WORD, 0), b"\0\1"))
    (row,) = collected(ValueCollector(), talk.packets()).take()
    found = Statistics()
    assert found.trend == []
    for at in range(48):
        row.time_ns = at * 1_000_000
        row._told = SharedValue(None, -1, at)
        found.add(row)
    assert found.trend == [float(at) for at in range(48)]
    row.time_ns += 999_999
    row._told = SharedValue(None, -1, 100)
    found.add(row)
    assert found.trend == [*[float(at) for at in range(47)], 100.0]
    row.time_ns += 1
    row._told = SharedValue(None, -1, 101)
    found.add(row)
    assert found.trend == [*[float(at) for at in range(1, 47, 2)], 100.0, 101.0]
