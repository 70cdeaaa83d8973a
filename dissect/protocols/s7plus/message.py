"""An S7comm-plus PDU: frames, integrity part, opcode, function, sequence number, session (docs/s7plus.md)."""

from __future__ import annotations

from bisect import bisect_right
from typing import Final

from mypy_extensions import i64, mypyc_attr

from dissect.protocols.s7plus import layouts
from dissect.protocols.s7plus.tables import (
    FUNCTIONS,
    KEEP_ALIVE,
    NO_RESPONSE,
    NOTIFICATION,
    OPCODES,
    PROTOCOL_ID,
    REQUEST,
    RESPONSE,
    RESPONSE2,
    SYSTEM_EVENT,
    V1,
    V3,
    VERSIONS,
)
from dissect.wire.copies import leaves
from dissect.wire.layout import Layout
from dissect.wire.malformed import Malformed
from dissect.wire.octets import u16, u32
from dissect.wire.varint import VLQ, VLQ64, read_varint

#: Size of a frame header: protocol id, version, and the size of the rest. A trailer has the same size.
HEADER_SIZE: Final = 4
#: Size of the digest in the integrity part of V3; size of that part, which begins with the size of the digest.
DIGEST_SIZE: Final = 32
INTEGRITY_SIZE: Final = 33
#: Subscriptions of S7-1200 with old firmware have ids below this. Their notifications have a sequence number of one octet
#: instead of the credit.
SHORT_HEADS: Final = 0x70000000
_LAYER: Final = "s7plus"
#: The fixed parts as names of this module, because most PDUs need them and names of the own module are found faster.
_REQUEST: Final = layouts.REQUEST
_RESPONSE: Final = layouts.RESPONSE
_NOTIFICATION: Final = layouts.NOTIFICATION


@mypyc_attr(acyclic=True, free_list_len=1)
class PlusPdu:
    """One S7comm-plus PDU.

    ``octets`` are all its frames, joined, with headers and trailer. ``data`` is the content of the frames, from the opcode on,
    without integrity parts; ``body`` is the part after the fixed part of ``data``. Numbers that the PDU does not have are -1.
    ``whole``: the trailer was seen. ``integrity`` is the digest of the first frame, empty before V3.
    """

    __slots__ = (
        "_places",
        "body",
        "connection",
        "credit_tick",
        "cut",
        "data",
        "data_offset",
        "frame",
        "frame_starts",
        "frames",
        "function",
        "integrity",
        "malformed",
        "message",
        "number",
        "octets",
        "opcode",
        "return_value",
        "sequence",
        "session_id",
        "side",
        "subscription_id",
        "time_ns",
        "transport_flags",
        "version",
        "whole",
    )

    def __init__(self, octets: bytes, frame: int, time_ns: int, connection: int, side: int) -> None:
        self.octets = octets
        self.frame = frame
        self.time_ns = time_ns
        self.connection = connection
        self.side = side
        self.cut = False
        self.version = -1
        self.frames = 0
        # Where each frame except the first begins: its offset within ``data`` -> its offset within ``octets``.
        self.frame_starts: dict[int, int] = {}
        self._places: tuple[list[int], list[int]] | None = None  # the same with the first frame, for bisection
        self.whole = False
        self.integrity = b""
        self.data = b""
        self.data_offset = 0  # of the first octet of ``data`` within ``octets``
        self.body = b""
        self.opcode = -1
        self.function = -1
        self.sequence = -1  # repeated by the response; notifications have numbers of their own
        self.session_id = -1
        self.transport_flags = -1
        self.return_value = -1
        self.subscription_id = -1
        self.credit_tick = -1
        self.number = -1  # of a keep-alive; for a system event the number of octets that it confirms
        self.message = b""  # text of a system event
        self.malformed: list[Malformed] = []

    def __repr__(self) -> str:
        return f"PlusPdu({self.kind}, {self.function_name or '-'}, sequence {self.sequence}, packet {self.frame})"

    @property
    def kind(self) -> str:
        """``Request``, ``Response``, ``Notification``, ``system event``, ``keep-alive``, or the number of the opcode."""
        if self.version in (SYSTEM_EVENT, KEEP_ALIVE):
            return VERSIONS.name(self.version)
        return OPCODES.name(self.opcode) if self.opcode >= 0 else "?"

    @property
    def function_name(self) -> str:
        """Name of the function, empty if there is none."""
        return FUNCTIONS.name(self.function) if self.function >= 0 else ""

    @property
    def return_code(self) -> int:
        """The lower 16 bits of the return value, -1 if there is none."""
        return self.return_value & 0xFFFF if self.return_value >= 0 else -1

    @property
    def wants_response(self) -> bool:
        """True for a request, unless its flags ask for no response."""
        return self.opcode == REQUEST and not (self.transport_flags >= 0 and self.transport_flags & NO_RESPONSE)

    @property
    def readable(self) -> bool:
        """True if opcode and sequence number could be read, so that the PDU can be paired."""
        return self.opcode in (REQUEST, RESPONSE, RESPONSE2) and self.sequence >= 0

    def place(self, at: int) -> int:
        """Return the offset within ``octets`` of the octet ``at`` of ``data``."""
        if self._places is None:
            self._places = ([0, *self.frame_starts], [self.data_offset, *self.frame_starts.values()])
        starts, begins = self._places
        frame = bisect_right(starts, at) - 1
        return begins[frame] + at - starts[frame]

    @property
    def frame_places(self) -> list[tuple[int, int, int]]:
        """For each frame, its beginning within ``octets``, the beginning of its data, and its end; also without data."""
        octets = self.octets
        found: list[tuple[int, int, int]] = []
        at = 0
        for _ in range(self.frames):
            start = at + HEADER_SIZE
            end = min(start + u16(octets, at + 2), len(octets))
            begin = min(start + 1 + octets[start], end) if self.version == V3 and start < end else start
            found.append((at, begin, end))
            at = end
        return found

    @property
    def digest_places(self) -> list[tuple[int, int]]:
        """Begin and end of the digest of each frame within ``octets``; none before version 3."""
        return [(at + HEADER_SIZE + 1, begin) for at, begin, _ in self.frame_places if begin > at + HEADER_SIZE + 1]

    def _tell(self, reason: str, field: str, offset: int, needed: int, available: int) -> None:
        """Add a fault to ``malformed``."""
        limit = "snaplen" if self.cut else "tsdu"
        self.malformed.append(Malformed(_LAYER, reason, field, offset, needed, available, limit))


