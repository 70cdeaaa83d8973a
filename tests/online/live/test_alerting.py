from __future__ import annotations

import threading
from types import SimpleNamespace
from typing import Any

import pytest

from dissect.cli.reloading import Reloading
from dissect.engine.pipeline import Options
from dissect.online.alerts.alert import Alert
from dissect.online.alerts.dispatcher import Dispatcher
from dissect.online.alerts.engine import AlertEngine
from dissect.online.alerts.loading import parse_rules
from dissect.online.live import alerting
from dissect.online.live.alerting import AlertCompanion, Succession
from dissect.online.live.run import LiveRun
from dissect.online.live.session import Session
from tests.meaning.report.support import begun, read
from tests.online.live.support import Clock, Line, never, taken
from tests.online.live.test_run import Told

RULES = """
[[rule]]
name = "silent"
when = "silence"
longer = "2s"

[[rule]]
name = "refused"
when = "finding"
finding = "transaction.item_error"
"""


def test_a_silent_line_raises_an_alert_and_so_does_a_finding() -> None:
    alerts: list[Alert] = []
    printed: list[str] = []
    dispatcher = Dispatcher({}, write=printed.append, tell=printed.append)

    def tell(alert: Alert) -> None:
        alerts.append(alert)
        dispatcher.submit(alert)

    companion = AlertCompanion(AlertEngine(parse_rules(RULES), None, tell), dispatcher)
    line = Line(Clock(), [read(begun(), 1, content=0x0A).packets(), *[[] for _ in range(100)]], ends=True)
    run = LiveRun(line, Told(), Options(strict=True), companions=[companion], clock=line.clock)
    while run.step():
        pass
    assert [alert.rule.name for alert in alerts] == ["refused", "silent"]
    assert len(printed) == 2
    assert run.failures == []


def test_something_may_be_said_from_outside() -> None:
    session = Session(lambda: Line(Clock(), [], ends=True))
    session.start()
    session.say("ALERT silent")
    assert [event.what for event in taken(session, never)] == ["ALERT silent"]


def test_alerts_for_which_there_was_no_room_while_the_rules_before_ended_are_told(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(alerting, "MAX_BETWEEN", 3)
    over = threading.Event()
    before: Any = SimpleNamespace(close=lambda: over.wait(20))
    given: list[int] = []
    after: Any = SimpleNamespace(start=lambda: None, submit=given.append)
    told: list[str] = []
    succession = Succession(before, after, told.append)
    succession.begin()
    some: list[Any] = list(range(5))
    for one in some:
        succession.submit(one)
    assert (succession.pass_on(), given, told) == (False, [], [])
    over.set()
    assert succession.pass_on(wait=True)
    assert given == [2, 3, 4]
    assert told == ["alerts: 2 alerts dropped, there was no room while the rules before ended"]
    assert succession.pass_on()
    assert len(told) == 1


def test_a_change_that_fails_lets_the_next_signal_be_heard(monkeypatch: pytest.MonkeyPatch) -> None:
    changes: list[Any] = []
    run = SimpleNamespace(between=changes.append, name_values=lambda _: None, renew=lambda: None)
    said: list[str] = []
    session: Any = SimpleNamespace(run=run, say=said.append)

    def fails() -> None:
        raise OSError("no thread can be started")

    rules = [fails, lambda: None]
    beside: Any = SimpleNamespace(alerting=None, reporting=None, rules_again=lambda: rules.pop(0))
    for name in ("read_again", "naming_again", "hosts"):
        monkeypatch.setattr(f"dissect.cli.reloading.{name}", dict)
    reloading = Reloading(session, beside)
    reloading._note(1, None)
    reloading.check()
    with pytest.raises(OSError, match="no thread"):
        changes.pop()()
    reloading._note(1, None)
    reloading.check()
    changes.pop()()
    assert said == ["HUP: rules, baseline, tags and hosts were read again; new files begin"]
