"""Actions really done: a program is run, a datagram is sent, an address is posted to; and what goes wrong is told."""

from __future__ import annotations

import json
import re
import socket
import sys
import threading
import time
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest

from dissect.online.alerts.actions import DeliveryError, Printed
from dissect.online.alerts.command import Command
from dissect.online.alerts.hosts import allowed, split_host
from dissect.online.alerts.syslog import Syslog
from dissect.online.alerts.webhook import Webhook
from tests.online.alerts.rules_of import alert

ODD = "TSAP \x1b[2J; rm -rf $HOME\n"
WRITER = """
import json, os, sys
with open(sys.argv[1], "w") as file:
    got = {"stdin": sys.stdin.read(), "arguments": sys.argv[2:], "environment": sorted(os.environ), "at": os.getcwd()}
    json.dump(got, file)
"""


# ---- command --------------------------------------------------------------------------------------------------------


def test_a_program_gets_the_alert_on_stdin(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SECRET", "no business of a program")
    target = tmp_path / "got.json"
    placed = (
        "{rule} {severity}",
        "{client}>{server}",
        "{connection}",
        "{repeated}",
        "{when}",
        "{time}",
        "{}",
        "$HOME;",
    )
    one = alert(ODD)
    Command("a", (sys.executable, "-c", WRITER, str(target), *placed)).deliver(one)
    got = json.loads(target.read_text())
    assert json.loads(got["stdin"]) == one.as_dict()
    assert got["arguments"] == [
        "rule warning", "10.0.0.1>10.0.0.2", "7", "0", "new", "2024-03-04T05:06:08.500000000Z", "{}", "$HOME;",
    ]  # fmt: skip
    assert ODD not in " ".join(got["arguments"])
    assert set(got["environment"]) <= {"PATH", "LANG", "LC_ALL", "LC_CTYPE", "TZ"}
    assert got["at"] == "/"


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("/no/such/program",), "program: No such file or directory"),
        ((sys.executable, "-c", "raise SystemExit(3)"), ": exit code 3"),
        ((sys.executable, "-c", "import os; os.close(0)"), ""),
    ],
)
def test_a_program_that_fails_is_told(arguments: tuple[str, ...], told: str) -> None:
    if not told:
        Command("a", arguments).deliver(alert())  # one that does not read is fine
        return
    with pytest.raises(DeliveryError) as error:
        Command("a", arguments).deliver(alert())
    assert str(error.value).endswith(told)


def test_a_program_that_takes_too_long_is_killed_with_what_it_started(tmp_path: Path) -> None:
    target = tmp_path / "child"
    script = f"sleep 60 & echo $! > {target}; wait"
    for limit in (1, 10, 60):  # the shell has to come to its second command
        with pytest.raises(DeliveryError, match=f"sh: took more than {limit} s and was killed"):
            Command("a", ("/bin/sh", "-c", script), timeout=limit).deliver(alert())
        if target.exists() and target.read_text().endswith("\n"):
            break
    child = Path("/proc", target.read_text().strip())
    for _ in range(500):
        if not child.exists() or " Z " in (child / "stat").read_text():
            break
        time.sleep(0.01)
    else:
        pytest.fail("what the program started still runs")


def test_what_runs_is_killed_at_the_end(tmp_path: Path) -> None:
    command = Command("a", ("/bin/sh", "-c", "sleep 60"), timeout=60)
    failures: list[str] = []

    def run() -> None:
        try:
            command.deliver(alert())
        except DeliveryError as error:
            failures.append(str(error))

    thread = threading.Thread(target=run)
    thread.start()
    while not command._running:
        time.sleep(0.01)
    command.close()
    thread.join(20)
    assert failures == ["sh: exit code -9"]
    with pytest.raises(DeliveryError, match="not started"):
        command.deliver(alert())


# ---- syslog ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("severity", "priority"), [("error", 3 * 8 + 3), ("warning", 3 * 8 + 4), ("note", 3 * 8 + 6)])
def test_syslog_by_udp(severity: str, priority: int) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        receiver.bind(("127.0.0.1", 0))
        receiver.settimeout(10)
        action = Syslog("a", receiver.getsockname())
        action.deliver(alert(ODD, severity=severity))
        got = receiver.recv(65536).decode()
        action.close()
    head = re.escape(f"<{priority}>1 2024-03-04T05:06:08.500000Z ")
    text = re.escape(rf"{severity} 10.0.0.1 > 10.0.0.2 rule: TSAP \x1b[2J; rm -rf $HOME\x0a")
    assert re.fullmatch(head + rf"\S+ s7dissect [0-9]+ new - {text}", got)


