"""The action that runs a program: without a shell, with the alert as JSON on stdin, a time limit and a minimal environment."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
import threading
from contextlib import suppress
from typing import Final

from dissect.online.alerts.actions import Action, DeliveryError
from dissect.online.alerts.alert import Alert
from dissect.scd.errors import shown
from dissect.scd.reading import Table
from dissect.wire.text import Clock, printable, reason

_PLACEHOLDER: Final = re.compile(r"\{([A-Za-z_]+)\}")
#: Placeholders in arguments: the user's own texts, numbers, and addresses, which are made from octets. Text from the wire is
#: never put into arguments, only into the JSON.
PLACEHOLDERS: Final = ("rule", "when", "severity", "time", "client", "server", "connection", "repeated")
_MAX_ARGUMENTS: Final = 64
#: The environment variables that a program gets.
_KEPT: Final = ("PATH", "LANG", "LC_ALL", "TZ")


class Command(Action):
    """Runs a program for each alert and waits for it, ``timeout`` seconds at most; then its process group is killed."""

    def __init__(self, name: str, arguments: tuple[str, ...], timeout: float = 10.0, parallel: int = 1) -> None:
        super().__init__(name, parallel)
        self._arguments = arguments
        self._timeout = timeout
        self._lock = threading.Lock()
        self._running: set[subprocess.Popen[bytes]] = set()
        self._closed = False

    def deliver(self, alert: Alert) -> None:
        """Run the program. Raises `DeliveryError` when it cannot be run, fails, or takes too long."""
        arguments = [self._arguments[0], *[filled(argument, alert) for argument in self._arguments[1:]]]
        program = printable(os.path.basename(arguments[0]))  # noqa: PTH119 - the text is kept as the user wrote it
        with self._lock:
            if self._closed:
                raise DeliveryError(f"{program}: not started, alerting has ended")
            try:
                process = subprocess.Popen(
                    arguments,
                    stdin=subprocess.PIPE,
                    stdout=subprocess.DEVNULL,
                    stderr=subprocess.DEVNULL,
                    cwd="/",
                    env={key: os.environ[key] for key in _KEPT if key in os.environ},
                    start_new_session=True,
                )
            except (OSError, ValueError) as error:
                raise DeliveryError(f"{program}: {getattr(error, 'strerror', None) or error}") from None
            self._running.add(process)
        try:
            process.communicate(alert.as_json().encode("ascii") + b"\n", self._timeout)
        except subprocess.TimeoutExpired:
            _kill(process)
            raise DeliveryError(f"{program}: took more than {self._timeout:g} s and was killed") from None
        except OSError as error:
            _kill(process)
            raise DeliveryError(f"{program}: {reason(error)}") from None
        finally:
            with self._lock:
                self._running.discard(process)
        if process.returncode:
            raise DeliveryError(f"{program}: exit code {process.returncode}")

    def close(self) -> None:
        """Kill the programs that still run."""
        with self._lock:
            self._closed = True
            for process in self._running:
                _kill_group(process)


def _kill(process: subprocess.Popen[bytes]) -> None:
    _kill_group(process)
    if process.stdin is not None:
        with suppress(OSError):
            process.stdin.close()
    process.wait()


def _kill_group(process: subprocess.Popen[bytes]) -> None:
    """Kill a program and the programs it started (its process group), unless it has ended: then the group may be another's."""
    if process.poll() is not None:
        return
    if sys.platform == "win32":
        process.kill()
        return
    with suppress(OSError):
        os.killpg(process.pid, signal.SIGKILL)


def filled(argument: str, alert: Alert) -> str:
    """Return an argument with the placeholders of `PLACEHOLDERS` filled in."""
    client, server = alert.pair if alert.pair is not None else ("", "")
    values = {
        "rule": alert.rule.name,
        "when": alert.rule.when,
        "severity": alert.severity,
        "time": Clock().iso(alert.time_ns),
        "client": client,
        "server": server,
        "connection": str(alert.connection),
        "repeated": str(alert.repeated),
    }
    return _PLACEHOLDER.sub(lambda match: values[match[1]], argument)


def command_of(table: Table, name: str, timeout: float, parallel: int, trial: bool = False) -> Command:
    """Return the action of a table; raises `DictionaryError`. For a ``trial`` the program need not be there."""
    # It is not printed at all, because an argument may be a token.
    if not isinstance(table.content.get("command"), list):
        raise table.fail("command", 'must be a list of texts, ["PROGRAM", "ARGUMENT"]; no shell is used')
    arguments = table.items("command")
    if not 1 <= len(arguments) <= _MAX_ARGUMENTS:
        raise table.fail(
            "command", f'must be a list of 1 to {_MAX_ARGUMENTS} texts, ["PROGRAM", "ARGUMENT"]; no shell is used'
        )
    for number, argument in enumerate(arguments, 1):
        if not isinstance(argument, str) or "\0" in argument:
            raise table.fail("command", f"entry {number} is not a text")
        for placeholder in _PLACEHOLDER.findall(argument):
            if placeholder not in PLACEHOLDERS:
                known = ", ".join([f"{{{one}}}" for one in PLACEHOLDERS])
                raise table.fail("command", f"{{{placeholder}}} is not a placeholder; known: {known}")
    program = arguments[0] if trial else shutil.which(arguments[0])
    if program is None:
        raise table.fail("command", f"{shown(arguments[0])} is not an executable program")
    return Command(name, (os.path.abspath(program), *arguments[1:]), timeout, parallel)  # noqa: PTH100 - links stay
