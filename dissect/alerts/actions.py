"""What can be done with an alert. `dissect.alerts.loading` makes an action from each [[action]] table; this is what all are."""

from __future__ import annotations

import sys
from abc import ABC, abstractmethod
from collections.abc import Callable
from pathlib import Path

from dissect.alerts.alert import Alert
from dissect.wire.text import reason


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


def is_there(path: str) -> bool:
    """Return whether a file is there."""
    try:
        return Path(path).exists()
    except (OSError, ValueError):
        return False
