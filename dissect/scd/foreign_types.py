"""Translates types of CANopen and POWERLINK device descriptions to SCD, and values that are written as texts (profile 3.1)."""

from __future__ import annotations

import math
import re
from types import MappingProxyType
from typing import Final, NamedTuple

from dissect.scd.errors import Error
from dissect.scd.plain import as_plain
from dissect.scd.records import Plain, TypeRecord
from dissect.scd.types import STANDARD, Kind, SimpleType
from dissect.scd.written import is_octal, whole_octal, written_value

VISIBLE_STRING: Final = 0x09
OCTET_STRING: Final = 0x0A
UNICODE_STRING: Final = 0x0B
TIME_OF_DAY: Final = 0x0C
TIME_DIFFERENCE: Final = 0x0D
DOMAIN_TYPE: Final = 0x0F
_STRING: Final = 10
_BLOCK: Final = 15

#: Widths for which SCD has no index → (kind, bits); a DEFTYPE is made for each one that is used (C15).
_ODD_WIDTHS: Final = MappingProxyType(
    {
        0x10: (Kind.INT, 24),
        0x12: (Kind.INT, 40),
        0x13: (Kind.INT, 48),
        0x14: (Kind.INT, 56),
        0x16: (Kind.UINT, 24),
        0x18: (Kind.UINT, 40),
        0x19: (Kind.UINT, 48),
        0x1A: (Kind.UINT, 56),
    }
)
#: Types that SCD lacks, or has in another form (C20, C23) → the text of the note.
_LOSSES: Final = MappingProxyType(
    {
        OCTET_STRING: "OCTET_STRING is read as a block, as type 10 of SCD is a text",
        UNICODE_STRING: "UNICODE_STRING (UTF-16) is read as a block, as texts of SCD are UTF-8",
        TIME_OF_DAY: "TIME_OF_DAY is read as a block of 6 bytes",
        TIME_DIFFERENCE: "TIME_DIFFERENCE is read as a block of 6 bytes, as the interval of SCD has 8",
    }
)
_SIX_OCTETS: Final = frozenset((TIME_OF_DAY, TIME_DIFFERENCE))
#: Types with the same number and meaning in SCD.
_SHARED: Final = frozenset(STANDARD) - {_STRING, 0x0D, _BLOCK}
_NODE_ID: Final = re.compile(r"\$NODEID", re.IGNORECASE)


class Translated(NamedTuple):
    """A translated type: its SCD type, the bits of the variable if the type leaves them open, what is lost (empty: nothing)."""

    type: SimpleType
    bits: int
    loss: str


class ForeignTypes:
    """Translates the type codes of a device description; makes the DEFTYPEs it needs, at indices that the file does not use."""

    def __init__(self, own: dict[int, SimpleType]) -> None:
        self._own = own
        self._made: dict[int, SimpleType] = {}
        free = (index for index in range(0x60, 0x80) if index not in own)
        for code, (kind, bits) in _ODD_WIDTHS.items():
            self._made[code] = SimpleType(next(free), f"{kind.name.lower()}{bits}", kind, bits)
        self._used: set[int] = set()

    def translate(self, code: int) -> Translated | None:
        """Return the type for a code; None if SCD has no simple type for it."""
        if code in _SHARED:
            return Translated(STANDARD[code], 0, "")
        if code in self._made:
            self._used.add(code)
            return Translated(self._made[code], 0, "")
        if code == VISIBLE_STRING:
            return Translated(STANDARD[_STRING], 0, "")
        if code in _LOSSES or code == DOMAIN_TYPE:
            return Translated(STANDARD[_BLOCK], 48 if code in _SIX_OCTETS else 0, _LOSSES.get(code, ""))
        own = self._own.get(code)
        return None if own is None else Translated(own, 0, "")

    def records(self) -> list[TypeRecord]:
        """Return the DEFTYPEs of the file and those that were made, sorted."""
        rows = [*self._own.values(), *(self._made[code] for code in self._used)]
        return [
            TypeRecord(row.index, row.name, int(row.kind), row.bits) for row in sorted(rows, key=lambda row: row.index)
        ]


def whole_of_node(text: str, node_id: int | None) -> int:
    """Return a whole number, also with CANopen's ``$NODEID+``. Raises ValueError."""
    if not _NODE_ID.search(text):
        return whole_octal(text)
    if node_id is None:
        raise ValueError("depends on the node id, which the file does not give: set it (--node)")
    return whole_octal(_NODE_ID.sub("", text).strip().strip("+") or "0") + node_id


def parse_value(text: str, code: int, kind: SimpleType, bits: int, node_id: int | None) -> Plain:
    """Return a value in a device description in the form of records. Raises ValueError with what is wrong."""
    found: object
    if code == UNICODE_STRING:
        found = text.strip().encode("utf-16-le")
    elif code in _SIX_OCTETS:
        number = whole_octal(text)
        if not 0 <= number < 1 << 48:
            raise ValueError("does not fit 48 bits")
        found = number.to_bytes(6, "little")
    elif kind.kind is Kind.STRING:
        found = text.rstrip("\0")
    elif kind.kind in (Kind.INT, Kind.UINT) and ("$" in text or is_octal(text)):
        found = whole_of_node(text, node_id)
    else:
        found = written_value(text, kind)
    try:
        return as_plain(kind.check(found, bits))
    except Error as error:
        raise ValueError(error.detail) from None


def parse_limit(text: str, kind: SimpleType) -> float | int:
    """Return a limit for numbers of the type. Raises ValueError."""
    octal = kind.kind is not Kind.REAL and is_octal(text)
    found = whole_octal(text) if octal else written_value(text, kind)
    if not isinstance(found, (int, float)) or not math.isfinite(found):
        raise ValueError("is not a finite number")
    if kind.kind is not Kind.REAL:
        try:
            kind.check(found)
        except Error as error:
            raise ValueError(error.detail) from None
    return found
