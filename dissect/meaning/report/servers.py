"""The servers of a run: their connections and PDUs, and the outcomes of the requests that they got."""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.engine.transactions.connection import Connection
from dissect.packets.tcp.link import within
from dissect.wire.copies import leaves

#: Servers with PDUs that are told apart, and as many without any; connections of further ones are counted in one number.
MAX_SERVERS: Final = 10_000


class Server:
    """The connections of a server by its address ``host``, in a VLAN if ``vlan`` is above 0."""

    __slots__ = (
        "answered", "connections", "errors", "host", "missed", "not_captured", "pdus", "still_open", "vlan",
    )  # fmt: skip

    def __init__(self, host: str, vlan: i64) -> None:
        self.host = host
        self.vlan = vlan
        self.connections: i64 = 0
        self.pdus: i64 = 0
        self.answered: i64 = 0
        self.errors: i64 = 0
        self.missed: i64 = 0
        self.still_open: i64 = 0
        self.not_captured: i64 = 0

    def __repr__(self) -> str:
        return f"Server({within(self.host, self.vlan)}, {self.connections} connections, {self.pdus} PDUs)"

    def take(self, connection: Connection) -> None:
        """Count a connection that is over."""
        self.connections += 1
        self.pdus += connection.pdus
        self.answered += connection.answered
        self.errors += connection.errors
        self.missed += connection.missed
        self.still_open += connection.still_open
        self.not_captured += connection.not_captured

    def merge(self, other: Server) -> None:
        """Add the connections of ``other``."""
        self.connections += other.connections
        self.pdus += other.pdus
        self.answered += other.answered
        self.errors += other.errors
        self.missed += other.missed
        self.still_open += other.still_open
        self.not_captured += other.not_captured


class Servers:
    """The servers of a run: ``found`` by name, ``further`` counts the connections of those that did not fit.

    A server on whose connections nothing was said is in ``silent``, until something is: a scan finds thousands.
    """

    def __init__(self, most: int = MAX_SERVERS) -> None:
        self._most = most
        self.found: dict[str, Server] = {}
        self.silent: dict[str, Server] = {}
        self.further: i64 = 0

    def __repr__(self) -> str:
        return f"Servers({len(self.found)})"

    def take(self, connection: Connection) -> None:
        """Count a connection that is over."""
        server = self._of(connection.server.host, connection.tcp.vlan, connection.pdus)
        if server is not None:
            server.take(connection)
        elif connection.pdus:
            self.further += 1

    def merge(self, other: Servers) -> None:
        """Add those of another run."""
        for one in (*other.found.values(), *other.silent.values()):
            server = self._of(one.host, one.vlan, one.pdus)
            if server is not None:
                server.merge(one)
            elif one.pdus:
                self.further += one.connections
        self.further += other.further

    def _of(self, host: str, vlan: i64, pdus: i64) -> Server | None:
        """Return the record of a server, on which ``pdus`` more were seen; None if there is no room for it."""
        name = within(host, vlan)
        server = self.found.get(name)
        if server is not None:
            return server
        if pdus:
            server = self.silent.pop(name, None)
            if len(self.found) >= self._most:
                return None
            server = self.found[name] = server or Server(host, vlan)
            return server
        server = self.silent.get(name)
        if server is None and len(self.silent) < self._most:
            server = self.silent[name] = Server(host, vlan)
        return server


leaves(Server, Servers)
