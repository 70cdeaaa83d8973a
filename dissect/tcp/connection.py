"""A TCP connection: its two ends, how it began and how it ended."""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.tcp.ip import address_text
from dissect.tcp.stream import FAR_AHEAD, MASK, HalfStream

FIN: Final = 0x01
SYN: Final = 0x02
RST: Final = 0x04
ACK: Final = 0x10

#: A reset is believed this far from the expected sequence number (RFC 5961 wants it exact; captures lose segments).
_RESET_WINDOW: Final = 65536


class Endpoint:
    """An address and a TCP port."""

    __slots__ = ("address", "port")

    def __init__(self, address: bytes, port: int) -> None:
        self.address = address
        self.port = port

    @property
    def host(self) -> str:
        """The address without the port, as text."""
        return address_text(self.address)

    def __repr__(self) -> str:
        return f"Endpoint({str(self)!r})"

    def __str__(self) -> str:
        text = address_text(self.address)
        return f"[{text}]:{self.port}" if len(self.address) == 16 else f"{text}:{self.port}"


class TcpConnection:
    """The TCP facts of a connection. Sides are 0 and 1: side 0 sent the SYN, or the first packet when there was none.

    ``initiator`` is the side that sent the SYN, -1 when it was not captured. ``ended`` is empty while the connection is
    open, then ``fin``, ``reset``, ``reused`` (a new connection took its addresses) or ``evicted``: what came first.
    ``ended_by`` is the side that began to close, -1 when nobody did. ``reset_by``, ``reset_frame`` and ``reset_ns`` are side,
    packet and time of the first RST, which may follow a FIN (-1, 0 and 0 for none).
    """

    __slots__ = (
        "ended",
        "ended_by",
        "ended_frame",
        "ended_ns",
        "ends",
        "fin_seen",
        "first_frame",
        "first_ns",
        "initiator",
        "last_frame",
        "last_ns",
        "packets",
        "reset_by",
        "reset_frame",
        "reset_ns",
        "streams",
        "vlan",
    )

    def __init__(self, first: Endpoint, second: Endpoint, vlan: i64, frame: i64, time_ns: i64) -> None:
        self.ends: list[Endpoint] = [first, second]
        self.vlan: i64 = vlan
        self.streams: list[HalfStream] = [HalfStream(), HalfStream()]
        self.initiator: i64 = -1
        self.first_frame: i64 = frame
        self.first_ns: i64 = time_ns
        self.last_frame: i64 = frame
        self.last_ns: i64 = time_ns
        self.packets: i64 = 0
        self.fin_seen: list[bool] = [False, False]
        self.ended: str = ""
        self.ended_by: i64 = -1
        self.ended_frame: i64 = 0
        self.ended_ns: i64 = 0
        self.reset_by: i64 = -1
        self.reset_frame: i64 = 0
        self.reset_ns: i64 = 0

    @property
    def has_holes(self) -> bool:
        """True when octets of either direction are missing from the capture."""
        first, second = self.streams
        return first.position > first.octets or second.position > second.octets

    @property
    def known_start(self) -> bool:
        """True when the SYN was captured, so that nothing before can have been missed."""
        return self.initiator >= 0

    def is_new_connection(self, side: i64, isn: i64) -> bool:
        """Tell whether a SYN with this initial sequence number starts another connection than this one."""
        stream = self.streams[side]
        if stream.start_seq < 0:
            return bool(self.ended)
        return stream.start_seq != ((isn + 1) & MASK)

    def note_fin(self, side: i64, end_seq: i64, frame: i64, time_ns: i64) -> bool:
        """A FIN was seen; the first one says who closed. False when it is far from what is expected, as with `note_reset`.

        ``end_seq`` is the sequence number after the octets it came with. It may be further away than a reset: the octets
        before it may be missing from the capture.
        """
        if not self._fits(side, end_seq, FAR_AHEAD):
            return False
        if not self.ended:
            self.ended = "fin"
            self.ended_by = side
            self.ended_frame = frame
            self.ended_ns = time_ns
        self.fin_seen[side] = True
        return True

    def _fits(self, side: i64, seq: i64, window: i64) -> bool:
        """Tell whether a sequence number is within ``window`` of what is expected from ``side``."""
        stream = self.streams[side]
        if stream.next_seq < 0:
            return True
        distance: i64 = (seq - stream.next_seq) & MASK
        return distance <= window or MASK + 1 - distance <= window

    def note_reset(self, side: i64, seq: i64, frame: i64, time_ns: i64) -> bool:
        """A RST was seen; False when its sequence number is far from what is expected, so that it is not believed."""
        if not self._fits(side, seq, _RESET_WINDOW):
            return False
        if not self.ended:
            self.ended = "reset"
            self.ended_by = side
            self.ended_frame = frame
            self.ended_ns = time_ns
        if self.reset_frame == 0:
            self.reset_by = side
            self.reset_frame = frame
            self.reset_ns = time_ns
        self.fin_seen[0] = True
        self.fin_seen[1] = True
        return True

    @property
    def closed(self) -> bool:
        """True when neither side sends any more."""
        return self.fin_seen[0] and self.fin_seen[1]
