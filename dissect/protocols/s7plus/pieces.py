"""Pieces that several bodies have in common: ids, counts, addresses, numbered values and refusals, the qualifier."""

from __future__ import annotations

from typing import Final

from dissect.protocols.s7plus import layouts
from dissect.protocols.s7plus.contents import Contents, VariableAddress, known_address
from dissect.protocols.s7plus.cursor import is_wanted, passed
from dissect.protocols.s7plus.ids import AREAS, BLOCK_KINDS, id_name
from dissect.protocols.s7plus.objects import Element, objects_of, read_into
from dissect.protocols.s7plus.return_tables import GENERIC_CODES, ORIGINS, RETURN_CODES
from dissect.protocols.s7plus.tables import V3
from dissect.protocols.s7plus.value_reading import read_members, read_value
from dissect.protocols.s7plus.walk import STEP, FormatError, Walk, Wanted
from dissect.wire.codes import coded
from dissect.wire.layout import Layout
from dissect.wire.varint import VLQ, VLQ64

_QUALIFIER: Final = b"\x00\x00\x04\xe8"
#: The qualifier of all captures, with its three members, and the work that reading these costs.
USUAL_QUALIFIER: Final = _QUALIFIER + bytes.fromhex("896900120000000089 6a001300 896b000400 00")
_COST: Final = 3 * STEP


def take_return_value(walk: Walk) -> int:
    """Read a return value of 64 bits. Raises `FormatError`."""
    at = walk.at
    value = walk.number(VLQ64, "return value")
    walk.part(layouts.RETURN_VALUE, at, return_details(value) if walk.shown else "")
    return value


def return_note(value: int) -> str:
    """Return a short text for a return value."""
    return coded(f"0x{value:x}", RETURN_CODES.name(value & 0xFFFF)) if value else "0 OK"


def return_details(value: int) -> str:
    """Return a text for all parts of a return value: error, generic error, origin within the firmware, and the rest."""
    if value < 1 << 16:
        return return_note(value)
    said = [return_note(value)]
    generic, origin, line = value >> 40 & 0x7F, value >> 32 & 0xFF, value >> 16 & 0xFFFF
    if generic:
        said.append(GENERIC_CODES.name(generic))
    said.append(f"from {ORIGINS.name(origin)}, line {line}")
    if value >> 62 & 1:
        said.append("details follow")
    return "; ".join(said)


def take_object_id(walk: Walk, found: Contents) -> None:
    """Read the id of the object of a request. Raises `FormatError`."""
    at = walk.at
    found.object_id = walk.fixed(4, "object id")
    walk.part(layouts.OBJECT_ID, at, id_name(found.object_id) if walk.shown else "")


def take_reserved(walk: Walk, size: int) -> None:
    """Read octets without a known meaning. Raises `FormatError`."""
    at = walk.at
    walk.take(size, "reserved")
    walk.part(layouts.RESERVED, at)


def take_qualifier(walk: Walk) -> None:
    """Read the qualifier, which is the same in all captures. Raises `FormatError`."""
    at = walk.at
    behind = at + len(USUAL_QUALIFIER)
    if not walk.shown and behind <= walk.end and walk.octets[at:behind] == USUAL_QUALIFIER:
        walk.at = behind
        walk.spend(_COST, "qualifier")
        return
    if walk.take(4, "qualifier") != _QUALIFIER:
        raise FormatError("bad_value", "qualifier", at, 1256, int.from_bytes(walk.octets[at : at + 4], "big"))
    walk.part(layouts.QUALIFIER, at)
    read_members(walk)


def take_count(walk: Walk) -> int:
    """Read a count. Raises `FormatError`."""
    at = walk.at
    count = walk.counted(VLQ, "count")
    walk.part(layouts.COUNT, at)
    return count


def take_ids(walk: Walk, found: Contents, count: int) -> None:
    """Read ``count`` ids of attributes. Raises `FormatError`."""
    walk.spend(count, "count")
    for _ in range(count):
        at = walk.at
        id_ = walk.number(VLQ, "attribute id")
        found.ids.append(id_)
        walk.part(layouts.ATTRIBUTE_ID, at, id_name(id_) if walk.shown else "")


class _Asked:
    """The content of a read request: addresses, or an object and ids of its attributes; and the work that reading it costs."""

    __slots__ = ("addresses", "cost", "ids", "object_id")

    def __init__(self, found: Contents, cost: int) -> None:
        self.addresses = found.addresses
        self.object_id = found.object_id
        self.ids = found.ids
        self.cost = cost


class _Known:
    """Parsed requests of reads by their octets, because polling repeats them. ``size`` is the sum of these octets."""

    def __init__(self) -> None:
        self.asked: dict[bytes, _Asked] = {}
        self.size = 0


_KNOWN: Final = _Known()
#: Total size of remembered requests; an address has at least four octets, and needs some hundred in memory once it is parsed.
_MAX_KNOWN: Final = 1 << 16


def take_read_addresses(walk: Walk, found: Contents) -> None:
    """Read the addresses in a read of several items, which the qualifier follows. Raises `FormatError`."""
    begin = walk.at
    end = walk.octets.find(_QUALIFIER, begin, walk.end) if not walk.shown else -1
    asked = walk.octets[begin:end] if end > begin else b""
    known = _KNOWN.asked.get(asked)
    if known is not None:
        found.addresses = known.addresses
        found.object_id = known.object_id
        found.ids = known.ids
        walk.at = end
        walk.spend(known.cost, "address")
    else:
        before = walk.budget
        take_addresses(walk, found)
        if walk.at == end and found.addresses:
            _remember(asked, found, before - walk.budget)


