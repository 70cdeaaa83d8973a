"""Protocols that are not ours: connections that are only counted, and messages inside ISO-on-TCP that are only named."""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.engine.exchange import Exchange
from dissect.iso.foreign import identify
from dissect.iso.upper import RDP, S7COMM_PLUS, TLS, UNKNOWN, UPPER_NAMES
from dissect.tls.handshake import chosen_version
from dissect.transactions.connection import FOREIGN, ISO_TSAP_PORT, Connection
from dissect.transactions.protocol import Protocol
from dissect.transactions.table import Side

#: Before the version in `Connection.identified_by` that a ServerHello chose.
_CHOSE: Final = ", the server chose "


def on_102(side: Side) -> bool:
    """Tell whether a connection uses the port that ISO-on-TCP is registered on."""
    ends = side.tcp.ends
    return ends[0].port == ISO_TSAP_PORT or ends[1].port == ISO_TSAP_PORT


class Foreign(Protocol):
    """Names what is not S7, by what identifies it. Of a connection that is given to it, octets are counted, nothing more."""

    def __init__(self, exchange: Exchange) -> None:
        super().__init__(FOREIGN)
        self._exchange: Exchange = exchange
        self._named: set[int] = set()  # (connection, protocol) pairs that were reported

    def take(self, side: Side, name: str, frame: i64, time_ns: i64, identity: str = "") -> None:
        """Another protocol: its packets are counted from now on. ``identity`` says what it was identified by."""
        connection = side.connection
        side.speak(self)
        connection.protocol = name
        connection.identified_by = identity or connection.identified_by
        if on_102(side):
            self._note(connection, name, connection.identified_by, frame, time_ns)

    def feed(self, side: Side, buf: bytes, at: i64, size: i64, frame: i64, time_ns: i64) -> None:
        """Count octets of a connection that speaks something else."""
        if side.connection.protocol == UPPER_NAMES[TLS]:
            if side.index != side.connection.client_side:
                side.connection.last_encrypted_ns = time_ns
            self._version(side, buf, at, at + size)
        side.framer.skipped += size

    def tsdu(self, side: Side, upper: i64, buf: bytes, at: i64, size: i64, frame: i64, time_ns: i64) -> None:
        """Name a TSDU of protocol ``upper``; on port 102 that is reported once for a protocol and connection."""
        connection = side.connection
        name = UPPER_NAMES[upper]
        if upper == TLS:
            self._version(side, buf, at, at + size)
        if name in {"empty", connection.protocol}:
            return
        key: i64 = connection.number * len(UPPER_NAMES) + upper
        fresh: bool = connection.protocol == "" or connection.protocol == UPPER_NAMES[UNKNOWN]
        if not fresh and key in self._named:
            return
        identity = identify(upper, buf, at, at + size)
        if upper == RDP and connection.pdus == 0:
            self.take(side, name, frame, time_ns, identity)  # what it says besides TPKTs is no fault of framing
            return
        if fresh:
            connection.protocol = name
            connection.identified_by = identity
        if (upper == UNKNOWN and side.holes) or key in self._named:
            return  # the rest of a message whose beginning is missing, or reported before
        self._named.add(key)
        if upper == TLS and connection.protocol == UPPER_NAMES[S7COMM_PLUS]:
            after = "InitSSL" if connection.identified_by == "InitSSL" else "S7comm-plus"
            connection.identified_by = f"{after}, then {identity}"
            self._exchange.reporter.note(
                "session.encrypted", connection.number, [frame], time_ns, f"{identity}, after {after}"
            )
            return
        if on_102(side):
            self._note(connection, name, identity, frame, time_ns)

    def _version(self, side: Side, buf: bytes, at: i64, end: i64) -> None:
        """Take the version that a ServerHello of TLS chooses for the session."""
        connection = side.connection
        chosen = chosen_version(buf, at, end)
        if chosen and _CHOSE not in connection.identified_by:
            connection.identified_by = f"{connection.identified_by}{_CHOSE}{chosen}".removeprefix(", ")

    def forget(self, connection: Connection) -> None:
        """A connection is over: its number may be forgotten."""
        for upper in range(len(UPPER_NAMES)):
            self._named.discard(connection.number * len(UPPER_NAMES) + upper)

    def _note(self, connection: Connection, name: str, identity: str, frame: i64, time_ns: i64) -> None:
        detail = f"{name}: {identity}" if identity else name
        self._exchange.reporter.note("session.foreign_on_102", connection.number, [frame], time_ns, detail)
