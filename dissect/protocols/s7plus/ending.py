"""The end of a PDU: integrity id, digest and zeros, in the forms that captures show (docs/s7plus.md)."""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.protocols.s7plus import layouts
from dissect.protocols.s7plus.contents import Contents
from dissect.protocols.s7plus.message import DIGEST_SIZE, PlusPdu
from dissect.protocols.s7plus.tables import RESPONSE2, V1, V2
from dissect.protocols.s7plus.walk import FormatError, Walk
from dissect.wire.varint import VLQ, pass_varint

#: Number of zeros that may end a PDU and a notification; one less is also possible.
FILL: Final = 5
NOTIFICATION_FILL: Final = 4
#: The result of `read_tail` for an end of another form.
_BAD: Final = -2
#: Number of zeros that end a response of the second kind; it is always the same.
RESPONSE2_FILL: Final = 11


def read_end(walk: Walk, found: Contents, pdu: PlusPdu) -> None:
    """Read the end of a request or response. Raises `FormatError` if it has another form."""
    fill = RESPONSE2_FILL if pdu.opcode == RESPONSE2 else FILL
    id_ = read_tail(walk.octets, walk.at, walk.end, pdu.version, fill, found.integrity_id >= 0)
    if id_ == _BAD:
        raise FormatError("trailing_octets", "end", walk.at, 0, walk.left)
    if id_ >= 0:
        start = walk.at
        found.integrity_id = walk.number(VLQ, "integrity id")
        walk.part(layouts.INTEGRITY_ID, start)
    if walk.peek() > 0:
        read_digest(walk, found)
    else:
        _fill(walk)


def read_notification_end(walk: Walk) -> None:
    """Read the zeros at the end of a notification. Raises `FormatError` for anything else."""
    few: bool = NOTIFICATION_FILL - 1 <= walk.left <= NOTIFICATION_FILL
    if walk.left and not (few and zeros_at(walk.octets, walk.at, walk.end)):
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


def read_tail(octets: bytes, at: i64, end: i64, version: i64, fill: i64, early: bool) -> i64:
    """Read the end of a request or response, with at most ``fill`` zeros .

    Return its integrity id, -1 if it has none; `_BAD` for another form. ``early``: the id came before.
    """
    if at == end or _filled(octets, at, end, fill) or (version == V2 and _is_digest(octets, at, end)):
        return -1
    if early or version == V1:
        return _BAD
    behind: i64 = pass_varint(octets, at, end, False)
    if behind < 0 or not (_filled(octets, behind, end, FILL) or _is_digest(octets, behind, end)):
        return _BAD
    id_: i64 = 0
    while at < behind:
        id_ = id_ << 7 | octets[at] & 0x7F
        at += 1
    return id_ & 0xFFFFFFFF


def _filled(octets: bytes, at: i64, end: i64, fill: i64) -> bool:
    left: i64 = end - at
    return (left == fill or (left == FILL - 1 and fill == FILL)) and zeros_at(octets, at, end)


def zeros_at(octets: bytes, at: i64, end: i64) -> bool:
    """Return whether there are only zeros."""
    while at < end:
        if octets[at]:
            return False
        at += 1
    return True


def _is_digest(octets: bytes, at: i64, end: i64) -> bool:
    return end - at == 1 + DIGEST_SIZE and octets[at] == DIGEST_SIZE
