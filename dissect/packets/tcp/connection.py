"""`TcpConnection`: the two ends of a TCP connection and their streams, how it began and how it ended."""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64, mypyc_attr

from dissect.packets.tcp.doubt import Doubt
from dissect.packets.tcp.stream import FAR_AHEAD, MASK, Endpoint, HalfStream
from dissect.wire.copies import leaves

#: A reset counts if it is at most this far from the expected sequence number (RFC 5961 wants it exact; captures lose segments).
_RESET_WINDOW: Final = 65536
#: The Ethernet address where there is none, as on loopback.
_NO_MAC: Final = bytes(6)


@mypyc_attr(acyclic=True)  # many are kept, and each is smaller without the header of the garbage collector
class TcpConnection:
    """The TCP facts of a connection. Sides are 0 and 1: side 0 sent the SYN, or the first packet when there was none.

    ``initiator`` is the side that sent the SYN, -1 when it was not captured. ``ended`` is empty while the connection is open,
    then what came first: ``fin``, ``reset``, ``reused`` (a new connection took its addresses) or ``evicted``. ``ended_by`` is
    the side that began to close, -1 for none. ``reset_by``, ``reset_frame`` and ``reset_ns`` are side, packet and time of the
    first RST, which may follow a FIN (-1, 0 and 0 for none). ``doubt`` is set while ``ended`` rests on a packet that its
    receiver may have ignored. ``macs`` are the Ethernet addresses of both sides at the beginning, six octets each, empty where
    the link has none; ``heard`` has a bit for each side that was captured sending, so that its address is certain. ``vlan`` is
    the VLAN key (`link.find_ip`) of the first packet, ``also`` those of other VLANs in which packets of the connection were
    captured.
    """

    __slots__ = (
        "_first_octets",
        "_first_position",
        "_second_octets",
        "_second_position",
        "_silent",
        "_streams",
        "also",
        "doubt",
        "ended",
        "ended_by",
        "ended_frame",
        "ended_ns",
        "ends",
        "first_frame",
        "first_ns",
        "heard",
        "initiator",
        "last_frame",
        "last_ns",
        "macs",
        "packets",
        "reset_by",
        "reset_frame",
        "reset_ns",
        "vlan",
    )

    def __init__(self, first: Endpoint, second: Endpoint, vlan: i64, frame: i64, time_ns: i64) -> None:
        self.ends: list[Endpoint] = [first, second]
        self.vlan: i64 = vlan
        self.also: tuple[int, ...] = ()
        self._streams: list[HalfStream] | None = [HalfStream(), HalfStream()]
        self._first_octets: i64 = 0  # this and the next three keep data of dropped streams
        self._first_position: i64 = 0
        self._second_octets: i64 = 0
        self._second_position: i64 = 0
        self.initiator: i64 = -1
        self.first_frame: i64 = frame
        self.first_ns: i64 = time_ns
        self.last_frame: i64 = frame
        self.last_ns: i64 = time_ns
        self.packets: i64 = 0
        self._silent: i64 = 0  # a bit for each side that sends nothing more
        self.doubt: Doubt | None = None
        self.ended: str = ""
        self.ended_by: i64 = -1
        self.ended_frame: i64 = 0
        self.ended_ns: i64 = 0
        self.reset_by: i64 = -1
        self.reset_frame: i64 = 0
        self.reset_ns: i64 = 0
        self.macs: bytes = b""
        self.heard: i64 = 0

    def __repr__(self) -> str:
        ended = f", {self.ended}" if self.ended else ""
        return f"TcpConnection({self.ends[0]} → {self.ends[1]}, {self.packets} packets{ended})"

    @property
    def streams(self) -> list[HalfStream]:
        """The data of each side; after `let_go` only ``octets`` and ``position`` are right."""
        found = self._streams
        if found is not None:
            return found
        first, second = HalfStream(), HalfStream()
        first.octets, first.position = self._first_octets, self._first_position
        second.octets, second.position = self._second_octets, self._second_position
        return [first, second]

    def let_go(self) -> None:
        """The connection is over: keep how much data it carried and drop the streams, because results keep many connections."""
        streams = self._streams
        if streams is None:
            return
        first, second = streams
        self._first_octets = first.octets
        self._first_position = first.position
        self._second_octets = second.octets
        self._second_position = second.position
        self._streams = None

    def note_vlan(self, vlan: int) -> None:
        """Take a VLAN in which packets of the connection were captured as well."""
        if vlan != self.vlan and vlan not in self.also:
            self.also = (*self.also, vlan)

    def note_link(self, side: i64, addresses: bytes) -> None:
        """Take the Ethernet addresses of a packet that ``side`` sent, the receiver's first, as on the wire."""
        if len(addresses) != 12:
            return
        if side == 1 and (self.heard == 0 or addresses == self.macs):  # the order in which they are kept
            self.macs = addresses
            self.heard |= 2
            return
        sender, receiver = addresses[6:], addresses[:6]
        if self.heard & (2 >> side):
            receiver = self.macs[6 - 6 * side : 12 - 6 * side]
        self.macs = sender + receiver if side == 0 else receiver + sender
        self.heard |= 1 << side

    def mac(self, side: i64) -> bytes:
        """Return the Ethernet address of a side; empty where it is not known, all zeros, or that of a group."""
        found = self.macs[6 * side : 6 * side + 6]
        return found if found and found != _NO_MAC and not found[0] & 1 else b""

    @property
    def has_holes(self) -> bool:
        """True when octets of either direction are missing from the capture."""
        first, second = self.streams
        return first.position > first.octets or second.position > second.octets

    @property
    def known_start(self) -> bool:
        """True when the SYN was captured, so that nothing before it can have been missed."""
        return self.initiator >= 0

    def is_new_connection(self, side: i64, isn: i64) -> bool:
        """Return whether a SYN with this initial sequence number starts a different connection from this one."""
        stream = self.streams[side]
        if stream.start_seq < 0:
            return bool(self.ended)
        return stream.start_seq != ((isn + 1) & MASK)

    def note_fin(self, side: i64, end_seq: i64, frame: i64, time_ns: i64, read: bool = True) -> bool:
        """Take a FIN; the first one says who closed. False when it is far from what is expected, and is ignored.

        ``end_seq`` is the sequence number after the octets that it came with. It may be further away than that of a reset,
        because octets before it may be missing from the capture. ``read``: the octets of the connection are followed, so that
        the FIN can be doubted.
        """
        if not self._fits(side, end_seq, FAR_AHEAD):
            return False
        self._note_end("fin", side, end_seq, frame, time_ns, read)
        return True

    def _note_end(self, how: str, side: i64, seq: i64, frame: i64, time_ns: i64, read: bool) -> None:
        """Note an end: an end with the expected sequence number is certain; the first of all others is in doubt."""
        silent: i64 = 3 if how == "reset" else 1 << side
        stream = self.streams[side]
        if self.ended:
            if self.doubt is not None and seq == stream.next_seq:
                self.doubt.note_other(how, side, frame, time_ns, silent)
        else:
            self.ended = how
            self.ended_by = side
            self.ended_frame = frame
            self.ended_ns = time_ns
            if read and seq != stream.next_seq and stream.next_seq >= 0:
                self.doubt = Doubt(how, side, seq, frame, time_ns, self.streams)
        self._silent |= silent

    def withdraw(self) -> None:
        """The end in doubt was not an end: the event that ended the connection later, if there is one, takes its place."""
        doubt = self.doubt
        if doubt is None:
            return
        self.doubt = None
        self.ended = doubt.other
        self.ended_by = doubt.other_side
        self.ended_frame = doubt.other_frame
        self.ended_ns = doubt.other_ns
        self._silent = doubt.silent
        self.reset_by, self.reset_frame, self.reset_ns = -1, 0, 0
        if self.ended == "reset":
            self.reset_by, self.reset_frame, self.reset_ns = self.ended_by, self.ended_frame, self.ended_ns

    def _fits(self, side: i64, seq: i64, window: i64) -> bool:
        """Return whether a sequence number is within ``window`` of the one expected from ``side``."""
        stream = self.streams[side]
        if stream.next_seq < 0:
            return True
        return -window <= stream.distance(seq) <= window

    def note_reset(self, side: i64, seq: i64, frame: i64, time_ns: i64) -> bool:
        """Take a RST; False when its sequence number is far from what is expected, so that it is ignored."""
        if not self._fits(side, seq, _RESET_WINDOW):
            return False
        self._note_end("reset", side, seq, frame, time_ns, True)
        if self.reset_frame == 0:
            self.reset_by = side
            self.reset_frame = frame
            self.reset_ns = time_ns
        return True

    @property
    def closed(self) -> bool:
        """True if neither side will send anything more."""
        return self._silent == 3


def _taken(tcp: TcpConnection) -> tuple[Endpoint, Endpoint, int, int, int]:
    return tcp.ends[0], tcp.ends[1], 0, 0, 0


leaves(TcpConnection, taken=_taken)
