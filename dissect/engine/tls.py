"""TLS inside ISO-on-TCP: the content of its handshake, and, if the session keys are known, the S7 messages in it.

An S7-1200 or 1500 answers InitSSL from TIA Portal V17 or later, and continues in TLS. Each TSDU then carries TLS records, whose
content is S7comm-plus (docs/tls.md).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from mypy_extensions import i64

from dissect.engine.connections import Foreign
from dissect.engine.exchange import Exchange
from dissect.engine.findings.tls_rules import judge_certificates, judge_closed, judge_session
from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.protocol import Protocol
from dissect.engine.transactions.side import Side
from dissect.protocols.iso.upper import S7COMM, S7COMM_PLUS, TLS, UPPER_NAMES, classify, is_sound
from dissect.protocols.s7plus.stream import FrameStream
from dissect.protocols.tls.key_log import KeyLog, KeyRing

if TYPE_CHECKING:
    from dissect.protocols.tls.session import TlsSession, Waiting


class Tls(Protocol):
    """Takes TSDUs with TLS.

    Counts connections with TLS (``sessions``), decrypted records (``opened``) and records that stay encrypted (``shut``).
    """

    def __init__(self, exchange: Exchange, foreign: Foreign, s7: Protocol, plus: Protocol, keys: KeyLog | None) -> None:
        super().__init__()
        self._exchange: Exchange = exchange
        self._foreign: Foreign = foreign
        self._s7: Protocol = s7
        self._plus: Protocol = plus
        self._waiting: Waiting | None = None
        self.keys: KeyRing = KeyRing(keys)
        self.more_keys: i64 = 0  # keys found by other runs, whose counts were added to these
        self.sessions: i64 = 0
        self.decrypted: i64 = 0  # sessions with decrypted content
        self.opened: i64 = 0
        self.shut: i64 = 0
        self.other: i64 = 0  # decrypted messages that are neither S7comm nor S7comm-plus

    def secrets(self, text: bytes) -> None:
        """Take a key log that the capture contains."""
        self.keys.found.add(text)

    def wants(self, side: Side, session: TlsSession, buf: bytes, at: i64, size: i64) -> bool:
        """Return whether a TSDU belongs to the TLS session of its connection; a sound S7 PDU never does."""
        return not is_sound(buf, at, at + size) and session.wants(side.index, buf, at, at + size)

    def feed(self, side: Side, buf: bytes, at: i64, size: i64, frame: i64, time_ns: i64) -> None:
        """Take a TSDU of TLS: records, or parts of records."""
        connection = side.connection
        if classify(buf, at, at + size) == TLS:
            self._foreign.tsdu(side, TLS, buf, at, size, frame, time_ns)
        session = connection.tls
        if session is None:
            session = self._begin(connection)
        version: int = session.version
        found = session.feed(side.index, buf[at : at + size], frame, time_ns)
        if side.index != connection.client_side and not found:
            connection.last_encrypted_ns = time_ns
        if session.version != version:
            judge_session(self._exchange.reporter, connection, session, frame, time_ns)
        if session.shown:
            judge_certificates(self._exchange.reporter, connection, session, frame, time_ns)
        peer = side.peer
        for content in found:
            end = side if content.index == side.index else peer
            if end is not None and content.frame == frame:
                self._content(end, content.octets, frame, time_ns)
            elif end is not None:
                self._waited(end, content.octets, content.frame, content.time_ns)

    def _waited(self, side: Side, octets: bytes, frame: i64, time_ns: i64) -> None:
        """Take data of an earlier packet, whose keys came later: what that packet acknowledged is no longer known."""
        ack: i64 = side.last_ack
        side.last_ack = -1
        try:
            self._content(side, octets, frame, time_ns)
        finally:
            side.last_ack = ack

    def _begin(self, connection: Connection) -> TlsSession:
        from dissect.protocols.tls.session import TlsSession, Waiting

        waiting = self._waiting
        if waiting is None:
            waiting = Waiting()
            self._waiting = waiting
        session = TlsSession(self.keys, waiting)
        connection.tls = session
        self.sessions += 1
        return session

    def _content(self, side: Side, octets: bytes, frame: i64, time_ns: i64) -> None:
        """Take decrypted application data of ``side``."""
        stream = side.inner
        if stream is None:
            stream = FrameStream()
            side.inner = stream
        for message in stream.push(octets):
            self._message(side, message, frame, time_ns)

    def _message(self, side: Side, message: bytes, frame: i64, time_ns: i64) -> None:
        upper = classify(message, 0, len(message))
        connection = side.connection
        if upper == S7COMM_PLUS or upper == S7COMM:
            if connection.protocol == UPPER_NAMES[TLS]:
                connection.protocol = UPPER_NAMES[upper]
            (self._plus if upper == S7COMM_PLUS else self._s7).feed(side, message, 0, len(message), frame, time_ns)
        else:
            self.other += 1
            self._foreign.inside(side, upper, message, frame, time_ns)

    def gap(self, side: Side, size: i64, cut: bool, frame: i64, time_ns: i64) -> None:
        """Octets are missing: the current record, and the frame in it, stay incomplete."""
        session = side.connection.tls
        if session is not None:
            session.lose(side.index, size)
            self._cut(side, frame, time_ns)

    def _cut(self, side: Side, frame: i64, time_ns: i64) -> None:
        stream = side.inner
        rest = stream.finish() if stream is not None else b""
        if rest:
            self._message(side, rest, frame, time_ns)

    def finish(self, side: Side, frame: i64, time_ns: i64) -> None:
        """No more octets come: use what there is of an unfinished frame."""
        self._cut(side, frame, time_ns)

    def end(self, side: Side, frame: i64, time_ns: i64) -> None:
        """The connection is over: report why records stayed encrypted. Called for both sides, but acts only once."""
        side.inner = None
        connection = side.connection
        session = connection.tls
        if session is None or side.index:
            return
        session.close()
        self.shut += session.shut
        self.opened += session.opened
        if session.is_open:
            self.decrypted += 1
        judge_closed(self._exchange.reporter, connection, session, frame, time_ns)

    def held(self, side: Side) -> i64:
        """Return the octets of unfinished records and frames; those kept for both sides count for side 0."""
        session = side.connection.tls
        if session is None:
            return 0
        stream = side.inner
        held: i64 = stream.held if stream is not None else 0
        return held + (session.held if side.index == 0 else 0)

    # ---- what was counted -------------------------------------------------------------------------------------------

    def describe(self) -> dict[str, object]:
        """Return the section ``tls``: it never has a key, only the number of keys."""
        keys = self.keys
        return {
            "tls": {
                "sessions": self.sessions,
                "decrypted": self.decrypted,
                "records_opened": self.opened,
                "records_closed": self.shut,
                "other_messages": self.other,
                "keys_of_sessions": len(keys) + self.more_keys,
            }
        }
