from __future__ import annotations

from dissect.alerts.alert import Alert
from dissect.alerts.dispatcher import Dispatcher
from dissect.alerts.engine import AlertEngine
from dissect.alerts.loading import parse_rules
from dissect.engine.pipeline import Options
from dissect.live.alerting import AlertCompanion
from dissect.live.run import LiveRun
from dissect.live.session import Session
from tests.live.support import Clock, Line, never, taken
from tests.live.test_run import Told
from tests.report.support import begun, read

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
