"""The items of a read request, and whether the next one reads the same: polling repeats its requests."""

from __future__ import annotations

from mypy_extensions import i64

from dissect.protocols.s7plus.check import Check
from dissect.protocols.s7plus.ending import FILL, read_tail
from dissect.protocols.s7plus.pieces import USUAL_QUALIFIER
from dissect.protocols.s7plus.plain import REQUEST_SIZE, one_frame


class Reads:
    """The variables of a read request, as `Check` found them: the same for every request with the same addresses."""

    __slots__ = ("asks", "item", "odd", "place", "sound")

    def __init__(self, found: Check) -> None:
        self.sound: bool = found.sound
        self.odd: bool = found.odd
        self.asks: bool = found.asks
        self.item: i64 = found.item
        self.place: i64 = found.place if found.data is found.octets else 0


def reads_again(octets: bytes, asked: bytes, before: Reads) -> bool:
    """Return whether a request certainly reads the same as the read ``before``, whose addresses are the octets ``asked``."""
    at, end = one_frame(octets)
    place: i64 = before.place
    begin: i64 = place - len(asked)
    if not before.sound or at < 0 or at + REQUEST_SIZE != begin or place > end or octets[begin:place] != asked:
        return False
    behind: i64 = place + len(USUAL_QUALIFIER)
    if behind > end or octets[place:behind] != USUAL_QUALIFIER:
        return False
    return read_tail(octets, behind, end, octets[1], FILL, False) >= -1
