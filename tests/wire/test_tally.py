"""Counters by number count what a list of numbers would."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.wire.tally import Tally


@given(
    st.lists(st.integers(0, 6)),
    st.integers(0, 6),
    st.integers(0, 6),
    st.lists(st.integers(0, 9), min_size=7, max_size=7),
)
def test_it_counts_what_came(numbers: list[int], often: int, also: int, more: list[int]) -> None:
    tally = Tally(7, often, also)
    for number in numbers:
        tally.add(number)
    assert tally.counts() == [numbers.count(number) for number in range(7)]
    tally.add_counts(more)
    assert tally.counts() == [numbers.count(number) + more[number] for number in range(7)]


def test_what_is_returned_is_a_copy() -> None:
    tally = Tally(2, 0, 1)
    tally.counts()[0] = 5
    assert tally.counts() == [0, 0]
    with pytest.raises(IndexError):
        tally.add(2)
