"""Finds the tags that an item covers: sorted arrays for each area and block, searched once for each distinct address."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from typing import Final

from mypy_extensions import i64

from dissect.meaning.tags.model import NUMBERED_BITS, Tag
from dissect.protocols.s7.tables import DB, DB_AREAS

#: With this many addresses in it, the cache of their tags is emptied.
MAX_CACHED: Final = 8192
#: Maximum number of parts of one item: a tag for each bit of the longest PDU would be more.
MAX_PARTS: Final = 4096


class TagPart:
    """The part of a tag that an item covers: ``count`` elements from ``first`` on; with ``whole`` False a piece of one element.

    The part begins at ``bit`` of the item and has ``bits`` bits. For a piece, ``first`` is its element, and ``piece`` the bit
    of the element at which the piece begins.
    """

    __slots__ = ("address", "bit", "bits", "count", "first", "name", "piece", "tag", "type", "whole")

    def __init__(self, tag: Tag, first: i64, count: i64, bit: i64, bits: i64, piece: i64, whole: bool) -> None:
        self.tag: Tag = tag
        self.first: i64 = first
        self.count: i64 = count
        self.bit: i64 = bit
        self.bits: i64 = bits
        self.piece: i64 = piece
        self.whole: bool = whole
        self.name: str = ""  # these three are filled in when the part is first shown
        self.address: str = ""
        self.type: str = ""

    @property
    def all(self) -> bool:
        """Whether the part is the whole tag, with all its elements."""
        return self.whole and self.count == self.tag.count


class Cover:
    """The tags of an item: ``parts`` in the order of their places, and the bits that no tag covers.

    ``free`` are octets without a tag, as (first, count). ``masks`` are octets that tags cover only in part, as (octet, mask of
    the bits without a tag). ``more`` is the number of parts beyond `MAX_PARTS`.
    """

    __slots__ = ("free", "masks", "more", "parts")

    def __init__(self) -> None:
        self.parts: list[TagPart] = []
        self.free: list[tuple[int, int]] = []
        self.masks: list[tuple[int, int]] = []
        self.more: i64 = 0


class _Room:
    """The tags of an area or block, sorted by their first bit; ``ends`` has the furthest end of each tag and all before it."""

    __slots__ = ("ends", "starts", "tags")

    def __init__(self, tags: list[Tag]) -> None:
        self.tags: list[Tag] = sorted(tags, key=_place)
        self.starts: list[int] = [int(tag.start) for tag in self.tags]
        self.ends: list[int] = []
        furthest = 0
        for tag in self.tags:
            furthest = max(furthest, int(tag.end))
            self.ends.append(furthest)

    def within(self, start: i64, end: i64) -> list[Tag]:
        """Return the tags that have a bit from ``start`` up to, but not including, ``end``."""
        low = bisect_right(self.ends, start)
        high = bisect_left(self.starts, end)
        return [tag for tag in self.tags[low:high] if tag.end > start]


def _place(tag: Tag) -> tuple[int, int, str]:
    return int(tag.start), -int(tag.end), tag.name


class TagIndex:
    """Finds the tags of an address."""

    def __init__(self, tags: list[Tag]) -> None:
        rooms: dict[int, list[Tag]] = {}
        for tag in tags:
            rooms.setdefault(_key(tag.area, tag.db), []).append(tag)
        self._rooms: dict[int, _Room] = {key: _Room(row) for key, row in rooms.items()}
        self._covers: dict[tuple[int, int, int], Cover | None] = {}

    def cover(self, area: i64, db: i64, start: i64, bits: i64) -> Cover | None:
        """Return the tags of ``bits`` bits from bit ``start`` on (`Tag.start`), None if there are none."""
        key = (int(_key(area, db)), int(start), int(bits))
        if key in self._covers:
            return self._covers[key]
        if len(self._covers) >= MAX_CACHED:
            self._covers.clear()
        room = self._rooms.get(key[0])
        found = _cover(room.within(start, start + bits), start, bits) if room is not None else None
        self._covers[key] = found
        return found


def _key(area: i64, db: i64) -> i64:
    # The block number of an item is only valid in areas of blocks; instance blocks (DI) are the same blocks.
    return (DB << 16) | db if area in DB_AREAS else area


def _cover(tags: list[Tag], start: i64, bits: i64) -> Cover | None:
    if not tags:
        return None
    cover = Cover()
    taken = bytearray((bits + 7) // 8)
    for tag in tags:
        for part in _parts(tag, start, bits):
            if len(cover.parts) >= MAX_PARTS:
                cover.more += 1
                continue
            cover.parts.append(part)
            _take(taken, part.bit, part.bits)
    size: i64 = len(taken)
    if bits % 8 == 0:
        at: i64 = 0
        while at < size:
            if taken[at] == 0:
                begin = at
                while at < size and taken[at] == 0:
                    at += 1
                cover.free.append((int(begin), int(at - begin)))
            else:
                if taken[at] != 0xFF:
                    cover.masks.append((int(at), 0xFF & ~int(taken[at])))
                at += 1
    return cover if cover.parts else None


def _take(taken: bytearray, bit: i64, bits: i64) -> None:
    end: i64 = bit + bits
    while bit < end:
        if bit % 8 == 0 and end - bit >= 8:
            taken[bit // 8] = 0xFF
            bit += 8
        else:
            taken[bit // 8] |= 1 << (bit % 8)
            bit += 1


def _parts(tag: Tag, start: i64, bits: i64) -> list[TagPart]:
    """Return the parts of a tag that ``bits`` bits from ``start`` on cover: elements, and pieces of elements at both ends."""
    end: i64 = start + bits
    begin: i64 = tag.start
    step: i64 = tag.step
    size: i64 = tag.size
    parts: list[TagPart] = []
    first: i64 = 0
    if start > begin:
        first = (start - begin) // step
        if start > begin + first * step:  # inside an element, or in the padding after it
            at: i64 = begin + first * step
            if start < at + size:
                stop: i64 = min(end, at + size)
                parts.append(TagPart(tag, first, 1, 0, stop - start, start - at, False))
            first += 1
    last: i64 = min(tag.count, (end - begin - size) // step + 1) if end >= begin + size else 0
    if last > first:
        place: i64 = begin + first * step
        parts.append(TagPart(tag, first, last - first, place - start, (last - first - 1) * step + size, 0, True))
        first = last
    if first < tag.count:
        at = begin + first * step
        if start <= at < end:
            parts.append(TagPart(tag, first, 1, at - start, min(end, at + size) - at, 0, False))
    return parts


__all__ = ["MAX_CACHED", "NUMBERED_BITS", "Cover", "TagIndex", "TagPart"]
