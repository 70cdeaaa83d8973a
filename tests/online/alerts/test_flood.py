"""A flood of alerts hides nothing: 3,000 reads of data blocks never seen before, and then a PLC stop."""

from __future__ import annotations

import json
import socket
import sys
import threading
import time
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest

from dissect.online.alerts import Alert, AlertEngine, Dispatcher
from dissect.online.alerts.loading import parse_rules
from tests.output.baseline.wire import Client, Wire, learned
from tests.properties import messages
from tests.properties.messages import Item, dt

APPEND = "import sys; open(sys.argv[1], 'ab').write(sys.stdin.buffer.read())"
STOP = bytes((0x29, 0, 0, 0, 0, 0, 9)) + b"P_PROGRAM"
S = 1_000_000_000


def flood(tell: list[Alert] | None, toml: str, reads: int = 3000) -> None:
    """Let the flood and the stop pass, and everything be told to ``tell``."""
    rules = parse_rules(toml)
    alerts: list[Alert] = tell if tell is not None else []
    dispatcher = Dispatcher(rules.actions, write=print, tell=print)

    def submit(alert: Alert) -> None:
        alerts.append(alert)
        dispatcher.submit(alert)

    engine = AlertEngine(rules, learned("10.0.0.1").baseline(("x",)), submit)
    wire = Wire(engine)
    client = Client(wire, 0.0, "10.0.0.1", ports=(5000, 102))
    for number in range(reads):
        client.read(1.0 + number * 0.001, Item(0x04, 1, 1000 + number, 0x84, 0), b"\x00\x01", answer=0.0005)
    client.talk.send(0, dt(messages.pdu(messages.JOB, 9999, STOP)))
    client.talk.send(1, dt(messages.pdu(messages.ACK_DATA, 9999, b"\x29")))
    client.pass_on(5.0)
    wire.finish()
    engine.finish()
    dispatcher.close(20.0)


RULES = """
[defaults]
actions = {actions}
{tables}
[[rule]]
name = "new"
when = "new"
[[rule]]
name = "findings"
when = "finding"
finding = "note"
"""


def stops(alerts: list[dict[str, object]]) -> int:
    return sum([1 for alert in alerts if "security.plc_stop" in json.dumps(alert) and "summary" not in alert])


def test_each_rule_is_bounded_and_sums_up_the_rest() -> None:
    alerts: list[Alert] = []
    flood(alerts, RULES.format(actions='["stderr"]', tables=""))
    reads = [alert for alert in alerts if alert.kind == "read" and alert.rule.name == "new"]
    assert len(reads) == 21
    assert [alert.repeated for alert in reads] == [0] * 20 + [2980]
    summary = reads[-1].detail["summary"]
    assert isinstance(summary, dict)
    assert (summary["alerts"], summary["kind"]) == (2980, "read")
    assert "2980 more alerts (read) in 4.00 s; the last: " in reads[-1].text
    (stop,) = [alert for alert in alerts if alert.kind == "security.plc_stop"]
    assert (stop.severity, stop.repeated) == ("error", 0)
    assert len(alerts) < 60


def test_a_burst_is_of_a_minute_of_a_kind_and_of_a_severity(capsys: pytest.CaptureFixture[str]) -> None:
    from dissect.online.alerts.cooldown import Cooldown
    from dissect.online.alerts.rules import Rule

    told: list[Alert] = []
    book = Cooldown(told.append)
    rule = Rule("r", "finding", burst=2)

    def happened(about: int, now_ns: int, slug: str = "a", severity: str = "warning") -> None:
        detail: dict[str, object] = {"finding": {"slug": slug}}
        book.event(
            rule, (about, slug, severity), now_ns, lambda at: Alert(rule, at, severity, None, f"{slug}{about}", detail)
        )

    for number in range(5):
        happened(number, S + number)
    happened(0, 2 * S, severity="error")
    happened(0, 2 * S, slug="b")
    assert [alert.text for alert in told] == ["a0", "a1", "a0", "b0"]
    book.flush(62 * S)
    assert told[4].repeated == 3
    assert told[4].text.startswith("3 more alerts (a) in 61.00 s; the last: a4")
    for number in range(10, 14):
        happened(number, 62 * S + number)
    book.flush(63 * S, over=True)
    assert [alert.text[:3] for alert in told[5:]] == ["a10", "a11", "2 m"]


