"""Items: the request items of a Read Var or Write Var, the data items of its answer, and both joined.

Reference section 3.5.
"""

from __future__ import annotations

import struct
from typing import Final

from librt.strings import BytesWriter, read_i32_be, read_i64_be, write_i64_be
from mypy_extensions import i64

from dissect.protocols.s7.address import address_text
from dissect.protocols.s7.syntaxes import DB_AREA, DB_READ, DB_READ_ITEM, item_text
from dissect.protocols.s7.tables import (
    ANSWER_TRANSPORT_SIZE,
    BIT,
    BYTE,
    DB,
    ELEMENT_OCTETS,
    LENGTH_IN_BITS,
    OCTET_STRING,
    RECORD_AREA,
    S7ANY,
    SUCCESS,
)
from dissect.protocols.s7.values import Value, decode_value
from dissect.wire.copies import leaves
from dissect.wire.malformed import Malformed
from dissect.wire.octets import u16, u24, u32

SPECIFICATION: Final = 0x12
DATA_HEAD: Final = 4
S7ANY_SIZE: Final = 12
#: The parts of `item_heads`: the size of the data block; then for each item its place and its first octets.
_SIZE: Final = struct.Struct(">q")
_PLACED: Final = struct.Struct(">II")
#: Number of octets of a data item that its `repr` shows.
_SHOWN: Final = 16

#: Kinds of areas that a write goes to, as bits: outputs and peripherals, where it has an immediate effect, and all others.
WRITTEN_IO: Final = 1
WRITTEN_ELSEWHERE: Final = 2
_IO_AREAS: Final = frozenset((0x80, 0x82))

#: Transport sizes whose length field counts bits, as a bit mask, because every item needs this check; all are below `_CODED`.
_CODED: Final = 32
_IN_BITS: Final[i64] = sum([1 << code for code in LENGTH_IN_BITS if code < _CODED])
_DINTEGER: Final = 0x06


class Item:
    """A request item.

    ``offset`` is within the parameter block of the PDU; ``octets`` are the whole item, head included. The fields from
    ``transport_size`` to ``start_bit`` are set for S7ANY; for all other syntaxes they are -1, and `address` names the syntax.
    ``size`` is the number of octets in a good answer, -1 if it is unknown (a data record may be shorter than requested, and
    devices pack several bits in different ways). ``areas`` are the areas of data blocks that a DBREAD item requests, each as an
    `Item`; None for other items.
    """

    __slots__ = (
        "_address",
        "area",
        "areas",
        "cell",
        "count",
        "db",
        "fragment",
        "head",
        "line",
        "octets",
        "offset",
        "shown",
        "size",
        "start_bit",
        "syntax_id",
        "transport_size",
    )

    def __init__(self, octets: bytes, offset: i64) -> None:
        self.octets: bytes = octets
        self.offset: i64 = offset
        self.syntax_id: i64 = octets[2] if len(octets) > 2 else -1
        self.transport_size: i64 = -1
        self.count: i64 = -1
        self.db: i64 = -1
        self.area: i64 = -1
        self.start_bit: i64 = -1
        self.size: i64 = -1
        self.areas: list[Item] | None = None
        self._address: str = ""  # made at the first access
        # Cached texts for reports, because polling repeats the same items for hours.
        self.fragment: str = ""  # for JSON
        self.head: bytes = b""  # the same, where lines are built as bytes
        self.cell: bytes = b""  # for CSV: the cells from the address to the value, for an item without an error
        self.shown: str = ""  # for a person
        self.line: bytes = b""  # the same for lines that are built as bytes, up to the value

    @property
    def address(self) -> str:
        """The address as people write it, for example ``DB10.DBW4``."""
        if not self._address:
            if self.transport_size >= 0:
                self._address = address_text(self.area, self.db, self.start_bit, self.transport_size)
            else:
                self._address = item_text(self.octets)
        return self._address

    @address.setter
    def address(self, address: str) -> None:
        """Give the item an address that does not follow from its fields."""
        self._address = address

    def fits(self, size: i64) -> bool:
        """Return whether ``size`` octets match what the item requests, so that they can be decoded.

        If the item's own ``size`` is unknown, any number of octets matches, except for several bits that share octets, whose
        order is unknown.
        """
        if self.size >= 0:
            return self.size == size
        return self.transport_size != BIT or self.area == RECORD_AREA or self.count == size

    @property
    def label(self) -> str:
        """The address, with the count unless it is 1, for example ``DB10.DBW4 x3``. Text from the wire is not escaped."""
        return f"{self.address} x{self.count}" if self.count >= 0 and self.count != 1 else self.address

    def __repr__(self) -> str:
        return f"Item({self.address!r}, count={self.count})"


