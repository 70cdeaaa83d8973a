"""`Side`: one direction of a connection, with the state of all code that reads what this side sends."""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.probes import Probes
from dissect.engine.transactions.protocol import Kept, Protocol
from dissect.engine.transactions.stray import Stray
from dissect.packets.tcp.connection import TcpConnection
from dissect.packets.tcp.stream import FAR_AHEAD, HALF_SPACE, MASK, WINDOW, HalfStream
from dissect.packets.tcp.stretches import Chunk
from dissect.protocols.ibh.framer import PacketFramer
from dissect.protocols.iso.cotp import Assembler
from dissect.protocols.iso.tpkt import MIN_LENGTH, Framer
from dissect.protocols.s7plus.assembly import PlusAssembler
from dissect.protocols.s7plus.stream import FrameStream

#: More octets than this cannot be missing, because they exceed the largest window (RFC 7323, 2.3): the acknowledgement is not
#: for them.
_MOST_UNSEEN: Final = 1 << 30


class Place:
    """The position of a direction: a packet, the sequence number after its octets, and its acknowledgement."""

    __slots__ = ("ack", "end_seq", "frame", "time_ns")

    def __init__(self) -> None:
        self.frame: i64 = 0
        self.time_ns: i64 = 0
        self.end_seq: i64 = 0
        self.ack: i64 = -1


