"""`Action`: the base class of all actions that deliver alerts.

`dissect.online.alerts.loading` makes an action of each [[action]] table.
"""

from __future__ import annotations

import sys
from abc import ABC, abstractmethod
from collections.abc import Callable
from pathlib import Path

from dissect.online.alerts.alert import Alert
from dissect.wire.text import reason


class DeliveryError(Exception):
    """An alert could not be delivered; the message says why."""


class RefusedError(DeliveryError):
    """The receiver refused an alert for good: a retry would not help."""


class Action(ABC):
    """Delivers alerts, one at a time in each of ``parallel`` threads. ``name`` is its name in rules."""

    def __init__(self, name: str, parallel: int = 1) -> None:
        self.name = name
        self.parallel = parallel

    @abstractmethod
    def deliver(self, alert: Alert) -> None:
        """Deliver an alert, within a bounded time. Raises `DeliveryError`."""

    def close(self) -> None:  # noqa: B027 - most actions hold nothing
        """Break off deliveries, and release resources."""


class Posting(Action):
    """Sends alerts to a receiver that may be down for a while: they wait in the folder ``spool``, None for the default one."""

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


def is_there(path: str) -> bool:
    """Return whether a file exists."""
    try:
        return Path(path).exists()
    except (OSError, ValueError):
        return False
