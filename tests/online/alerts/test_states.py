"""What is measured for a rule is bounded, and what gives way is counted."""

from __future__ import annotations

import pytest

from dissect.engine.transactions.results import GAPS
from dissect.online.alerts import states
from dissect.output.baseline import Learner
from tests.engine.transactions.talk import SECOND, Talk, dbw, read, words
from tests.online.alerts.rules_of import Kept
from tests.output.baseline.wire import Client

RULES = (
    'when = "rate"\nabove = 100',
    'when = "latency"\nabove = "1s"',
    'when = "latency"\nabove = "1s"\nper = "connection"',
    'when = "silence"\nlonger = "1h"',
    'when = "silence"\nlonger = "1h"\nof = "transactions"\nper = "connection"',
    'when = "outcome"\nabove = 1000',
)


@pytest.mark.parametrize("rule", RULES)
def test_measures_are_bounded(monkeypatch: pytest.MonkeyPatch, rule: str) -> None:
    monkeypatch.setattr(states, "MAX_MEASURED", 4)
    engine = Kept(rule)
    for number in range(10):
        client = Client(engine.wire, number, f"10.0.1.{number}", ports=(5000 + number, 102))
        client.read(number + 0.5, content=0x0A)
    watch = engine._states[0]
    kept = next(value for key, value in vars(watch).items() if key in {"_counters", "_answers", "_last"})
    assert len(getattr(kept, "kept", kept)) == 4
    assert engine.forgotten >= 6
    engine.over()
    assert engine.alerts == []


def test_what_was_seen_last_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(states, "MAX_MEASURED", 2)
    engine = Kept('when = "rate"\nabove = 1.5\nwindow = "2s"')
    first = Client(engine.wire, 0.0, "10.0.1.1", ports=(5000, 102))
    for number in range(8):
        Client(engine.wire, 1.0, f"10.0.2.{number}", ports=(6000 + number, 102))
        first.read(1.0)
    assert [alert.pair for alert in engine.alerts] == []
    first.read(3.2)
    first.read(3.3)
    engine.over()
    assert {alert.pair for alert in engine.alerts} == {("10.0.1.1", "10.0.0.2")}


def test_an_answer_that_is_only_likely_has_no_answer_time() -> None:
    """Neither for a rule about answer times, nor for the baseline that it compares with."""
    (watch,) = Kept('when = "latency"\nabove = "1ms"')._states
    talk = Talk()
    talk.open()
    talk.ask(read(1, dbw(1, 0)))
    talk.wait(SECOND)
    talk.tell(words(1, 1))
    transaction = talk.transactions[-1]
    pair = ("10.0.0.1", "10.0.0.2")
    for flags, alerts in ((GAPS, False), (0, True)):
        transaction._flags = flags
        watch.take(pair, transaction, talk.now_ns)
        assert any(make is not None for _, make in watch.look(talk.now_ns)) is alerts
        learner = Learner()
        learner.transaction(transaction)
        (norm,) = learner.baseline().pairs.values()
        assert (norm.median_ms is not None, norm.transactions) == (alerts, 1)
