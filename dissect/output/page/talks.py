"""The pairs of hosts that talked: how much, and the most severe finding of each pair."""

from __future__ import annotations

from collections import OrderedDict
from typing import Final

from dissect.engine.findings.catalogue import SEVERITIES
from dissect.engine.transactions.connection import Connection
from dissect.output.page.rows import octets_of

#: Maximum number of pairs of client and server that are kept.
MAX_PAIRS: Final = 1000
#: This many finished connections are remembered, because findings about them may still come.
_RECENT: Final = 4096


class Pair:
    """The traffic of a client and a server on all their connections. ``worst`` is a severity, empty without findings."""

    __slots__ = ("connections", "errors", "missed", "octets", "pdus", "worst")

    def __init__(self) -> None:
        self.connections = 0
        self.pdus = 0
        self.octets = 0
        self.errors = 0
        self.missed = 0
        self.worst = ""

    def note(self, severity: str) -> None:
        """Take the severity of a finding."""
        self.worst = worse(self.worst, severity)


def worse(one: str, other: str) -> str:
    """Return the worse of two severities; empty means none."""
    if not one or not other:
        return one or other
    return min(one, other, key=SEVERITIES.index)


class Talks:
    """The pairs of a run."""

    def __init__(self) -> None:
        self.pairs: dict[tuple[str, str, int], Pair] = {}  # by client, server and their VLAN
        self.not_told_apart = 0
        self._waiting: dict[int, str] = {}
        self._over: OrderedDict[int, Pair] = OrderedDict()

    def finding(self, connection: int, severity: str) -> None:
        """Take the severity of a finding on a connection, which may be open or over."""
        over = self._over.get(connection)
        if over is not None:
            over.note(severity)
        elif connection in self._waiting or len(self._waiting) < _RECENT:
            self._waiting[connection] = worse(self._waiting.get(connection, ""), severity)

    def over(self, connection: Connection) -> None:
        """Take a finished connection."""
        number = int(connection.number)
        key = (str(connection.client.host), str(connection.server.host), int(connection.tcp.vlan))
        pair = self.pairs.get(key)
        if pair is None:
            if len(self.pairs) >= MAX_PAIRS:
                self.not_told_apart += 1
                return
            pair = self.pairs.setdefault(key, Pair())
        pair.connections += 1
        pair.pdus += int(connection.pdus)
        pair.octets += octets_of(connection)
        pair.errors += int(connection.errors)
        pair.missed += int(connection.missed)
        pair.note(self._waiting.pop(number, ""))
        self._over[number] = pair
        if len(self._over) > _RECENT:
            del self._over[next(iter(self._over))]