def parse_item(octets: bytes, offset: i64) -> Item:
    """Read one request item, head included (``octets``: at least 3). Never raises."""
    item = Item(octets, offset)
    if item.syntax_id == S7ANY and len(octets) == S7ANY_SIZE:
        item.transport_size = octets[3]
        item.count = u16(octets, 4)
        item.db = u16(octets, 6)
        item.area = octets[8]
        item.start_bit = u24(octets, 9)
        element: i64 = ELEMENT_OCTETS.get(item.transport_size, -1)
        if element > 0 and item.area != RECORD_AREA and not (item.transport_size == BIT and item.count != 1):
            item.size = element * item.count
    elif item.syntax_id == DB_READ:
        item.areas = _areas(octets, offset)
    return item


def _areas(octets: bytes, offset: i64) -> list[Item] | None:
    """Return the areas of a DBREAD item; None if its length does not match their count (reference 3.5)."""
    first: i64 = DB_READ_ITEM.size
    step: i64 = DB_AREA.size
    size: i64 = len(octets)
    if size <= first or size != first + octets[first - 1] * step:
        return None
    areas: list[Item] = []
    for at in range(first, size, step):
        area = Item(octets[at : at + step], offset + at)
        area.syntax_id = DB_READ
        area.transport_size = BYTE
        area.count = octets[at]
        area.size = area.count
        area.area = DB
        area.db = u16(octets, at + 1)
        area.start_bit = 8 * u16(octets, at + 3)
        areas.append(area)
    return areas


def walk_areas(areas: list[Item], octets: bytes) -> list[DataItem]:
    """Parse the answer to a DBREAD item into its areas: for each a return code, with octets if it is success (3.5).

    Return an empty list unless the areas fill ``octets`` exactly: otherwise none of them can be trusted.
    """
    found: list[DataItem] = []
    at: i64 = 0
    end: i64 = len(octets)
    for area in areas:
        if at >= end:
            return []
        code: i64 = octets[at]
        size: i64 = area.size if code == SUCCESS else 0
        if at + 1 + size > end:
            return []
        found.append(DataItem(code, OCTET_STRING, size, octets[at + 1 : at + 1 + size], at))
        at += 1 + size
    return found if at == end else []


def written_areas(items: list[Item]) -> i64:
    """Return the kinds of areas that a write of these items goes to (`WRITTEN_IO` | `WRITTEN_ELSEWHERE`)."""
    areas: i64 = 0
    for item in items:
        areas |= written_area(item.area)
    return areas


def written_area(area: i64) -> i64:
    """Return the kind of an area that a write goes to."""
    if area in _IO_AREAS:
        return WRITTEN_IO
    return WRITTEN_ELSEWHERE


def parse_items(octets: bytes, at: i64, end: i64, count: i64, malformed: list[Malformed]) -> list[Item]:
    """Read up to ``count`` request items from ``octets[at:end]``; note faults in ``malformed``."""
    items: list[Item] = []
    for number in range(count):
        if at + 3 > end:
            malformed.append(Malformed("s7", "count_mismatch", "item_count", 1, count, number, "param"))
            return items
        size: i64 = octets[at + 1] + 2
        if size < 3:
            malformed.append(Malformed("s7", "length_below", "item.length", at, 1, size - 2, "item"))
            return items
        if at + size > end:
            malformed.append(Malformed("s7", "length_beyond", "item.length", at, size, end - at, "param"))
            return items
        item = parse_item(octets[at : at + size], at)
        if octets[at] != SPECIFICATION:
            malformed.append(Malformed("s7", "bad_value", "item.specification", at, SPECIFICATION, octets[at], "item"))
        if item.syntax_id == S7ANY and size != S7ANY_SIZE:
            reason = "length_below" if size < S7ANY_SIZE else "trailing_octets"
            malformed.append(Malformed("s7", reason, "item.length", at + 1, S7ANY_SIZE - 2, size - 2, "item"))
        items.append(item)
        at += size + item_fill(size, number + 1 == count)
    if at < end:
        malformed.append(Malformed("s7", "trailing_octets", "items", at, 0, end - at, "param"))
    return items


def item_fill(size: i64, last: bool) -> i64:
    """Return the fill octets (0 or 1) after an item of ``size`` octets: an odd item is padded, unless it is the ``last``.

    The rule is the same for request items and data items (reference 3.5).
    """
    if last:
        return 0
    return size & 1


def data_size_within(transport_size: i64, length: i64, room: i64) -> i64:
    """Return the size of a data item's content; its ``length`` field counts bits for some transport sizes.

    Sources disagree whether it counts octets or bits for 0x06. So ``room``, the number of remaining octets, decides (reference
    3.6).
    """
    if transport_size < _CODED and _IN_BITS >> transport_size & 1:
        return (length + 7) >> 3
    if transport_size == _DINTEGER and length > room:
        return (length + 7) >> 3
    return length


