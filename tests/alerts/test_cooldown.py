"""What is remembered of alerts is bounded, and forgotten when it is over."""

from __future__ import annotations

import pytest

from dissect.alerts import Alert, cooldown
from dissect.alerts.cooldown import Cooldown
from tests.alerts.rules_of import alert, rule

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
    assert told[-1].repeated == 1


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
    assert [alert.repeated for alert in told] == [0, 1]
