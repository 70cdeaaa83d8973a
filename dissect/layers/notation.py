"""Items from addresses as people write them: the inverse of `dissect.s7.address`."""

from __future__ import annotations

import re
from typing import Final

from dissect.layers.variables import S7_Any
from dissect.s7.tables import LETTER_AREAS, TRANSPORT_SIZES

#: Transport size of a width letter. No letter is one bit.
_WIDTHS: Final = {"": 0x01, "X": 0x01, "B": 0x02, "W": 0x04, "D": 0x06, "L": 0x0F}
_BLOCKS: Final = {"DB": 0x84, "DI": 0x85}
_COUNTER: Final = 0x1C
_TIMER: Final = 0x1D
_BIT: Final = 0x01

_IN_BLOCK: Final = re.compile(r"(DB|DI)(\d+)\.(?:DB|DI)([XBWDL])(\d+)(?:\.([0-7]))?")
_ELSEWHERE: Final = re.compile(r"([A-Z])([BWDL]?)(\d+)(?:\.([0-7]))?")
_MAX_OCTET: Final = (1 << 21) - 1
_MAX_WORD: Final = 65535


def at(address: str, count: int = 1, transport_size: str | int | None = None) -> S7_Any:
    """Return the item of ``address``: ``DB10.DBX4.1``, ``DB10.DBW4``, ``MW20``, ``I0.0`` or ``E0.0``, ``T5``, ``C3`` or ``Z3``.

    ``count`` is in elements. The transport size follows from the width letter (B BYTE, W WORD, D DWORD, none or X BIT, L
    DATE_AND_TIME); ``transport_size`` names another for the same place, for example ``"REAL"`` for ``DB1.DBD8``. Raises
    ValueError for what is no address.
    """
    text = address.strip().upper()
    block = _IN_BLOCK.fullmatch(text)
    if block:
        area, db, width = _BLOCKS[block[1]], int(block[2]), block[3]
        octet, bit = int(block[4]), block[5]
    else:
        other = _ELSEWHERE.fullmatch(text)
        if other is None or other[1] not in LETTER_AREAS:
            raise _no_address(address, "write it as DB10.DBX4.1, DB10.DBW4, MW20, I0.0, T5 or C3")
        area, db, width = LETTER_AREAS[other[1]], 0, other[2]
        octet, bit = int(other[3]), other[4]
        if area in (_COUNTER, _TIMER):
            return _item(address, area, 0, _number(address, width, octet, bit), area, count, transport_size)
    if octet > _MAX_OCTET or db > _MAX_WORD:
        raise _no_address(address, "its numbers do not fit the fields of an item")
    size = _WIDTHS[width]
    if (bit is None) == (size == _BIT):
        raise _no_address(address, "a bit has a place after the dot, anything wider has none")
    return _item(address, area, db, octet * 8 + int(bit or 0), size, count, transport_size)


def _number(address: str, width: str, number: int, bit: str | None) -> int:
    if width or bit is not None or number > _MAX_WORD:
        raise _no_address(address, "a counter or timer is a letter and a number")
    return number


def _item(
    address: str, area: int, db: int, place: int, size: int, count: int, transport_size: str | int | None
) -> S7_Any:
    if not 0 < count <= _MAX_WORD:
        message = f"{count} elements of {address!r} cannot be asked for: give 1 to {_MAX_WORD}"
        raise ValueError(message)
    if isinstance(transport_size, str):
        names = {name: number for number, name in TRANSPORT_SIZES.names().items()}
        if transport_size.upper() not in names:
            message = f"{transport_size!r} is no transport size: give one of {', '.join(names)}"
            raise ValueError(message)
        transport_size = names[transport_size.upper()]
    if transport_size is not None:
        size = transport_size
    return S7_Any(transport_size=size, count=count, db=db, area=area, address=place)


def _no_address(address: str, advice: str) -> ValueError:
    return ValueError(f"{address!r} is no address: {advice}")
