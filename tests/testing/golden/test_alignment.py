from __future__ import annotations

from collections import Counter
from itertools import pairwise
from random import Random

from hypothesis import given
from hypothesis import strategies as st

from dissect.testing.golden.alignment import align
from tests.growth import assert_growth

_SEQUENCES = st.lists(st.integers(0, 5), max_size=40) | st.lists(st.integers(0, 200), max_size=60)


def checked(a: list[int], b: list[int]) -> list[tuple[int, int]]:
    """Return the pairs, having looked that they are a common subsequence."""
    pairs = align(a, b)
    assert all(a[i] == b[j] for i, j in pairs)
    assert all(one[0] < other[0] and one[1] < other[1] for one, other in pairwise(pairs))
    return pairs


def longest(a: list[int], b: list[int]) -> int:
    """Return the length of the longest common subsequence, by the table in every textbook."""
    row = [0] * (len(b) + 1)
    for element in a:
        before = 0
        for at, other in enumerate(b, 1):
            before, row[at] = row[at], before + 1 if element == other else max(row[at], row[at - 1])
    return row[-1]


@given(_SEQUENCES, _SEQUENCES)
def test_pairs_are_a_common_subsequence(a: list[int], b: list[int]) -> None:
    checked(a, b)


@given(st.lists(st.integers(0, 2), max_size=30), st.lists(st.integers(0, 2), max_size=30))
def test_without_anchors_it_is_the_longest_one(a: list[int], b: list[int]) -> None:
    a, b = a + a + [9], [9, *b, *b]  # nothing begins or ends alike, and hardly anything is unique
    if 1 in Counter(a).values() and 1 in Counter(b).values():
        a, b = a + a, b + b
    assert len(checked(a, b)) == longest(a, b)


@given(_SEQUENCES)
def test_a_sequence_is_like_itself(a: list[int]) -> None:
    assert align(a, a) == [(at, at) for at in range(len(a))]


@given(st.lists(st.integers(0, 3), min_size=1, max_size=80), st.data())
def test_one_element_less_is_one_pair_less(a: list[int], data: st.DataObject) -> None:
    gone = data.draw(st.integers(0, len(a) - 1))
    assert len(checked(a, a[:gone] + a[gone + 1 :])) == len(a) - 1


def test_polling_with_lost_rounds_is_aligned_around_the_losses() -> None:
    polling = list(range(20)) * 500
    lost = {3, 777, 5000, 5001, 9998}
    rest = [element for at, element in enumerate(polling) if at not in lost]
    assert len(checked(polling, rest)) == len(rest)


def test_more_differences_than_one_search_looks_for() -> None:
    random = Random(4)
    polling = [random.randrange(3) for _ in range(4000)]
    rest = [element for at, element in enumerate(polling) if at % 7]
    assert len(checked(polling, rest)) > 0.95 * len(rest)


def test_work_grows_little_more_than_linearly() -> None:
    random = Random(5)

    def shuffled(size: int) -> None:
        a = [random.randrange(40) for _ in range(size)]
        b = [random.randrange(40) for _ in range(size)]
        align(a, b)

    assert_growth(lambda: shuffled(500), lambda: shuffled(2000), 9)
