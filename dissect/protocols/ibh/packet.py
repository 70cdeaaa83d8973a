"""One IBH-NetLink packet: its kind and its content."""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.protocols.ibh.layouts import MPI_LONG, MPI_SHORT
from dissect.protocols.ibh.tables import (
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
#: Size of MPI headers up to and including their length field, which counts the octets after it.
SHORT_HEAD: Final = 5
LONG_HEAD: Final = 7
#: Octets between the length and the user data: function and number.
BEFORE_DATA: Final = 2
#: Octets after the header in a receipt of the gateway.
_RECEIPT_SIZE: Final = 5


def little(octets: bytes, at: i64) -> i64:
    """Return the little-endian number at ``at``. Raises IndexError if its two octets are not there."""
    low: i64 = octets[at]
    high: i64 = octets[at + 1]
    return (high << 8) | low


def mpi_head(r_flags: i64) -> i64:
    """Return the size of the packet's MPI header, up to and including its length; 0 if it has none."""
    if r_flags == MPI_REQUEST:
        return SHORT_HEAD
    return LONG_HEAD if r_flags == MPI_INDICATION else 0


class IbhPacket:
    """A parsed packet. ``kind`` is one of `dissect.protocols.ibh.tables`.

    ``function`` and ``mpi_number`` are -1 if the packet has none; so is ``acked``, the number of the acknowledged data packet.
    ``data`` is the captured content of a data packet; ``data_at`` is its offset. ``mpi`` is the layout of the MPI header, None
    if there is none.
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
        """The service that the packet requests or answers."""
        return self.r_flags or self.s_flags

    @property
    def name(self) -> str:
        """The purpose of the packet as text."""
        if self.function >= 0:
            return f"MPI {FUNCTIONS.name(self.function)}"
        if self.kind == KIND_RECEIPT:
            return "receipt"
        known = self.service in SERVICES
        name = SERVICES.name(self.service if known else self.service & 0xFF)
        return f"{name} {'asked' if self.r_flags else 'answered'}" if self.service else name


def parse_packet(octets: bytes) -> IbhPacket:
    """Read a packet with its header, complete or as far as captured. Never raises."""
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
    """Read the MPI header, which follows the first header; ``head`` is its size up to and including the length."""
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
