"""How often a client comes, and how many distinct values a variable has."""

from __future__ import annotations

import json
from collections.abc import Iterable

import pytest

from dissect.meaning.report.words import Places
from dissect.output.variables.collector import ValueCollector
from dissect.output.variables.statistics import MAX_DISTINCT, Pace
from dissect.output.variables.summary import Summary, csv_rows, json_lines, text_lines
from dissect.wire.text import Clock
from tests.meaning.report.support import begun
from tests.output.variables.support import WORD, collected, db, reads


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
