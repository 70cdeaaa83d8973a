"""Blocks of plain request items, as nearly all are: their size and their answers, without an object for any item.

An item is plain if it is S7ANY, its codes are known, nothing is odd about its address (`odd_address` in
`dissect.engine.findings.transaction_rules`), and the size of a good answer follows from its type and count. A block is plain if
all its items are plain, so there is nothing to judge in it. All items of such a block have the same size, so each is found by
its index (reference 3.5).
"""

from __future__ import annotations

from typing import Final

from librt.strings import read_i64_be
from mypy_extensions import i64

from dissect.protocols.s7.items import DATA_HEAD, S7ANY_SIZE, data_size_within
from dissect.protocols.s7.tables import (
    ANSWER_TRANSPORT_SIZE,
    AREAS,
    BIT,
    DB,
    DB_AREAS,
    ELEMENT_OCTETS,
    NUMBERED_AREAS,
    OWN_SIZE_AREAS,
    RECORD_AREA,
    SUCCESS,
    TRANSPORT_SIZES,
)
from dissect.wire.octets import u16, u32

#: The beginning of an S7ANY item: specification, length of the rest, syntax.
_HEAD: Final = 0x120A10
#: Position of the first item of a block, and of count and area in an item.
_FIRST: Final = 2
_COUNT_AT: Final = 4
_AREA_AT: Final = 8

#: Kinds of areas: bit addresses outside and inside data blocks; numbers; numbers with a transport size of their own.
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
#: Size of an element by transport size; 0 if it is unknown, or if the size of an answer does not follow from it.
_ELEMENTS: Final = bytes([ELEMENT_OCTETS.get(code, 0) if code in TRANSPORT_SIZES else 0 for code in range(256)])
#: The transport size of a good answer, by that of the request; 0 if unknown.
_ANSWERED_AS: Final = bytes([ANSWER_TRANSPORT_SIZE.get(code, 0) for code in range(256)])

# The same for the usual transport sizes, four bits for each in one number: compiled, an index into bytes takes a dozen times as
# long.
_USUAL: Final = 8
_USUAL_ELEMENTS: Final[i64] = sum([_ELEMENTS[code] << 4 * code for code in range(_USUAL + 1)])
_USUAL_ANSWERS: Final[i64] = sum([_ANSWERED_AS[code] << 4 * code for code in range(_USUAL + 1)])


def _element(code: i64) -> i64:
    """Return the size of an element of transport size ``code``; 0 if unknown."""
    if code <= _USUAL:
        return _USUAL_ELEMENTS >> (code << 2) & 15
    return _ELEMENTS[code]


def _answered_as(code: i64) -> i64:
    """Return the transport size with which CPUs answer an item of transport size ``code``; 0 if unknown."""
    if code <= _USUAL:
        return _USUAL_ANSWERS >> (code << 2) & 15
    return _ANSWERED_AS[code]


def plain_octets(octets: bytes, count: i64) -> i64:
    """Return the size of the data items that answer the block ``octets`` of a Read Var or Write Var request.

    Return -1 unless it has exactly ``count`` plain items.
    """
    at: i64 = _FIRST
    end: i64 = len(octets)
    if count == 0 or end != at + count * S7ANY_SIZE:
        return -1
    total: i64 = 0
    size: i64 = 0
    while at < end:
        head: i64 = u32(octets, at)
        place: i64 = read_i64_be(octets, at + _COUNT_AT)  # count (2 octets), DB (2), area (1), address (3)
        code: i64 = head & 0xFF
        element: i64 = _element(code)
        if head >> 8 != _HEAD or element == 0 or not _is_plain(code, place):
            return -1
        size = element * (place >> 48 & 0xFFFF)
        total += DATA_HEAD + size + (size & 1)
        at += S7ANY_SIZE
    return total - (size & 1)  # no fill octet after the last item


def _is_plain(code: i64, place: i64) -> bool:
    """Return whether an item is not odd; ``code`` is its transport size, ``place`` has its last eight octets."""
    area: i64 = place >> 24 & 0xFF
    kind: i64 = _BITS_IN_DB
    if area != DB:  # most are in a DB
        kind = _KINDS[area]
    if kind != _BITS_IN_DB and (kind == _NOT_PLAIN or place >> 32 & 0xFFFF):
        return False
    if code == BIT and place >> 48 & 0xFFFF != 1:
        return False
    if kind > _BITS_IN_DB:
        return kind != _OWN_NUMBERS or area == code
    return place & 0xF80000 == 0 and (code == BIT or place & 7 == 0)


def plain_size(octets: bytes, index: i64) -> i64:
    """Return the size of item ``index`` (from 0) of a plain block in a good answer, and in a write."""
    at: i64 = _FIRST + index * S7ANY_SIZE
    return _element(u32(octets, at) & 0xFF) * u16(octets, at + _COUNT_AT)


def plain_area(octets: bytes, index: i64) -> i64:
    """Return the area of item ``index`` (from 0) of a plain block."""
    return octets[_FIRST + index * S7ANY_SIZE + _AREA_AT]


def plain_answered_as(octets: bytes, index: i64) -> i64:
    """Return the transport size with which CPUs answer item ``index`` (from 0) of a plain block; 0 if unknown."""
    return _answered_as(u32(octets, _FIRST + index * S7ANY_SIZE) & 0xFF)


def plainly_answered(octets: bytes, buf: bytes, at: i64, end: i64) -> bool:
    """Return whether ``buf[at:end]`` are the data items with which CPUs answer all items of the plain block ``octets``.

    So all return codes are success, and sizes and transport sizes follow from the request.
    """
    asked: i64 = _FIRST
    last: i64 = len(octets)
    size: i64 = 0
    while asked < last:
        room: i64 = end - at - DATA_HEAD
        if room < 0:
            return False
        wanted: i64 = read_i64_be(
            octets, asked
        )  # specification, length, syntax, transport size, count (2 octets), DB (2)
        code: i64 = wanted >> 32 & 0xFF
        head: i64 = u32(buf, at)
        transport_size: i64 = head >> 16 & 0xFF
        size = _element(code) * (wanted >> 16 & 0xFFFF)
        if head >> 24 != SUCCESS or transport_size != _answered_as(code):
            return False
        if data_size_within(transport_size, head & 0xFFFF, room) != size:
            return False
        at += DATA_HEAD + size + (size & 1)
        asked += S7ANY_SIZE
    return at == end or at - (size & 1) == end
