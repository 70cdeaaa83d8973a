"""Positions of variables in a sequence of bits, and the formats of struct and bitstruct for them (R20-R27)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

from dissect.scd.errors import E_MAP, Error
from dissect.scd.types import Kind, SimpleType

#: The key of a variable: index and sub-index, or the name of a field of a struct.
Key = tuple[int, int] | str


def address_text(key: tuple[int, int]) -> str:
    """Return index and sub-index as people write them: "0x6041:0"."""
    return f"0x{key[0]:04x}:{key[1]}"


_CODES: Final = {
    (Kind.INT, 8): "b",
    (Kind.INT, 16): "h",
    (Kind.INT, 32): "i",
    (Kind.INT, 64): "q",
    (Kind.UINT, 8): "B",
    (Kind.UINT, 16): "H",
    (Kind.UINT, 32): "I",
    (Kind.UINT, 64): "Q",
    (Kind.REAL, 32): "f",
    (Kind.REAL, 64): "d",
    (Kind.NETTIME, 64): "ii",
    (Kind.INTERVAL, 64): "ii",
}
OCTETS: Final = frozenset((Kind.STRING, Kind.BLOCK, Kind.MAC, Kind.IP))
TIMES: Final = frozenset((Kind.NETTIME, Kind.INTERVAL))
_BIT_CODES: Final = {Kind.BOOL: "b", Kind.INT: "s", Kind.UINT: "u", Kind.REAL: "f"}


class Slot(NamedTuple):
    """The position of a variable: ``offset`` and ``bits`` in the sequence of bits; ``where`` names it in errors.

    ``fixed`` is the defined value of reserved bits (R32), None for "any". ``low`` and ``high`` are limits of the raw value,
    None if there are none.
    """

    key: Key
    type: SimpleType
    bits: int
    offset: int
    where: str
    fixed: int | None = None
    low: float | int | None = None
    high: float | int | None = None


def check_places(slots: Sequence[Slot], bits: int, where: str) -> None:
    """Raise `Error` E_MAP if variables overlap, descend or have no width, or if one ends after ``bits``."""
    end = 0
    for slot in slots:
        if slot.bits <= 0 and slot.type.kind is not Kind.RESERVED:
            raise Error(
                E_MAP, slot.where, "a variable length needs a size: from the mapping, the struct or the message"
            )
        if slot.offset < end:
            raise Error(E_MAP, slot.where, f"it begins at bit {slot.offset}, the one before ends at {end}")
        end = slot.offset + slot.bits
    if end > bits:
        raise Error(E_MAP, where, f"the last variable ends at bit {end} of {bits}")


def aligned(slots: Sequence[Slot]) -> bool:
    """Return whether struct can pack them: each variable has whole octets of its own, in a width that struct knows."""
    # If all begin at an octet, a Boolean has its octet for itself.
    return all(
        slot.offset % 8 == 0
        and (slot.type.kind in OCTETS or slot.type.kind is Kind.BOOL or (slot.type.kind, slot.bits) in _CODES)
        for slot in slots
    )


def struct_format(slots: Sequence[Slot], size: int) -> str:
    """Return the struct format for variables at whole octets, ``size`` octets altogether."""
    codes, at = ["<"], 0
    for slot in slots:
        first = slot.offset // 8
        width = (slot.bits + 7) // 8
        if slot.type.kind is Kind.BOOL:
            code = "B"
        else:
            code = f"{width}s" if slot.type.kind in OCTETS else _CODES[slot.type.kind, slot.bits]
        codes.append(f"{first - at}x" if first > at else "")
        codes.append(code)
        at = first + width
    codes.append(f"{size - at}x" if size > at else "")
    return "".join(codes)


def bit_format(slots: Sequence[Slot], size: int) -> str:
    """Return the bitstruct format for the reversed octets, from the last variable to the first."""
    codes, end = [], 8 * size
    for slot in reversed(slots):
        after = slot.offset + slot.bits
        if after < end:
            codes.append(f"p{end - after}")
        if slot.type.kind in TIMES:
            codes.append("s32s32")
        elif slot.type.kind in OCTETS:
            codes.append(f"r{slot.bits}")
        else:
            codes.append(f"{_BIT_CODES[slot.type.kind]}{slot.bits}")
        end = slot.offset
    if end:
        codes.append(f"p{end}")
    return "".join(codes)
