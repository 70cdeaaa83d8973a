"""How long an answer is waited for."""

from __future__ import annotations

import pytest

from dissect.engine.transactions.transaction import CAPTURE_ENDED, CONNECTION_CLOSED, HOLE, REFERENCE_REUSED
from dissect.testing.golden.exchange import S7, Exchange
from dissect.testing.golden.model import Link, Transaction
from dissect.testing.playback.client.plan import ASK, Step
from dissect.testing.playback.client.settings import SHORTEST_S, SILENCE_S, Timeouts


def step(reason: str, gap_ns: int | None = None, heard: bool = True) -> Step:
    """Return a request that was not answered for this reason; answered for none."""
    transaction = Transaction(Link(), "client", Exchange(S7, b"", b""), "unanswered" if reason else "answered", reason)
    return Step(ASK, transaction, None, heard, gap_ns)


def test_an_answer_that_was_recorded_and_one_of_our_own_may_take_their_time() -> None:
    patience = Timeouts(5, 1)
    assert patience.seconds(step("")) == 5
    assert patience.seconds(None) == 5


@pytest.mark.parametrize("reason", [CONNECTION_CLOSED, REFERENCE_REUSED, CAPTURE_ENDED])
def test_one_that_stayed_away_is_waited_for_as_long_as_the_client_did(reason: str) -> None:
    patience = Timeouts(5, 1)
    assert patience.seconds(step(reason, 40_000_000)) == 0.04
    assert patience.seconds(step(reason, 0)) == 0
    assert patience.seconds(step(reason, 60_000_000_000)) == 5


@pytest.mark.parametrize("reason", [CONNECTION_CLOSED, REFERENCE_REUSED])
def test_or_shortly_where_nobody_knows_how_long_that_was(reason: str) -> None:
    assert Timeouts(5, 1).seconds(step(reason)) == SILENCE_S
    assert Timeouts(0.1, 1).seconds(step(reason)) == 0.1


@pytest.mark.parametrize(
    "lost",
    [step(HOLE, 1000), step(CAPTURE_ENDED), step(CONNECTION_CLOSED, 1000, False), step(CAPTURE_ENDED, 1000, False)],
)
def test_one_that_was_lost_is_waited_for_less_each_time_until_one_comes(lost: Step) -> None:
    patience = Timeouts(5, 1)
    waits = []
    for _ in range(200):
        waits.append(patience.seconds(lost))
        patience.missed(lost)
    assert waits[:3] == [1, 0.5, 0.25]
    assert waits[-1] == SHORTEST_S
    assert sum(waits) <= 2 + 200 * SHORTEST_S
    patience.came(lost)
    assert patience.seconds(lost) == 5


def test_other_answers_say_nothing_of_lost_ones() -> None:
    patience = Timeouts(5, 1)
    for other in (None, step(""), step(CONNECTION_CLOSED, 1000)):
        patience.came(other)
        patience.missed(other)
    assert patience.seconds(step(HOLE)) == 1


def test_nothing_is_waited_for_longer_than_the_user_said() -> None:
    patience = Timeouts(0.01, 1)
    assert patience.seconds(step(HOLE)) == 0.01
    patience.missed(step(HOLE))
    assert patience.seconds(step(HOLE)) == 0.01
