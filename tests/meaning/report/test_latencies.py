from __future__ import annotations

import math
import statistics
from collections.abc import Sequence
from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.meaning.report.latencies import EXACT, Latencies, _bucket
from dissect.wire.build import COMPILED
from tests.growth import UNCOUNTED, lines

QUANTILES = (0.0, 0.001, 0.25, 0.5, 0.75, 0.95, 0.99, 0.999, 1.0)
MINUTE = 60_000_000_000


def of(values: Sequence[int]) -> Latencies:
    latencies = Latencies()
    for value in values:
        latencies.add(value)
    return latencies


def at_rank(values: Sequence[int], q: float) -> int:
    """The value at rank ⌈q·n⌉, counted from 1: so many do not exceed it."""
    return sorted(values)[max(1, math.ceil(Fraction(q) * len(values))) - 1]


def exactly(values: Sequence[int], q: float) -> int:
    """The same while all are kept, but the median of an even count: that lies between two."""
    if q == 0.5 and len(values) % 2 == 0:
        return (statistics.median_low(values) + statistics.median_high(values)) // 2
    return at_rank(values, q)


def many(count: int) -> list[int]:
    """Answer times as they come: from tens of microseconds to seconds, in no order."""
    return [20_000 + (number * number * 7919) % (10 ** (4 + number % 6)) for number in range(count)]


def test_none() -> None:
    latencies = Latencies()
    assert latencies.as_dict() == {"min": None, "median": None, "p95": None, "p99": None, "max": None}
    assert [latencies.quantile(q) for q in QUANTILES] == [None] * len(QUANTILES)
    assert (latencies.count, latencies.exact) == (0, True)


def test_one() -> None:
    assert of([7]).as_dict() == {"min": 7, "median": 7, "p95": 7, "p99": 7, "max": 7}


@given(st.lists(st.integers(-MINUTE, MINUTE), min_size=1, max_size=300))
def test_exact_while_there_are_few(values: list[int]) -> None:
    latencies = of(values)
    assert [latencies.quantile(q) for q in QUANTILES] == [exactly(values, q) for q in QUANTILES]
    assert latencies.as_dict() == {
        "min": min(values),
        "median": exactly(values, 0.5),
        "p95": at_rank(values, 0.95),
        "p99": at_rank(values, 0.99),
        "max": max(values),
    }
    assert (latencies.count, latencies.exact) == (len(values), True)


@pytest.mark.parametrize("count", [256, 257, 1021])
def test_exact_whatever_the_spread(count: int) -> None:
    """Of many only those near a rank are put in order: the same, the smallest and the largest there can be, too early ones."""
    for values in (
        [7] * count,
        [number - count // 2 for number in range(count)],
        [(-1) ** number * 2 ** (number % 63) for number in range(count)],
        [2**63 - 1 - number * 2**55 for number in range(count) if number < 250] * 2,
    ):
        latencies = of(values)
        assert [latencies.quantile(q) for q in QUANTILES] == [exactly(values, q) for q in QUANTILES]


@given(st.lists(st.integers(0, MINUTE), min_size=2, max_size=50), st.integers(1, 49))
def test_asking_changes_nothing(values: list[int], asked_at: int) -> None:
    latencies = Latencies()
    for number, value in enumerate(values):
        latencies.add(value)
        if number == asked_at:
            latencies.as_dict()
    assert latencies.as_dict() == of(values).as_dict()


def test_exact_up_to_the_limit() -> None:
    values = many(EXACT)
    latencies = of(values)
    assert latencies.exact
    assert [latencies.quantile(q) for q in QUANTILES] == [exactly(values, q) for q in QUANTILES]
    latencies.add(5)
    assert not latencies.exact
    assert latencies.count == EXACT + 1
    assert latencies.as_dict()["min"] == 5


@pytest.mark.parametrize("count", [EXACT + 1, 2 * EXACT])
def test_within_one_part_in_128_beyond_the_limit(count: int) -> None:
    values = many(count)
    latencies = of(values)
    assert not latencies.exact
    for q in QUANTILES:
        exact = at_rank(values, q)
        told = latencies.quantile(q)
        assert told is not None
        assert exact - exact / 128 < told <= exact
    assert latencies.as_dict()["min"] == min(values)
    assert latencies.as_dict()["max"] == max(values)
    assert latencies.count == count


@given(st.integers(0, 2**62))
def test_every_size_is_within_one_part_in_128(value: int) -> None:
    """A bucket holds values that differ by 1/128 at most, whatever their size; below 256 every value has its own."""
    latencies = of([value - 1 if value else 0, value, 2**62] * 2)
    latencies._fold(EXACT)
    told = latencies.quantile(0.5)
    assert told is not None
    assert value - value / 128 <= told <= value
    assert told == value or value >= 256


@given(st.lists(st.integers(-MINUTE, MINUTE), min_size=1, max_size=100))
def test_negative_times_of_reordered_captures(values: list[int]) -> None:
    """In buckets they count as 0; minimum and maximum stay what they are."""
    latencies = of(values)
    latencies._fold(EXACT)
    for q in QUANTILES:
        exact = at_rank(values, q)
        told = latencies.quantile(q)
        assert told is not None
        assert min(values) <= told <= max(values)
        if exact < 0:
            assert told == min(0, max(values))
        else:
            assert exact - exact / 128 <= told <= exact
    assert (latencies.as_dict()["min"], latencies.as_dict()["max"]) == (min(values), max(values))


def test_memory_does_not_grow_with_the_count() -> None:
    latencies = Latencies()
    sizes = []
    for round_ in range(4):
        for number in range(EXACT):
            latencies.add((number * 2654435761 + round_) % (10**9))
        buckets = latencies._buckets
        kept = len(latencies._kept) + len(latencies._waiting)
        sizes.append(kept // 8 + len(buckets))
    assert max(sizes) <= EXACT + 64 * 128


def test_quantiles_do_not_fall_when_q_rises() -> None:
    latencies = of(many(2 * EXACT))
    told = [latencies.quantile(step / 200) for step in range(201)]
    assert told == sorted(told, key=lambda value: -1 if value is None else value)
    assert None not in told


@pytest.mark.skipif(COMPILED, reason=UNCOUNTED)
def test_no_answer_waits_for_all_the_others() -> None:
    """What is counted in buckets from the limit on moves there a little with each one."""
    latencies = of(many(EXACT))
    worst = max(lines_of(latencies, value) for value in many(2 * EXACT))
    assert worst <= 2_000
    assert latencies.count == 3 * EXACT


def lines_of(latencies: Latencies, value: int) -> int:
    return lines(lambda: latencies.add(value))


@given(st.integers(-5, 2**63 - 1))
def test_buckets_are_found_alike_by_either_way(latency_ns: int) -> None:
    """Compiled, the doubling is counted; interpreted, bits are. Where this is compiled both are the same way."""
    found: list[int] = []
    for compiled in (True, False):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("dissect.meaning.report.latencies.COMPILED", compiled)
            found.append(_bucket(latency_ns))
    assert found[0] == found[1]


@pytest.mark.parametrize("share", [-0.1, 1.5, 95, math.nan])
def test_what_is_no_share_is_refused(share: float) -> None:
    latencies = Latencies()
    latencies.add(5)
    with pytest.raises(ValueError, match="expected a share from 0 to 1"):
        latencies.quantile(share)