def test_syslog_by_a_socket(tmp_path: Path) -> None:
    path = str(tmp_path / "log")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as receiver:
        receiver.bind(path)
        receiver.settimeout(10)
        action = Syslog("a", path, "local0")
        action.deliver(alert())
        assert receiver.recv(65536).startswith(b"<132>1 ")
        action.close()
    Path(path).unlink()
    with pytest.raises(DeliveryError, match=r"syslog .*log: "):
        action.deliver(alert())


# ---- webhook --------------------------------------------------------------------------------------------------------


class Receiver(BaseHTTPRequestHandler):
    got: list[tuple[str, str, bytes]]

    def do_POST(self) -> None:
        body = self.rfile.read(int(self.headers["Content-Length"]))
        type(self).got.append((self.path, self.headers["Content-Type"], body))
        if self.path == "/moved":
            self.send_response(302)
            self.send_header("Location", "/there")
        else:
            self.send_response(500 if self.path == "/broken" else 204)
        self.end_headers()

    def do_GET(self) -> None:
        type(self).got.append((self.path, "GET", b""))
        self.send_response(200)
        self.end_headers()

    def log_message(self, format: str, *args: object) -> None:  # noqa: A002 - the name of the library
        pass


@pytest.fixture
def server() -> Iterator[str]:
    Receiver.got = []
    with ThreadingHTTPServer(("127.0.0.1", 0), Receiver) as http:
        thread = threading.Thread(target=http.serve_forever, kwargs={"poll_interval": 0.01})
        thread.start()
        yield f"http://127.0.0.1:{http.server_port}"
        http.shutdown()
        thread.join()


def test_a_webhook_posts_json(server: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("http_proxy", "http://127.0.0.1:9")  # nobody asked for a proxy
    one = alert(ODD)
    Webhook("a", f"{server}/alerts").deliver(one)
    ((path, kind, body),) = Receiver.got
    assert (path, kind) == ("/alerts", "application/json")
    assert json.loads(body) == one.as_dict()


@pytest.mark.parametrize(("path", "told"), [("broken", "HTTP 500"), ("moved", "HTTP 302")])
def test_what_a_webhook_refuses_is_told(server: str, path: str, told: str) -> None:
    with pytest.raises(DeliveryError, match=told):
        Webhook("a", f"{server}/{path}").deliver(alert())
    assert [one[0] for one in Receiver.got] == [f"/{path}"]  # no redirection was followed


def test_a_webhook_that_nobody_answers_is_told() -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        url = f"http://127.0.0.1:{taken.getsockname()[1]}/"
        with pytest.raises(DeliveryError, match="Connection refused"):
            Webhook("a", url).deliver(alert())
        taken.listen()
        with pytest.raises(DeliveryError, match="timed out"):
            Webhook("a", url, timeout=0.2).deliver(alert())


# ---- the rest -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("host", "yes"),
    [
        ("127.0.0.1", True), ("127.8.8.8", True), ("::1", True), ("localhost", True), ("LOCALHOST", True),
        ("Hook.example", True),
        ("10.0.0.1", False), ("example", False), ("127.0.0.1.example", False), ("0.0.0.0", False), ("", False),
    ],
)  # fmt: skip
def test_hosts(host: str, yes: bool) -> None:
    assert allowed(host, frozenset(("hook.Example",))) is yes


@pytest.mark.parametrize(
    ("text", "place"),
    [
        ("127.0.0.1", ("127.0.0.1", 514)), ("a.example:99", ("a.example", 99)), ("[::1]:5", ("::1", 5)),
        ("[::1]", ("::1", 514)),
        ("a:0", None), ("a:99999", None), ("a b", None), ("::1", None), ("", None),
    ],
)  # fmt: skip
def test_places(text: str, place: tuple[str, int] | None) -> None:
    assert split_host(text, 514) == place


def test_printed(capsys: pytest.CaptureFixture[str]) -> None:
    Printed("stderr").deliver(alert())
    assert capsys.readouterr().err == "2024-03-04 05:06:08.500000 UTC  ALERT warning  rule: something happened\n"
