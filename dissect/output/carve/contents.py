"""The values of a transferred data block by tags, because its own declarations have no names."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from dissect.engine.program.carved import CarvedBlock
from dissect.engine.transactions.naming import NamedValue, Naming
from dissect.protocols.mc7.listing import no_names
from dissect.protocols.s7.items import Item, ItemResult
from dissect.protocols.s7.tables import BYTE, DB, SUCCESS

__all__ = ["NamedValue", "block_values", "tag_names"]

#: How many tags an operand may have.
_TAGS: Final = 3


def block_values(block: CarvedBlock) -> list[NamedValue]:
    """Return the values in a data block by the tags of its CPU, and the octets between them; empty if there are no tags."""
    operation = block.operation
    naming = operation.connection.naming if operation is not None else None
    if naming is None or block.classic is None or block.kind != "DB":
        return []  # without a header it is unknown where the values begin
    data = block.classic.code
    item = Item(b"values of block %d" % block.number, 0)
    item.transport_size = BYTE
    item.area = DB
    item.db = block.number
    item.start_bit = 0
    item.count = item.size = len(data)
    return naming.named(ItemResult(item, SUCCESS, data, None))


def tag_names(naming: Naming | None) -> Callable[[int, int, int, int], str]:
    """Return a function that names an address (area, data block, first bit, bits) by tags; an empty text for none."""
    from dissect.meaning.tags.naming import TagNaming, part_name

    if not isinstance(naming, TagNaming):
        return no_names
    index = naming.index

    def name(area: int, db: int, bit: int, bits: int) -> str:
        cover = index.cover(area, db, bit, bits)
        if cover is None:
            return ""
        names = [part_name(part) for part in cover.parts[:_TAGS]]
        return ", ".join(names) + (" …" if len(cover.parts) > _TAGS else "")

    return name
