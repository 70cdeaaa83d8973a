"""Which packets of a capture an expression selects.

The capture is read twice: first to find what is wanted, then to test each packet. A packet is selected if it carries a part of
a request or answer of a selected transaction; and, if the expression names fields that only findings have, if a selected
finding names it. A packet that carries none of these is tested by its own fields: number, time, ends, connection. If the
expression has only such fields, every packet is tested by them.
"""

from __future__ import annotations

from bisect import bisect_right, insort
from collections.abc import Callable
from typing import Final

from mypy_extensions import i64

from dissect.engine.findings.reporter import Finding
from dissect.engine.observer import Observer
from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.side import Side
from dissect.engine.transactions.table import endpoints, keys_of, reverse_key
from dissect.engine.transactions.transaction import Transaction
from dissect.meaning.select.places import Places, packet_key, parsed
from dissect.meaning.select.selection import AGAIN_NS, SameKeys
from dissect.meaning.select.sieve import Numbers
from dissect.meaning.select.spans import SpanBook, TimedSpan
from dissect.meaning.select.things import FINDING, PACKET, TRANSACTION, Packet
from dissect.meaning.select.where import Where
from dissect.packets.tcp.stream import Endpoint

#: Kinds of things whose fields an expression for packets may name.
KINDS: Final = (PACKET, TRANSACTION, FINDING)
#: Returns whether a packet is selected; arguments: number, time, buffer, start, end, link type.
PacketTest = Callable[[int, int, bytes, int, int, int], bool]
#: Connections with the same addresses and ports follow one another; a late packet may still belong to the one before.
_AT_ONCE: Final = 2


class _Ends:
    """The part of `Connection.tcp` that the fields of a packet need."""

    __slots__ = ("ends", "vlan")

    def __init__(self, connection: Connection) -> None:
        self.ends = connection.tcp.ends
        self.vlan = int(connection.tcp.vlan)


class _Line:
    """A connection, reduced to what the fields of a packet need, and its first and last place in the capture."""

    __slots__ = ("client", "first", "last", "number", "pdu_length", "server", "tcp", "tsap_called", "tsap_calling")

    def __init__(self, connection: Connection) -> None:
        self.number = int(connection.number)
        self.client = connection.client
        self.server = connection.server
        self.tcp = _Ends(connection)
        self.tsap_calling = connection.tsap_calling
        self.tsap_called = connection.tsap_called
        self.pdu_length = int(connection.pdu_length)
        self.first = int(connection.tcp.first_frame)
        self.last = int(connection.tcp.last_frame)


class PacketSelection(Observer):
    """Observes the first reading; `test` then returns the test for the packets of the second one."""

    def __init__(self, where: Where) -> None:
        super().__init__()
        self._where = where
        self._alone = where.knows(PACKET)
        self._findings = not self._alone and not where.knows(TRANSACTION)
        self.wants_pdus = self.wants_tpdus = not self._alone
        self._wanted = where.predicate(TRANSACTION)
        self._book = SpanBook()
        self._lines: dict[bytes, list[_Line]] = {}
        self._carrying = Numbers()
        self._frames: set[int] = set()
        self._spans: list[TimedSpan] = []
        self._same = SameKeys()

    def connection_opened(self, connection: Connection) -> None:
        """Remember a connection, for findings."""
        self._where.context.opened(connection)

    def connection_closed(self, connection: Connection) -> None:
        """Remember the facts of a connection that tests of packets need."""
        self._where.context.closed(connection)
        line = _Line(connection)
        self._same.note(connection.tcp)
        for key in keys_of(connection.tcp):
            for one in {key, reverse_key(key)}:
                insort(self._lines.setdefault(one, []), line, key=_first_of)

    def tpdu(self, frame: i64, time_ns: i64, side: Side, octets: bytes) -> None:
        """Note where in its stream a TPKT is."""
        self._book.tpkt(side, octets)

    def ibh_packet(self, frame: i64, time_ns: i64, side: Side, octets: bytes) -> None:
        """Note where in its stream an IBH-NetLink packet is."""
        self._book.ibh_packet(side, octets)

    def pdu(self, frame: i64, time_ns: i64, side: Side, octets: bytes, cut: bool) -> None:
        """Note where in its stream an S7 PDU is."""
        self._book.pdu(side, int(frame), len(octets))

    def plus_pdu(self, frame: i64, time_ns: i64, side: Side, octets: bytes, cut: bool) -> None:
        """Note where in its stream an S7comm-plus PDU is."""
        self._book.pdu(side, int(frame), len(octets))

    def transaction(self, transaction: Transaction) -> None:
        """Remember the places of request and answer in their streams, if the transaction is selected."""
        if self._alone:
            return
        number, asked_by = int(transaction.connection.number), int(transaction.asked_by)
        spans = [
            self._book.pop(number, asked_by, int(transaction.request_frame), int(transaction.request_size)),
            self._book.pop(number, 1 - asked_by, int(transaction.response_frame), int(transaction.response_size)),
        ]
        frames = transaction.frames
        for frame in frames:
            self._carrying.add(frame)
        if not self._wanted(transaction):
            return
        self._frames.update(frames)
        times = [int(at) for at in (transaction.request_ns, transaction.response_ns) if at]
        self._spans += [
            TimedSpan(span, min(times) - AGAIN_NS, max(times) + AGAIN_NS) for span in spans if span is not None
        ]

    def finding(self, finding: Finding) -> None:
        """Remember the packets of a finding, if the expression names fields of findings."""
        if not self._findings:
            return
        for frame in finding.frames:
            self._carrying.add(int(frame))
        if self._where.finding(finding):
            self._frames.update([int(frame) for frame in finding.frames])

    def test(self) -> PacketTest:
        """Return the function that returns whether a packet is selected. It never raises."""
        carried = Places(frozenset(self._frames), self._same.found)
        carried.add_spans(self._spans)
        itself = self._where.predicate(PACKET)

        def takes(frame: int, time_ns: int, buf: bytes, start: int, end: int, link_type: int) -> bool:
            if not self._alone:
                if frame in carried.frames:
                    return True
                found = parsed(buf, start, end, link_type) if carried.looks else None
                if found is not None and carried.wants(frame, time_ns, buf, *found):
                    return True
                if frame in self._carrying:
                    return False
            return itself(self._packet(frame, time_ns, buf, start, end, link_type))

        return takes

    def _packet(self, frame: int, time_ns: int, buf: bytes, start: int, end: int, link_type: int) -> Packet:
        key, addresses = packet_key(buf, start, end, link_type)
        if not addresses:
            return Packet(frame, time_ns, None, None)
        if not key:
            half = len(addresses) // 2
            return Packet(frame, time_ns, (Endpoint(addresses[:half], -1), Endpoint(addresses[half:], -1)), None)
        lines = self._lines.get(key, [])
        begun = bisect_right(lines, frame, key=_first_of)
        for line in lines[max(0, begun - _AT_ONCE) : begun]:
            if frame <= line.last:
                return Packet(frame, time_ns, endpoints(key), line)
        return Packet(frame, time_ns, endpoints(key), None)


def _first_of(line: _Line) -> int:
    return line.first
