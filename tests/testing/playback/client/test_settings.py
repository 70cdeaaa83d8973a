"""Which open requests have to be answered before something else is done."""

from __future__ import annotations

from dissect.testing.golden.exchange import S7, Exchange
from dissect.testing.golden.model import Link, Transaction
from dissect.testing.playback.client.plan import ASK, Step
from dissect.testing.playback.client.settings import PendingRequest


def asked(time_ns: int | None, latency_ns: int | None) -> PendingRequest:
    transaction = Transaction(Link(), "client", Exchange(S7, b"", b""), "answered")
    transaction.time_ns, transaction.latency_ns = time_ns, latency_ns
    return PendingRequest(Step(ASK, transaction), 0.0)


def test_what_was_answered_before_is_due_and_what_was_answered_after_is_not() -> None:
    one = asked(1000, 500)
    assert not one.due(1499)
    assert one.due(1500)
    assert one.due(2000)


def test_what_nobody_knows_is_due() -> None:
    assert asked(1000, 500).due(None)
    assert asked(None, 500).due(0)
    assert asked(1000, None).due(0)
    assert PendingRequest(None, 0.0).due(0)
