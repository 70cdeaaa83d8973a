"""The things whose values a user wants to see: a place in a CPU with a type, or a name."""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.meaning.tags.index import TagPart
from dissect.meaning.tags.model import NUMBERED_BITS, UNLETTERED, Tag, place_text
from dissect.meaning.tags.naming import TagNaming, part_name
from dissect.meaning.tags.values import decode_part
from dissect.output.variables.model import Variable
from dissect.protocols.s7.tables import BYTE, DB_AREAS, TRANSPORT_SIZES
from dissect.protocols.s7.values import decode_value

#: The types of places of unknown type that are shown as a number, by their bits.
_NUMBERS: Final[dict[int, str]] = {8: "BYTE", 16: "WORD", 32: "DWORD", 64: "LWORD"}
#: The areas of timers and counters; the transport size of their values has the same number as the area.
_COUNTING: Final = frozenset((0x1C, 0x1D))


def place_key(area: i64, db: i64) -> i64:
    """Return a number for an area, or for a block in one."""
    return (area << 16) | db if area in DB_AREAS else area << 16


class Wanted:
    """Something wanted: ``bits`` bits from bit ``start`` of a place (`dissect.meaning.tags.model.Tag.start`), or a ``word``.

    ``part`` says how the place is decoded, None if its type is unknown. ``naming`` are the tags of its CPUs, None for every
    CPU. ``word``, in lower case, is the address or name of a value that has no place in memory (S7comm-plus, SCD).
    """

    __slots__ = ("area", "bits", "db", "naming", "part", "start", "text", "word")

    def __init__(self, text: str, area: i64 = -1, db: i64 = 0, start: i64 = 0, bits: i64 = 0) -> None:
        self.text: str = text
        self.word: str = text.lower()
        self.area: i64 = area
        self.db: i64 = db
        self.start: i64 = start
        self.bits: i64 = bits
        self.part: TagPart | None = None
        self.naming: TagNaming | None = None

    @property
    def end(self) -> i64:
        """The first bit after the place."""
        return self.start + self.bits

    @property
    def address(self) -> str:
        """The address in STEP 7's form."""
        return place_text(self.area, self.db, self.start, self.bits)

    def __repr__(self) -> str:
        return f"Wanted({self.text!r})"


def of_tag(text: str, tag: Tag, naming: TagNaming | None) -> Wanted:
    """Return a tag as a `Wanted`."""
    wanted = Wanted(text, tag.area, tag.db, tag.start, tag.end - tag.start)
    wanted.part = whole(tag)
    wanted.naming = naming
    return wanted


def whole(tag: Tag) -> TagPart:
    """Return the whole of a tag as a part; its first bit counts from the octet in which it begins."""
    bits: i64 = tag.end - tag.start
    return TagPart(tag, 0, tag.count, tag.start % 8, bits, 0, True)


