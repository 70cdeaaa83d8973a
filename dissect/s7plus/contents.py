"""What a PDU carries behind its head, as its readers leave it: values, objects, addresses, refusals, and their parts."""

from __future__ import annotations

from typing import Final

from dissect.s7plus.ids import AREAS, DATA_BLOCK, block_name, member_name, short_name
from dissect.s7plus.objects import PlusObject, every_object
from dissect.s7plus.values import Member, Value
from dissect.wire.malformed import Malformed
from dissect.wire.part import Part


class Address:
    """Where a variable is: an area or object, the attribute that holds it (``sub_area``), and the way to it within that.

    ``crc`` is the checksum of its symbol, 0 for none. An attribute of an object has no LIDs. One address serves for every
    read or write that repeats it, so that nothing of it is changed; ``fragment`` is for who writes it again and again.
    """

    __slots__ = ("_label", "area", "crc", "fragment", "lids", "sub_area")

    def __init__(self, crc: int, area: int, sub_area: int, lids: list[int]) -> None:
        self.crc = crc
        self.area = area
        self.sub_area = sub_area
        self.lids = lids
        self._label = ""
        self.fragment: tuple[bytes, str, str, bytes] | None = None

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Address) and self.key == other.key

    def __hash__(self) -> int:
        return hash(self.key)

    def __repr__(self) -> str:
        return f"Address({self.label!r})"

    @property
    def key(self) -> tuple[int, ...]:
        """All its numbers."""
        return (self.crc, self.area, self.sub_area, *self.lids)

    @property
    def label(self) -> str:
        """The address as far as it tells without the type information of its block.

        For example ``DB3 LID 14``, ``MW100``, ``CPUexecUnit.OperatingStateREQ``. The checksum of a symbol follows in
        brackets, as it is what the device compares.
        """
        if not self._label:
            self._label = self._said()
        return self._label

    def _said(self) -> str:
        where = AREAS.get(self.area) or block_name(self.area)
        if not where:
            return ".".join([short_name(self.area), *[member_name(id_) for id_ in (self.sub_area, *self.lids)]])
        absolute = self._absolute()
        if absolute:
            return absolute
        path = ".".join([str(lid) for lid in self.lids])
        symbol = f" [CRC 0x{self.crc:08x}]" if self.crc else ""
        held = "" if self.sub_area in _ACTUAL else f" {member_name(self.sub_area)}"
        return f"{where}{held}{' LID ' + path if path else ''}{symbol}"

    @property
    def start_bit(self) -> int:
        """Number of the first bit of an absolute address, -1 for a symbol or an attribute."""
        lids = self.lids
        if self.crc or len(lids) not in {3, 4} or lids[0] != _CLASSIC_BLOB:
            return -1
        if self.area not in AREAS and self.area >> 16 != DATA_BLOCK:
            return -1
        return 8 * lids[1] + (lids[3] if len(lids) == 4 else 0)

    def _absolute(self) -> str:
        """Return the address of octets or of a bit, empty when it is none: LIDs 3, offset, octets, for a bit its number."""
        if self.start_bit < 0:
            return ""
        lids = self.lids
        prefix = AREAS.get(self.area) or f"{block_name(self.area)}.DB"
        if len(lids) == 4:
            return f"{prefix}{'' if self.area in AREAS else 'X'}{lids[1]}.{lids[3]}"
        letter = _LETTERS.get(lids[2])
        return f"{prefix}{letter}{lids[1]}" if letter is not None else f"{prefix}B{lids[1]} x{lids[2]}"


#: Addresses by their numbers, and how many are remembered.
_KNOWN: Final[dict[tuple[int, ...], Address]] = {}
_MAX_KNOWN: Final = 4096
#: LIDs of the longest that is.
_MAX_LIDS: Final = 16


def known_address(crc: int, area: int, sub_area: int, lids: list[int]) -> Address:
    """Return the address that has these numbers, the same one as before where it was asked for not long ago."""
    if len(lids) > _MAX_LIDS:
        return Address(crc, area, sub_area, lids)
    key = (crc, area, sub_area, *lids)
    found = _KNOWN.get(key)
    if found is None:
        if len(_KNOWN) >= _MAX_KNOWN:
            _KNOWN.clear()
        found = _KNOWN[key] = Address(crc, area, sub_area, lids)
    return found


#: Letters of addresses of one, two and four octets.
_LETTERS: Final = {1: "B", 2: "W", 4: "D"}
#: First LID of an address in octets, for everything that is not optimised.
_CLASSIC_BLOB: Final = 3
#: Attributes that hold the values the program works with, which nobody needs to be told.
_ACTUAL: Final = frozenset((2550, 3736))


class Made:
    """What CreateObject and Explore are about. ``object_id`` is where an object is made, -1 for none, ``ids`` are those it got.

    ``begun`` are the objects where one of them ends too soon or is wrong somewhere, as far as they were read.
    """

    __slots__ = ("begun", "ids", "object_id", "objects")

    def __init__(self) -> None:
        self.object_id = -1
        self.ids: list[int] = []
        self.objects: list[PlusObject] = []
        self.begun: list[PlusObject] = []

    @property
    def every(self) -> list[PlusObject]:
        """The objects with those inside them, each before those it holds."""
        return every_object(self.objects)


class Contents(Made):
    """The contents of one PDU. What a function does not have stays empty, or -1.

    ``items`` are values by the number of their item (in a notification by its reference), ``refusals`` return values by the
    same. ``items_left_out`` of so many items that a tree ends before them are counted only. ``blobs`` are the compressed ones,
    ``pieces`` the octets of a stream, one range of offsets within the data each.
    """

    __slots__ = (
        "addresses",
        "blobs",
        "digest",
        "exhausted",
        "frame_starts",
        "integrity_id",
        "items",
        "items_left_out",
        "list",
        "malformed",
        "method",
        "parts",
        "pieces",
        "refusals",
        "return_value",
        "sequence",
        "value",
        "version",
        "whole",
    )

    def __init__(self, version: int, return_value: int, frame_starts: dict[int, int]) -> None:
        """``frame_starts`` are those of `PlusPdu`."""
        super().__init__()
        self.version = version
        self.return_value = return_value
        self.frame_starts = frame_starts
        self.parts: list[Part] = []
        self.malformed: list[Malformed] = []
        self.whole = False  # read up to the last octet, and nothing was odd
        self.exhausted = False  # given up, because it takes more work than was allowed
        self.integrity_id = -1
        self.digest = b""
        self.method = -1
        self.sequence = -1
        self.addresses: list[Address] = []
        self.items: list[tuple[int, Value]] = []
        self.items_left_out = 0
        self.refusals: list[tuple[int, int]] = []
        self.value: Value | None = None
        self.list: list[Member] = []
        self.pieces: list[tuple[int, int]] = []
        self.blobs: list[tuple[int, int]] = []

    @property
    def item_count(self) -> int:
        """How many items there are, with those that were left out."""
        return len(self.items) + self.items_left_out

    @property
    def notes(self) -> list[str]:
        """What the parts are about, in wire order; text from the wire, not escaped."""
        return [part.note for part in self.parts if part.note]
