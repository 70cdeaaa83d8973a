"""`Writer`, which writes results in one format, and the feeds that pass it the results that a command needs.

A writer is an observer that keeps its lines until they are taken (`Writer.take`). The pipeline reports everything to its
observer (transactions, operations, findings …), so a feed between them passes only the wanted results.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Callable, Container
from typing import Final

from mypy_extensions import i64, mypyc_attr

from dissect.engine.exchange import PayloadDecoder
from dissect.engine.observer import Observer
from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.operation import Operation
from dissect.engine.transactions.payloads import ScdMessage
from dissect.engine.transactions.side import Side
from dissect.engine.transactions.transaction import BEHIND_MALFORMED, UNANSWERED, Transaction
from dissect.meaning.report.headers import Header, irregular
from dissect.meaning.report.styled import Line, Written
from dissect.meaning.report.words import Places, carried, message_name
from dissect.protocols.ibh.packet import parse_packet
from dissect.protocols.ibh.tables import KIND_DATA, KIND_FRAGMENT
from dissect.protocols.iso.cotp import parse_tpdu
from dissect.protocols.iso.irregular import odd_place
from dissect.protocols.iso.tables import DT, ED
from dissect.protocols.iso.upper import S7COMM, S7COMM_PLUS, SCD, UPPER_NAMES, classify
from dissect.wire.text import Clock

#: Maximum number of lines of transactions, and of characters in them, that wait for earlier transactions that are held back.
KEPT_LINES: Final = 4096
KEPT_CHARACTERS: Final = 16 * 1024 * 1024

#: Octets of a TPKT before the data of a DT without parameters; and the octet that means DT, which follows the length, 2.
_DT_HEAD: Final = 7
_PLAIN_DT: Final = 0xF0

#: Protocol names, besides those of `UPPER_NAMES`, for messages without a PDU: TPDUs, and packets of IBH-NetLink.
COTP: Final = "cotp"
NETLINK: Final = "netlink"

#: Return whether a transaction, or an operation, is wanted.
Choice = Callable[[Transaction], bool]
OperationChoice = Callable[[Operation], bool]
#: Returns whether a message is wanted, by its protocol, packet, time in nanoseconds, connection, the side that sent it, octets,
#: whether the capture cut it, for SCD the message, and whether it comes after a malformed header.
MessageChoice = Callable[[str, int, int, Connection, int, bytes, bool, ScdMessage | None, bool], bool]


@mypyc_attr(allow_interpreted_subclasses=True)
class Writer(Observer):
    """Writes results in one format: override the methods for what it takes, and add a row to `dissect.meaning.report.formats`.

    ``lines`` are the lines that were written so far: text (`str`), its octets in UTF-8 (`bytes`), or text with a style
    (`Line`), which a terminal wraps and colours. One item may contain several lines. ``plain`` is True if no terminal wraps and
    colours them, so that a writer may return octets. ``clock`` writes times in the form that the user wants (`Clock.moment`;
    for programs `Clock.iso`, always UTC). ``verbose`` asks for all details (option -V of `show`). Names and values come from
    the wire: pass text for people through `dissect.wire.text.printable`.

    ``number_width`` and ``joint`` say how numbers can be changed in finished lines. ``number_width`` is the minimum width of
    the number of a transaction, in characters. ``joint`` is the text between the numbers of transaction and connection, if each
    line contains both in this form and only there; it is empty if lines contain only a connection, and None if numbers may be
    anywhere.

    Feeds call these methods of an observer: `transaction`, `operation`, `comment`, for PDUs `pdu` and `plus_pdu`, and for
    packets without a PDU `tpdu` and `ibh_packet`; and the methods `packet` and `scd_message` of this class. PDUs may hold
    passwords: see `dissect.protocols.s7.hiding.without_secrets`.
    """

    def __init__(self, clock: Clock | None = None, verbose: bool = False) -> None:
        super().__init__()
        self.places: Places = Places([], False)
        self.clock: Clock = clock if clock is not None else Clock()
        self.verbose: bool = verbose
        self.lines: list[Written] = []
        self.carrying: bytes = b""  # the present TPKT or IBH-NetLink packet
        self.number_width: int = 0
        self.joint: bytes | None = None
        self.plain: bool = False
        self.most: int = 0  # maximum number of items that a text line names, 0 for all

    def begin(self, places: Places) -> None:
        """Set ``places``, which gives the names of packets; called once, before the first result."""
        self.places = places

    def packet(self, octets: bytes) -> None:
        """Take the TPKT or IBH-NetLink packet, header included, that carries the next PDU."""
        self.carrying = octets

    def header_of(self, side: Side, pdu: bytes) -> Header | None:
        """Return the irregular header of the TPKT that carries ``pdu``; None for nearly all, which are regular."""
        return irregular(self.carrying, pdu, side.connection.class_)

    def carrier(self, frame: i64, time_ns: i64, side: Side, octets: bytes) -> None:
        """Take a TPKT with a DT that carries a PDU, a part of one or nothing; called only if all TPDUs are wanted."""
        self.tpdu(frame, time_ns, side, octets)

    def scd_message(self, found: ScdMessage, connection: Connection) -> None:
        """Take an SCD message, from a connection of its own or from an item of S7comm."""

    def take(self) -> list[Written]:
        """Return the lines collected since the last call."""
        lines = self.lines
        self.lines = []
        return lines


class TransactionFeed(Observer):
    """Passes transactions on to a writer, all or those that ``choose`` wants, and keeps its lines in the order of the capture.

    The place of a transaction is that of the packet that completed it or, without an answer, the end of the wait; the same
    applies to messages behind a malformed header. A transaction that was held back behind a gap of its TCP stream reaches the
    feed late: its lines are put before those of transactions that were completed by later packets.
    """

    def __init__(
        self,
        writer: Writer,
        choose: Choice | None = None,
        most_lines: int = KEPT_LINES,
        most_characters: int = KEPT_CHARACTERS,
    ) -> None:
        super().__init__()
        self._writer: Writer = writer
        self._choose: Choice | None = choose
        self._most_lines: int = most_lines
        self._most_characters: int = most_characters
        self._packets: list[int] = []  # the packet of each line of the writer, in ascending order
        self._latest: i64 = 0
        self.protocols: dict[str, int] = {}  # by protocol: number of finished connections that spoke it

    def connection_closed(self, connection: Connection) -> None:
        """Count the protocol of a connection."""
        self.protocols[connection.protocol] = self.protocols.get(connection.protocol, 0) + 1

    def transaction(self, transaction: Transaction) -> None:
        """Pass on a transaction if it is wanted."""
        if self._choose is not None and not self._choose(transaction):
            return
        packet: i64 = 0
        if transaction._outcome not in (UNANSWERED, BEHIND_MALFORMED):
            packet = max(transaction.request_frame, transaction.response_frame)
        self.settle()
        self._writer.transaction(transaction)
        self.place(packet)

    def settle(self) -> None:
        """Give lines that the writer added by itself, such as a heading, their place before all packets."""
        lines = self._writer.lines
        packets = self._packets
        while len(packets) < len(lines):
            packets.append(0)

    def place(self, packet: i64) -> None:
        """Move the new lines of the writer to the place of ``packet``; 0 leaves them after all others."""
        lines = self._writer.lines
        packets = self._packets
        if packet == 0:
            packet = self._latest
        fresh: i64 = len(lines) - len(packets)
        if packet >= self._latest:
            self._latest = packet
            if fresh == 1:  # nearly always
                packets.append(packet)
            elif fresh:
                packets.extend([int(packet)] * int(fresh))
            return
        at = bisect_right(packets, packet)
        late = lines[len(packets) :]
        del lines[len(packets) :]
        lines[at:at] = late
        packets[at:at] = [int(packet)] * int(fresh)

    def take(self, held: int) -> list[Written]:
        """Return the lines before packet ``held``, the first packet that is held back (0 for none): no late line belongs there.

        Other lines stay, up to ``most_lines`` and ``most_characters``; if there are more, the oldest are returned, too.
        """
        lines = self._writer.take()
        packets = self._packets
        ready = bisect_left(packets, held) if held else len(lines)
        kept = len(lines)
        room = self._most_characters
        while kept > ready and len(lines) - kept < self._most_lines:
            line = lines[kept - 1]
            room -= len(line.text) if isinstance(line, Line) else len(line)
            if room < 0:
                break
            kept -= 1
        self._writer.lines = lines[kept:]
        self._packets = packets[kept:]
        return lines[:kept]


class OperationFeed(Observer):
    """Passes operations on to a writer, all or those that ``choose`` wants."""

    def __init__(self, writer: Writer, choose: OperationChoice | None = None) -> None:
        super().__init__()
        self._writer: Writer = writer
        self._choose: OperationChoice | None = choose

    def operation(self, operation: Operation) -> None:
        """Pass on an operation if it is wanted."""
        if self._choose is None or self._choose(operation):
            self._writer.operation(operation)


class PduFeed(Observer):
    """Passes PDUs on to a writer, and TPDUs and packets that carry none: all, or those that a packet of ``frames`` completes.

    ``found`` are the packets of ``frames`` for which the writer wrote something. ``decoder`` decides which messages are SCD,
    ``choose`` which are wanted. With ``every`` TPDUs that carry a PDU, a part of one or nothing are passed on, too.
    """

    def __init__(
        self,
        writer: Writer,
        frames: Container[int] | None = None,
        decoder: PayloadDecoder | None = None,
        choose: MessageChoice | None = None,
        every: bool = False,
    ) -> None:
        super().__init__()
        self.wants_pdus = True
        self.wants_tpdus = True
        self.found: set[int] = set()
        self._writer: Writer = writer
        self._frames: Container[int] | None = frames
        self._decoder: PayloadDecoder | None = decoder
        self._choose: MessageChoice | None = choose
        self._every: bool = every
        self._carrying: bytes = b""  # the present TPKT
        self._before: int = 0  # number of lines of the writer before the current message

    def comment(self, frame: i64, text: str) -> None:
        """Pass on a packet comment, unless ``choose`` selects messages, to which comments do not belong."""
        if self._choose is None and self._wanted(frame):
            self._writer.comment(frame, text)
            self._find(frame)

    def tpdu(self, frame: i64, time_ns: i64, side: Side, octets: bytes) -> None:
        """Give the writer the TPKT of the PDU that may follow; pass on a TPDU that carries no PDU."""
        self._writer.packet(octets)
        if not self._wanted(frame):
            return
        alone = self._alone(side, octets)
        if not (alone or self._every) or not self._chosen(COTP, frame, time_ns, side, octets, False):
            return
        if alone:
            self._writer.tpdu(frame, time_ns, side, octets)
        else:
            self._writer.carrier(frame, time_ns, side, octets)
        self._find(frame)

    def _alone(self, side: Side, octets: bytes) -> bool:
        """Return whether a TPKT contains no PDU, SCD message or part of either, so that it needs its own line."""
        self._carrying = octets
        if len(octets) > _DT_HEAD and octets[4] == 2 and octets[5] == _PLAIN_DT:
            upper = classify(octets, _DT_HEAD, len(octets))
            if upper in (S7COMM, S7COMM_PLUS):
                return False  # as nearly always
        tpdu = parse_tpdu(octets[4:])
        if odd_place(tpdu, octets[4:], side.connection.class_) >= 0:
            return False
        if tpdu.type not in {DT, ED}:
            return True
        if self._decoder is not None and self._decoder.claims_tsdus(side.connection):
            return False
        return side.assembler.clear and bool(carried(tpdu))

    def ibh_packet(self, frame: i64, time_ns: i64, side: Side, octets: bytes) -> None:
        """Give the writer the packet of the PDU that may follow; pass on a packet that carries no part of a PDU."""
        self._writer.packet(octets)
        if not self._wanted(frame):
            return
        packet = parse_packet(octets)
        if packet.kind in {KIND_DATA, KIND_FRAGMENT} and packet.data:
            if not side.assembler.clear or not message_name(packet.data):
                return
        if not self._chosen(NETLINK, frame, time_ns, side, octets, False):
            return
        self._writer.ibh_packet(frame, time_ns, side, octets)
        self._find(frame)

    def pdu(self, frame: i64, time_ns: i64, side: Side, octets: bytes, cut: bool) -> None:
        """Pass on an S7 PDU if it is wanted."""
        if self._wanted(frame) and self._chosen(UPPER_NAMES[S7COMM], frame, time_ns, side, octets, cut):
            self._writer.pdu(frame, time_ns, side, octets, cut)
            self._find(frame)

    def plus_pdu(self, frame: i64, time_ns: i64, side: Side, octets: bytes, cut: bool) -> None:
        """Pass on an S7comm-plus PDU if it is wanted."""
        if self._wanted(frame) and self._chosen(UPPER_NAMES[S7COMM_PLUS], frame, time_ns, side, octets, cut):
            self._writer.plus_pdu(frame, time_ns, side, octets, cut)
            self._find(frame)

    def scd(self, frame: i64, time_ns: i64, side: Side, found: ScdMessage) -> None:
        """Pass on an SCD message from a connection of its own."""
        self._scd(found, side.connection)

    def transaction(self, transaction: Transaction) -> None:
        """Pass on the SCD messages in an S7 transaction; those in a write have the packet of its request."""
        for found in transaction._carried or ():
            self._scd(found, transaction.connection)

    def _scd(self, found: ScdMessage, connection: Connection) -> None:
        if self._wanted(found.frame):
            choose = self._choose
            if choose is not None and not choose(
                UPPER_NAMES[SCD], found.frame, found.time_ns, connection, found.side, found.octets, False, found, False
            ):
                return
            self._writer.scd_message(found, connection)
            self._find(found.frame)

    def _chosen(self, protocol: str, frame: i64, time_ns: i64, side: Side, octets: bytes, cut: bool) -> bool:
        choose = self._choose
        if choose is None:
            return True
        header = irregular(self._carrying, octets, side.connection.class_) if protocol != COTP else None
        behind = header is not None and header.behind
        return choose(protocol, frame, time_ns, side.connection, side.index, octets, cut, None, behind)

    def _find(self, frame: i64) -> None:
        """Add ``frame`` to ``found`` if the writer wrote something for it."""
        if self._frames is not None and len(self._writer.lines) > self._before:
            self.found.add(self._writer.places.number(int(frame)))

    def _wanted(self, frame: i64) -> bool:
        if self._frames is None:
            return True
        self._before = len(self._writer.lines)
        return self._writer.places.number(int(frame)) in self._frames
