"""Connections from their first data to their end: each one gets a protocol and a number, and is closed properly at the end.

Every connection begins with `Recognition`. The first octets show the protocol, on any port (docs/decisions/0005): a supported
protocol gets the connection by `Connections.open`, any other connection goes to `Foreign`, which only counts connections and
names the messages that it finds inside ISO-on-TCP. `Connections.end` closes what is still open, in the only order that reports
nothing twice: first the buffers, then the judgement of the ending, then the open requests, and the observer last.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from mypy_extensions import i64

from dissect.engine.counters import Counters
from dissect.engine.exchange import Exchange
from dissect.engine.findings.scan_rules import ScanWatch
from dissect.engine.findings.session_rules import judge_cut, judge_end
from dissect.engine.findings.transport_rules import end_stray, judge_bare_confirm
from dissect.engine.transactions.connection import FOREIGN, ISO_TSAP_PORT, LEFT_OUT, PROBING, Connection
from dissect.engine.transactions.ending import Ending
from dissect.engine.transactions.memory_limit import holds_something
from dissect.engine.transactions.protocol import Protocol
from dissect.engine.transactions.side import Side
from dissect.engine.transactions.table import ConnectionTable
from dissect.engine.transactions.transaction import CONNECTION_CLOSED
from dissect.packets.tcp.stream import MASK
from dissect.protocols.iso.cotp import parse_tpdu
from dissect.protocols.iso.foreign import identify
from dissect.protocols.iso.recognition import HERE, OTHER, PROBES, WITHIN, raw_protocol, recognise
from dissect.protocols.iso.tables import CC, CR, DT
from dissect.protocols.iso.tpkt import plausible
from dissect.protocols.iso.upper import RDP, S7COMM_PLUS, TLS, UNKNOWN, UPPER_NAMES
from dissect.protocols.s7.parameters import PROTOCOL_ID
from dissect.protocols.s7plus.parameters import PLUS
from dissect.protocols.tls.handshake import chosen_version
from dissect.wire.octets import u16

#: In `Connection.identified_by`, this text precedes the version that a ServerHello chose.
_CHOSE: Final = ", the server chose "


def on_102(side: Side) -> bool:
    """Return whether a connection uses the port that ISO-on-TCP is registered on."""
    ends = side.tcp.ends
    return ends[0].port == ISO_TSAP_PORT or ends[1].port == ISO_TSAP_PORT


class Foreign(Protocol):
    """Names protocols that are not S7, by what identifies them. It only counts the octets of its connections."""

    def __init__(self, exchange: Exchange) -> None:
        super().__init__(FOREIGN)
        self._exchange: Exchange = exchange
        self._named: dict[int, int] = {}  # by connection: a bit for each protocol that was reported on it

    def take(self, side: Side, name: str, frame: i64, time_ns: i64, identity: str = "") -> None:
        """Take note of an unsupported protocol: the packets of its connection are counted from now on.

        ``identity`` says how it was identified.
        """
        connection = side.connection
        for end in (side, side.peer):
            if end is not None:
                end_stray(self._exchange.reporter, end)
        side.speak(self)
        connection.protocol = name
        connection.identified_by = identity or connection.identified_by
        if on_102(side):
            self._note(connection, name, connection.identified_by, frame, time_ns)

    def feed(self, side: Side, buf: bytes, at: i64, size: i64, frame: i64, time_ns: i64) -> None:
        """Count octets that waited behind those which showed an unsupported protocol."""
        side.framer.skipped += size

    def tsdu(self, side: Side, upper: i64, buf: bytes, at: i64, size: i64, frame: i64, time_ns: i64) -> None:
        """Name a TSDU of protocol ``upper``; on port 102 report each protocol once per connection."""
        connection = side.connection
        name = UPPER_NAMES[upper]
        if upper == TLS:
            self._version(side, buf, at, at + size)
        if name in {"empty", connection.protocol}:
            return
        named: bool = self._is_named(connection, upper)
        fresh: bool = connection.protocol == "" or connection.protocol == UPPER_NAMES[UNKNOWN]
        if not fresh and named:
            return
        identity = identify(upper, buf, at, at + size)
        if upper == RDP and connection.pdus == 0:
            self.take(side, name, frame, time_ns, identity)  # RDP also sends messages that are not TPKTs
            return
        if fresh:
            connection.protocol = name
            connection.identified_by = identity
        if (upper == UNKNOWN and side.holes) or named:
            return  # the rest of a message whose beginning is missing or was reported before
        self._name(connection, upper)
        if upper == TLS and connection.protocol == UPPER_NAMES[S7COMM_PLUS]:
            after = "InitSSL" if connection.identified_by == "InitSSL" else "S7comm-plus"
            connection.identified_by = f"{after}, then {identity}"
            self._exchange.reporter.note(
                "session.encrypted", connection.number, [frame], time_ns, f"{identity}, after {after}"
            )
            return
        if on_102(side):
            self._note(connection, name, identity, frame, time_ns)

    def inside(self, side: Side, upper: i64, octets: bytes, frame: i64, time_ns: i64) -> None:
        """Name a decrypted message of protocol ``upper``, as `tsdu` does for plain text."""
        if upper == TLS:
            upper = UNKNOWN
        connection = side.connection
        if side.holes or self._is_named(connection, upper) or not on_102(side):
            return
        self._name(connection, upper)
        identity = identify(upper, octets, 0, len(octets))
        self._note(connection, f"{UPPER_NAMES[upper]} in TLS", identity, frame, time_ns)

    def _version(self, side: Side, buf: bytes, at: i64, end: i64) -> None:
        """Take the version that a ServerHello of TLS chooses for the session."""
        connection = side.connection
        chosen = chosen_version(buf, at, end)
        if chosen and _CHOSE not in connection.identified_by:
            connection.identified_by = f"{connection.identified_by}{_CHOSE}{chosen}".removeprefix(", ")

    def forget(self, connection: Connection) -> None:
        """A connection is over: forget what was reported on it."""
        if self._named:
            self._named.pop(connection.number, None)

    def _is_named(self, connection: Connection, upper: i64) -> bool:
        """Return whether a protocol was reported on a connection."""
        return bool(self._named) and self._named.get(connection.number, 0) >> upper & 1 == 1

    def _name(self, connection: Connection, upper: i64) -> None:
        """Remember that a protocol was reported on a connection."""
        self._named[connection.number] = self._named.get(connection.number, 0) | 1 << upper

    def _note(self, connection: Connection, name: str, identity: str, frame: i64, time_ns: i64) -> None:
        detail = f"{name}: {identity}" if identity else name
        self._exchange.reporter.note("session.foreign_on_102", connection.number, [frame], time_ns, detail)


class Unread(Protocol):
    """Takes the connections that the user's selection excludes.

    It reads only the TPDU type at the beginning of a segment: a connect request after data begins another connection in its
    place, which has its own number and may be selected.
    """

    def __init__(self, connections: Connections) -> None:
        super().__init__(LEFT_OUT)
        self._connections: Connections = connections

    def feed(self, side: Side, buf: bytes, at: i64, size: i64, frame: i64, time_ns: i64) -> None:
        """Examine a segment whose octets are all new."""
        octets = buf[at : at + size]
        if size <= 6 or not plausible(octets, 0, size):
            return
        connection = side.connection
        type_: i64 = octets[5] >> 4
        if type_ == DT:
            if size > 7 and (octets[7] == PROTOCOL_ID or octets[7] == PLUS):
                connection.pdus = 1
            return
        if type_ != CR and type_ != CC:
            return
        tpdu = parse_tpdu(octets[4 : u16(octets, 2)])
        if tpdu.malformed and connection.established:
            return
        if type_ == CC:
            connection.tpdu_size = tpdu.tpdu_size or 1
        elif connection.established and (connection.cr_seen or connection.tpdu_size == 0):
            self._connections.begin_anew(side)
            side.protocol.feed(side, octets, 0, size, frame, time_ns)
        else:
            connection.cr_seen = True


class Connections:
    """Gives connections to protocols and takes them back. ``count`` is the number of connections opened so far.

    ``forgotten`` counts connections that were evicted without a loss: they had nothing open or unread. Later packets of an
    evicted connection form a new one; ``twice`` counts connections that may be such duplicates.

    A connection that ``only`` rejects gets a number and nothing else; ``left_out`` counts these connections. ``iso`` takes a
    connection that replaces a rejected one.
    """

    def __init__(self, exchange: Exchange, only: Callable[[Connection], bool] | None = None) -> None:
        self._exchange: Exchange = exchange
        self.count: i64 = 0
        self.left_out: i64 = 0
        self.forgotten: i64 = 0
        self.twice: i64 = 0
        self._only: Callable[[Connection], bool] | None = only
        self._unread: Protocol = Unread(self)
        self.iso: Protocol = self._unread
        self.foreign: Foreign = Foreign(exchange)
        self.scans: ScanWatch = ScanWatch(exchange.reporter)
        self.table: ConnectionTable = ConnectionTable()  # the table of the pipeline, once the pipeline has one

    def open(self, side: Side, protocol: Protocol, at_start: bool) -> None:
        """Open a connection whose protocol is now known; with ``at_start`` the next octets of ``side`` begin a message."""
        connection = side.connection
        self.count += 1
        connection.number = self.count
        side.speak(protocol)
        if self._only is not None and not self._only(connection):
            self.left_out += 1
            side.speak(self._unread)
            return
        if self._exchange.naming is not None:
            connection.naming = self._exchange.naming.of(connection)
        if connection.mid_stream and self.table.may_be_forgotten(side):
            self.twice += 1
        self._exchange.reporter.ledger.met(connection)
        protocol.begin(side, at_start)
        self._exchange.observer.connection_opened(connection)
        self._exchange.watch.opened(connection)

    def note_evicted(self, counters: Counters, side: Side, detail: str) -> None:
        """Report a loss of the connection of ``side``, which is dropped because too much is open at once."""
        connection = side.connection
        if not connection.followed:
            return
        if detail or holds_something(side):
            counters.note("stream.evicted", detail, connection.number)
        else:
            self.forgotten += 1
            self.table.forget(side)

    def begin_anew(self, side: Side) -> None:
        """Begin a new transport connection on the same TCP connection, in place of one that is not read."""
        peer = side.peer
        assert peer is not None
        connection = Connection(0, side.tcp)
        for end in (side, peer):
            end.connection = connection
        self.open(side, self.iso, True)

    def replace(self, side: Side, frame: i64, now_ns: i64) -> None:
        """Begin a new transport connection on the same TCP connection; the packets between the two were not captured."""
        peer = side.peer
        assert peer is not None
        old = side.connection
        old.closed_reason = "replaced"
        self.end(side, CONNECTION_CLOSED, frame, now_ns)
        self.count += 1
        connection = Connection(self.count, side.tcp)
        connection._state = old._state
        connection._told = old._told  # these reports concern octets that still wait to be passed on
        connection.naming = old.naming
        for end in (side, peer):
            end.connection = connection
        self._exchange.reporter.ledger.met(connection)
        self._exchange.observer.connection_opened(connection)

    def end(self, side: Side, reason: str, frame: i64, now_ns: i64) -> None:
        """Close what is open on both sides of a finished connection; ``reason`` is why its open requests stay unanswered.

        ``frame`` is the current packet, which may belong to another connection; unfinished messages are reported with their own
        last packet.
        """
        if side.connection._state == LEFT_OUT:
            return
        exchange = self._exchange
        peer = side.peer
        assert peer is not None
        last_frame: i64 = side.tcp.last_frame
        last_ns: i64 = side.tcp.last_ns
        side.protocol.finish(side, last_frame, last_ns)
        peer.protocol.finish(peer, last_frame, last_ns)
        exchange.behind.end(side)
        asked = exchange.dialogue.certainly_open(side) + exchange.dialogue.certainly_open(peer)
        ending = Ending(side.connection, asked, frame, now_ns)
        side.connection.ending = ending
        judge_end(exchange.reporter, side)
        exchange.causes.at_end(side, reason, asked, ending)
        judge_bare_confirm(exchange.reporter, side, ending)
        judge_cut(exchange.reporter, side, ending, self.table)
        exchange.causes.close()
        if ending.connecting:
            self.scans.refused(side.connection, ending.time_ns)
        for end in (side, peer):
            end.protocol.end(end, last_frame, last_ns)
            exchange.dialogue.end(end, reason, now_ns)
        if exchange.dialogue.also:
            exchange.beside(frame, now_ns)
        if exchange.decoder is not None:
            exchange.decoder.end(side, last_frame, last_ns)
        self.foreign.forget(side.connection)
        exchange.watch.end(side.connection, reason)
        exchange.causes.forget(side.connection)
        exchange.observer.connection_closed(side.connection)
        exchange.reporter.over(side.connection.number)
        side.connection._let_go()


class Recognition(Protocol):
    """The protocol that every connection begins with: examines octets until the protocol of the connection is certain.

    ``streams`` are the protocols to try, in this order. ISO-on-TCP is tried last, and over several segments, because a capture
    may begin in the middle of a message.
    """

    def __init__(self, connections: Connections, iso: Protocol, streams: list[Protocol]) -> None:
        super().__init__(PROBING)
        self._connections: Connections = connections
        self._iso: Protocol = iso
        self._streams: list[Protocol] = streams

    def feed(self, side: Side, buf: bytes, at: i64, size: i64, frame: i64, time_ns: i64) -> None:
        """Examine octets of a connection that is not recognised yet; once it is, give it with them to its protocol."""
        octets = buf[at : at + size]
        known_start: bool = side.tcp.known_start
        at_start: bool = known_start and (side.end_seq - size) & MASK == side.stream.start_seq
        for stream in self._streams:
            if stream.probe(side, octets, at_start):
                self._connections.open(side, stream, at_start)
                side.protocol.feed(side, octets, 0, size, frame, time_ns)
                return
        connection = side.connection
        found: i64 = recognise(octets, at_start, on_102(side), connection._probed)
        if found == HERE or found == WITHIN:
            # Garbage before the first TPKT is reported only when it is certain that nothing was missed.
            self._connections.open(side, self._iso, found == HERE or at_start)
            side.protocol.feed(side, octets, 0, size, frame, time_ns)
            return
        if connection._probed == 0:
            connection._probed_frame = frame
            connection._probed_ns = time_ns
        connection._probed += 1
        if connection.protocol == "":
            raw: i64 = raw_protocol(octets)
            connection.protocol = UPPER_NAMES[raw]
            connection.identified_by = identify(raw, octets, 0, size)
        if found == OTHER:
            self._take_other(side)
        side.framer.skipped += size

    def end(self, side: Side, frame: i64, time_ns: i64) -> None:
        """Report a connection on port 102 that was never recognised, unless too little of it was captured."""
        if side.tcp.known_start or side.connection._probed >= PROBES:
            self._take_other(side)

    def _take_other(self, side: Side) -> None:
        """Report an unsupported protocol with the first octets of the connection, not with those that made it certain."""
        connection = side.connection
        self._connections.foreign.take(side, connection.protocol, connection._probed_frame, connection._probed_ns)
