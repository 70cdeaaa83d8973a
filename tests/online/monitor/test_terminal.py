"""Where the keys come from, in a terminal of our own: what runs there is the command as a person starts it."""

from __future__ import annotations

import fcntl
import os
import pty
import re
import select
import signal
import struct
import subprocess
import sys
import termios
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final

import pytest

from dissect.online.monitor import terminal
from tests.online.monitor.support import CAPTURES

_ESCAPES: Final = re.compile(rb"\x1b(\[[0-9;?<>=]*[A-Za-z]|[()][A-Z0-9]|[=>78])")


class Terminal:
    """A command in a terminal of 80 x 24 that belongs to it."""

    def __init__(self, command: str, **environment: str) -> None:
        self.seen = b""
        self.master, slave = pty.openpty()
        fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 80, 0, 0))
        self.process = subprocess.Popen(
            ["setsid", "--ctty", "--wait", "sh", "-c", command],
            stdin=slave,
            stdout=slave,
            stderr=slave,
            env={**os.environ, "TERM": "xterm", "PYTHON": sys.executable, "COLUMNS": "", "LINES": "", **environment},
        )
        os.close(slave)

    def until(self, what: Callable[[str], bool], seconds: float = 60) -> str:
        """Read what is written until it suits."""
        end = time.monotonic() + seconds
        while not what(self.text):
            assert time.monotonic() < end, self.text[-2000:]
            if select.select([self.master], [], [], 0.1)[0]:
                try:
                    self.seen += os.read(self.master, 65536)
                except OSError:  # the other end is closed
                    break
        assert what(self.text), self.text[-2000:]
        return self.text

    @property
    def text(self) -> str:
        return _ESCAPES.sub(b"", self.seen).decode("utf-8", "replace")

    def press(self, keys: bytes) -> None:
        os.write(self.master, keys)

    def end(self) -> None:
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait()
        os.close(self.master)


CAPTURE: Final = CAPTURES / "nodes7-poll-missing.pcapng"


@pytest.mark.parametrize(
    "command",
    [
        f"$PYTHON -m dissect monitor {CAPTURE}; echo code=$?",
        f"cat {CAPTURE} | $PYTHON -m dissect monitor -; echo code=$?",
    ],
    ids=["file", "pipe"],
)
def test_keys_come_from_the_terminal(command: str) -> None:
    ours = Terminal(command)
    try:
        ours.until(lambda text: "TRANSACTIONS" in text and "has ended" in text)
        ours.press(b"q")
        told = ours.until(lambda text: "code=" in text)
        assert "code=0" in told
        assert "18 packets, 1 connection, 3 transactions (2 with errors), 4 findings" in told
    finally:
        ours.end()


def test_sigterm_gives_the_summary_and_the_code() -> None:
    ours = Terminal(f"$PYTHON -m dissect monitor {CAPTURE} & pid=$!; echo pid=$pid; wait $pid; echo code=$?")
    try:
        ours.until(lambda text: "has ended" in text)
        match = re.search(r"pid=(\d+)", ours.text)
        assert match is not None
        os.kill(int(match[1]), signal.SIGTERM)
        told = ours.until(lambda text: "code=" in text)
        assert "code=130" in told
        assert "18 packets, 1 connection" in told
    finally:
        ours.end()


def test_what_becomes_of_alerts_is_said_when_the_screens_are_left(tmp_path: Path) -> None:
    rules = tmp_path / "rules.toml"
    rules.write_text(
        f'[[action]]\nname = "hook"\nwebhook = "http://127.0.0.1:9/"\nspool = "{tmp_path}"\n'
        '[[rule]]\nname = "r"\nwhen = "finding"\nfinding = "warning"\nactions = ["hook"]\n',
        encoding="utf-8",
    )
    ours = Terminal(f"(cat {CAPTURE}; sleep 60) | $PYTHON -m dissect monitor - --alerts {rules}")
    try:
        ours.until(lambda text: "Connection refused" in text)
        ours.press(b"q")
        ours.until(lambda text: re.search(r"(?<!PROBLEM )alerts: action hook: \d alerts? waits? in ", text) is not None)
    finally:
        ours.end()


def test_a_dumb_terminal_gets_lines() -> None:
    ours = Terminal(f"$PYTHON -m dissect monitor {CAPTURE}; echo code=$?", TERM="dumb")
    try:
        told = ours.until(lambda text: "code=" in text)
        assert "code=0" in told
        assert b"\x1b" not in ours.seen
        assert "granted PDU 960, AmQ 8/8" in told
    finally:
        ours.end()


def test_a_choice_of_lines_is_not_lost_on_the_screens() -> None:
    ours = Terminal(f"$PYTHON -m dissect monitor {CAPTURE} --only findings; echo code=$?")
    try:
        told = ours.until(lambda text: "code=" in text)
        assert "code=2" in told
        assert "--only is for lines, and the screens show everything: add --plain" in " ".join(told.split())
    finally:
        ours.end()


def test_where_there_is_no_terminal_it_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(terminal, "_TERMINAL", "/dev/null/nothing")
    monkeypatch.setattr("sys.stdin", open(os.devnull, encoding="ascii"))  # noqa: PTH123, SIM115
    with pytest.raises(terminal.NoKeyboardError, match="/dev/null/nothing"), terminal.keyboard():
        pass
    sys.stdin.close()
