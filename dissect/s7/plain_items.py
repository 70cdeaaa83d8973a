"""Blocks of plain request items, which nearly all are: what they ask for, without an object for any item.

An item is plain if it is S7ANY, its codes are known, nothing is odd about its address (`odd_address` in
`dissect.findings.transaction_rules`), and the octets of a good answer follow from its type and count. A block is plain if it is
nothing but plain items, so that there is nothing to judge in it. All items of such a block have the same size, so that each
is found by its index (reference 3.5).
"""

from __future__ import annotations

from typing import Final

from librt.strings import read_i64_be
from mypy_extensions import i64

from dissect.s7.tables import (
    ANSWER_TRANSPORT_SIZE,
    AREAS,
    BIT,
    DB_AREAS,
    ELEMENT_OCTETS,
    NUMBERED_AREAS,
    OWN_SIZE_AREAS,
    RECORD_AREA,
    TRANSPORT_SIZES,
)
from dissect.wire.octets import u16, u32

#: Octets of an S7ANY item, and what it begins with: specification, length of the rest, syntax.
S7ANY_SIZE: Final = 12
_HEAD: Final = 0x120A10
#: Where the first item of a block stands, and in an item the transport size, the count, and count to address as eight octets.
_FIRST: Final = 2
_TRANSPORT_AT: Final = 3
_COUNT_AT: Final = 4

#: Kinds of areas: bit addresses outside and inside data blocks; numbers; numbers with a transport size of the area's own.
_NOT_PLAIN: Final = 0
_BITS: Final = 1
_BITS_IN_DB: Final = 2
_NUMBERS: Final = 3
_OWN_NUMBERS: Final = 4


def _kind(area: int) -> int:
    if area not in AREAS or area == RECORD_AREA:
        return _NOT_PLAIN
    if area in NUMBERED_AREAS:
        return _OWN_NUMBERS if area in OWN_SIZE_AREAS else _NUMBERS
    return _BITS_IN_DB if area in DB_AREAS else _BITS


_KINDS: Final = bytes([_kind(area) for area in range(256)])
#: Octets of an element by transport size; 0 where the size is not known, or that of an answer does not follow from it.
_ELEMENTS: Final = bytes([ELEMENT_OCTETS.get(code, 0) if code in TRANSPORT_SIZES else 0 for code in range(256)])
#: The transport size of a good answer by that of the request; 0 where it is not known.
_ANSWERED_AS: Final = bytes([ANSWER_TRANSPORT_SIZE.get(code, 0) for code in range(256)])


def are_plain(octets: bytes, count: i64) -> bool:
    """Return whether the block ``octets`` of a Read Var or Write Var request has ``count`` plain items and nothing else."""
    at: i64 = _FIRST
    if count == 0 or len(octets) != at + count * S7ANY_SIZE:
        return False
    end: i64 = len(octets)
    while at < end:
        head: i64 = u32(octets, at)
        code: i64 = head & 0xFF
        place: i64 = read_i64_be(octets, at + _COUNT_AT)  # count (2 octets), DB (2), area (1), address (3)
        kind: i64 = _KINDS[place >> 24 & 0xFF]
        if head >> 8 != _HEAD or _ELEMENTS[code] == 0 or kind == _NOT_PLAIN:
            return False
        if kind != _BITS_IN_DB and place >> 32 & 0xFFFF:
            return False
        if code == BIT:
            if place >> 48 & 0xFFFF != 1:
                return False
        elif place & 7 and kind <= _BITS_IN_DB:
            return False
        if kind <= _BITS_IN_DB:
            if place & 0xF80000:
                return False
        elif kind == _OWN_NUMBERS and place >> 24 & 0xFF != code:
            return False
        at += S7ANY_SIZE
    return True


def plain_size(octets: bytes, index: i64) -> i64:
    """Return the octets that item ``index`` (from 0) of a plain block has in a good answer, and in a write."""
    at: i64 = _FIRST + index * S7ANY_SIZE
    return _ELEMENTS[octets[at + _TRANSPORT_AT]] * u16(octets, at + _COUNT_AT)


def plain_area(octets: bytes, index: i64) -> i64:
    """Return the area of item ``index`` (from 0) of a plain block."""
    return octets[_FIRST + index * S7ANY_SIZE + 8]


def plain_answered_as(octets: bytes, index: i64) -> i64:
    """Return the transport size with which CPUs answer item ``index`` (from 0) of a plain block; 0 where it is not known."""
    return _ANSWERED_AS[octets[_FIRST + index * S7ANY_SIZE + _TRANSPORT_AT]]
