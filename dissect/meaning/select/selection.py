"""`Selection`: finds out in the first reading of a capture which packets are wanted, in little memory.

It observes an analysis. Afterwards `Selection.choice` returns a `Choice`, which recognises the packets in the second reading:
by addresses and ports of connections, sequence numbers of transactions, and numbers of packets with findings. It also takes
what is needed to understand a message: the beginning of its connection, the negotiation, and the end.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Collection
from typing import Final

from mypy_extensions import i64

from dissect.engine.findings.bounds import KEPT
from dissect.engine.findings.reporter import Finding
from dissect.engine.observer import Observer
from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.side import Side
from dissect.engine.transactions.table import keys_of, reverse_key
from dissect.engine.transactions.transaction import PUSH, Transaction
from dissect.meaning.report.contract import worst_first
from dissect.meaning.select.comments import finding_comment
from dissect.meaning.select.places import Places, Stretch, parsed
from dissect.meaning.select.spans import Span, SpanBook, TimedSpan
from dissect.meaning.select.subscriptions import Asked, SubscriptionBook
from dissect.packets.tcp import ip
from dissect.packets.tcp.connection import TcpConnection
from dissect.protocols.ibh.packet import parse_packet
from dissect.protocols.ibh.tables import KIND_CONFIRM, KIND_CONNECT, KIND_DISCONNECT, KIND_GO_AHEAD, KIND_SERVICE
from dissect.protocols.iso.tables import CC, CR, DC, DR
from dissect.protocols.s7.tables import SETUP_COMMUNICATION as _SETUP

#: Maximum number of connections that are remembered, and of packets of each that opened or closed it above TCP.
MAX_CONNECTIONS: Final = 16_384
MAX_FRAMES: Final = 16


class Beginning:
    """The TPDUs or IBH-NetLink packets that open or close a connection, and its latest Setup, by packets and by spans.

    ``frames`` are the packets that completed the TPDUs, ``opening`` the spans of their octets.
    """

    __slots__ = ("frames", "opening", "setup", "spans")

    def __init__(self) -> None:
        self.frames: list[int] = []
        self.opening: list[TimedSpan] = []
        self.setup: list[int] = []
        self.spans: list[Span] = []


class ContextBook:
    """Beginnings by the number of their connection; if there are too many, the least recently used are forgotten."""

    def __init__(self) -> None:
        self._known: OrderedDict[int, Beginning] = OrderedDict()

    def opened(self, number: int, frame: int, time_ns: int, span: Span | None) -> None:
        """Packet ``frame`` completes what opens or closes connection ``number``; ``span`` has its octets, None if unknown."""
        beginning = self.of(number)
        if len(beginning.frames) < MAX_FRAMES:
            beginning.frames.append(frame)
            if span is not None:
                beginning.opening.append(TimedSpan(span, time_ns - AGAIN_NS, time_ns))

    def negotiated(self, number: int, frames: list[int], spans: list[Span]) -> None:
        """Note the packets of a Setup communication."""
        beginning = self.of(number)
        beginning.setup = frames
        beginning.spans = spans

    def of(self, number: int) -> Beginning:
        """Return the `Beginning` of a connection; make it if it is new."""
        beginning = self._known.get(number)
        if beginning is None:
            beginning = self._known[number] = Beginning()
            if len(self._known) > MAX_CONNECTIONS:
                self._known.popitem(last=False)
        else:
            self._known.move_to_end(number)
        return beginning


#: TPDUs that open and close a transport connection, and IBH-NetLink packets that do.
_OPENING: Final = frozenset((CR, CC, DR, DC))
_OPENING_IBH: Final = frozenset((KIND_CONNECT, KIND_CONFIRM, KIND_DISCONNECT, KIND_GO_AHEAD, KIND_SERVICE))
#: Retransmissions of a transaction's octets are searched for this long before its request and after its answer.
AGAIN_NS: Final = 10_000_000_000


class Wanted:
    """The wanted things: numbers of connections, transactions and findings, slugs of findings.

    If all are empty, everything is wanted. Findings are numbered in the order of the details in the analysis, the heaviest
    first, from 1.
    """

    def __init__(
        self,
        connections: Collection[int] = (),
        transactions: Collection[int] = (),
        findings: Collection[int] = (),
        slugs: Collection[str] = (),
    ) -> None:
        self.connections = frozenset(connections)
        self.transactions = frozenset(transactions)
        self.findings = frozenset(findings)
        self.slugs = frozenset(slugs)

    @property
    def everything(self) -> bool:
        """Whether nothing in particular is wanted."""
        return not (self.connections or self.transactions or self.findings or self.slugs)


class Selection(Observer):
    """Observes the first reading.

    Afterwards ``missing`` names, as text, the wanted things that were not found; empty if there are none. With ``context``, the
    packets that begin and end the connection of a wanted transaction, and its Setup, are wanted, too.
    """

    def __init__(self, wanted: Wanted, comments: bool = True, context: bool = False) -> None:
        super().__init__()
        self.wants_tpdus = self.wants_pdus = bool(wanted.transactions)
        self.uncertain = 0  # number of wanted PDUs for which only the packet that completed them is known
        self._wanted = wanted
        self._comments = comments
        self._book = SpanBook()
        self._connections: dict[int, Connection] = {}
        self._transactions: set[int] = set()
        self._spans: list[TimedSpan] = []
        self._frames: set[int] = set()
        self._findings: list[Finding] = []
        self._subscriptions = SubscriptionBook()
        self._asked: set[int] = set()  # numbers of transactions whose packets are wanted
        self._context = ContextBook() if context and wanted.transactions else None
        self._around: dict[int, Connection] = {}  # connections of wanted transactions
        self._unanswered: list[tuple[Connection, int]] = []  # connection and request packet of unanswered ones
        self._around_frames: set[int] = set()
        self._around_spans: list[TimedSpan] = []
        self._same = SameKeys()

    # ---- observer ---------------------------------------------------------------------------------------------------

    def connection_opened(self, connection: Connection) -> None:
        """Remember a connection that is wanted."""
        if connection.number in self._wanted.connections:
            self._connections[int(connection.number)] = connection

    def connection_closed(self, connection: Connection) -> None:
        """Remember the VLANs of a connection's packets, if there are several."""
        self._same.note(connection.tcp)

    def tpdu(self, frame: i64, time_ns: i64, side: Side, octets: bytes) -> None:
        """Note where in its stream a TPKT is."""
        span = self._book.tpkt(side, octets)
        if self._context is not None and octets[5] >> 4 in _OPENING:
            self._context.opened(int(side.connection.number), int(frame), int(time_ns), span)

    def ibh_packet(self, frame: i64, time_ns: i64, side: Side, octets: bytes) -> None:
        """Note where in its stream an IBH-NetLink packet is."""
        span = self._book.ibh_packet(side, octets)
        if self._context is not None and parse_packet(octets).kind in _OPENING_IBH:
            self._context.opened(int(side.connection.number), int(frame), int(time_ns), span)

    def pdu(self, frame: i64, time_ns: i64, side: Side, octets: bytes, cut: bool) -> None:
        """Note where a PDU is in its stream."""
        self._book.pdu(side, int(frame), len(octets))

    def plus_pdu(self, frame: i64, time_ns: i64, side: Side, octets: bytes, cut: bool) -> None:
        """Take note where a PDU stands in its stream."""
        self._book.pdu(side, int(frame), len(octets))

    def transaction(self, transaction: Transaction) -> None:
        """Remember the places of request and answer of a wanted transaction in their streams."""
        if not self.wants_pdus:
            return
        number = int(transaction.connection.number)
        asked_by = int(transaction.asked_by)
        spans = [
            self._book.pop(number, asked_by, int(transaction.request_frame), int(transaction.request_size)),
            self._book.pop(number, 1 - asked_by, int(transaction.response_frame), int(transaction.response_size)),
        ]
        frames = transaction.frames
        if self._context is not None and transaction.function == _SETUP:
            self._context.negotiated(number, frames, [span for span in spans if span is not None])
        self._subscriptions.note(transaction, frames, spans)
        if transaction.number not in self._wanted.transactions:
            return
        self._transactions.add(int(transaction.number))
        self._surround(transaction)
        self._want(Asked(transaction, frames, spans))
        if transaction._outcome == PUSH:
            forgotten = self._subscriptions.forgotten
            for asked in self._subscriptions.of(transaction):
                self._want(asked)
            self.uncertain += self._subscriptions.forgotten - forgotten

    def _want(self, asked: Asked) -> None:
        """Want the packets of a request and its answer, including retransmissions."""
        if asked.number in self._asked:
            return
        self._asked.add(asked.number)
        self._frames.update(asked.frames)
        known = [span for span in asked.spans if span is not None]
        self._spans += [TimedSpan(span, asked.from_ns - AGAIN_NS, asked.to_ns + AGAIN_NS) for span in known]
        if not asked.connection.udp:  # a datagram is one packet
            self.uncertain += len(asked.frames) - len(known)

    def _surround(self, transaction: Transaction) -> None:
        """Want the end of the connection of an unanswered request; with ``context``, its beginning and end in any case."""
        connection = transaction.connection
        if connection.udp:
            return
        if self._context is None:
            if not transaction.response_frame:
                self._unanswered.append((connection, int(transaction.request_frame)))
            return
        self._around[int(connection.number)] = connection
        beginning = self._context.of(int(connection.number))
        self._around_frames.update(beginning.setup)
        first_ns = int(connection.tcp.first_ns)
        last_ns = max(int(transaction.request_ns), int(transaction.response_ns))
        self._around_spans += [TimedSpan(span, first_ns, last_ns) for span in beginning.spans]

    def finding(self, finding: Finding) -> None:
        """Remember a finding."""
        if finding.room == KEPT:  # the number of these is limited
            self._findings.append(finding)

    # ---- what came of it --------------------------------------------------------------------------------------------

    @property
    def missing(self) -> str:
        """The things that were wanted by number but are not in the capture, as text; empty if there are none."""
        wanted = self._wanted
        parts = []
        for name, gone in (
            ("connection", wanted.connections - self._connections.keys()),
            ("transaction", wanted.transactions - self._transactions),
            ("finding", wanted.findings - {int(finding.number) for finding in self._findings}),
        ):
            if gone:
                numbers = sorted(gone)
                parts.append(f"no {name} {', '.join([str(number) for number in numbers[:10]])}")
        return "; ".join(parts)

    def choice(self, from_ns: int, to_ns: int) -> Choice:
        """Return the `Choice` of the wanted packets between two times, both included (nanoseconds since 1970)."""
        frames = set(self._frames)
        ordered = list(worst_first(self._findings))
        for finding in ordered:
            if finding.number in self._wanted.findings or finding.slug in self._wanted.slugs:
                frames.update([int(frame) for frame in finding.frames])
        comments: dict[int, list[str]] = {}
        if self._comments:
            for finding in ordered:
                text = finding_comment(finding)
                for frame in sorted(set(finding.frames)):
                    comments.setdefault(int(frame), []).append(text)
        same = self._same.found
        places = Places(frozenset(frames), same)
        places.add_connections([_stretch(connection) for connection in self._connections.values()])
        places.add_spans(self._spans)
        choice = Choice(self._wanted.everything, places, (from_ns, to_ns), comments)
        marked = [_stretch(connection, frame) for connection, frame in self._unanswered]
        if self._context is not None:
            for number in self._around:
                beginning = self._context.of(number)
                self._around_frames.update(beginning.frames)
                self._around_spans += beginning.opening
            marked = [_stretch(connection) for connection in self._around.values()]
        if marked:
            around = Places(frozenset(self._around_frames), same)
            around.mark(marked)
            around.add_spans(self._around_spans)
            choice.surround(around)
        return choice