def test_a_burst_does_not_hide_a_server() -> None:
    from dissect.online.alerts import cooldown
    from dissect.online.alerts.rules import Rule

    told: list[Alert] = []
    book = cooldown.Cooldown(told.append)
    rule = Rule("r", "finding", burst=2)

    def stopped(number: int, server: str) -> None:
        detail: dict[str, object] = {"finding": {"slug": "security.plc_stop"}}
        pair = (f"10.0.1.{number}", server)
        book.event(rule, (pair,), S + number, lambda at: Alert(rule, at, "error", pair, f"stop of {server}", detail, 1))

    for number in range(50):
        stopped(number, "10.0.0.2")
    stopped(51, "10.0.0.3")
    assert [alert.text for alert in told] == ["stop of 10.0.0.2", "stop of 10.0.0.2", "stop of 10.0.0.3"]
    for number in range(60, 60 + cooldown.MAX_SERVERS):
        stopped(number, f"10.0.9.{number}")
    book.flush(90 * S, over=True)
    last = told[-1]
    assert last.repeated == 50
    assert ", of 2 further servers 10.0.9.158, 10.0.9.159; the last: stop of 10.0.9.159" in last.text


def test_what_was_only_counted_is_told_with_the_next_alert() -> None:
    from dissect.online.alerts.cooldown import Cooldown
    from dissect.online.alerts.rules import Rule

    told: list[Alert] = []
    book = Cooldown(told.append)
    rule = Rule("r", "finding", cooldown_ns=60 * S)

    def make(at: int) -> Alert:
        return Alert(rule, at, "error", None, "stop", {})

    book.event(rule, "a", S, make)
    book.more(rule, "a", 600, 2 * S, make)
    book.flush(30 * S)
    assert [alert.repeated for alert in told] == [0]
    book.flush(62 * S)
    assert [alert.repeated for alert in told] == [0, 599]  # the alert is about the latest one
    book.more(rule, "b", 600, 63 * S, make)  # its first alert was forgotten
    assert [alert.repeated for alert in told] == [0, 599, 599]


def test_a_program_hears_of_the_stop(tmp_path: Path) -> None:
    target = tmp_path / "got"
    command = json.dumps([sys.executable, "-c", APPEND, str(target)])
    flood(None, RULES.format(actions='["page"]', tables=f'[[action]]\nname = "page"\ncommand = {command}\n'))
    assert stops([json.loads(line) for line in target.read_text().splitlines()]) == 1


def test_a_syslog_hears_of_the_stop(tmp_path: Path) -> None:
    path = str(tmp_path / "log")
    got: list[str] = []
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as receiver:
        receiver.bind(path)
        receiver.settimeout(60)

        def listen() -> None:
            while octets := receiver.recv(65536):
                got.append(octets.decode())

        thread = threading.Thread(target=listen)
        thread.start()
        flood(None, RULES.format(actions='["log"]', tables=f'[[action]]\nname = "log"\nsyslog = "{path}"\n'))
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sender:
            sender.sendto(b"", path)
        thread.join()
    (stop,) = [line for line in got if "PLC" in line and " error " in line and "stop" in line.lower()]
    assert stop.startswith("<27>1 ")  # daemon.err


class Hook(BaseHTTPRequestHandler):
    """Keeps what is posted, and answers with what a test says."""

    got: list[dict[str, object]]
    code: int

    def do_POST(self) -> None:
        body = self.rfile.read(int(self.headers["Content-Length"]))
        if self.code == 204:
            self.got.append(json.loads(body))
        self.send_response(self.code)
        self.end_headers()

    def log_message(self, format: str, *args: object) -> None:  # noqa: A002 - the name of the library
        pass


