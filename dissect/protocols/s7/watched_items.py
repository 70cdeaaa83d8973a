"""Variables of test functions (monitor, modify, force) as items of six octets each (reference section 4.8)."""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.protocols.s7.address import address_text
from dissect.protocols.s7.items import Item
from dissect.protocols.s7.tables import BIT, ELEMENT_OCTETS
from dissect.wire.octets import u16

#: Size of an address: area and width, repetition count or bit number, DB, octet.
ADDRESS_SIZE: Final = 6

#: Areas of `dissect.protocols.s7.tables.AREAS` by the high nibble of a test function's area.
_AREAS: Final[dict[int, int]] = {0x0: 0x83, 0x1: 0x81, 0x2: 0x82, 0x3: 0x80, 0x7: 0x84}
#: Transport sizes of request items by the low nibble: bit, octet, word, double word.
_WIDTHS: Final[dict[int, int]] = {0: 0x01, 1: 0x02, 2: 0x04, 3: 0x06}
#: Timers and counters: (the letter of the address, area, transport size).
_NUMBERED: Final[dict[int, tuple[str, int, int]]] = {0x54: ("T", 0x1D, 0x1D), 0x64: ("C", 0x1C, 0x1C)}
_PERIPHERAL: Final = 0x3


def parse_test_item(octets: bytes, offset: i64) -> Item:
    """Read the address of a variable (`ADDRESS_SIZE` octets). Its ``syntax_id`` is -1, because it is not an item of a job.

    Never raises.
    """
    item = Item(octets, offset)
    item.syntax_id = -1
    area: i64 = octets[0]
    number: i64 = octets[1]
    place: i64 = u16(octets, 4)
    item.count = number
    numbered = _NUMBERED.get(area)
    if numbered is not None:
        letter, item.area, item.transport_size = numbered
        item.start_bit = place
        item.address = f"{letter}{place}"
    else:
        known = _AREAS.get(area >> 4)
        width = _WIDTHS.get(area & 0x0F)
        if known is None or width is None:
            item.address = f"area 0x{area:02x}, byte {place}"
            return item
        item.area = known
        item.transport_size = width
        item.start_bit = 8 * place
        if width == BIT:
            item.count = 1
            item.start_bit += number
        item.db = u16(octets, 2)
        text = address_text(known, item.db, item.start_bit, width)
        item.address = f"PI{text[1:]}" if area >> 4 == _PERIPHERAL else text
    item.count = max(item.count, 1)
    item.size = ELEMENT_OCTETS[item.transport_size] * item.count
    return item


def parse_test_items(octets: bytes) -> list[Item]:
    """Read the data block of a request: the number of variables and their addresses, as far as they are present."""
    if len(octets) < 2:
        return []
    count: i64 = u16(octets, 0)
    items: list[Item] = []
    for number in range(count):
        at: i64 = 2 + ADDRESS_SIZE * number
        if at + ADDRESS_SIZE > len(octets):
            break
        items.append(parse_test_item(octets[at : at + ADDRESS_SIZE], at))
    return items
