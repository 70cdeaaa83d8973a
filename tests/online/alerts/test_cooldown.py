"""What is remembered of alerts is bounded, and forgotten when it is over."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.online.alerts import Alert, cooldown
from dissect.online.alerts.cooldown import Cooldown
from dissect.online.alerts.rules import Rule
from tests.online.alerts.rules_of import alert, rule

S = 1_000_000_000


def made(now_ns: int) -> Alert:
    return alert()


def test_what_is_over_is_forgotten() -> None:
    told: list[Alert] = []
    book = Cooldown(told.append)
    one = rule()
    for number in range(100):
        book.event(one, number, S, made)
    book.state(one, "state", S, made)
    assert len(told) == 101
    book.flush(30 * S)
    assert len(book._told) == 101
    book.flush(61 * S)
    assert len(book._told) == 0
    assert len(told) == 101


def test_too_many_different_ones_are_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cooldown, "MAX_REMEMBERED", 3)
    told: list[Alert] = []
    book = Cooldown(told.append)
    one = rule()
    for number in range(5):
        book.event(one, number, S, made)
        book.state(one, ("state", number), S, made)
    assert len(told) == 10  # what is new is told; the oldest is forgotten for it
    assert (book.crowded, len(book._told)) == (7, 3)
    book.event(one, 4, 2 * S, made)
    book.flush(2 * S, over=True)
    assert (len(told), told[-1].repeated) == (11, 0)  # this one, and no more


def test_a_state_whose_subject_is_gone_is_over() -> None:
    told: list[Alert] = []
    book = Cooldown(told.append)
    one = rule()
    book.state(one, "connection", S, made)
    book.flush(S)
    book.flush(2 * S)  # nobody said that it holds
    book.state(one, "connection", 3 * S, made)
    book.flush(3 * S)
    assert len(told) == 1
    book.flush(70 * S)
    assert [alert.repeated for alert in told] == [0, 0]


@given(st.lists(st.floats(0, 200), min_size=1, max_size=400), st.integers(1, 120))
def test_alerts_and_what_they_count_add_up_to_all_events(times: list[float], cooldown_s: int) -> None:
    """However events lie within and between cooldowns, and whether anybody looks at the clock between them or not."""
    told: list[Alert] = []
    book = Cooldown(told.append)
    one = Rule("rule", "finding", cooldown_ns=cooldown_s * S, burst=0)
    for at in sorted(times):
        book.event(one, "same", int((1 + at) * S), made)
        if int(at) % 3 == 0:
            book.flush(int((1 + at) * S))
    book.flush(300 * S, over=True)
    assert sum([1 + alert.repeated for alert in told]) == len(times)


def test_of_400_events_the_first_is_told_then_the_last_with_398_more() -> None:
    told: list[Alert] = []
    book = Cooldown(told.append)
    one = Rule("rule", "finding", cooldown_ns=3600 * S, burst=0)
    for number in range(400):
        book.event(one, "same", (1 + number) * S, made)
    book.flush(500 * S, over=True)
    assert [alert.repeated for alert in told] == [0, 398]
    assert told[1].message().endswith(", 398 more")


def test_stop_start_stop_within_a_cooldown_and_what_comes_after_a_summary() -> None:
    """The alert at the end of a cooldown begins the next; only after a silent one the next time is told at once."""
    told: list[tuple[int, int]] = []  # when, and how many more
    now = 0
    book = Cooldown(lambda given: told.append((now, given.repeated)))
    one = Rule("rule", "finding", cooldown_ns=60 * S, burst=0)
    happens = {1: "stop", 2: "start", 3: "stop", 65: "stop", 70: "stop", 75: "stop", 200: "stop"}
    for now in range(1, 210):
        if now in happens:
            book.event(one, happens[now], now * S, made)
        book.flush(now * S)
    # The second stop is told when the cooldown of the first is over, the three behind it when that of this summary is.
    assert told == [(1, 0), (2, 0), (61, 0), (121, 2), (200, 0)]
