"""S7 addresses the way people write them: ``DB10.DBX4.1``, ``DB10.DBW4``, ``MW20``, ``I0.0``, ``T5``, ``C3``."""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.s7.tables import AREA_LETTERS, ELEMENT_OCTETS, NUMBERED_AREAS

_BIT: Final = 0x01
_RECORD: Final = 0x01
_DB: Final = 0x84
_DI: Final = 0x85

#: Areas whose letter is followed by a width letter (B, W, D).
_LETTERED: Final = frozenset((0x80, 0x81, 0x82, 0x83, 0x86, 0x87))
#: Areas whose letter is followed by a number at once.
_PLAIN: Final = frozenset((0x1C, 0x1D))
#: Width letters of the DB family and of the others, by octets of an element.
_WIDTHS: Final[dict[int, str]] = {1: "B", 2: "W", 4: "D", 8: "L"}


def address_text(area: i64, db: i64, address: i64, transport_size: i64) -> str:
    """Return the address of one item.

    ``address`` is the field as it stands on the wire: octet times 8 plus bit, or a plain number in the timer and counter
    areas. ``transport_size`` is that of a request item and decides the width letter. An area no table knows is shown by
    its number, so that nothing is invented.
    """
    if area in NUMBERED_AREAS:
        # C5, but C200:5 in the 200 family: C2005 is the S7 counter of that number.
        return f"{AREA_LETTERS[area]}{'' if area in _PLAIN else ':'}{address}"
    if area == _RECORD:
        return f"RECORD{db}@{address}"
    octet: i64 = address >> 3
    bit: i64 = address & 7
    if transport_size == _BIT:
        place = f"{octet}.{bit}"
        width = "X"
    else:
        place = str(octet) if bit == 0 else f"{octet}.{bit}"
        width = _WIDTHS.get(ELEMENT_OCTETS.get(transport_size, 1), "B")
    if area == _DB:
        return f"DB{db}.DB{width}{place}"
    if area == _DI:
        return f"DI{db}.DI{width}{place}"
    if area in _LETTERED:
        return f"{AREA_LETTERS[area]}{'' if width == 'X' else width}{place}"
    name = AREA_LETTERS.get(area, f"area0x{area:02x}")
    return f"{name}:{width}{place}"
