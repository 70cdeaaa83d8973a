"""One direction of a connection: everything that reads what its side sends."""

from __future__ import annotations

from mypy_extensions import i64

from dissect.ibh.framer import PacketFramer
from dissect.iso.cotp import Assembler
from dissect.iso.tpkt import Framer
from dissect.s7plus.assembly import PlusAssembler
from dissect.s7plus.stream import FrameStream
from dissect.tcp.connection import TcpConnection
from dissect.tcp.stream import HalfStream
from dissect.transactions.connection import Connection
from dissect.transactions.probes import Probes
from dissect.transactions.protocol import Kept, Protocol
from dissect.transactions.stray import Stray


class Place:
    """Where a direction stood: a packet of it, the sequence number after its octets, and the acknowledgement it came with."""

    __slots__ = ("ack", "end_seq", "frame", "time_ns")

    def __init__(self) -> None:
        self.frame: i64 = 0
        self.time_ns: i64 = 0
        self.end_seq: i64 = 0
        self.ack: i64 = -1


class Side:
    """One direction of a connection: everything that reads what side ``index`` sends."""

    __slots__ = (
        "addresses",
        "also",
        "assembler",
        "begun_tpkt",
        "begun_tsdu",
        "connection",
        "end_seq",
        "framer",
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
        "peer",
        "place",
        "plus",
        "ports",
        "probes",
        "protocol",
        "requests",
        "rival",
        "stray",
        "stream",
        "tcp",
        "told_overdue",
        "waiting",
        "watched",
    )

    def __init__(self, index: i64, key: bytes, tcp: TcpConnection, connection: Connection, protocol: Protocol) -> None:
        self.index: i64 = index
        self.key: bytes = key
        self.also: list[bytes] | None = None  # keys by which it is found besides: its packets in other VLANs
        self.tcp: TcpConnection = tcp
        self.connection: Connection = connection
        self.protocol: Protocol = protocol  # takes its octets; that of its peer is the same
        self.stream: HalfStream = tcp.streams[index]
        self.framer: Framer = Framer()
        self.ibh: PacketFramer | None = None  # in the place of `framer` once the connection speaks IBH-NetLink
        self.assembler: Assembler = Assembler()
        self.plus: PlusAssembler | None = None  # there from the first S7comm-plus frame on
        self.inner: FrameStream | None = None  # of what was decrypted; there from the first of it on
        self.kept: Kept | None = None  # of another protocol that frames the stream by itself, in the place of `framer`
        self.peer: Side | None = None
        self.place: i64 = -1  # where `ConnectionTable.find` found it last, by these two
        self.addresses: i64 = 0
        self.ports: i64 = 0
        self.last_ack: i64 = -1  # TCP acknowledgement of the packet at hand
        self.end_seq: i64 = 0  # sequence number after the octets at hand
        self.begun_tpkt: Place | None = None  # the latest packet that left a TPKT unfinished
        self.begun_tsdu: Place | None = None  # the latest one with a DT that left a TSDU unfinished
        #: The longest TPKT that is taken straight if it comes next (`IsoOnTcp.longest`), 0 where more has to be looked at.
        self.longest: i64 = 0
        self.requests: i64 = 0
        self.probes: Probes | None = None  # keep-alives before anything else was captured
        self.holes: i64 = 0
        self.missing: i64 = 0  # octets in holes
        self.hole_frame: i64 = 0  # packet at which the latest hole was given up
        self.waiting: bool = False  # in the pipeline's list of sides to look at when time passes
        self.watched: bool = False  # of those whose requests are watched for being overdue
        self.told_overdue: i64 = 0  # number of its latest request that was told to be
        self.stray: Stray | None = None  # inside a stretch that belongs to no TPKT
        self.rival: Rival | None = None  # a SYN with other numbers, which nothing has confirmed

    def speak(self, protocol: Protocol) -> None:
        """From now on ``protocol`` takes the octets of both directions."""
        self.protocol = protocol
        if self.peer is not None:
            self.peer.protocol = protocol
        self.connection.state = protocol.state

    def note_probe(self, frame: i64, time_ns: i64, filled: bool) -> None:
        """Packet ``frame`` is a keep-alive, before anything else was captured; ``filled``: with a byte."""
        if self.probes is None:
            self.probes = Probes()
        self.probes.add(frame, time_ns, filled)

    def note_place(self, place: Place | None, frame: i64, time_ns: i64) -> Place:
        """Return ``place``, or a new one, that says where the side stands with packet ``frame``."""
        if place is None:
            place = Place()
        place.frame = frame
        place.time_ns = time_ns
        place.end_seq = self.end_seq
        place.ack = self.last_ack
        return place

    @property
    def at_rest(self) -> bool:
        """True when the octets passed on so far end with whole messages: none is begun."""
        if self.framer.buffered or self.framer.skip or not self.assembler.clear:
            return False
        if self.ibh is not None and self.ibh.buffered:
            return False
        if self.plus is not None and self.plus.parts is not None:
            return False
        return self.kept is None

    @property
    def unfinished(self) -> bool:
        """True while a TPKT or a TSDU is begun; it may be whole, if its length or the lack of its end mark is wrong."""
        return self.framer.buffered > 0 or not self.assembler.clear

    @property
    def captured(self) -> bool:
        """True when any packet of this side was captured; a RST need not acknowledge anything."""
        return self.last_ack >= 0 or self.stream.start_seq >= 0 or self.tcp.reset_by == self.index


class Rival:
    """A SYN that a side of an open connection is said to have sent, to begin another one: ``seq`` is the number after it.

    ``octets`` is how many that side had sent then, ``answered`` how many the other one; ``last_frame`` and ``last_ns`` are the
    latest packet of the connection before it.
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
