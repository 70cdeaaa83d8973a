"""Counts over time and distributions: joining loses nothing, and what is said of many durations is true to 1/32."""

from __future__ import annotations

import itertools

from hypothesis import given
from hypothesis import strategies as st

from dissect.output.page.bins import WIDTHS, Bins, Spread, bucket, lower_end

DURATIONS = st.integers(min_value=-10, max_value=2**60)


def test_each_width_is_a_multiple_of_the_one_before() -> None:
    assert [wide % narrow for narrow, wide in itertools.pairwise(WIDTHS)] == [0] * (len(WIDTHS) - 1)


@given(st.lists(st.tuples(st.integers(0, 10**19), st.integers(0, 4)), max_size=200))
def test_joined_bins_hold_what_was_counted(events: list[tuple[int, int]]) -> None:
    bins = Bins(most=8)
    for time_ns, column in events:
        bins.add(time_ns, column)
    assert len(bins.rows) <= 8
    for column in range(5):
        assert sum([row.get(column, 0) for row in bins.rows.values()]) == [one for _, one in events].count(column)
    assert {time_ns // bins.width for time_ns, _ in events} == set(bins.rows)


def test_settled_bins_are_few_over_the_time_they_cover() -> None:
    bins = Bins()
    for second in range(0, 3600, 60):
        bins.add(second * 10**9, 0)
    bins.settle(0, 3600 * 10**9, 100)
    assert bins.width == 60 * 10**9
    assert sum([row[0] for row in bins.rows.values()]) == 60


@given(DURATIONS)
def test_a_bucket_holds_its_durations(ns: int) -> None:
    number = bucket(ns)
    assert lower_end(number) <= max(ns, 0) < lower_end(number + 1)
    assert max(ns, 0) - lower_end(number) <= max(ns, 0) / 32


def _exact(times: list[int], share: float) -> float:
    ordered = sorted(times)
    rank = max(1, -int(-share * len(times) // 1))
    if share == 0.5 and len(times) % 2 == 0:
        return (ordered[rank - 1] + ordered[rank]) // 2
    return ordered[rank - 1]


def _spread(times: list[int]) -> Spread:
    spread = Spread()
    for ns in times:
        spread.add(ns)
    assert (spread.smallest, spread.largest, spread.count) == (min(times), max(times), len(times))
    assert spread.mean == sum(times) // len(times)
    return spread


@given(st.lists(st.integers(0, 10**12), min_size=1, max_size=100))
def test_quantiles_of_few_durations_are_exact(times: list[int]) -> None:
    spread = _spread(times)
    for share in (0.05, 0.5, 0.95, 1.0):
        assert spread.quantile(share) == _exact(times, share)


def test_the_median_of_two_lies_between_them() -> None:
    assert _spread([10_000_000, 1_500_000_000]).quantile(0.5) == 755_000_000


@given(st.lists(st.integers(0, 10**12), min_size=1, max_size=8))
def test_quantiles_of_many_durations_are_right_to_a_thirtysecond(some: list[int]) -> None:
    times = [time for time in some for _ in range(1025)]
    spread = _spread(times)
    for share in (0.05, 0.95, 1.0):
        assert abs(spread.quantile(share) - _exact(times, share)) <= _exact(times, share) / 32 + 1


def test_the_median_of_many_is_not_the_lower_end_of_its_bucket() -> None:
    times = [1_000_000_000 + 1000 * number for number in range(-2000, 2001)]
    assert abs(_spread(times).quantile(0.5) - 1_000_000_000) < 5_000_000


def test_an_even_spread_has_no_deviation() -> None:
    spread = Spread()
    assert (spread.mean, spread.deviation, spread.quantile(0.5)) == (0, 0, 0)
    for _ in range(5):
        spread.add(250)
    assert spread.deviation == 0
    spread.add(10_250)
    assert 3700 < spread.deviation < 3750
