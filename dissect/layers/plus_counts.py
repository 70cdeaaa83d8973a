"""Values of counting fields in S7comm-plus parts that no layout defines (`dissect.layers.plus_tables`)."""

from __future__ import annotations

from itertools import takewhile
from typing import Final

from scapy.packet import Packet

from dissect.protocols.s7plus import layouts
from dissect.wire.layout import Field, Layout

#: Numbers of an address that are counted besides its LIDs.
_ADDRESS: Final = 4
_IN_BLOCK: Final = frozenset((layouts.LIST_ID, layouts.VARIABLE, layouts.VARIABLE_NAME))
_IDS: Final = frozenset((layouts.ATTRIBUTE_ID, layouts.OBJECT_ID, layouts.OBJECT_ID_VLQ))


def _layout(packet: Packet) -> Layout | None:
    return getattr(packet, "layout", None)


def ids_behind(field: Field, behind: list[Packet], sizes: list[int]) -> int:
    """Return how many ids follow directly."""
    return len(list(takewhile(lambda part: _layout(part) in _IDS, behind)))


def block_behind(field: Field, behind: list[Packet], sizes: list[int]) -> int:
    """Return the octets of the variables or names that follow directly."""
    count = len(list(takewhile(lambda part: _layout(part) in _IN_BLOCK, behind)))
    return sum(sizes[:count])


def items_behind(field: Field, behind: list[Packet], sizes: list[int]) -> int:
    """Return how many addresses follow directly, or the numbers that they take in all; ids of one object count one each."""
    addresses = list(takewhile(lambda part: _layout(part) is layouts.ADDRESS, behind))
    if not addresses:
        return ids_behind(field, behind, sizes)
    if field.name == "item_count":
        return len(addresses)
    return sum([_ADDRESS + len(address.lids) for address in addresses])


def group_behind(field: Field, behind: list[Packet], sizes: list[int]) -> int:
    """Return how many filters, or how many ids, follow in a group of Explore."""
    wanted = layouts.EXPLORE_FILTER if field.name == "filters" else layouts.ATTRIBUTE_ID
    own = takewhile(lambda part: _layout(part) is not layouts.EXPLORE_GROUP, behind)
    return sum([_layout(part) is wanted for part in own])


def address_numbers(address: Packet) -> int:
    """Return how many numbers follow in an address: its sub area, and its LIDs."""
    return 1 + len(address.lids)


def name_octets(part: Packet) -> int:
    """Return the octets of a name without the 0 that ends it."""
    return max(0, len(part.get_field("name_").i2m(part, part.getfieldval("name_"))) - 1)


def packed_octets(part: Packet) -> int:
    """Return the octets of a structure of the program."""
    return len(part.octets)
