"""`TagNaming`: gives outputs the values of an item by tag (the interface is in `dissect.engine.transactions.naming`)."""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.naming import NamedValue, Naming
from dissect.meaning.tags.index import Cover, TagIndex, TagPart
from dissect.meaning.tags.model import NUMBERED_BITS, Tag, place_text
from dissect.meaning.tags.values import decode_part
from dissect.protocols.s7.items import Item, ItemResult
from dissect.protocols.s7.tables import BIT, NUMBERED_AREAS
from dissect.protocols.s7plus.program import Program
from dissect.wire.copies import leaves

#: The values of this many items are remembered with their octets: a polled value rarely changes, and need not be decoded again.
_MAX_REMEMBERED: Final = 4096


class TagNaming(Naming):
    """Names values by tags, the same for every CPU."""

    def __init__(self, tags: list[Tag], programs: dict[str, Program] | None) -> None:
        self.tags: list[Tag] = tags
        self.index: TagIndex = TagIndex(tags)
        self._programs: dict[str, Program] = programs if programs is not None else {}
        self._remembered: dict[tuple[bytes, bytes], list[NamedValue]] = {}

    def program(self, host: str) -> Program | None:
        """Return the variables of a CPU that a capture among the files declares, None for none."""
        return self._programs.get(host)

    def cover(self, item: Item, size: i64) -> Cover | None:
        """Return the tags of the first ``size`` octets of an item, None if there are none."""
        area: i64 = item.area
        if area < 0 or size == 0:
            return None
        if area in NUMBERED_AREAS:
            return self.index.cover(area, 0, item.start_bit * NUMBERED_BITS, 8 * size)
        if item.transport_size == BIT:
            return self.index.cover(area, item.db, item.start_bit, 1) if size == 1 else None
        if item.start_bit % 8:
            return None
        return self.index.cover(area, item.db, item.start_bit, 8 * size)

    def asked(self, item: Item) -> Cover | None:
        """Return the tags of an item without data, by the size that it requests."""
        return self.cover(item, item.size) if item.size > 0 else None

    def named(self, result: ItemResult) -> list[NamedValue]:
        """Return the values of an item by tag, and the octets between tags, in their order; empty if no tag is covered."""
        item = result.item
        if item is None:
            return []
        data = result.data
        if data is None or not item.fits(len(data)):
            cover = self.asked(item)
            return [_silent(part) for part in cover.parts] if cover is not None else []
        key = (item.octets, data)
        known = self._remembered.get(key)
        if known is not None:
            return known
        cover = self.cover(item, len(data))
        found = _values(cover, item, data) if cover is not None else []
        if len(self._remembered) >= _MAX_REMEMBERED:
            self._remembered.clear()
        self._remembered[key] = found
        return found


class HostNaming(Naming):
    """Names values with different tags for each host; ``rest`` are the tags for all other hosts, None for none."""

    def __init__(self, hosts: dict[str, TagNaming], rest: TagNaming | None) -> None:
        self._hosts: dict[str, TagNaming] = hosts
        self._rest: TagNaming | None = rest

    @property
    def all(self) -> list[TagNaming]:
        """The tags of each host, then those for all others."""
        return [*self._hosts.values(), *([self._rest] if self._rest is not None else [])]

    def of(self, connection: Connection) -> Naming | None:
        """Return the tags of the CPU of a connection: those of the server's host, else of the client's, else the rest."""
        for end in (connection.server, connection.client):
            found = self._hosts.get(end.host)
            if found is not None:
                return found
        return self._rest


def _values(cover: Cover, item: Item, data: bytes) -> list[NamedValue]:
    found = [_value(part, data) for part in cover.parts]
    base: i64 = item.start_bit * NUMBERED_BITS if item.area in NUMBERED_AREAS else item.start_bit
    for at, count in cover.free:
        found.append(_free(item, base, at, data[at : at + count]))
    for at, mask in cover.masks:
        if data[at] & mask:
            rest = _free(item, base, at, bytes([data[at] & mask]))
            rest.remark = "bits beside the tags"
            found.append(rest)
    if cover.free or cover.masks:
        found.sort(key=_order)
    if cover.more:
        found[-1].remark = f"and {cover.more} tags more"
    return found


def _order(value: NamedValue) -> int:
    return int(value.offset)


def _free(item: Item, base: i64, at: i64, octets: bytes) -> NamedValue:
    value = NamedValue("", place_text(item.area, item.db, base + 8 * at, 8), "")
    value.offset = at
    value.data = octets
    value.whole = False
    return value


def part_name(part: TagPart) -> str:
    """Return the name of a part: ``Tank.Level``, ``a[3]``, ``a[3..5]``."""
    tag = part.tag
    if not tag.dims or (part.all and not tag.prefix):
        return tag.name
    if part.count == 1:
        return tag.element(part.first)
    last: i64 = part.first + part.count - 1
    return f"{tag.name}[{tag.prefix}{tag.index(part.first)}..{tag.index(last)}]"


def _silent(part: TagPart) -> NamedValue:
    """Return a part without a value, for an item that was refused, not answered or only requested."""
    tag = part.tag
    if not part.name:
        start: i64 = tag.start + part.first * tag.step + part.piece
        bits: i64 = tag.size if part.whole else min(part.bits, 8)
        part.name = part_name(part)
        part.address = tag.address if part.all else place_text(tag.area, tag.db, start, bits)
        part.type = _type(part)
    value = NamedValue(part.name, part.address, part.type)
    value.offset = part.bit // 8
    value.unit = tag.unit
    value.comment = tag.comment
    value.whole = part.whole
    value.remark = tag.remark
    return value


def _type(part: TagPart) -> str:
    tag = part.tag
    if not tag.dims or part.count == 1:
        return tag.type
    return tag.declared if part.all else f"{part.count} x {tag.type}"


def _value(part: TagPart, data: bytes) -> NamedValue:
    """Return a part with its value, or with its octets if they have no value."""
    value = _silent(part)
    tag = part.tag
    if not part.whole:
        return _piece(value, part, data)
    value.value, value.raw = decode_part(part, data)
    begin: i64 = part.bit // 8
    value.data = data[begin : begin + (part.bits + 7) // 8]
    if value.value is None and tag.kind != "OCTETS":
        value.remark = f"no valid {tag.type}"
    return value


def _piece(value: NamedValue, part: TagPart, data: bytes) -> NamedValue:
    """Name a piece of an element: one bit of it by its number, else its octets."""
    tag = part.tag
    begin: i64 = part.bit // 8
    octets = data[begin : begin + (part.bits + 7) // 8]
    value.data = octets
    size: i64 = tag.size // 8
    at: i64 = part.piece // 8
    if part.bits == 1 and size <= 8:
        # Bit 0 is the lowest bit of the last octet.
        number: i64 = 8 * (size - 1 - at) + part.piece % 8
        value.name += f".%X{number}"
        value.type = "BOOL"
        value.value = octets[0] & 1 == 1
        value.raw = value.value
        value.unit = ""
        value.remark = f"bit {number} of {tag.type}"
        return value
    last: i64 = at + len(octets) - 1
    which = f"byte {at}" if last == at else f"bytes {at} to {last}"
    value.remark = f"{which} of {size}"
    return value


leaves(TagNaming, without=("_remembered", "index"))
leaves(HostNaming)