def parse_plus(
    octets: bytes, frame: int = 0, time_ns: int = 0, connection: int = 0, side: int = 0, cut: bool = False
) -> PlusPdu:
    """Read one S7comm-plus PDU, given its joined frames. Never raises.

    ``cut``: octets are missing at the end, so a missing trailer is not a fault of the sender.
    """
    pdu = PlusPdu(octets, frame, time_ns, connection, side)
    pdu.cut = cut
    size = len(octets)
    if size >= 2:
        pdu.version = octets[1]
    if size < HEADER_SIZE:
        pdu._tell("too_short", "header", 0, HEADER_SIZE, size)
        return pdu
    pdu.frames = 1
    if pdu.version == KEEP_ALIVE:
        pdu.number = octets[2]
        pdu.whole = True
        if size > HEADER_SIZE:
            pdu._tell("trailing_octets", "keep-alive", HEADER_SIZE, HEADER_SIZE, size)
    elif pdu.version == SYSTEM_EVENT:
        _read_event(pdu, octets)
    else:
        if not V1 <= pdu.version <= V3 and pdu.version not in VERSIONS:
            pdu._tell("unknown_type", "version", 1, 0, pdu.version)
        _read_frames(pdu, octets)
        _read_head(pdu)
        if not pdu.whole and not cut and not pdu.malformed:
            pdu._tell("too_short", "trailer", size, size + HEADER_SIZE, size)
    return pdu


def _read_event(pdu: PlusPdu, octets: bytes) -> None:
    length = u16(octets, 2)
    end = HEADER_SIZE + length
    pdu.whole = end <= len(octets)
    if not pdu.whole:
        pdu._tell("length_beyond", "length", 2, end, len(octets))
    elif end < len(octets) and octets[end:] != _trailer(SYSTEM_EVENT):
        pdu._tell("trailing_octets", "system event", end, end, len(octets))
    pdu.data_offset = HEADER_SIZE
    pdu.data = octets[HEADER_SIZE:end]
    fixed = layouts.EVENT.size
    if len(pdu.data) >= 8:
        pdu.number = u32(pdu.data, 4)
    if len(pdu.data) < fixed:
        if pdu.whole:
            pdu._tell("too_short", "system event", HEADER_SIZE, fixed, len(pdu.data))
        return
    pdu.message = pdu.data[fixed:]


