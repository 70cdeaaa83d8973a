"""`Selection`: finds out in the first reading of a capture which packets are wanted, in little memory.

It observes an analysis. Afterwards `Selection.choice` returns a `Choice`, which recognises the packets in the second reading:
by addresses and ports of connections, sequence numbers of transactions, and numbers of packets with findings. It also takes
what is needed to understand a message: the beginning of its connection, the negotiation, and the end.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Final

from mypy_extensions import i64

from dissect.engine.observer import Observer
from dissect.findings.bounds import KEPT
from dissect.findings.reporter import Finding
from dissect.ibh.packet import parse_packet
from dissect.ibh.tables import KIND_CONFIRM, KIND_CONNECT, KIND_DISCONNECT, KIND_GO_AHEAD, KIND_SERVICE
from dissect.iso.tables import CC, CR, DC, DR
from dissect.recording.comments import finding_comment
from dissect.recording.spans import Span, SpanBook
from dissect.recording.subscriptions import Asked, SubscriptionBook
from dissect.report.contract import by_weight
from dissect.s7.tables import SETUP_COMMUNICATION as _SETUP
from dissect.tcp import ip, link
from dissect.tcp.connection import TcpConnection
from dissect.tcp.stream import FIN, RST, SYN
from dissect.tcp.tunnel import Inner
from dissect.transactions.connection import Connection
from dissect.transactions.side import Side
from dissect.transactions.table import keys_of, reverse_key
from dissect.transactions.transaction import PUSH, Transaction
from dissect.wire.octets import u16, u32

#: Greatest number of connections that are remembered, and of packets of each that opened or closed it above TCP.
MAX_CONNECTIONS: Final = 16_384
MAX_FRAMES: Final = 16


class Beginning:
    """The ``frames`` of TPDUs or IBH-NetLink packets that open or close a connection; frames and spans of its latest Setup."""

    __slots__ = ("frames", "setup", "spans")

    def __init__(self) -> None:
        self.frames: list[int] = []
        self.setup: list[int] = []
        self.spans: list[Span] = []


class ContextBook:
    """Beginnings by the number of their connection; if there are too many, the least recently used are forgotten."""

    def __init__(self) -> None:
        self._known: OrderedDict[int, Beginning] = OrderedDict()

    def opened(self, number: int, frame: int) -> None:
        """Packet ``frame`` opens or closes connection ``number``."""
        beginning = self.of(number)
        if len(beginning.frames) < MAX_FRAMES:
            beginning.frames.append(frame)

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
#: The octet of the TCP header with the flags, and the flags that open and close a connection.
_FLAGS_AT: Final = 13
_MARKS: Final = SYN | FIN | RST
#: Retransmissions of a transaction's octets are searched for so long before its request and after its answer.
AGAIN_NS: Final = 10_000_000_000


class Wanted:
    """What is wanted: numbers of connections, transactions and findings, slugs of findings. All empty: everything.

    Findings are numbered as the analysis lists their details, the heaviest first, from 1.
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


class Stretch:
    """A connection in the capture: ``key`` of one direction, TCP or UDP, from packet ``first`` to packet ``last``."""

    __slots__ = ("first", "key", "last", "protocol")

    def __init__(self, key: bytes, protocol: int, first: int, last: int) -> None:
        self.key = key
        self.protocol = protocol
        self.first = first
        self.last = last


class TimedSpan:
    """The range of a PDU, and the times between which its octets are searched for."""

    __slots__ = ("from_ns", "span", "to_ns")

    def __init__(self, span: Span, from_ns: int, to_ns: int) -> None:
        self.span = span
        self.from_ns = from_ns
        self.to_ns = to_ns


