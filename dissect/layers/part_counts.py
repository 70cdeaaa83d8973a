"""Values of counting fields that no layout defines (`dissect.layers.part_tables`).

Each function takes the field, the parts after its own in the block, and their sizes in octets; it returns the number.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from scapy.packet import Packet

from dissect.layers.parts import layout_of
from dissect.protocols.s7 import layouts, programmer_layouts, szl_records
from dissect.protocols.s7.data_parts import RETURN_CODE
from dissect.protocols.s7.tables import OBJECT_DOES_NOT_EXIST, OCTET_STRING, SUCCESS
from dissect.wire.layout import Field

#: A function of this module.
Counting = Callable[[Field, list[Packet], list[int]], int]

#: Transport size of a payload of octets.
#: Parts of a programmer command's parameter block; everything else is its data block.
_PARAMETERS: Final = frozenset((
    programmer_layouts.TEST_REQUEST,
    programmer_layouts.TEST_BLOCK,
    programmer_layouts.TEST_STEP,
    programmer_layouts.TEST_ENVIRONMENT,
    programmer_layouts.TEST_ENVIRONMENT_DBS,
    programmer_layouts.TEST_ENVIRONMENT_BLOCK,
    programmer_layouts.TEST_ENVIRONMENT_ADDRESS,
    programmer_layouts.TEST_ANSWER,
))  # fmt: skip


def octets_behind(field: Field, behind: list[Packet], sizes: list[int]) -> int:
    """Return the octets of all following parts, unchanged if there is only one piece."""
    return sum(sizes)


def payload_behind(field: Field, behind: list[Packet], sizes: list[int]) -> int:
    """Return the value of a field of the data head, which depends on whether a payload follows."""
    if field.name == "length":
        return sum(sizes)
    codes = (SUCCESS, OCTET_STRING) if sum(sizes) else (OBJECT_DOES_NOT_EXIST, 0)
    return codes[field.name == "transport_size"]


def block_size(field: Field, behind: list[Packet], sizes: list[int]) -> int:
    """Return the size of the parameter block, with which the following parts begin, or of the data block."""
    count = next((number for number, part in enumerate(behind) if layout_of(part) not in _PARAMETERS), len(behind))
    return sum(sizes[:count] if field.name == "parameter_size" else sizes[count:])


def variables_behind(field: Field, behind: list[Packet], sizes: list[int]) -> int:
    """Return how many addresses follow, or values, or return codes if there are no addresses."""
    kinds = [layout_of(part) for part in behind]
    addresses = kinds.count(programmer_layouts.TEST_ADDRESS) + kinds.count(programmer_layouts.TEST_BIT)
    return addresses or kinds.count(layouts.DATA_ITEM) or kinds.count(RETURN_CODE)


def local_data(field: Field, behind: list[Packet], sizes: list[int]) -> int:
    """Return the octets of the local data that follow."""
    pairs = zip(behind, sizes, strict=True)
    return sum([size for part, size in pairs if layout_of(part) is programmer_layouts.LSTACK_DATA])


def records_behind(field: Field, behind: list[Packet], sizes: list[int]) -> int:
    """Return how many records of a system status list follow, or the octets of the first one."""
    starts = [number for number, part in enumerate(behind) if layout_of(part) is not szl_records.RECORD_REST]
    if field.name == "record_count":
        return len(starts)
    return sum(sizes[: starts[1]] if len(starts) > 1 else sizes)