def _stretch(connection: Connection, first: int = 0) -> Stretch:
    """Return where the packets of a connection are, from packet ``first`` on."""
    tcp = connection.tcp
    protocol = ip.UDP if connection.udp else ip.TCP
    return Stretch(keys_of(tcp)[0], protocol, max(int(tcp.first_frame), first), int(tcp.last_frame))


class SameKeys:
    """Keys of packets of one connection in several VLANs: ``found`` has the first key of a connection for each other key."""

    def __init__(self) -> None:
        self.found: dict[bytes, bytes] = {}

    def note(self, tcp: TcpConnection) -> None:
        """Note the keys of a connection that is over."""
        if not tcp.also or len(self.found) >= MAX_CONNECTIONS:
            return
        first, *others = keys_of(tcp)
        for key in others:
            for own, other in ((first, key), (reverse_key(first), reverse_key(key))):
                known = self.found.get(own, own)
                if self.found.get(other, other) != known:
                    self.found[other] = known


class Choice:
    """Recognises wanted packets. ``comments`` are findings by the number of the packet that they concern, the worst first.

    ``context`` counts packets that are wanted only because they begin or end the connection of a wanted transaction.
    """

    def __init__(
        self, everything: bool, wanted: Places, times: tuple[int, int], comments: dict[int, list[str]]
    ) -> None:
        self.comments = comments
        self.context = 0
        self._everything = everything
        self._wanted = wanted
        self._around: Places | None = None
        self.times = times
        self._from_ns, self._to_ns = times
        self._narrow: Callable[[int, int, bytes, int, int, int], bool] | None = None

    @property
    def everything(self) -> bool:
        """Whether all packets between the two ``times`` are wanted, so that `takes` need not be called."""
        return self._everything and self._narrow is None and self._around is None

    def narrow(self, test: Callable[[int, int, bytes, int, int, int], bool]) -> None:
        """Want only packets for which ``test``, called with the arguments of `takes`, returns True, too."""
        self._narrow = test

    def surround(self, around: Places) -> None:
        """Also want these packets, as context."""
        self._around = around

    def takes(self, frame: int, time_ns: int, buf: bytes, start: int, end: int, link_type: int) -> bool:
        """Return whether packet ``frame`` is wanted. Never raises."""
        if self._narrow is not None and not self._narrow(frame, time_ns, buf, start, end, link_type):
            return False
        if not self._from_ns <= time_ns <= self._to_ns:
            return False
        wanted, around = self._wanted, self._around
        if self._everything or frame in wanted.frames:
            return True
        found = None
        if wanted.looks or (around is not None and around.looks):
            found = parsed(buf, start, end, link_type)
        if found is not None and wanted.wants(frame, time_ns, buf, *found):
            return True
        if around is None:
            return False
        if frame in around.frames or (found is not None and around.wants(frame, time_ns, buf, *found)):
            self.context += 1
            return True
        return False
