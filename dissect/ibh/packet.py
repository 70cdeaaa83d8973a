"""One IBH-NetLink packet: what kind it is and what it carries."""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.ibh.layouts import MPI_LONG, MPI_SHORT
from dissect.ibh.tables import (
    FUNCTIONS,
    KIND_ACK,
    KIND_DATA,
    KIND_FRAGMENT,
    KIND_MPI_OTHER,
    KIND_OF,
    KIND_OTHER,
    KIND_RECEIPT,
    KIND_SERVICE,
    MPI_INDICATION,
    MPI_REQUEST,
    SERVICES,
)
from dissect.wire.layout import Layout
from dissect.wire.malformed import Malformed

HEADER: Final = 8
#: MPI headers up to their length, which counts what follows it.
SHORT_HEAD: Final = 5
LONG_HEAD: Final = 7
#: Function and number: what stands between the length and the user data.
BEFORE_DATA: Final = 2
#: Octets a receipt of the gateway has behind its header.
_RECEIPT_SIZE: Final = 5


def little(octets: bytes, at: i64) -> i64:
    """Return the two octets at ``at`` as a number, the low one first; IndexError when they are not there."""
    low: i64 = octets[at]
    high: i64 = octets[at + 1]
    return (high << 8) | low


def mpi_head(r_flags: i64) -> i64:
    """Return the octets of the MPI header up to and with its length that a packet has; 0 for no such header."""
    if r_flags == MPI_REQUEST:
        return SHORT_HEAD
    return LONG_HEAD if r_flags == MPI_INDICATION else 0


class IbhPacket:
    """A packet as it was read. ``kind`` is one of `dissect.ibh.tables`.

    ``function`` and ``mpi_number`` are -1 where the packet has none; so is ``acked``, the number of the data packet that an
    acknowledgement names. ``data`` is what a data packet carries, as far as it is there; ``data_at`` is where it begins.
    ``mpi`` is the layout of the MPI header behind the first one, None without.
    """

    __slots__ = (
        "acked",
        "data",
        "data_at",
        "dst_conn",
        "function",
        "kind",
        "malformed",
        "mpi",
        "mpi_number",
        "number",
        "octets",
        "r_flags",
        "s_flags",
        "src_conn",
        "station",
    )

    def __init__(self, octets: bytes) -> None:
        self.octets: bytes = octets
        self.kind: i64 = KIND_OTHER
        self.number: i64 = -1
        self.s_flags: i64 = 0
        self.r_flags: i64 = 0
        self.mpi: Layout | None = None
        self.src_conn: i64 = -1
        self.dst_conn: i64 = -1
        self.station: i64 = -1
        self.function: i64 = -1
        self.mpi_number: i64 = -1
        self.acked: i64 = -1
        self.data: bytes = b""
        self.data_at: i64 = 0
        self.malformed: list[Malformed] = []

    @property
    def service(self) -> int:
        """What the packet is about: what it asks for, or what it answers."""
        return self.r_flags or self.s_flags

    @property
    def name(self) -> str:
        """What the packet does, for a person."""
        if self.function >= 0:
            return f"MPI {FUNCTIONS.name(self.function)}"
        if self.kind == KIND_RECEIPT:
            return "receipt"
        known = self.service in SERVICES
        name = SERVICES.name(self.service if known else self.service & 0xFF)
        return f"{name} {'asked' if self.r_flags else 'answered'}" if self.service else name


def parse_packet(octets: bytes) -> IbhPacket:
    """Read a packet, header included: whole, or as far as it was captured. Never raises."""
    packet = IbhPacket(octets)
    size: i64 = len(octets)
    if size < HEADER:
        packet.malformed.append(Malformed("IBH", "too_short", "header", 0, HEADER, size, "packet"))
        return packet
    packet.number = octets[3]
    packet.s_flags = little(octets, 4)
    packet.r_flags = little(octets, 6)
    length: i64 = octets[2]
    if HEADER + length != size:
        reason = "length_beyond" if HEADER + length > size else "trailing_octets"
        packet.malformed.append(Malformed("IBH", reason, "length", 2, length, size - HEADER, "packet"))
    head: i64 = mpi_head(packet.r_flags)
    if head:
        _read_mpi(packet, octets, head, min(size, HEADER + length))
    elif packet.s_flags == MPI_REQUEST and packet.r_flags == 0 and length == _RECEIPT_SIZE:
        packet.kind = KIND_RECEIPT
    elif packet.service & 0xFF and (packet.service & 0xFF) in SERVICES and packet.service & 0xFF != MPI_REQUEST:
        packet.kind = KIND_SERVICE
    return packet


def _read_mpi(packet: IbhPacket, octets: bytes, head: i64, end: i64) -> None:
    """Read the MPI header behind the first one; ``head`` are its octets up to and with the length."""
    packet.kind = KIND_MPI_OTHER
    packet.mpi = MPI_SHORT if head == SHORT_HEAD else MPI_LONG
    there: i64 = end - HEADER
    if there < head:
        packet.malformed.append(Malformed("MPI", "too_short", "header", HEADER, head, there, "packet"))
        return
    packet.src_conn = octets[HEADER]
    packet.dst_conn = octets[HEADER + 1]
    packet.station = octets[HEADER + 2]
    at: i64 = HEADER + head
    length: i64 = octets[at - 1]
    if at + length != end:
        reason = "length_beyond" if at + length > end else "trailing_octets"
        packet.malformed.append(Malformed("MPI", reason, "length", at - 1, length, end - at, "packet"))
        end = min(end, at + length)
    if at == end:
        return
    packet.function = octets[at]
    packet.kind = KIND_OF.get(packet.function, KIND_MPI_OTHER)
    if end - at >= BEFORE_DATA:
        packet.mpi_number = octets[at + 1]
    if packet.kind == KIND_DATA or packet.kind == KIND_FRAGMENT:
        if end - at < BEFORE_DATA:
            packet.malformed.append(Malformed("MPI", "length_below", "length", at - 1, BEFORE_DATA, length, "packet"))
            return
        packet.data_at = at + BEFORE_DATA
        packet.data = octets[at + BEFORE_DATA : end]
    elif packet.kind == KIND_ACK and end - at > BEFORE_DATA:
        packet.acked = octets[at + BEFORE_DATA]