@pytest.fixture
def hook() -> Iterator[ThreadingHTTPServer]:
    Hook.got, Hook.code = [], 204
    with ThreadingHTTPServer(("127.0.0.1", 0), Hook) as http:
        thread = threading.Thread(target=http.serve_forever, kwargs={"poll_interval": 0.01})
        thread.start()
        yield http
        http.shutdown()
        thread.join()


def with_hook(port: int, spool: Path) -> str:
    table = f'[[action]]\nname = "hook"\nwebhook = "http://127.0.0.1:{port}/"\nspool = "{spool}"\n'
    return RULES.format(actions='["hook"]', tables=table)


def test_a_webhook_hears_of_the_stop(hook: ThreadingHTTPServer, tmp_path: Path) -> None:
    flood(None, with_hook(hook.server_port, tmp_path / "spool"))
    assert stops(Hook.got) == 1
    assert not list(tmp_path.rglob("*.json"))


def test_a_webhook_that_is_down_hears_of_it_after_a_restart_of_both(tmp_path: Path) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        port = int(taken.getsockname()[1])
        alerts: list[Alert] = []
        flood(alerts, with_hook(port, tmp_path / "spool"))
    waiting = sorted(tmp_path.rglob("*.json"))
    assert len(waiting) == len(alerts)
    assert json.loads(waiting[0].read_bytes())["severity"] == "error"
    Hook.got, Hook.code = [], 204
    with ThreadingHTTPServer(("127.0.0.1", port), Hook) as http:
        thread = threading.Thread(target=http.serve_forever, kwargs={"poll_interval": 0.01})
        thread.start()
        dispatcher = Dispatcher(parse_rules(with_hook(port, tmp_path / "spool")).actions, tell=print)
        dispatcher.start()
        end = time.monotonic() + 30
        while len(Hook.got) < len(alerts) and time.monotonic() < end:
            time.sleep(0.01)
        dispatcher.close(20.0)
        http.shutdown()
        thread.join()
    assert len(Hook.got) == len(alerts)
    ranks = [("error", "warning", "note").index(str(alert["severity"])) for alert in Hook.got]
    assert ranks == sorted(ranks)
    assert not list(tmp_path.rglob("*.json"))


def test_a_webhook_that_comes_back_is_tried_again(hook: ThreadingHTTPServer, tmp_path: Path) -> None:
    told: list[str] = []
    Hook.code = 503
    rules = parse_rules(with_hook(hook.server_port, tmp_path / "spool"))
    with Dispatcher(rules.actions, tell=told.append) as dispatcher:
        from tests.online.alerts.rules_of import alert

        dispatcher.submit(alert(actions=("hook",)))
        end = time.monotonic() + 30
        while not told and time.monotonic() < end:
            time.sleep(0.01)
        Hook.code = 204
        while not Hook.got and time.monotonic() < end:
            time.sleep(0.01)
    assert len(Hook.got) == 1
    assert "HTTP 503; delivery will be retried" in told[0]
    assert dispatcher.counts["hook"].as_dict() == {"delivered": 1, "failed": 0, "dropped": 0}


def test_an_alert_that_is_refused_for_good_is_given_up(hook: ThreadingHTTPServer, tmp_path: Path) -> None:
    told: list[str] = []
    Hook.code = 422
    rules = parse_rules(with_hook(hook.server_port, tmp_path / "spool"))
    with Dispatcher(rules.actions, tell=told.append) as dispatcher:
        from tests.online.alerts.rules_of import alert

        dispatcher.submit(alert(actions=("hook",)))
        end = time.monotonic() + 30
        while not told and time.monotonic() < end:
            time.sleep(0.01)
    assert dispatcher.counts["hook"].as_dict() == {"delivered": 0, "failed": 1, "dropped": 0}
    assert "HTTP 422" in told[0]
    assert not list(tmp_path.rglob("*.json"))
