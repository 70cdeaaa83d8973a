"""Secrets of receivers: where they come from, and that none is ever printed."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path

import pytest

from dissect.online.alerts.actions import DeliveryError
from dissect.online.alerts.alert import Alert
from dissect.online.alerts.loading import RuleError, load_rules
from dissect.online.alerts.rules import PROBLEM, Rule
from dissect.online.alerts.secrets import address_shown
from dissect.online.alerts.webhook import Webhook
from tests.cli.support import run

SECRET = "s3cr3t-T0ken"
RULE = '[[rule]]\nname = "r"\nwhen = "finding"\nfinding = "error"\n'


class Receiver(BaseHTTPRequestHandler):
    got: list[tuple[str, dict[str, str]]]
    code = 204

    def do_POST(self) -> None:
        self.rfile.read(int(self.headers["Content-Length"]))
        type(self).got.append((self.path, dict(self.headers.items())))
        self.send_response(type(self).code)
        self.end_headers()

    def log_message(self, format: str, *args: object) -> None:  # noqa: A002 - the name of the library
        pass


@pytest.fixture
def port() -> Iterator[int]:
    Receiver.got = []
    Receiver.code = 204
    with HTTPServer(("127.0.0.1", 0), Receiver) as http:
        thread = threading.Thread(target=http.serve_forever, kwargs={"poll_interval": 0.01})
        thread.start()
        yield http.server_port
        http.shutdown()
        thread.join()


def rules(tmp_path: Path, action: str) -> Path:
    path = tmp_path / "rules.toml"
    path.write_text(f'[[action]]\nname = "hook"\n{action}\n{RULE}actions = ["hook"]\n', encoding="utf-8")
    return path


def an_alert() -> Alert:
    return Alert(Rule("r", PROBLEM), 1, "note", None, "x", {"test": True})


def test_secrets_are_put_in(port: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "token").write_text(f"{SECRET}\n", encoding="utf-8")
    (tmp_path / "cred").write_text("from-systemd", encoding="utf-8")
    monkeypatch.setenv("CREDENTIALS_DIRECTORY", str(tmp_path))
    monkeypatch.setenv("SITE", "plant 7")
    path = rules(
        tmp_path,
        f'webhook = "http://127.0.0.1:{port}/s7?token={{credential:cred}}"\n'
        f'headers = {{ Authorization = "Bearer {{file:{tmp_path}/token}}", X-Site = "{{env:SITE}}" }}',
    )
    load_rules(path).actions["hook"].deliver(an_alert())
    ((asked, headers),) = Receiver.got
    assert asked == "/s7?token=from-systemd"
    assert (headers["Authorization"], headers["X-Site"]) == (f"Bearer {SECRET}", "plant 7")


@pytest.mark.parametrize(
    ("action", "told"),
    [
        ('webhook = "http://127.0.0.1/{env:NO_SUCH}"', "there is no 'NO_SUCH' in the environment"),
        ('webhook = "http://127.0.0.1/{credential:../x}"', "there is no credential '../x'"),
        ('webhook = "http://127.0.0.1/"\nheaders = { A = "{file:token}" }', "'token' is not an absolute path"),
        ('webhook = "http://127.0.0.1/"\nheaders = { A = "{file:/none/x}" }', "No such file or directory"),
        (
            'webhook = "http://127.0.0.1/"\nheaders = { A = "{env:LINES_TWO}" }',
            "A: a header is printable ASCII on one line",
        ),
        ('webhook = "http://127.0.0.1/"\nheaders = { Host = "x" }', "'Host' is not a header that can be set"),
        ('webhook = "http://127.0.0.1/"\nheaders = { "A b" = "x" }', "'A b' is not a header that can be set"),
        ('webhook = "http://127.0.0.1/"\nheaders = ["x"]', "must be a table"),
        ('webhook = "https://127.0.0.1/"\nca_file = "/dev/null"', "'/dev/null' contains no certificates"),
        ('webhook = "ftp://127.0.0.1/{env:LINES_TWO}"', "is not an address such as"),
    ],
)
def test_what_is_wrong_is_told_without_a_secret(
    action: str, told: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("LINES_TWO", f"{SECRET}\r\nX: y")
    monkeypatch.delenv("CREDENTIALS_DIRECTORY", raising=False)
    with pytest.raises(RuleError) as raised:
        load_rules(rules(tmp_path, action))
    assert told in str(raised.value)
    assert SECRET not in str(raised.value)


def test_a_trial_needs_no_secret(tmp_path: Path) -> None:
    path = rules(tmp_path, 'webhook = "http://127.0.0.1/{env:NO_SUCH}"\nheaders = { A = "{file:/none/x}" }')
    assert set(load_rules(path, trial=True).actions) == {"hook"}


@pytest.mark.parametrize(
    "action",
    [
        f'webhook = ["http://127.0.0.1/?token={SECRET}"]',
        f'webhook = {{ url = "http://127.0.0.1/{SECRET}" }}',
        f'webhook = "ftp://127.0.0.1/{SECRET}"',
        f'webhook = "http://user:{SECRET}@127.0.0.1/"',
        f'webhook = "http://127.0.0.1/"\nheaders = ["{SECRET}"]',
        f'webhook = "http://127.0.0.1/"\nheaders = {{ A = ["{SECRET}"] }}',
        f'webhook = "http://127.0.0.1/"\nheaders = {{ A = "{SECRET}\u00e4" }}',
        f'command = "curl -H {SECRET}"',
        f'command = ["true", {{ A = "{SECRET}" }}]',
        f'command = ["true", "{SECRET}{{nonsense}}"]',
        f'command = {{ program = "{SECRET}" }}',
    ],
)
def test_a_value_of_a_wrong_type_is_not_printed(action: str, tmp_path: Path) -> None:
    path = rules(tmp_path, action)
    with pytest.raises(RuleError) as raised:
        load_rules(path)
    assert SECRET not in str(raised.value)
    assert "[[action]]" in str(raised.value)


@pytest.mark.parametrize(
    ("url", "shown"),
    [
        ("https://alerts.example/s7?token=x#y", "https://alerts.example"),
        ("http://user:password@h:8080/x", "http://h:8080"),
        ("http://[::1]:80/x", "http://[::1]:80"),
        ("http://h:x/", "(an address)"),
        ("", "(an address)"),
        (f"file:///{SECRET}", "(an address)"),
    ],
)
def test_an_address_is_shown_without_what_may_be_secret(url: str, shown: str) -> None:
    assert address_shown(url) == shown


@pytest.mark.parametrize("code", [400, 401, 500, 302])
def test_a_refusal_shows_no_secret(code: int, port: int) -> None:
    Receiver.code = code
    with pytest.raises(DeliveryError) as told:
        Webhook("a", f"http://127.0.0.1:{port}/{SECRET}?token={SECRET}", headers={"A": SECRET}).deliver(an_alert())
    assert str(told.value) == f"http://127.0.0.1:{port}: HTTP {code}"


def test_a_receiver_that_talks_nonsense_shows_no_secret() -> None:
    with socket.create_server(("127.0.0.1", 0)) as listening:

        def answer() -> None:
            taken, _ = listening.accept()
            taken.recv(65536)
            taken.sendall(f"NONSENSE /{SECRET}?token={SECRET}\r\n\r\n".encode())
            taken.close()

        thread = threading.Thread(target=answer)
        thread.start()
        url = f"http://127.0.0.1:{listening.getsockname()[1]}/{SECRET}?token={SECRET}"
        with pytest.raises(DeliveryError) as told:
            Webhook("a", url).deliver(an_alert())
        thread.join()
    assert SECRET not in str(told.value)


# ---- the command ----------------------------------------------------------------------------------------------------


def test_every_action_is_tried(capfdbinary: pytest.CaptureFixture[bytes], port: int, tmp_path: Path) -> None:
    path = tmp_path / "rules.toml"
    path.write_text(
        f'[[action]]\nname = "hook"\nwebhook = "http://127.0.0.1:{port}/s7?token={SECRET}"\n'
        '[[action]]\nname = "good"\ncommand = ["true"]\n'
        f'[[action]]\nname = "bad"\ncommand = ["false"]\n{RULE}actions = ["hook", "bad"]\n',
        encoding="utf-8",
    )
    ran = run(capfdbinary, "alerts", "test", path)
    assert ran.code == 1
    assert ran.out.splitlines() == [
        "stderr: delivered",
        "hook: delivered",
        "good: delivered",
        "bad: not delivered: false: exit code 1",
        "used by no rule: good",
    ]
    assert "ALERT note  test alert: This is a test of s7dissect; nothing happened." in ran.err
    assert [asked for asked, _ in Receiver.got] == [f"/s7?token={SECRET}"]
    Receiver.code = 503
    ran = run(capfdbinary, "alerts", "test", path)
    assert f"hook: not delivered: http://127.0.0.1:{port}: HTTP 503" in ran.out
    assert SECRET not in ran.out + ran.err


def test_all_is_delivered(capfdbinary: pytest.CaptureFixture[bytes], port: int, tmp_path: Path) -> None:
    path = tmp_path / "rules.toml"
    path.write_text(
        f'[[action]]\nname = "hook"\nwebhook = "http://127.0.0.1:{port}/s7"\n{RULE}actions = ["hook"]\n',
        encoding="utf-8",
    )
    ran = run(capfdbinary, "alerts", "test", path)
    assert (ran.code, ran.out.splitlines()) == (0, ["stderr: delivered", "hook: delivered"])


def test_rules_that_cannot_be_used(capfdbinary: pytest.CaptureFixture[bytes], tmp_path: Path) -> None:
    path = tmp_path / "rules.toml"
    path.write_text("[[rule]]\n", encoding="utf-8")
    assert run(capfdbinary, "alerts", "test", path).code == 2
    assert run(capfdbinary, "alerts", "test", tmp_path / "none").code != 0