class Selection(Observer):
    """Observes the first reading. Afterwards ``missing`` says in words what was wanted but not found; empty if nothing.

    With ``context``, the packets that begin and end the connection of a wanted transaction, and its Setup, are wanted, too.
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
        self._book.tpkt(side, octets)
        if self._context is not None and octets[5] >> 4 in _OPENING:
            self._context.opened(int(side.connection.number), int(frame))

    def ibh_packet(self, frame: i64, time_ns: i64, side: Side, octets: bytes) -> None:
        """Note where in its stream an IBH-NetLink packet is."""
        self._book.ibh_packet(side, octets)
        if self._context is not None and parse_packet(octets).kind in _OPENING_IBH:
            self._context.opened(int(side.connection.number), int(frame))

    def pdu(self, frame: i64, time_ns: i64, side: Side, octets: bytes, cut: bool) -> None:
        """Take note where a PDU stands in its stream."""
        self._book.pdu(side, int(frame), len(octets))

    def plus_pdu(self, frame: i64, time_ns: i64, side: Side, octets: bytes, cut: bool) -> None:
        """Take note where a PDU stands in its stream."""
        self._book.pdu(side, int(frame), len(octets))

    def transaction(self, transaction: Transaction) -> None:
        """Remember where in their streams request and answer of a wanted transaction are."""
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
        if finding.room == KEPT:  # of these there are only so many
            self._findings.append(finding)

    # ---- what came of it --------------------------------------------------------------------------------------------

    @property
    def missing(self) -> str:
        """What was wanted by number but is not in the capture, in words; empty if everything is there."""
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
        ordered = list(by_weight(self._findings))
        for finding in ordered:
            if finding.number in self._wanted.findings or finding.slug in self._wanted.slugs:
                frames.update([int(frame) for frame in finding.frames])
        comments: dict[int, list[str]] = {}
        if self._comments:
            for finding in ordered:
                text = finding_comment(finding)
                for frame in sorted(set(finding.frames)):
                    comments.setdefault(int(frame), []).append(text)
        stretches = [_stretch(connection) for connection in self._connections.values()]
        times = (from_ns, to_ns)
        same = self._same.found
        choice = Choice(self._wanted.everything, frozenset(frames), stretches, self._spans, times, comments, same)
        marked = [_stretch(connection, frame) for connection, frame in self._unanswered]
        if self._context is not None:
            for number in self._around:
                self._around_frames.update(self._context.of(number).frames)
            marked = [_stretch(connection) for connection in self._around.values()]
        if marked:
            choice.surround(frozenset(self._around_frames), marked, self._around_spans)
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
    """Recognises wanted packets. ``comments`` are findings by the number of the packet that they are about, the worst first.

    ``context`` counts packets that are wanted only because they begin or end the connection of a wanted transaction.
    """

    def __init__(
        self,
        everything: bool,
        frames: frozenset[int],
        stretches: Sequence[Stretch],
        spans: Sequence[TimedSpan],
        times: tuple[int, int],
        comments: dict[int, list[str]],
        same: Mapping[bytes, bytes],
    ) -> None:
        self._same = same
        self.comments = comments
        self.context = 0
        self._narrow: Callable[[int, int, bytes, int, int, int], bool] | None = None
        self._around: Choice | None = None
        self._marked: dict[bytes, list[Stretch]] = {}  # connections whose SYN, FIN and RST packets are wanted
        self._everything = everything
        self._frames = frames
        self._from_ns, self._to_ns = times
        self._stretches: dict[bytes, list[Stretch]] = {}
        self._spans: dict[bytes, list[TimedSpan]] = {}
        self._hosts: dict[bytes, list[Stretch]] = {}  # by addresses only, for IP fragments, which have no ports
        for stretch in stretches:
            for key in self._keys(stretch):
                self._stretches.setdefault(key, []).append(stretch)
                self._hosts.setdefault(_addresses(key), []).append(stretch)
        self._span_hosts: dict[bytes, list[TimedSpan]] = {}
        self._first = min([one.first for one in stretches], default=1)
        self._last = max([one.last for one in stretches], default=0)
        self._begin = min([one.from_ns for one in spans], default=1)
        self._end = max([one.to_ns for one in spans], default=0)
        for timed in spans:
            self._spans.setdefault(same.get(timed.span.key, timed.span.key), []).append(timed)
            self._span_hosts.setdefault(_addresses(timed.span.key), []).append(timed)

    def narrow(self, test: Callable[[int, int, bytes, int, int, int], bool]) -> None:
        """Want only packets for which ``test``, called with the arguments of `takes`, returns True, too."""
        self._narrow = test

    def surround(self, frames: frozenset[int], marked: Sequence[Stretch], spans: Sequence[TimedSpan]) -> None:
        """Also want these packets, and those that open or close the TCP connections ``marked``."""
        self._around = Choice(False, frames, (), spans, (self._from_ns, self._to_ns), {}, self._same)
        self._around.mark(marked)

    def mark(self, stretches: Sequence[Stretch]) -> None:
        """Want the packets that open and close these TCP connections."""
        for stretch in stretches:
            for key in self._keys(stretch):
                self._marked.setdefault(key, []).append(stretch)

    def _keys(self, stretch: Stretch) -> tuple[bytes, bytes]:
        """Return the keys of both directions by which a stretch is looked up."""
        there, back = stretch.key, reverse_key(stretch.key)
        return self._same.get(there, there), self._same.get(back, back)

    def takes(self, frame: int, time_ns: int, buf: bytes, start: int, end: int, link_type: int) -> bool:
        """Return whether packet ``frame`` is wanted. Never raises."""
        if self._narrow is not None and not self._narrow(frame, time_ns, buf, start, end, link_type):
            return False
        if self._wants(frame, time_ns, buf, start, end, link_type):
            return True
        if self._around is None or not self._around.takes(frame, time_ns, buf, start, end, link_type):
            return False
        self.context += 1
        return True

    def _wants(self, frame: int, time_ns: int, buf: bytes, start: int, end: int, link_type: int) -> bool:
        if not self._from_ns <= time_ns <= self._to_ns:
            return False
        if self._everything or frame in self._frames:
            return True
        if not self._hosts and not self._span_hosts and not self._marked:
            return False
        found = _parsed(buf, start, end, link_type)
        if found is None:
            return False
        packet, key = found
        if packet.fragment_key:
            return self._takes_fragment(frame, time_ns, packet)
        if not key:
            return False
        key = self._same.get(key, key)
        protocol = packet.protocol
        if any(one.first <= frame <= one.last and one.protocol == protocol for one in self._stretches.get(key, ())):
            return True
        if protocol == ip.TCP and packet.end - packet.start >= _FLAGS_AT + 1 and buf[packet.start + _FLAGS_AT] & _MARKS:
            if any(one.first <= frame <= one.last for one in self._marked.get(key, ())):
                return True
        spans = self._spans.get(key) if protocol == ip.TCP else None
        return spans is not None and _carries(spans, time_ns, buf, packet)

    def _takes_fragment(self, frame: int, time_ns: int, packet: ip.IpPacket) -> bool:
        """Return whether an IP fragment is wanted: it is between the hosts of something wanted, at that time.

        A fragment of a tunnel does not show whose packet is in it, so any one at that time is wanted.
        """
        if packet.protocol in ip.CARRIERS and (
            self._first <= frame <= self._last or self._begin <= time_ns <= self._end
        ):
            return True
        if any(one.first <= frame <= one.last for one in self._hosts.get(packet.addresses, ())):
            return True
        return any(one.from_ns <= time_ns <= one.to_ns for one in self._span_hosts.get(packet.addresses, ()))


def _parsed(buf: bytes, start: int, end: int, link_type: int) -> tuple[ip.IpPacket, bytes] | None:
    """Return the IP packet in a frame, and its key (empty for a fragment or without ports); None if there is no IP packet."""
    at, vlan = link.find_ip(buf, start, end, link_type)
    if at >= 0:
        packet = ip.parse_ip(buf, at, end, True)
        if packet.problem:
            return None
        if packet.protocol != ip.TCP:
            inner = Inner(packet, vlan, True)
            inner.descend(buf)
            if not inner.problem:
                packet, vlan = inner.packet, inner.vlan
    elif at == link.FRAME:
        inner = Inner(ip.IpPacket(), 0, True)
        inner.open_frame(buf, vlan, end)
        inner.descend(buf)
        if inner.problem:
            return None
        packet, vlan = inner.packet, inner.vlan
    else:
        return None
    if packet.fragment_key or packet.end - packet.start < 4:
        return packet, b""
    tag = int(vlan).to_bytes(8, "big") if vlan else b""
    return packet, b"%b%b%b" % (packet.addresses, buf[packet.start : packet.start + 4], tag)


def packet_key(buf: bytes, start: int, end: int, link_type: int) -> tuple[bytes, bytes]:
    """Return the key of a TCP or UDP packet, and its two addresses; both are empty for other packets. Never raises."""
    found = _parsed(buf, start, end, link_type)
    if found is None:
        return b"", b""
    packet, key = found
    return (key if packet.protocol in {ip.TCP, ip.UDP} else b""), packet.addresses


def _addresses(key: bytes) -> bytes:
    """Return the addresses of a key, without ports and VLAN."""
    return key[:8] if len(key) in (12, 20) else key[:32]


def _carries(spans: Sequence[TimedSpan], time_ns: int, buf: bytes, packet: ip.IpPacket) -> bool:
    """Return whether a TCP segment carries octets of one of ``spans``."""
    at, end = int(packet.start), int(packet.end)
    if end - at < 20:
        return False
    seq = u32(buf, at + 4)
    size = end + int(packet.missing) - at - (u16(buf, at + 12) >> 12 << 2)
    return any(one.from_ns <= time_ns <= one.to_ns and one.span.overlaps(seq, size) for one in spans)
