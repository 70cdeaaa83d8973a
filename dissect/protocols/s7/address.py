"""S7 addresses as people write them: ``DB10.DBX4.1``, ``DB10.DBW4``, ``MW20``, ``I0.0``, ``T5``, ``C3``.

`address_text` writes them and `parse_address` reads them; it accepts all texts that `address_text` writes.
"""

from __future__ import annotations

import re
from typing import Final

from mypy_extensions import i64

from dissect.protocols.s7.tables import (
    AREA_LETTERS,
    BIT,
    DB,
    DB_AREAS,
    DI,
    ELEMENT_OCTETS,
    LETTER_AREAS,
    NUMBERED_AREAS,
    RECORD_AREA,
)

#: Areas whose letter is followed by a width letter (B, W, D).
_LETTERED: Final = frozenset((0x80, 0x81, 0x82, 0x83, 0x86, 0x87))
#: Areas whose letter is followed directly by a number.
_PLAIN: Final = frozenset((0x1C, 0x1D))
#: Width letters, by octets of an element.
_WIDTHS: Final[dict[int, str]] = {1: "B", 2: "W", 4: "D", 8: "L"}
#: Limits of an item's fields: the highest octet that its 24-bit address can reach, and the highest number of a data block.
MAX_OCTET: Final = (1 << 21) - 1
MAX_DB: Final = 0xFFFF

_AREAS: Final[dict[str, int]] = {letters: area for area, letters in AREA_LETTERS.items()}
# Patterns are texts, which `re` compiles and caches at their first use: most runs use none.
_IN_BLOCK: Final = r"(DB|DI)([0-9]{1,8})\.\1([XBWDL])([0-9]{1,8})(?:\.([0-7]))?"
_IN_RECORD: Final = r"RECORD([0-9]{1,8})@([0-9]{1,8})"
_NUMBERED: Final = r"(C200|T200|[CTZ]):?([0-9]{1,8})"
_ELSEWHERE: Final = r"([A-Z])([BWDL]?)([0-9]{1,8})(?:\.([0-7]))?"
_SPELT_OUT: Final = r"(area0x[0-9a-f]{2}|[A-Z0-9]+):([XBWDL])([0-9]{1,8})(?:\.([0-7]))?"


class Address:
    """The parts of an address; whether an item can contain it is not checked here.

    ``number`` is the octet, or the number of a timer, counter or record. ``width`` is the letter X, B, W, D or L, empty if none
    is written. ``bit`` is -1 if none is written. ``field`` is the address field of an item: octet times 8 plus bit, or the
    number.
    """

    __slots__ = ("area", "bit", "db", "field", "number", "width")

    def __init__(self, area: int, db: int, number: int, width: str = "", bit: int = -1) -> None:
        self.area = area
        self.db = db
        self.number = number
        self.width = width
        self.bit = bit
        plain = area in NUMBERED_AREAS or area == RECORD_AREA
        self.field = number if plain else number * 8 + max(bit, 0)


def parse_address(text: str) -> Address | None:
    """Return the address in ``text``; None if it is not an address.

    It accepts all texts that `address_text` writes, and the German letters E, A and Z.
    """
    if found := re.fullmatch(_IN_BLOCK, text):
        return Address(DB if found[1] == "DB" else DI, int(found[2]), int(found[4]), found[3], int(found[5] or -1))
    if found := re.fullmatch(_IN_RECORD, text):
        return Address(RECORD_AREA, int(found[1]), int(found[2]))
    if found := re.fullmatch(_NUMBERED, text):
        return Address(_AREAS.get(found[1], LETTER_AREAS["Z"]), 0, int(found[2]))
    if (found := re.fullmatch(_ELSEWHERE, text)) and LETTER_AREAS.get(found[1], 0x1C) not in NUMBERED_AREAS:
        return Address(LETTER_AREAS[found[1]], 0, int(found[3]), found[2], int(found[4] or -1))
    if found := re.fullmatch(_SPELT_OUT, text):
        area = int(found[1][4:], 16) if found[1].startswith("area") else _AREAS.get(found[1], -1)
        if area >= 0 and area not in DB_AREAS and area not in NUMBERED_AREAS:
            return Address(area, 0, int(found[3]), found[2], int(found[4] or -1))
    return None


def address_text(area: i64, db: i64, address: i64, transport_size: i64) -> str:
    """Return the address of an item as text.

    ``address`` is the field as sent: octet times 8 plus bit, or a plain number for timers and counters. ``transport_size``
    belongs to the request item and determines the width letter. An area that is in no table is shown by its number.
    """
    if area in NUMBERED_AREAS:
        # C5, but C200:5 in the 200 family, because C2005 would be the S7 counter with that number.
        return f"{AREA_LETTERS[area]}{'' if area in _PLAIN else ':'}{address}"
    if area == RECORD_AREA:
        return f"RECORD{db}@{address}"
    octet: i64 = address >> 3
    bit: i64 = address & 7
    if transport_size == BIT:
        place = f"{octet}.{bit}"
        width = "X"
    else:
        place = str(octet) if bit == 0 else f"{octet}.{bit}"
        width = _WIDTHS.get(ELEMENT_OCTETS.get(transport_size, 1), "B")
    if area == DB:
        return f"DB{db}.DB{width}{place}"
    if area == DI:
        return f"DI{db}.DI{width}{place}"
    if area in _LETTERED:
        return f"{AREA_LETTERS[area]}{'' if width == 'X' else width}{place}"
    name = AREA_LETTERS.get(area, f"area0x{area:02x}")
    return f"{name}:{width}{place}"