def addresses_of(asked: bytes) -> list[VariableAddress]:
    """Return the addresses that a sound read requests; ``asked`` are their octets."""
    known = _KNOWN.asked.get(asked)
    if known is not None:
        return known.addresses
    found = Contents(V3, -1, {})
    walk = Walk(asked, 0, len(asked), False)
    before = walk.budget
    take_addresses(walk, found)
    if found.addresses:
        _remember(asked, found, before - walk.budget)
    return found.addresses


def _remember(asked: bytes, found: Contents, cost: int) -> None:
    _KNOWN.size += len(asked)
    if _KNOWN.size > _MAX_KNOWN:
        _KNOWN.asked.clear()
        _KNOWN.size = len(asked)
    _KNOWN.asked[asked] = _Asked(found, cost)


def take_addresses(walk: Walk, found: Contents) -> int:
    """Read the addresses of items: variables, or attributes of one object. Return the number of items.

    Raises `FormatError` if it is not such a list.
    """
    at = walk.at
    link = walk.fixed(4, "link")
    count = walk.counted(VLQ, "item count")
    fields = walk.counted(VLQ, "field count")
    walk.part(layouts.ITEM_COUNTS, at, id_name(link) if link and walk.shown else "")
    if link:
        found.object_id = link
        take_ids(walk, found, fields)
        found.addresses = [known_address(0, link, id_, []) for id_ in found.ids]
        return count
    before = walk.at
    for _ in range(count):
        found.addresses.append(_take_address(walk))
    told = sum([4 + len(address.lids) for address in found.addresses])
    if told != fields:
        raise FormatError("count_mismatch", "field count", before, fields, told)
    return count


def _take_address(walk: Walk) -> VariableAddress:
    at = walk.at
    crc = walk.number(VLQ, "CRC")
    area = walk.number(VLQ, "area")
    count = walk.counted(VLQ, "id count")
    if count == 0:
        raise FormatError("length_below", "id count", walk.at - 1, 1, 0)
    walk.spend(STEP + count, "address")
    sub_area = walk.number(VLQ, "sub area")
    address = known_address(crc, area, sub_area, [walk.number(VLQ, "LID") for _ in range(count - 1)])
    walk.part(layouts.ADDRESS, at, address.label if walk.shown else "")
    return address


def take_values(walk: Walk, found: Contents, count: int) -> None:
    """Read ``count`` numbers with values."""
    for _ in range(count):
        at = walk.at
        number = walk.number(VLQ, "item")
        if walk.wanted is not None and not _is_needed(walk.wanted, found, number) and passed(walk):
            continue
        take_item(walk, found, number, layouts.ITEM_VALUE, at)


def _is_needed(wanted: Wanted, found: Contents, number: int) -> bool:
    """Return whether the walk wants an item."""
    if wanted.written or not 0 < number <= len(found.addresses):
        return True
    return is_asked_for(wanted.attributes, found.addresses[number - 1])


def is_asked_for(attributes: bytes, address: VariableAddress) -> bool:
    """Return whether an address is a variable of the program, or an attribute that the table ``attributes`` wants."""
    if address.area in AREAS or address.area >> 16 in BLOCK_KINDS:
        return True
    return is_wanted(attributes, address.lids[-1] if address.lids else address.sub_area)


def _item_number(walk: Walk) -> int:
    """Read the number of the next item; 0 ends the list and is a separate part."""
    at = walk.at
    number = walk.number(VLQ, "item")
    if number == 0:
        walk.part(layouts.LIST_END, at)
    return number


def take_item(walk: Walk, found: Contents, number: int, layout: Layout, at: int) -> None:
    """Read the value of an item, whose part begins at ``at``. Raises `FormatError`."""
    value = read_value(walk, layout, at, f"{number}: " if walk.shown else "")
    if walk.full:
        found.items_left_out += 1
    else:
        found.items.append((number, value))


def take_values_to_end(walk: Walk, found: Contents) -> None:
    """Read numbers with values up to the number 0."""
    at = walk.at
    items = walk.wanted.items if walk.wanted is not None else None
    while number := _item_number(walk):
        if items is not None and number not in items and passed(walk):
            continue
        take_item(walk, found, number, layouts.ITEM_VALUE, at)
        at = walk.at


def take_refusals(walk: Walk, found: Contents) -> None:
    """Read numbers with return values up to the number 0. Raises `FormatError`."""
    at = walk.at
    while number := _item_number(walk):
        value = walk.number(VLQ64, "return value")
        walk.spend(STEP, "return value")
        found.refusals.append((number, value))
        walk.part(layouts.ITEM_ERROR, at, f"{number}: {return_note(value)}" if walk.shown else "")
        at = walk.at


def take_value(walk: Walk, found: Contents) -> None:
    """Read a single value. Raises `FormatError`."""
    found.value = read_value(walk, layouts.VALUE, walk.at, "", found.ids[-1] if found.ids else 0)


def take_objects(walk: Walk, found: Contents) -> None:
    """Read all objects that follow. Raises `FormatError`; the objects begun by then are kept."""
    elements: list[Element] = []
    try:
        read_into(walk, elements)
    except FormatError:
        found.begun = objects_of(elements)
        raise
    found.objects = objects_of(elements)


def take_integrity_id(walk: Walk, found: Contents) -> None:
    """Read an integrity id that is within the body. Raises `FormatError`."""
    at = walk.at
    found.integrity_id = walk.number(VLQ, "integrity id")
    walk.part(layouts.INTEGRITY_ID, at)
