"""S7comm-plus inside TLS: records may join and split frames, so only the lengths of the frames separate them."""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.protocols.iso.upper import is_sound
from dissect.protocols.s7plus.message import HEADER_SIZE
from dissect.protocols.s7plus.tables import PROTOCOL_ID, V3
from dissect.wire.octets import u16

_FIRST: Final = bytes((PROTOCOL_ID,))


class FrameStream:
    """Splits one direction into frames, each with its trailer if it has one. At most one frame is kept.

    A frame without a trailer is one of several of a PDU; only the next octets show that, so it is returned with them.
    """

    __slots__ = ("_rest",)

    def __init__(self) -> None:
        self._rest: bytes = b""

    @property
    def held(self) -> int:
        """Octets of an unfinished frame."""
        return len(self._rest)

    def push(self, octets: bytes) -> list[bytes]:
        """Take the next octets; return the frames that they complete, and all other octets unchanged.

        If ``octets`` are a whole frame, the unfinished frame before it had a wrong length, and ends. After octets that are not
        a frame, the next frame is searched for.
        """
        found: list[bytes] = []
        rest = self._rest
        if rest and octets[0] == PROTOCOL_ID and _is_open(rest) and is_sound(octets, 0, len(octets)):
            found.append(rest)
            rest = b""
        octets = rest + octets
        at: i64 = 0
        size: i64 = len(octets)
        while at < size:
            if octets[at] != PROTOCOL_ID:
                next_: i64 = _next(octets, at, size)
                found.append(octets[at:next_])
                at = next_
                continue
            end: i64 = _end(octets, at, size)
            if end < 0:
                break
            found.append(octets[at:end])
            at = end
        self._rest = octets[at:]
        return found

    def finish(self) -> bytes:
        """Return the rest of an unfinished frame; nothing more of it will come."""
        rest = self._rest
        self._rest = b""
        return rest


def _is_open(octets: bytes) -> bool:
    """Return whether a frame is incomplete by its own length."""
    return len(octets) < HEADER_SIZE or len(octets) < HEADER_SIZE + u16(octets, 2)


def _next(octets: bytes, at: i64, size: i64) -> i64:
    """Return where the next whole frame with a trailer begins after ``at``, where none begins; ``size`` if there is none."""
    if is_sound(octets, at, size):
        return size  # S7comm; its content is not searched
    place: i64 = octets.find(_FIRST, at + 1)
    while place >= 0 and size - place > 2 * HEADER_SIZE:
        whole: i64 = place + 2 * HEADER_SIZE + u16(octets, place + 2)
        if octets[place + 1] <= V3 and _end(octets, place, size) == whole and is_sound(octets, place, whole):
            return place
        place = octets.find(_FIRST, place + 1)
    return size


def _end(octets: bytes, at: i64, size: i64) -> i64:
    """Return the end of the frame at ``at``, -1 while it is unknown."""
    if size - at < HEADER_SIZE:
        return -1
    version: i64 = octets[at + 1]
    if version == 0xFF:
        return at + HEADER_SIZE  # a keep-alive is only a header
    end: i64 = at + HEADER_SIZE + u16(octets, at + 2)
    if end > size:
        return -1
    if version > V3:
        return end  # a system event has no trailer
    if end == size or (size - end < HEADER_SIZE and octets[end] == PROTOCOL_ID):
        return -1
    if octets[end] == PROTOCOL_ID and octets[end + 1] == version and u16(octets, end + 2) == 0:
        return end + HEADER_SIZE
    return end