class Side:
    """One direction of a connection: the data that side ``index`` sends, and the state of all code that reads it."""

    __slots__ = (
        "acked",
        "addresses",
        "also",
        "assembler",
        "begun_tpkt",
        "begun_tsdu",
        "connection",
        "end_seq",
        "fin_seq",
        "first_ack",
        "fourth",
        "framer",
        "hole_end",
        "hole_frame",
        "holes",
        "ibh",
        "index",
        "inner",
        "kept",
        "key",
        "last_ack",
        "longest",
        "missing",
        "numbers_fine",
        "peer",
        "place",
        "plus",
        "ports",
        "probes",
        "protocol",
        "requests",
        "rival",
        "second",
        "size",
        "slight",
        "stray",
        "stream",
        "tcp",
        "third",
        "told_jobs",
        "told_overdue",
        "waiting",
        "watched",
    )

    def __init__(self, index: i64, key: bytes, tcp: TcpConnection, connection: Connection, protocol: Protocol) -> None:
        self.index: i64 = index
        self.key: bytes = key
        self.also: list[bytes] | None = None  # further keys that lead to it: those of its packets in other VLANs
        self.tcp: TcpConnection = tcp
        self.connection: Connection = connection
        self.protocol: Protocol = protocol  # takes its octets; the same for both sides of a connection
        self.stream: HalfStream = tcp.streams[index]
        self.framer: Framer = Framer()
        self.ibh: PacketFramer | None = None  # frames instead of `framer` once the connection speaks IBH-NetLink
        self.assembler: Assembler = Assembler()
        self.plus: PlusAssembler | None = None  # there from the first S7comm-plus frame on
        self.inner: FrameStream | None = None  # frames decrypted data; exists once there are any
        self.kept: Kept | None = None  # state of another protocol that frames the stream itself, instead of `framer`
        self.peer: Side | None = None
        self.place: i64 = -1  # where `ConnectionTable.find` found it last, by the next ones
        self.addresses: i64 = 0
        self.ports: i64 = 0
        self.second: i64 = 0  # what IPv6 addresses have after `addresses`
        self.third: i64 = 0
        self.fourth: i64 = 0
        self.last_ack: i64 = -1  # TCP acknowledgement of the packet at hand
        #: The highest sequence number that the other side is known to have sent: this side acknowledged it, or the other side
        #: continued after it; -1 for none.
        self.acked: i64 = -1
        self.first_ack: i64 = -1  # the first number that this side acknowledged
        #: Sequence number after the octets at hand; before the first ones their own, -1 while that is unknown.
        self.end_seq: i64 = -1
        self.size: i64 = 0  # number of octets in that segment
        self.fin_seq: i64 = -1  # the number of its FIN, -1 for none
        self.begun_tpkt: Place | None = None  # the latest packet that left a TPKT unfinished
        self.begun_tsdu: Place | None = None  # the latest packet with a DT that left a TSDU unfinished
        #: The longest TPKT that the fast path may take next (`IsoOnTcp.longest`), 0 if more must be examined.
        self.longest: i64 = 0
        self.requests: i64 = 0
        # the numbers of its TPDUs are known not to be the reason for unanswered requests
        self.numbers_fine: bool = False
        self.probes: Probes | None = None  # keep-alives before anything else was captured
        self.holes: i64 = 0
        self.missing: i64 = 0  # octets in holes
        self.hole_frame: i64 = 0  # packet at which the latest gap was declared
        self.hole_end: i64 = -1  # sequence number after the gap, -1 for none, or if it is the rest of a cut packet
        # a gap that contains no message unless another follows at once; kept until that is known
        self.slight: Chunk | None = None
        self.waiting: bool = False  # it is in the list of sides that `Timers` checks when time passes
        self.watched: bool = False  # `OverdueWatch` checks its requests
        self.told_jobs: i64 = 0  # packet of its latest request that exceeded the granted number
        self.told_overdue: i64 = 0  # number of its latest request that was reported as overdue
        self.stray: Stray | None = None  # exists while its octets belong to no TPKT
        self.rival: Rival | None = None  # a SYN with new sequence numbers that nothing has confirmed yet

    def speak(self, protocol: Protocol) -> None:
        """From now on ``protocol`` takes the octets of both directions."""
        self.protocol = protocol
        if self.peer is not None:
            self.peer.protocol = protocol
        self.connection._state = protocol.state

    def note_probe(self, frame: i64, time_ns: i64, filled: bool) -> None:
        """Packet ``frame`` is a keep-alive before all other packets; ``filled``: it has an octet."""
        if self.probes is None:
            self.probes = Probes()
        self.probes.add(frame, time_ns, filled)

    def note_place(self, place: Place | None, frame: i64, time_ns: i64) -> Place:
        """Return ``place``, or a new one, with the position of the side at packet ``frame``."""
        if place is None:
            place = Place()
        place.frame = frame
        place.time_ns = time_ns
        place.end_seq = self.end_seq
        place.ack = self.last_ack
        return place

    def begin(self, seq: i64) -> None:
        """Its octets begin at sequence number ``seq``."""
        self.stream.start(seq)
        self.end_seq = self.stream.next_seq

    def begin_late(self, seq: i64) -> None:
        """Begin with ``seq``, the first captured octets; earlier ones that the other side had not acknowledged are a gap.

        A segment before these was retransmitted or captured late, and begins the stream.
        """
        peer = self.peer
        begin: i64 = seq
        if peer is not None and peer.first_ack >= 0 and (seq - peer.first_ack) & MASK <= FAR_AHEAD:
            begin = peer.first_ack
        self.begin(begin)

    def note_ack(self, seq: i64, ack: i64) -> None:
        """Take the acknowledgement of a packet of this side; if its ``seq`` is far off, it may belong to another connection."""
        if self.stream.next_seq >= 0 and not -FAR_AHEAD <= self.stream.distance(seq) <= FAR_AHEAD:
            return
        if self.acked < 0:
            self.acked = ack
            self.first_ack = ack
        elif (ack - self.acked) & MASK < HALF_SPACE:
            self.acked = ack

    def note_bare(self, seq: i64, ends: bool) -> None:
        """Take the sequence number of a packet without data; ``ends``: it has SYN, FIN or RST, and may be forged."""
        peer = self.peer
        if self.stream.next_seq < 0 and peer is not None and peer.first_ack >= 0:
            if MIN_LENGTH <= (seq - peer.first_ack) & MASK <= FAR_AHEAD:
                self.begin(peer.first_ack)  # what it sent after the other side's first acknowledgement is a gap
        if not ends:
            self.note_end(seq)

    def note_end(self, seq: i64) -> None:
        """Take the sequence number of a packet without data: earlier octets were sent, even if they were not captured."""
        peer = self.peer
        if peer is None or peer.acked < 0 or self.end_seq < 0:
            return
        if self.is_ahead(seq) and (seq - self.end_seq) & MASK <= WINDOW:
            if (seq - peer.acked) & MASK < HALF_SPACE:
                peer.acked = seq

    def note_gap(self, frame: i64, end_seq: i64) -> None:
        """Octets up to ``end_seq`` (-1: unknown) are declared missing at packet ``frame``; they may include a message."""
        self.hole_frame = frame
        self.hole_end = end_seq

    def is_ahead(self, ack: i64) -> bool:
        """Return whether ``ack``, of the other side, acknowledges octets of this side that were not passed on yet."""
        known: i64 = self.end_seq
        if known < 0:
            peer = self.peer
            if peer is None or peer.first_ack < 0:
                return False
            known = peer.first_ack
        return ack >= 0 and 0 < (ack - known) & MASK < HALF_SPACE

    @property
    def unseen(self) -> i64:
        """Number of octets of this side that the other side acknowledged but that were not passed on.

        0 if they are so few that they are only the numbers of FINs and not a message; a single one counts as 0 even while a
        message is begun.
        """
        peer = self.peer
        if peer is None or peer.acked < 0:
            return 0
        known: i64 = self.end_seq
        if known < 0:
            known = peer.first_ack
        ahead: i64 = (peer.acked - known) & MASK
        least: i64 = 2 if self.unfinished else MIN_LENGTH
        return ahead if least <= ahead < _MOST_UNSEEN else 0

    @property
    def at_rest(self) -> bool:
        """True when the octets passed on so far end with a whole message."""
        if self.framer.buffered or self.framer.skip or not self.assembler.clear:
            return False
        if self.ibh is not None and self.ibh.buffered:
            return False
        if self.plus is not None and self.plus.parts is not None:
            return False
        return self.kept is None

    @property
    def unfinished(self) -> bool:
        """True while a TPKT or a TSDU is unfinished; a wrong length or a missing end mark makes a whole one look unfinished."""
        return self.framer.buffered > 0 or not self.assembler.clear

    @property
    def captured(self) -> bool:
        """True when any packet of this side was captured; a RST need not acknowledge anything."""
        return self.last_ack >= 0 or self.stream.start_seq >= 0 or self.tcp.reset_by == self.index


class Rival:
    """A SYN with the address of a side of an open connection, which would begin a new one; it may be forged.

    ``seq`` is the sequence number after it. ``octets`` is the number of octets that this side had sent until then, ``answered``
    the number of the other side; ``last_frame`` and ``last_ns`` are the latest packet of the open connection before the SYN.
    """

    __slots__ = ("answered", "frame", "last_frame", "last_ns", "octets", "seq", "time_ns")

    def __init__(self, tcp: TcpConnection, seq: i64, octets: i64, answered: i64, frame: i64, time_ns: i64) -> None:
        self.last_frame: i64 = tcp.last_frame
        self.last_ns: i64 = tcp.last_ns
        self.seq: i64 = seq
        self.octets: i64 = octets
        self.answered: i64 = answered
        self.frame: i64 = frame
        self.time_ns: i64 = time_ns
