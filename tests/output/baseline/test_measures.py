"""Windows and answer times: what they hold, and how much at most."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from dissect.output.baseline.measures import STEPS, AnswerTimes, RateWindow, RecentAnswers

S = 1_000_000_000


def test_a_window_holds_what_lies_within_it() -> None:
    window = RateWindow(S)
    for tenth in range(20):
        window.add(tenth * S // 10)
    assert window.total(19 * S // 10) == 10
    assert window.highest == 10
    assert window.total(23 * S // 10) == 6
    assert window.total(100 * S) == 0
    assert window.highest == 10


def test_what_comes_late_counts_where_it_belongs() -> None:
    window = RateWindow(S)
    window.add(5 * S)
    assert window.add(5 * S - S // 2) == 2
    assert window.add(2 * S) == 2  # older than the window
    assert window.total(5 * S + 6 * S // 10) == 1


@given(st.lists(st.integers(0, 40), min_size=1, max_size=60), st.integers(1, 5))
def test_a_window_counts_as_a_list_would(gaps: list[int], seconds: int) -> None:
    window = RateWindow(seconds * S)
    step = seconds * S // STEPS
    times, now = [], 1000 * S
    for gap in gaps:
        now += gap * S // 20
        times.append(now)
        expected = sum(1 for one in times if one // step > now // step - STEPS)
        assert window.add(now) == expected


def test_answer_times_are_near_and_few() -> None:
    times = AnswerTimes()
    for latency in range(100_000):
        times.add(latency * 1000)
    assert times.count == 100_000
    assert times.longest == 99_999_000
    for q in (0.5, 0.99):
        found = times.quantile(q)
        assert found is not None
        assert q * 1e8 * (1 - 1 / 128) - 1000 <= found <= q * 1e8
    assert len(times._counts) < 128 * 27
    assert AnswerTimes().quantile(0.5) is None
    times.add(-5)
    assert times.quantile(0.0) == 0


def test_recent_answers_leave_the_window() -> None:
    recent = RecentAnswers(10 * S)
    recent.add(0, 5)
    recent.add(9 * S, 7)
    assert recent.all(9 * S).count == 2
    assert recent.all(10 * S).longest == 7
    recent.add(S, 900)  # came late, and is older than the window by now
    assert recent.all(11 * S).longest == 7
    assert recent.all(19 * S).count == 0
    assert len(recent._steps) == 0