def item_heads(count: i64, buf: bytes, at: i64, end: i64) -> bytes:
    """Return what `begin_alike` compares: the size of a sound data block; for each item its place and first four octets."""
    heads = BytesWriter()
    write_i64_be(heads, end - at)
    place: i64 = at
    for _ in range(count):
        head: i64 = u32(buf, place)
        write_i64_be(heads, (place - at) << 32 | head)
        place += 4 + data_size_within(head >> 16 & 0xFF, head & 0xFFFF, end - place - 4)
        place += place - at & 1  # the fill octet after an odd item
    return heads.getvalue()


def begin_alike(heads: bytes, buf: bytes, at: i64, end: i64) -> bool:
    """Return whether ``buf[at:end]`` is as long as the data block of ``heads`` (`item_heads`), and its items begin equally.

    Then the sizes of all items are the same as well. Return False if ``heads`` is empty.
    """
    stop: i64 = len(heads)
    if stop == 0 or read_i64_be(heads, 0) != end - at:
        return False
    index: i64 = 8
    while index < stop:
        placed: i64 = read_i64_be(heads, index)
        if i64(read_i32_be(buf, at + (placed >> 32))) & 0xFFFFFFFF != placed & 0xFFFFFFFF:
            return False
        index += 8
    return True


def answer_layout(heads: bytes) -> struct.Struct:
    """Return a struct that reads an answer similar to that of ``heads`` (`item_heads`), from the error code to the end.

    It yields the error code, function and item count, and the first four octets of each item.
    """
    (size,) = _SIZE.unpack_from(heads)
    form = ">HH"
    at = 0
    for place, _ in _PLACED.iter_unpack(heads[_SIZE.size :]):
        form += f"{place - at}xI"
        at = place + DATA_HEAD
    return struct.Struct(f"{form}{size - at}x")


class DataItem:
    """A data item: ``return_code``, the data ``transport_size``, the ``length`` field as sent, and the content, ``data``."""

    __slots__ = ("data", "length", "offset", "return_code", "transport_size")

    def __init__(self, return_code: i64, transport_size: i64, length: i64, data: bytes, offset: i64) -> None:
        self.return_code: i64 = return_code
        self.transport_size: i64 = transport_size
        self.length: i64 = length
        self.data: bytes = data
        self.offset: i64 = offset

    def __repr__(self) -> str:
        shown = self.data[:_SHOWN].hex(" ") + (" …" if len(self.data) > _SHOWN else "")
        return f"DataItem(0x{self.return_code:02x}, {len(self.data)} bytes: {shown})"


def parse_data_items(
    octets: bytes, at: i64, end: i64, count: i64, response: bool, malformed: list[Malformed]
) -> list[DataItem]:
    """Read up to ``count`` data items from ``octets[at:end]``; note faults in ``malformed``.

    In a ``response``, an item whose return code is not success has only its head of four octets, whatever its length field
    says. One octet after an odd last item is tolerated, because one client pads the last item as well (reference 3.5).
    """
    items: list[DataItem] = []
    size: i64 = 0
    for number in range(count):
        if at + DATA_HEAD > end:
            malformed.append(Malformed("s7", "count_mismatch", "data items", at, count, number, "data"))
            return items
        return_code: i64 = octets[at]
        transport_size: i64 = octets[at + 1]
        length: i64 = u16(octets, at + 2)
        body: i64 = at + DATA_HEAD
        refused: bool = response and return_code != SUCCESS
        size = 0 if refused else data_size_within(transport_size, length, end - body)
        if body + size > end:
            malformed.append(Malformed("s7", "length_beyond", "data.length", at, size, end - body, "data"))
            items.append(DataItem(return_code, transport_size, length, octets[body:end], at))
            return items
        items.append(DataItem(return_code, transport_size, length, octets[body : body + size], at))
        at = body + size + item_fill(size, number + 1 == count)
    if at < end and not (end - at == 1 and size & 1):
        malformed.append(Malformed("s7", "trailing_octets", "data items", at, 0, end - at, "data"))
    return items


def without_fill(items: list[Item], octets: bytes, at: i64, end: i64) -> i64:
    """Return the index of the first data item of a write that begins one octet early; 0 if this is not the fault.

    A data item of odd length takes a fill octet, unless it is the last. A client that omits it writes a data block that
    contradicts itself, but is sound if the missing fill octets are not expected.
    """
    first: i64 = 0
    size: i64 = 0
    for index in range(len(items)):
        if size & 1:
            if _begins(items[index], octets, at + 1, end):
                at += 1
            elif first == 0:
                first = index
        if not _begins(items[index], octets, at, end):
            return 0
        size = data_size_within(octets[at + 1], u16(octets, at + 2), end - at - DATA_HEAD)
        at += DATA_HEAD + size
    return first if at == end or (at + 1 == end and size & 1) else 0