class Image:
    """The octets of a wanted place of one CPU, put together from all items that touch it.

    ``octets`` begin with the octet in which the place begins; ``missing`` counts bits of the place that were never seen.
    """

    __slots__ = ("known", "missing", "octets", "part", "size", "transport_size", "variable", "wanted")

    def __init__(self, wanted: Wanted, naming: TagNaming | None) -> None:
        self.wanted: Wanted = wanted
        first: i64 = wanted.start // 8
        self.octets: bytearray = bytearray((wanted.end + 7) // 8 - first)
        self.known: bytearray = bytearray(len(self.octets))
        self.missing: i64 = wanted.bits
        self.variable: Variable | None = None
        self.transport_size: i64 = -1
        self.part: TagPart | None = wanted.part
        if self.part is None and naming is not None:
            self.part = _tag_at(wanted, naming)
        if self.part is None and wanted.bits > 1 and (wanted.start % 8 or wanted.bits % 8):
            self.part = whole(_truths(wanted))
        if self.part is None and wanted.area in _COUNTING and wanted.bits == NUMBERED_BITS:
            self.transport_size = wanted.area  # for timers and counters, both have the same number

    def copy(self) -> Image:
        """Return an image that may take uncertain octets, and leaves this one unchanged."""
        made = Image(self.wanted, None)
        made.octets = bytearray(self.octets)
        made.known = bytearray(self.known)
        made.missing = self.missing
        made.variable = self.variable
        made.transport_size = self.transport_size
        made.part = self.part
        return made

    def take(self, data: bytes, start: i64, bits: i64) -> bool:
        """Take octets that begin at bit ``start``; return whether they cover the whole place."""
        wanted = self.wanted
        begin: i64 = max(start, wanted.start)
        end: i64 = min(start + bits, wanted.end)
        base: i64 = wanted.start - wanted.start % 8
        if begin % 8 == 0 and end % 8 == 0:
            at: i64 = (begin - start) // 8
            first: i64 = (begin - base) // 8
            last: i64 = (end - base) // 8
            self.octets[first:last] = data[at : at + last - first]
            if self.missing:
                for index in range(first, last):
                    self._know(index, 0xFF)
        else:
            bit: i64 = begin
            while bit < end:
                # An item of one bit has it in the lowest bit of its octet.
                told: i64 = data[0] & 1 if bits == 1 else (data[(bit - start) // 8] >> ((bit - start) % 8)) & 1
                index = (bit - base) // 8
                mask: i64 = 1 << (bit % 8)
                self.octets[index] = (self.octets[index] & ~mask) | (mask if told else 0)
                self._know(index, mask)
                bit += 1
        return end - begin == wanted.bits

    def _know(self, index: i64, mask: i64) -> None:
        fresh: i64 = mask & ~self.known[index]
        self.known[index] |= mask
        while fresh:
            self.missing -= fresh & 1
            fresh >>= 1

    def data(self) -> bytes:
        """Return the octets of the place; for a single bit, an octet with the value of the bit."""
        if self.wanted.bits == 1:
            return bytes([(self.octets[0] >> (self.wanted.start % 8)) & 1])
        return bytes(self.octets)

    def value(self, data: bytes) -> object:
        """Return the value of ``data``, octets that `data` returned."""
        part = self.part
        if self.wanted.bits == 1:
            return data[0] == 1
        if part is not None:
            return decode_part(part, data)[0]
        if self.transport_size >= 0:
            return decode_value(self.transport_size, data)
        return int.from_bytes(data, "big") if self.wanted.bits in _NUMBERS else list(data)

    @property
    def bytes_only(self) -> bool:
        """Whether the octets have no known meaning and are shown as bytes."""
        bits: i64 = self.wanted.bits
        if self.part is not None or bits == 1:
            return False
        return self.transport_size == BYTE and bits > 8 if self.transport_size >= 0 else bits not in _NUMBERS

    def names(self, typed: str) -> tuple[str, str, str, str]:
        """Return address, type, tag and unit; ``typed`` is the type of an item that had exactly this place, else empty."""
        wanted = self.wanted
        part = self.part
        if part is None:
            bits: i64 = wanted.bits
            if bits == 1:
                return wanted.address, "BOOL", "", ""
            if self.bytes_only and typed:  # the form of an item in other outputs: MB8, 4 x BYTE
                return place_text(wanted.area, wanted.db, wanted.start, 8), typed, "", ""
            if not typed and self.transport_size >= 0:
                typed = TRANSPORT_SIZES.name(self.transport_size)
            return wanted.address, typed or _NUMBERS.get(bits, f"{bits // 8} x BYTE"), "", ""
        tag = part.tag
        address = place_text(wanted.area, wanted.db, wanted.start, 8 if tag.kind in UNLETTERED else tag.size)
        name = part_name(part) if tag.name else ""
        typename = tag.declared if part.all else tag.type if part.count == 1 else f"{part.count} x {tag.type}"
        return address, typename, name, tag.unit


def _truths(wanted: Wanted) -> Tag:
    """Return a tag without a name for several bits that are no whole octets: a truth value for each."""
    tag = Tag("", wanted.area, wanted.db, wanted.start, "BOOL", "BOOL", 1)
    tag.count = wanted.bits
    tag.dims = [(0, int(wanted.bits) - 1)]
    return tag


def _tag_at(wanted: Wanted, naming: TagNaming) -> TagPart | None:
    """Return the tag, or the element of a tag, that is exactly the wanted place; None if there is none."""
    cover = naming.index.cover(wanted.area, wanted.db, wanted.start, wanted.bits)
    if cover is None:
        return None
    for part in cover.parts:
        if part.whole and part.bit == 0 and part.bits == wanted.bits:
            return TagPart(part.tag, part.first, part.count, wanted.start % 8, part.bits, 0, True)
    return None


class WantedSet:
    """Everything that is wanted, found by place or by name."""

    def __init__(self, wanted: list[Wanted]) -> None:
        self.all: list[Wanted] = wanted
        self.words: dict[str, Wanted] = {one.word: one for one in wanted}
        self._places: dict[int, list[Wanted]] = {}
        for one in wanted:
            if one.area >= 0:
                self._places.setdefault(int(place_key(one.area, one.db)), []).append(one)

    def touched(self, area: i64, db: i64, start: i64, bits: i64, naming: TagNaming | None) -> list[Wanted]:
        """Return the wanted places that have a bit in common with ``bits`` bits from bit ``start`` on."""
        rows = self._places.get(int(place_key(area, db)))
        if rows is None:
            return []
        end: i64 = start + bits
        found = [
            one for one in rows if one.start < end and start < one.end and (one.naming is None or one.naming is naming)
        ]
        found.sort(key=_start)
        return found


def _start(wanted: Wanted) -> int:
    return wanted.start
