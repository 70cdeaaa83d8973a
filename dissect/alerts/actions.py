"""What can be done with an alert: a line on stderr, a program, syslog, a webhook. Each is written in an [[action]]."""

from __future__ import annotations

import sys
from abc import ABC, abstractmethod
from collections.abc import Callable
from pathlib import Path
from typing import Final

from dissect.alerts.alert import Alert
from dissect.scd.reading import Table
from dissect.wire.text import reason

_KINDS: Final = ("command", "syslog", "webhook")
#: Programs or requests of one action at a time.
MAX_PARALLEL: Final = 8


class DeliveryError(Exception):
    """An alert did not get where it should; the text says why."""


class RefusedError(DeliveryError):
    """An alert was refused for good: to try again would not help."""


class Action(ABC):
    """Delivers alerts, one at a time in each of ``parallel`` threads. ``name`` is what rules call it."""

    def __init__(self, name: str, parallel: int = 1) -> None:
        self.name = name
        self.parallel = parallel

    @abstractmethod
    def deliver(self, alert: Alert) -> None:
        """Deliver an alert, within a bounded time. Raises `DeliveryError`."""

    def close(self) -> None:  # noqa: B027 - most actions hold nothing
        """Break off what is being delivered, and give back what is held."""


class Posting(Action):
    """Sends octets to a receiver that may be down for a while: they wait in the folder ``spool``, None for the usual one."""

    def __init__(self, name: str, parallel: int = 1, spool: Path | None = None) -> None:
        super().__init__(name, parallel)
        self.spool = spool

    def deliver(self, alert: Alert) -> None:
        """Post an alert now. Raises `DeliveryError`."""
        self.post(alert.as_json().encode("ascii"))

    @abstractmethod
    def post(self, content: bytes) -> None:
        """Post an alert as JSON, within a bounded time. Raises `DeliveryError`, `RefusedError` when it is refused for good."""


class Printed(Action):
    """Writes lines; by default to stderr."""

    def __init__(self, name: str, write: Callable[[str], None] | None = None) -> None:
        super().__init__(name)
        self._write = write if write is not None else to_stderr

    def deliver(self, alert: Alert) -> None:
        """Write the alert as a line."""
        self._write(alert.line())


def to_stderr(line: str) -> None:
    """Write a line to stderr, if there is one."""
    if sys.stderr is not None:
        try:
            print(line, file=sys.stderr, flush=True)  # noqa: T201 - this is what it is for
        except (OSError, ValueError) as error:
            raise DeliveryError(f"stderr cannot be written: {reason(error)}") from None


def action_of(table: Table, name: str, hosts: frozenset[str], timeout: float, trial: bool = False) -> Action:
    """Return the action of a table; raises `DictionaryError`. ``hosts`` are those that may be told besides this machine.

    A ``trial`` sends nothing, so neither the program nor the socket has to be there.
    """
    keys = [key for key in _KINDS if table.has(key)]
    if len(keys) != 1:
        told = "is missing" if not keys else "exclude each other: use one table for each"
        raise table.fail(", ".join(keys or _KINDS), told)
    parallel = table.number("parallel", 1)
    if not 1 <= parallel <= MAX_PARALLEL:
        raise table.fail("parallel", f"{parallel} is outside 1 to {MAX_PARALLEL}")
    if keys[0] == "command":
        from dissect.alerts.command import command_of

        return command_of(table, name, timeout, parallel, trial)
    if keys[0] == "syslog":
        from dissect.alerts.syslog import syslog_of

        return syslog_of(table, name, hosts, trial)
    from dissect.alerts.webhook import webhook_of

    return webhook_of(table, name, hosts, timeout, parallel)


def is_there(path: str) -> bool:
    """Tell whether a file is there."""
    try:
        return Path(path).exists()
    except (OSError, ValueError):
        return False
