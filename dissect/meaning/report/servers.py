"""The servers of a run: their connections and PDUs, and the outcomes of the requests that they got."""

from __future__ import annotations

from typing import Final

from dissect.engine.transactions.connection import Connection
from dissect.packets.tcp.link import within

#: Servers with PDUs that are told apart, and as many without any; connections of further ones are counted in one number.
MAX_SERVERS: Final = 10_000


class Server:
    """The connections of a server by its address ``host``, in a VLAN if ``vlan`` is above 0."""

    __slots__ = (
        "answered", "connections", "errors", "host", "missed", "not_captured", "pdus", "still_open", "vlan",
    )  # fmt: skip

    def __init__(self, host: str, vlan: int) -> None:
        self.host = host
        self.vlan = vlan
        self.connections = 0
        self.pdus = 0
        self.answered = 0
        self.errors = 0
        self.missed = 0
        self.still_open = 0
        self.not_captured = 0

    def __repr__(self) -> str:
        return f"Server({within(self.host, self.vlan)}, {self.connections} connections, {self.pdus} PDUs)"

    def take(self, connection: Connection) -> None:
        """Count a connection that is over."""
        self.connections += 1
        self.pdus += int(connection.pdus)
        self.answered += int(connection.answered)
        self.errors += int(connection.errors)
        self.missed += int(connection.missed)
        self.still_open += int(connection.still_open)
        self.not_captured += int(connection.not_captured)

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

    def __init__(self) -> None:
        self.found: dict[str, Server] = {}
        self.silent: dict[str, Server] = {}
        self.further = 0

    def __repr__(self) -> str:
        return f"Servers({len(self.found)})"

    def take(self, connection: Connection) -> None:
        """Count a connection that is over."""
        server = self._of(connection.server.host, int(connection.tcp.vlan), int(connection.pdus))
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

    def _of(self, host: str, vlan: int, pdus: int) -> Server | None:
        """Return the record of a server, on which ``pdus`` more were seen; None if there is no room for it."""
        name = within(host, vlan)
        server = self.found.get(name)
        if server is not None:
            return server
        if pdus:
            server = self.silent.pop(name, None)
            if len(self.found) >= MAX_SERVERS:
                return None
            server = self.found[name] = server or Server(host, vlan)
            return server
        server = self.silent.get(name)
        if server is None and len(self.silent) < MAX_SERVERS:
            server = self.silent[name] = Server(host, vlan)
        return server
