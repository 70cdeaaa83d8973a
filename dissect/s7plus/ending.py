"""The end of a PDU: an integrity id, a digest, and zeros, in the forms that captures show (docs/s7plus.md)."""

from __future__ import annotations

from typing import Final

from dissect.s7plus import layouts
from dissect.s7plus.contents import Contents
from dissect.s7plus.message import DIGEST_SIZE, PlusPdu
from dissect.s7plus.tables import RESPONSE2, V1, V2
from dissect.s7plus.walk import FormatError, Walk
from dissect.wire.varint import VLQ, read_varint

#: Zeros that may end a PDU; notifications have one less.
_FILLS: Final = (4, 5)
_NOTIFICATION_FILLS: Final = (4, 3)
#: Those of a response of the other kind.
_RESPONSE2_FILLS: Final = (11,)


def read_end(walk: Walk, found: Contents, pdu: PlusPdu) -> None:
    """Read the end of a request or response. Raises `FormatError` for anything else."""
    fills = _RESPONSE2_FILLS if pdu.opcode == RESPONSE2 else _FILLS
    if _all_zeros(walk, walk.at, fills) or walk.left == 0:
        _fill(walk)
        return
    if pdu.version == V2 and _is_digest(walk, walk.at):
        read_digest(walk, found)
        return
    if found.integrity_id < 0 and pdu.version != V1:
        number, behind = read_varint(walk.octets, walk.at, walk.end, VLQ)
        if behind > 0 and (_all_zeros(walk, behind, _FILLS) or _is_digest(walk, behind)):
            start, walk.at = walk.at, behind
            found.integrity_id = number
            walk.part(layouts.INTEGRITY_ID, start)
            if _is_digest(walk, behind):
                read_digest(walk, found)
            else:
                _fill(walk)
            return
    raise FormatError("trailing_octets", "end", walk.at, 0, walk.left)


def read_notification_end(walk: Walk) -> None:
    """Read the end of a notification: zeros. Raises `FormatError` for anything else."""
    if not _all_zeros(walk, walk.at, _NOTIFICATION_FILLS) and walk.left:
        raise FormatError("trailing_octets", "end", walk.at, 0, walk.left)
    _fill(walk)


def read_digest(walk: Walk, found: Contents) -> None:
    """Read a digest behind the data, as a CPU 1511 with firmware 1.0 sends it."""
    start = walk.at
    walk.at += 1
    found.digest = walk.take(DIGEST_SIZE, "digest")
    walk.part(layouts.DIGEST, start)


def _fill(walk: Walk) -> None:
    if walk.left:
        start, walk.at = walk.at, walk.end
        walk.part(layouts.FILL, start)


def _all_zeros(walk: Walk, at: int, sizes: tuple[int, ...]) -> bool:
    size = walk.end - at
    return size in sizes and walk.octets[at : walk.end] == bytes(size)


def _is_digest(walk: Walk, at: int) -> bool:
    return walk.end - at == 1 + DIGEST_SIZE and walk.octets[at] == DIGEST_SIZE
