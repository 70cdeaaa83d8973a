"""Items from addresses as people write them (`dissect.s7.address.parse_address`)."""

from __future__ import annotations

from typing import Final

from dissect.layers.variables import S7_Any
from dissect.s7.address import MAX_DB, MAX_OCTET, parse_address
from dissect.s7.tables import BIT, DB_AREAS, LETTER_AREAS, NUMBERED_AREAS, TRANSPORT_SIZES

#: Transport size of a width letter. No letter is one bit.
_WIDTHS: Final = {"": 0x01, "X": 0x01, "B": 0x02, "W": 0x04, "D": 0x06, "L": 0x0F}
_MAX_WORD: Final = 65535
#: Areas that are written without a colon.
_AREAS: Final = DB_AREAS | frozenset(LETTER_AREAS.values())


def at(address: str, count: int = 1, transport_size: str | int | None = None) -> S7_Any:
    """Return the item of ``address``: ``DB10.DBX4.1``, ``DB10.DBW4``, ``MW20``, ``I0.0`` or ``E0.0``, ``T5``, ``C3`` or ``Z3``.

    ``count`` is in elements. The transport size follows from the width letter (B BYTE, W WORD, D DWORD, none or X BIT, L
    DATE_AND_TIME); ``transport_size`` names another for the same place, for example ``"REAL"`` for ``DB1.DBD8``. Raises
    ValueError for what is no address.
    """
    found = parse_address(address.strip().upper())
    if found is None or found.area not in _AREAS or ":" in address:
        raise _no_address(address, "write it as DB10.DBX4.1, DB10.DBW4, MW20, I0.0, T5 or C3")
    if found.area in NUMBERED_AREAS:
        if found.number > _MAX_WORD:
            raise _no_address(address, "a counter or timer is a letter and a number")
        return _item(address, found.area, 0, found.number, found.area, count, transport_size)
    if found.number > MAX_OCTET or found.db > MAX_DB:
        raise _no_address(address, "its numbers do not fit the fields of an item")
    size = _WIDTHS[found.width]
    if (found.bit < 0) == (size == BIT):
        raise _no_address(address, "a bit has a place after the dot, anything wider has none")
    return _item(address, found.area, found.db, found.field, size, count, transport_size)


def _item(
    address: str, area: int, db: int, place: int, size: int, count: int, transport_size: str | int | None
) -> S7_Any:
    if not 0 < count <= _MAX_WORD:
        message = f"{count} elements of {address!r} cannot be requested: give 1 to {_MAX_WORD}"
        raise ValueError(message)
    if isinstance(transport_size, str):
        names = {name: number for number, name in TRANSPORT_SIZES.names().items()}
        if transport_size.upper() not in names:
            message = f"{transport_size!r} is not a transport size: give one of {', '.join(names)}"
            raise ValueError(message)
        transport_size = names[transport_size.upper()]
    if transport_size is not None:
        size = transport_size
    return S7_Any(transport_size=size, count=count, db=db, area=area, address=place)


def _no_address(address: str, advice: str) -> ValueError:
    return ValueError(f"{address!r} is not an address: {advice}")
