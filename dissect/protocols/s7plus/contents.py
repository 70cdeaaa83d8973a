"""`Contents`: the part of a PDU after its head. Values, objects, addresses, refusals, and their parts."""

from __future__ import annotations

from typing import Final

from mypy_extensions import mypyc_attr

from dissect.protocols.s7plus.ids import AREAS, DATA_BLOCK, block_name, member_name, short_name
from dissect.protocols.s7plus.objects import PlusObject, every_object
from dissect.protocols.s7plus.values import Member, Value
from dissect.wire.copies import leaves
from dissect.wire.malformed import Malformed
from dissect.wire.part import Part


@mypyc_attr(acyclic=True)
class VariableAddress:
    """The address of a variable: an area or object, the attribute with the variable (``sub_area``), and the path inside it.

    ``crc`` is the checksum of its symbol, 0 for none. An attribute of an object has no LIDs. One address object is used for
    every read or write that repeats it, so it must not be changed; ``fragment`` is a cache for writers that write it again and
    again.
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
        return isinstance(other, VariableAddress) and self.key == other.key

    def __hash__(self) -> int:
        return hash(self.key)

    def __repr__(self) -> str:
        return f"Address({self.label!r})"

    @property
    def key(self) -> tuple[int, ...]:
        """All numbers of the address."""
        return (self.crc, self.area, self.sub_area, *self.lids)

    @property
    def label(self) -> str:
        """The address as text, as far as possible without the type information of its block.

        For example ``DB3 LID 14``, ``MW100``, ``CPUexecUnit.OperatingStateREQ``. The checksum of a symbol follows in brackets,
        because the device compares it.
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
        """Return the text of an absolute address (LIDs: 3, offset, size, and the number of a bit); empty for others."""
        if self.start_bit < 0:
            return ""
        lids = self.lids
        prefix = AREAS.get(self.area) or f"{block_name(self.area)}.DB"
        if len(lids) == 4:
            return f"{prefix}{'' if self.area in AREAS else 'X'}{lids[1]}.{lids[3]}"
        letter = _LETTERS.get(lids[2])
        return f"{prefix}{letter}{lids[1]}" if letter is not None else f"{prefix}B{lids[1]} x{lids[2]}"


#: Addresses by their numbers, and the maximum number of remembered ones.
_KNOWN: Final[dict[tuple[int, ...], VariableAddress]] = {}
_MAX_KNOWN: Final = 4096
#: Maximum number of LIDs of a remembered address.
_MAX_LIDS: Final = 16


def known_address(crc: int, area: int, sub_area: int, lids: list[int]) -> VariableAddress:
    """Return the address with these numbers; the same object as before if it was requested recently."""
    if len(lids) > _MAX_LIDS:
        return VariableAddress(crc, area, sub_area, lids)
    key = (crc, area, sub_area, *lids)
    found = _KNOWN.get(key)
    if found is None:
        if len(_KNOWN) >= _MAX_KNOWN:
            _KNOWN.clear()
        found = _KNOWN[key] = VariableAddress(crc, area, sub_area, lids)
    return found


#: Letters of addresses of one, two and four octets.
_LETTERS: Final = {1: "B", 2: "W", 4: "D"}
#: First LID of an absolute address, used for everything that is not optimised.
_CLASSIC_BLOB: Final = 3
#: Attributes with the actual values of the program; labels omit them.
_ACTUAL: Final = frozenset((2550, 3736))


@mypyc_attr(acyclic=True)
class Made:
    """Contents of CreateObject and Explore.

    ``object_id``: where objects are created, -1 for none; ``ids``: the ids that they got. ``begun`` are the objects as far as
    they were read, if one of them ends too soon or has a fault.
    """

    __slots__ = ("begun", "ids", "object_id", "objects")

    def __init__(self, ids: list[int], objects: list[PlusObject]) -> None:
        self.object_id = -1
        self.ids: list[int] = ids
        self.objects: list[PlusObject] = objects
        self.begun: list[PlusObject] = []

    @property
    def every(self) -> list[PlusObject]:
        """The objects and all objects inside them, each before those inside it."""
        return every_object(self.objects)


@mypyc_attr(acyclic=True, free_list_len=1)
class Contents(Made):
    """The contents of one PDU. Fields that its function does not have are empty or -1.

    ``items`` are (number, value) pairs; in a notification the number is a reference. ``refusals`` are (number, return value)
    pairs. ``items_left_out`` counts items beyond the number of parts that a tree can show. ``blobs`` are the compressed blobs;
    ``pieces`` are the octets of a stream, each as a range of offsets within the data.
    """

    __slots__ = (
        "addresses",
        "blobs",
        "digest",
        "exhausted",
        "expected",
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
        """``frame_starts`` as in `PlusPdu`."""
        super().__init__([], [])
        self.version = version
        self.return_value = return_value
        self.frame_starts = frame_starts
        self.parts: list[Part] = []
        self.malformed: list[Malformed] = []
        self.whole = False  # read up to the last octet, without a fault
        self.exhausted = False  # given up, because it takes more work than allowed
        self.integrity_id = -1
        self.digest = b""
        self.method = -1
        self.sequence = -1
        self.addresses: list[VariableAddress] = []
        self.expected = 0  # number of values that the addresses of a write announce
        self.items: list[tuple[int, Value]] = []
        self.items_left_out = 0
        self.refusals: list[tuple[int, int]] = []
        self.value: Value | None = None
        self.list: list[Member] = []
        self.pieces: list[tuple[int, int]] = []
        self.blobs: list[tuple[int, int]] = []

    @property
    def item_count(self) -> int:
        """Number of items, including omitted ones."""
        return len(self.items) + self.items_left_out

    @property
    def notes(self) -> list[str]:
        """The notes of the parts in wire order; text from the wire is not escaped."""
        return [part.note for part in self.parts if part.note]


leaves(VariableAddress)
