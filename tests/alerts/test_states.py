"""What is measured for a rule is bounded, and what gives way is counted."""

from __future__ import annotations

import pytest

from dissect.alerts import states
from tests.alerts.rules_of import Kept
from tests.baseline.wire import Client

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
