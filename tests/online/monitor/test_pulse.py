from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.online.monitor.rate_history import LEVELS, SECONDS, RateHistory, level

S = 1_000_000_000


def test_the_rate_counts_whole_seconds() -> None:
    pulse = RateHistory()
    for at in range(30):
        pulse.add(100 * S + at * S // 10, 1000)  # ten a second, for three seconds
    assert pulse.rate(103 * S, 1) == 10
    assert pulse.rate(103 * S, 10) == 3
    assert pulse.rate(104 * S, 1) == 0
    assert pulse.rate(112 * S, 10) == 1
    assert pulse.rate(113 * S, 10) == 0


def test_the_worst_answer_of_each_second() -> None:
    pulse = RateHistory()
    pulse.add(100 * S, 5)
    pulse.add(100 * S, 9)
    pulse.add(102 * S, 3)
    pulse.add(102 * S, None)
    assert pulse.worst(103 * S, 5) == [-1, 9, -1, 3, -1]


def test_a_long_silence_leaves_nothing() -> None:
    pulse = RateHistory()
    pulse.add(100 * S, 5)
    pulse.add(100 * S + SECONDS * S, None)
    assert pulse.worst(100 * S + SECONDS * S, SECONDS) == [-1] * SECONDS
    assert pulse.rate(101 * S + SECONDS * S, 1) == 1


def test_time_that_runs_backwards_counts_for_now() -> None:
    pulse = RateHistory()
    pulse.add(100 * S, 5)
    pulse.add(90 * S, 7)
    assert pulse.worst(100 * S, 2) == [-1, 7]
    assert pulse.rate(101 * S, 1) == 2


@given(st.lists(st.tuples(st.integers(0, 200), st.integers(-5, 10**12))))
def test_it_agrees_with_a_count_of_everything(added: list[tuple[int, int]]) -> None:
    pulse = RateHistory()
    newest = 0
    counted: list[tuple[int, int]] = []
    for second, latency in added:
        newest = max(newest, second)
        counted.append((newest, max(latency, -1)))
        pulse.add(second * S, latency)
    now = newest + 1
    assert pulse.rate(now * S, 10) == sum([now - 10 <= second < now for second, _ in counted]) / 10
    expected = [
        max([latency for at, latency in counted if at == second], default=-1) for second in range(now - 9, now + 1)
    ]
    assert pulse.worst(now * S, 10) == expected


@pytest.mark.parametrize(
    ("latency", "expected"),
    [
        (-1, -1),
        (0, 0),
        (316_228, 0),
        (316_229, 1),
        (1_000_000, 1),
        (10_000_000, 3),
        (316_227_766, 6),
        (10**12, LEVELS - 1),
    ],
)
def test_levels(latency: int, expected: int) -> None:
    assert level(latency) == expected
