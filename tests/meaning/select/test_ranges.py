"""`Ranges` against a list that is searched from end to end."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from dissect.meaning.select.places import Ranges

_RANGE = st.tuples(st.integers(0, 60), st.integers(0, 60))


@given(st.lists(_RANGE), st.lists(_RANGE))
def test_a_number_is_in_it_as_in_any_of_the_ranges(before: list[tuple[int, int]], later: list[tuple[int, int]]) -> None:
    ranges = Ranges()
    known: list[tuple[int, int]] = []
    for added in (before, later):
        for first, last in added:
            ranges.add(first, last)
        known += added
        for number in range(-1, 62):
            assert (number in ranges) == any(first <= number <= last for first, last in known)
