"""The action that writes to syslog, RFC 5424: to the socket of this machine, or by UDP to this machine or an allowed host."""

from __future__ import annotations

import logging
import os
import re
import socket
from logging.handlers import SysLogHandler
from typing import Final

from dissect.engine.findings.catalogue import ERROR, NOTE
from dissect.online.alerts.actions import Action, DeliveryError, is_there
from dissect.online.alerts.alert import Alert
from dissect.online.alerts.hosts import allowed, split_host
from dissect.scd.errors import shown
from dissect.scd.reading import Table
from dissect.wire.text import Clock, reason

_APP: Final = "s7dissect"
#: Characters that a host name in a message must not have.
_UNPRINTED: Final = re.compile(r"[^!-~]")
_FACILITIES: Final = ("user", "daemon", *[f"local{number}" for number in range(8)])
#: Log levels, from which the handler derives the severities of RFC 5424.
_LEVELS: Final = {ERROR: logging.ERROR, NOTE: logging.INFO}


class _Sender(SysLogHandler):
    """A handler that raises errors to the caller instead of writing them to stderr."""

    append_nul = False

    def handleError(self, record: logging.LogRecord) -> None:  # noqa: N802 - the name of the library
        """Raise the error again: the library calls this while it handles it."""
        raise  # noqa: PLE0704


class Syslog(Action):
    """Sends alerts to a syslog: to the path of its socket, or to (host, port) by UDP."""

    def __init__(self, name: str, address: str | tuple[str, int], facility: str = "daemon") -> None:
        super().__init__(name)
        self._address = address
        self._facility = facility
        self._sender: _Sender | None = None
        self._host = _UNPRINTED.sub("-", socket.gethostname())[:255] or "-"

    def deliver(self, alert: Alert) -> None:
        """Send the alert. Raises `DeliveryError`; the next one connects again."""
        try:
            if self._sender is None:
                self._sender = _Sender(self._address, self._facility)
            level = _LEVELS.get(alert.severity, logging.WARNING)
            self._sender.emit(logging.LogRecord(_APP, level, "", 0, self._message(alert), None, None))
        except (OSError, ValueError) as error:
            self.close()
            where = self._address if isinstance(self._address, str) else f"{self._address[0]}:{self._address[1]}"
            raise DeliveryError(f"syslog {where}: {reason(error)}") from None

    def close(self) -> None:
        """Close the socket."""
        if self._sender is not None:
            self._sender.close()
            self._sender = None

    def _message(self, alert: Alert) -> str:
        """Return the message after the priority: version, time, host, application, process, kind, no structured data, text."""
        time = Clock().iso(alert.time_ns)[:26] + "Z"  # six digits at most
        client, server = alert.pair if alert.pair is not None else ("-", "-")
        text = f"{alert.severity} {client} > {server} {alert.message()}"
        return f"1 {time} {self._host} {_APP} {os.getpid()} {alert.rule.when} - {text}"


def syslog_of(table: Table, name: str, hosts: frozenset[str], trial: bool = False) -> Syslog:
    """Return the action of a table; raises `DictionaryError`. For a ``trial``, the socket need not exist."""
    written = table.text("syslog")
    facility = table.choice("facility", _FACILITIES, "daemon")
    if written.startswith("/"):
        if not trial and not is_there(written):
            raise table.fail("syslog", f"there is no {shown(written)}")
        return Syslog(name, written, facility)
    place = split_host(written, 514)
    if place is None:
        raise table.fail("syslog", f'{shown(written)} is neither the path of a socket nor "HOST:PORT" for UDP')
    if not allowed(place[0], hosts):
        raise table.fail("syslog", f"{place[0]} is not this machine: name it in allow_hosts at the top of the file")
    return Syslog(name, place, facility)
