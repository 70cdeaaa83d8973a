"""A place in the memory of an S7 CPU, as a binding writes it: ``DB10.DBB0``, ``DB10.DBW4``, ``MB20``, ``EB0``."""

from __future__ import annotations

import re
from typing import Final, NamedTuple

from dissect.s7.address import address_text
from dissect.s7.tables import DB_AREAS, LETTER_AREAS, NUMBERED_AREAS

#: The highest octet that the 24 bits of an item's address reach, and the highest DB number.
MAX_OCTET: Final = (1 << 21) - 1
MAX_DB: Final = 0xFFFF
#: Areas that consist of octets, by the letters people write.
AREAS: Final = {
    **{letter: area for letter, area in LETTER_AREAS.items() if area not in NUMBERED_AREAS},
    "DB": 0x84,
    "DI": 0x85,
}
_BYTE: Final = 0x02
_IN_BLOCK: Final = re.compile(r"(DB|DI)([0-9]{1,5})\.\1[BWD]([0-9]{1,7})")
_ELSEWHERE: Final = re.compile(r"([A-Z])[BWD]([0-9]{1,7})")


class Place(NamedTuple):
    """Code of the area, number of the DB (0 outside of DBs), offset in octets."""

    area: int
    db: int
    offset: int

    def __str__(self) -> str:
        return address_text(self.area, self.db, self.offset * 8, _BYTE)


def parse_place(written: str) -> Place | None:
    """Return the place that ``written`` names, None where it is none. The width letter only says that octets are meant."""
    text = written.strip().upper()
    block = _IN_BLOCK.fullmatch(text)
    other = _ELSEWHERE.fullmatch(text)
    if block is not None:
        place = Place(AREAS[block[1]], int(block[2]), int(block[3]))
    elif other is not None and other[1] in AREAS:
        place = Place(AREAS[other[1]], 0, int(other[2]))
    else:
        return None
    return place if place.db <= MAX_DB and place.offset <= MAX_OCTET else None


def in_blocks(area: int) -> bool:
    """Whether a place of the area has the number of a block."""
    return area in DB_AREAS