def _begins(item: Item, octets: bytes, at: i64, end: i64) -> bool:
    """Return whether the data of a written item begin at ``at``: a head without a return code, and the size of the item."""
    if at + DATA_HEAD > end or octets[at]:
        return False
    size: i64 = data_size_within(octets[at + 1], u16(octets, at + 2), end - at - DATA_HEAD)
    return at + DATA_HEAD + size <= end and (size == item.size or (item.size < 0 < size))


def fitting(items: list[Item], found: list[DataItem]) -> list[DataItem]:
    """Return the data items of a block that contradicts itself, up to the first one that does not match its item."""
    sound: list[DataItem] = []
    for index in range(min(len(items), len(found))):
        if found[index].return_code or not items[index].fits(len(found[index].data)):
            break
        sound.append(found[index])
    return sound


class ItemResult:
    """A request item joined with its answer; either may be missing.

    ``return_code`` is -1 if there is no answer. ``data`` are the octets that were read or written, None if there are none.
    ``decodable``: ``data`` has the requested size, so ``value`` can be decoded. ``unchanged``: a push states that the value is
    the same as in the previous push.
    """

    __slots__ = ("answer", "data", "item", "return_code", "unchanged")

    def __init__(self, item: Item | None, return_code: i64, data: bytes | None, answer: DataItem | None) -> None:
        self.item: Item | None = item
        self.return_code: i64 = return_code
        self.data: bytes | None = data
        self.answer: DataItem | None = answer
        self.unchanged: bool = False

    def __repr__(self) -> str:
        return f"ItemResult({self.item!r}, {self.return_code}, {self.data!r})"

    @property
    def refused(self) -> bool:
        """True if there is an answer and its code is not success."""
        return self.return_code != -1 and self.return_code != SUCCESS and not self.unchanged

    @property
    def decodable(self) -> bool:
        """True if the size of ``data`` fits the item (`Item.fits`)."""
        item = self.item
        data = self.data
        return item is not None and data is not None and item.fits(len(data))

    @property
    def value(self) -> Value:
        """The decoded value, None if there is none (see `decode_value`)."""
        item = self.item
        data = self.data
        if item is None or data is None or not self.decodable:
            return None
        return decode_value(item.transport_size, data)


def read_results(items: list[Item], answers: list[DataItem]) -> list[ItemResult]:
    """Join the items of a read with the data items of its answer; a DBREAD item gives one result for each of its areas."""
    results: list[ItemResult] = []
    for index in range(max(len(items), len(answers))):
        item = items[index] if index < len(items) else None
        answer = answers[index] if index < len(answers) else None
        if item is not None and item.areas is not None:
            results.extend(area_results(item, answer))
        elif answer is None:
            results.append(ItemResult(item, -1, None, None))
        else:
            results.append(_result(item, answer))
    return results


def _result(item: Item | None, answer: DataItem) -> ItemResult:
    return ItemResult(item, answer.return_code, answer.data if answer.return_code == SUCCESS else None, answer)


def area_results(item: Item, answer: DataItem | None) -> list[ItemResult]:
    """Return one result for each area of a DBREAD item; only one if it was refused or its answer does not match."""
    areas = item.areas
    if areas is None:
        return [_result(item, answer)] if answer is not None else [ItemResult(item, -1, None, None)]
    if answer is None:
        return [ItemResult(area, -1, None, None) for area in areas]
    told = walk_areas(areas, answer.data) if answer.return_code == SUCCESS else []
    if not told:
        return [_result(item, answer)]
    return [_result(area, told[index]) for index, area in enumerate(areas)]


def write_results(items: list[Item], written: list[DataItem], codes: list[int]) -> list[ItemResult]:
    """Join the items of a write with their values and the return codes of its answer."""
    results: list[ItemResult] = []
    for index in range(max(len(items), len(codes))):
        item = items[index] if index < len(items) else None
        data_item = written[index] if index < len(written) else None
        code = codes[index] if index < len(codes) else -1
        results.append(ItemResult(item, code, data_item.data if data_item is not None else None, data_item))
    return results


def odd_data_code(item: Item, answer: DataItem) -> bool:
    """Return whether a good data item has a transport size that CPUs never use for its request item (reference 3.5)."""
    if item.syntax_id != S7ANY or item.area == RECORD_AREA:
        return False
    expected: int = ANSWER_TRANSPORT_SIZE.get(item.transport_size, -1)
    return expected >= 0 and expected != answer.transport_size


leaves(Item, DataItem, ItemResult)
