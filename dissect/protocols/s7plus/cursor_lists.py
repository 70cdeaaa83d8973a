"""Skips the lists of variables and of names in objects (`dissect.protocols.s7plus.variables` reads them)."""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.protocols.s7plus.tables import VARIABLE_NUMBERS
from dissect.wire.octets import u16

#: Sizes in a list of variables: its id; a variable without its numbers; the offset of the attributes within a variable. Then,
#: by the highest four bits of the attributes: the number of four-octet numbers that follow.
_LIST_ID: Final = 4
_VARIABLE: Final = 16
_ATTRIBUTES: Final = 9
_NUMBERS: Final = bytes(VARIABLE_NUMBERS)


def pass_variables(octets: bytes, at: i64, limit: i64) -> tuple[i64, i64]:
    """Pass over a list of variables after its tag. Return (its end, its number of variables); (-1, 0) if it must be read."""
    count: i64 = 0
    begun = False
    while at + 2 <= limit:
        end: i64 = at + 2 + u16(octets, at)
        at += 2
        if end == at:
            return at, count
        if end > limit:
            return -1, 0
        if not begun:
            begun = True
            at += _LIST_ID
        while at < end:
            if at + _VARIABLE > end:
                return -1, 0
            numbers: i64 = _NUMBERS[octets[at + _ATTRIBUTES] >> 4]
            at += _VARIABLE + 4 * numbers
            count += 1
        if at != end:
            return -1, 0
    return -1, 0


def pass_names(octets: bytes, at: i64, limit: i64) -> tuple[i64, i64]:
    """Pass over a list of names after its tag. Return (its end, its number of names); (-1, 0) if it must be read."""
    count: i64 = 0
    while at + 2 <= limit:
        end: i64 = at + 2 + u16(octets, at)
        at += 2
        if end == at:
            return at, count
        if end > limit:
            return -1, 0
        while at < end:
            length: i64 = octets[at]
            at += 1 + length
            if at >= end or octets[at] != 0:
                return -1, 0
            at += 1
            count += 1
    return -1, 0
