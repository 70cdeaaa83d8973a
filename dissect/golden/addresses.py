"""Items as a golden names them: ``DB10.DBW4 INT x3``, and back to the twelve octets on the wire (reference 3.5)."""

from __future__ import annotations

import re
import struct
from typing import Final

from dissect.s7.items import SPECIFICATION, Item, parse_item
from dissect.s7.tables import AREA_LETTERS, DB_AREAS, NUMBERED_AREAS, S7ANY, TRANSPORT_SIZES

_S7ANY_LENGTH: Final = 10
#: Names of transport sizes, in one word.
_TYPES: Final = {code.number: code.name.replace(" ", "_") for code in TRANSPORT_SIZES}
_BY_TYPE: Final = {name: number for number, name in _TYPES.items()}
_LETTERS: Final = {letters: area for area, letters in AREA_LETTERS.items()}
#: Areas whose addresses name a number in the field of the DB.
_NAMED_DB: Final = DB_AREAS | {0x01}

_BLOCK: Final = re.compile(r"(DB|DI)([0-9]{1,5})\.\1[XBWDL]([0-9]{1,7})(?:\.([0-7]))?")
_RECORD: Final = re.compile(r"RECORD([0-9]{1,5})@([0-9]{1,8})")
_NUMBERED: Final = re.compile(r"(C200|T200|C|T):?([0-9]{1,8})")
_OCTET: Final = re.compile(r"(area0x[0-9a-f]{2}|[A-Z0-9]+):[XBWDL]([0-9]{1,7})(?:\.([0-7]))?")
_LETTERED: Final = re.compile(r"([PIQMLV])[BWDL]?([0-9]{1,7})(?:\.([0-7]))?")


def type_name(transport_size: int) -> str:
    """Return the type an item asks for in one word, ``0x..`` where it has no name."""
    return _TYPES.get(transport_size, f"0x{transport_size:02x}")


def named_item(item: Item) -> str:
    """Return the name of a request item that reads back to its octets: address, type, count; or its octets."""
    if item.transport_size >= 0:
        text = f"{item.address} {type_name(int(item.transport_size))}"
        if item.count != 1:
            text += f" x{item.count}"
        db = int(item.db) if item.area not in _NAMED_DB else 0
        if db:
            text += f" db {db}"  # which nobody looks at there, but it is on the wire
        try:
            if item_octets(item.address, type_name(int(item.transport_size)), int(item.count), db) == item.octets:
                return text
        except ValueError:
            pass
    return f"item <{item.octets.hex(' ')}>"


def item_octets(address: str, type_: str, count: int, idle_db: int = 0) -> bytes:
    """Return a request item of twelve octets. Raises ValueError when there is no such address or type.

    ``idle_db`` stands in the field of the DB number where the address has none.
    """
    size = _type(type_)
    area, db, place = _place(address)
    db = db if area in _NAMED_DB else idle_db
    if db > 0xFFFF or place > 0xFFFFFF or count > 0xFFFF:
        raise ValueError(f"{address} x{count} is beyond what an item can hold")
    octets = struct.pack(">BBBBHHB", SPECIFICATION, _S7ANY_LENGTH, S7ANY, size, count, db, area) + place.to_bytes(
        3, "big"
    )
    if parse_item(octets, 0).address != address:
        raise ValueError(
            f"{address} {type_}: the address does not suit the type, it is {parse_item(octets, 0).address}"
        )
    return octets


def _type(name: str) -> int:
    found = _BY_TYPE.get(name)
    if found is None and re.fullmatch("0x[0-9a-f]{2}", name):
        found = int(name, 16)
    if found is None:
        raise ValueError(f"{name} is no type; there are {', '.join(_BY_TYPE)}, and numbers such as 0x1f")
    return found


def _place(address: str) -> tuple[int, int, int]:
    """Return (area, db, address field)."""
    if found := _BLOCK.fullmatch(address):
        return _LETTERS[found[1]], int(found[2]), _bits(found[3], found[4])
    if found := _RECORD.fullmatch(address):
        return _LETTERS["RECORD"], int(found[1]), int(found[2])
    if found := _NUMBERED.fullmatch(address):
        return _LETTERS[found[1]], 0, int(found[2])
    if found := _LETTERED.fullmatch(address):
        return _LETTERS[found[1]], 0, _bits(found[2], found[3])
    if found := _OCTET.fullmatch(address):
        area = int(found[1][4:], 16) if found[1].startswith("area") else _LETTERS.get(found[1], -1)
        if area >= 0 and area not in DB_AREAS and area not in NUMBERED_AREAS:
            return area, 0, _bits(found[2], found[3])
    raise ValueError(f"{address} is no address such as DB10.DBW4, M20.1 or T5")


def _bits(octet: str, bit: str | None) -> int:
    return int(octet) * 8 + int(bit or 0)
