"""Names of items in a golden: ``DB10.DBW4 INT x3``, and back to the twelve octets on the wire (reference 3.5)."""

from __future__ import annotations

import re
from typing import Final

from dissect.protocols.s7.address import parse_address
from dissect.protocols.s7.build import build_item
from dissect.protocols.s7.items import Item, parse_item
from dissect.protocols.s7.tables import DB_AREAS, TRANSPORT_SIZES

#: Names of transport sizes, in one word.
_TYPES: Final = {code.number: code.name.replace(" ", "_") for code in TRANSPORT_SIZES}
_BY_TYPE: Final = {name: number for number, name in _TYPES.items()}
#: Areas whose addresses use the DB field for a number.
_NAMED_DB: Final = DB_AREAS | {0x01}


def type_name(transport_size: int) -> str:
    """Return the type of an item in one word, ``0x..`` if it has no name."""
    return _TYPES.get(transport_size, f"0x{transport_size:02x}")


def named_item(item: Item) -> str:
    """Return a name of a request item that can be parsed back to its octets: address, type and count; otherwise the octets."""
    if item.transport_size >= 0:
        text = f"{item.address} {type_name(int(item.transport_size))}"
        if item.count != 1:
            text += f" x{item.count}"
        db = int(item.db) if item.area not in _NAMED_DB else 0
        if db:
            text += f" db {db}"  # the DB number is meaningless for this area, but it is on the wire
        try:
            if item_octets(item.address, type_name(int(item.transport_size)), int(item.count), db) == item.octets:
                return text
        except ValueError:
            pass
    return f"item <{item.octets.hex(' ')}>"


def item_octets(address: str, type_: str, count: int, idle_db: int = 0) -> bytes:
    """Return a request item of twelve octets. Raises ValueError for an unknown address or type.

    ``idle_db`` is the value of the DB field if the address has no DB number.
    """
    size = _type(type_)
    place = parse_address(address)
    if place is None:
        raise ValueError(f"{address} is not an address such as DB10.DBW4, M20.1 or T5")
    db = place.db if place.area in _NAMED_DB else idle_db
    if db > 0xFFFF or place.field > 0xFFFFFF or count > 0xFFFF:
        raise ValueError(f"{address} x{count} is more than an item can hold")
    octets = build_item(size, count, db, place.area, place.field)
    if parse_item(octets, 0).address != address:
        raise ValueError(
            f"{address} {type_}: the address does not fit the type, it would be {parse_item(octets, 0).address}"
        )
    return octets


def _type(name: str) -> int:
    type_ = _BY_TYPE.get(name)
    if type_ is None and re.fullmatch("0x[0-9a-f]{2}", name):
        type_ = int(name, 16)
    if type_ is None:
        raise ValueError(f"{name} is not a type; known types: {', '.join(_BY_TYPE)}, and numbers such as 0x1f")
    return type_
