"""The end of a PDU: integrity id, digest and zeros, in the forms that captures show (docs/s7plus.md)."""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.s7plus import layouts
from dissect.s7plus.contents import Contents
from dissect.s7plus.message import DIGEST_SIZE, PlusPdu
from dissect.s7plus.tables import RESPONSE2, V1, V2
from dissect.s7plus.walk import FormatError, Walk
from dissect.wire.varint import VLQ, read_varint

#: How many zeros may end a PDU and a notification; one less is possible, too.
FILL: Final = 5
NOTIFICATION_FILL: Final = 4
#: Zeros that end a response of the second kind; always this many.
RESPONSE2_FILL: Final = 11


def read_end(walk: Walk, found: Contents, pdu: PlusPdu) -> None:
    """Read the end of a request or response. Raises `FormatError` if it has another form."""
    second: bool = pdu.opcode == RESPONSE2
    if _all_zeros(walk, walk.at, RESPONSE2_FILL if second else FILL, second) or walk.left == 0:
        _fill(walk)
        return
    if pdu.version == V2 and _is_digest(walk, walk.at):
        read_digest(walk, found)
        return
    if found.integrity_id < 0 and pdu.version != V1:
        number, behind = read_varint(walk.octets, walk.at, walk.end, VLQ)
        if behind > 0 and (_all_zeros(walk, behind, FILL) or _is_digest(walk, behind)):
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
    """Read the zeros at the end of a notification. Raises `FormatError` for anything else."""
    if not _all_zeros(walk, walk.at, NOTIFICATION_FILL) and walk.left:
        raise FormatError("trailing_octets", "end", walk.at, 0, walk.left)
    _fill(walk)


def read_digest(walk: Walk, found: Contents) -> None:
    """Read a digest after the data, as a CPU 1511 with firmware 1.0 sends it."""
    start = walk.at
    walk.at += 1
    found.digest = walk.take(DIGEST_SIZE, "digest")
    walk.part(layouts.DIGEST, start)


def _fill(walk: Walk) -> None:
    if walk.left:
        start, walk.at = walk.at, walk.end
        walk.part(layouts.FILL, start)


def _all_zeros(walk: Walk, at: i64, size: i64, exactly: bool = False) -> bool:
    """Return whether just ``size`` zeros are left; one less is accepted as well unless ``exactly`` is True."""
    end: i64 = walk.end
    left: i64 = end - at
    if left != size and (exactly or left != size - 1):
        return False
    octets = walk.octets
    while at < end:
        if octets[at]:
            return False
        at += 1
    return True


def _is_digest(walk: Walk, at: int) -> bool:
    return walk.end - at == 1 + DIGEST_SIZE and walk.octets[at] == DIGEST_SIZE
