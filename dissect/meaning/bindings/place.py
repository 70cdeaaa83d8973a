"""A place in the memory of an S7 CPU in the notation of bindings: ``DB10.DBB0``, ``DB10.DBW4``, ``MB20``, ``EB0``."""

from __future__ import annotations

from typing import Final, NamedTuple

from dissect.protocols.s7.address import MAX_DB, MAX_OCTET, address_text, parse_address
from dissect.protocols.s7.tables import BYTE, DB_AREAS, LETTER_AREAS, NUMBERED_AREAS

#: Areas of octets, by their letters.
AREAS: Final = {
    **{letter: area for letter, area in LETTER_AREAS.items() if area not in NUMBERED_AREAS},
    "DB": 0x84,
    "DI": 0x85,
}


class Place(NamedTuple):
    """Code of the area, number of the DB (0 outside of DBs), offset in octets."""

    area: int
    db: int
    offset: int

    def __str__(self) -> str:
        return address_text(self.area, self.db, self.offset * 8, BYTE)


def parse_place(written: str) -> Place | None:
    """Return the place that ``written`` names, None if it is not valid.

    The width letter only shows that the place counts in octets.
    """
    found = parse_address(written.strip().upper())
    if found is None or found.width not in {"B", "W", "D"} or found.bit >= 0 or found.area not in AREAS.values():
        return None
    return Place(found.area, found.db, found.number) if found.db <= MAX_DB and found.number <= MAX_OCTET else None


def in_blocks(area: int) -> bool:
    """Return whether places in the area have a block number."""
    return area in DB_AREAS