def _read_frames(pdu: PlusPdu, octets: bytes) -> None:
    """Split the PDU into frames: join their contents in ``data``; the trailer ends the PDU.

    A frame without data before version 3 looks like a trailer: of two in a row the second is the trailer.
    """
    size = len(octets)
    parts: list[bytes] = []
    at = 0
    count = 0
    taken = 0
    while at + HEADER_SIZE <= size and octets[at] == PROTOCOL_ID and octets[at + 1] == pdu.version:
        length = u16(octets, at + 2)
        start = at + HEADER_SIZE
        end = start + length
        if length == 0 and count and octets[end : end + HEADER_SIZE] != octets[at:end]:
            pdu.whole = True
            at = end
            break
        if end > size:
            pdu._tell("length_beyond", "length", at + 2, end, size)
            end = size
        start = _read_integrity(pdu, octets, start, end, count == 0)
        if count == 0:
            pdu.data_offset = start
        else:
            pdu.frame_starts[taken] = start
        parts.append(octets[start:end])
        taken += end - start
        count += 1
        at = end
    pdu.frames = count
    pdu.data = parts[0] if count == 1 else b"".join(parts)
    if at < size and not (pdu.cut and at + HEADER_SIZE > size):
        pdu._tell("trailing_octets", "pdu", at, at, size)


def _read_integrity(pdu: PlusPdu, octets: bytes, start: int, end: int, first: bool) -> int:
    """Return where the data of a frame begins: in V3 after a digest, which is kept if it is the ``first`` frame's."""
    if pdu.version != V3 or start >= end:
        return start
    size = octets[start]
    behind = start + 1 + size
    if size != DIGEST_SIZE:
        pdu._tell("bad_value", "digest_length", start, DIGEST_SIZE, size)
    if behind > end:
        pdu._tell("length_beyond", "digest", start, behind, end)
        behind = end
    if first:
        pdu.integrity = octets[start + 1 : behind]
    return behind


def _read_head(pdu: PlusPdu) -> None:
    data = pdu.data
    size = len(data)
    if size == 0:
        if not pdu.malformed:
            pdu._tell("too_short", "opcode", pdu.data_offset, 1, 0)
        return
    pdu.opcode = data[0]
    if pdu.opcode == NOTIFICATION:
        _read_notification(pdu, data)
        return
    if pdu.opcode != REQUEST and pdu.opcode != RESPONSE and pdu.opcode not in OPCODES:
        pdu._tell("unknown_type", "opcode", pdu.data_offset, 0, pdu.opcode)
        pdu.body = data[1:]
        return
    layout = _REQUEST if pdu.opcode == REQUEST else _RESPONSE
    if size >= 5:
        pdu.function = u16(data, 3)
    if size >= 9:
        pdu.sequence = u16(data, 7)
    if size < layout.size:
        pdu._tell("too_short", layout.name, pdu.data_offset, layout.size, size)
        return
    pdu.transport_flags = data[layout.size - 1]
    pdu.body = data[layout.size :]
    if pdu.opcode == REQUEST:
        pdu.session_id = u32(data, 9)
    elif pdu.function in FUNCTIONS:
        pdu.return_value = read_varint(pdu.body, 0, len(pdu.body), VLQ64)[0]


def _read_notification(pdu: PlusPdu, data: bytes) -> None:
    size = len(data)
    if pdu.version == V1:
        pdu.body = data[1:]  # another form, which only old S7-1200 CPUs use
        return
    if size >= 5:
        pdu.subscription_id = u32(data, 1)
    fixed = _NOTIFICATION.size
    if size < fixed:
        pdu._tell("too_short", "notification", pdu.data_offset, fixed, size)
        return
    pdu.credit_tick = data[fixed - 1]
    pdu.body = data[fixed:]
    if pdu.subscription_id < SHORT_HEADS:
        pdu.sequence = pdu.credit_tick
    else:
        pdu.sequence = read_varint(pdu.body, 0, len(pdu.body), VLQ)[0]


def fixed_part(pdu: PlusPdu) -> Layout | None:
    """Return the layout of the fixed part at the beginning of ``data``; None if there is none or its kind is unknown."""
    if pdu.version == SYSTEM_EVENT:
        return layouts.EVENT
    if pdu.opcode == NOTIFICATION:
        return layouts.NOTIFICATION_V1 if pdu.version == V1 else _NOTIFICATION
    if pdu.opcode == REQUEST:
        return _REQUEST
    return _RESPONSE if pdu.opcode == RESPONSE or pdu.opcode in OPCODES else None


def is_beginning(pdu: PlusPdu) -> bool:
    """Return whether the octets are the beginning of a PDU, not the rest of one. Only the fields of the fixed part show it."""
    if pdu.opcode == NOTIFICATION:
        return pdu.version == V1 or pdu.credit_tick >= 0
    if not pdu.readable:
        return False
    reserved: i64 = u16(pdu.data, 1) | u16(pdu.data, 5)
    return reserved == 0 or pdu.function in FUNCTIONS


def _trailer(version: int) -> bytes:
    return bytes((PROTOCOL_ID, version, 0, 0))


leaves(PlusPdu)
