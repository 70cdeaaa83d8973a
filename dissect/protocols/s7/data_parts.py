"""Request items and data items as parts; used for Read and Write Var, cyclic services, test functions and alarms."""

from __future__ import annotations

from typing import Final

from dissect.protocols.s7.items import Item, data_size_within, parse_items
from dissect.protocols.s7.layouts import DATA_ITEM, S7ANY_ITEM
from dissect.protocols.s7.syntaxes import take_item
from dissect.protocols.s7.tables import SUCCESS
from dissect.wire.layout import HOLDS_VALUE, REST, Field, Layout
from dissect.wire.malformed import Malformed
from dissect.wire.part import Cursor

#: The content of a data item.
CONTENT: Final = Layout(
    "content",
    "reference section 3.5",
    [Field("data", REST, "Values, or a bit in the lowest bit.", "s7comm.resp.data", holds=HOLDS_VALUE)],
)
#: A return code that is the whole answer for an item, as in a write.
RETURN_CODE: Final = Layout("return code", "reference section 3.5", [DATA_ITEM.fields[0]])


def take_items(cursor: Cursor, items: list[Item], start: int) -> None:
    """Parse the request ``items`` with the fill octets between them; their offsets are relative to ``start``."""
    for item in items:
        if start + item.offset > cursor.at:
            cursor.take_fill(1)
        if item.transport_size >= 0:
            cursor.take(S7ANY_ITEM, note=item.label)
        else:
            take_item(cursor, item.octets, item.label)


def take_request_items(cursor: Cursor, count: int) -> list[Item]:
    """Parse up to ``count`` request items of any syntax at the cursor; return those that are complete."""
    told: list[Malformed] = []
    items = parse_items(cursor.octets, cursor.at, cursor.end, count, told)
    take_items(cursor, items, 0)
    for fault in told:
        if fault.field != "items":  # octets after the last item are noted by the caller that finishes the block
            limit = cursor.limit if fault.limit == "param" else fault.limit
            cursor.malformed.append(
                Malformed("s7", fault.reason, fault.field, fault.offset, fault.needed, fault.available, limit)
            )
    if len(items) < count:
        cursor.rest()  # an item that does not fit; its fault was noted above
    return items


def take_data_items(cursor: Cursor, count: int, response: bool, names: list[str] | None = None) -> None:
    """Parse up to ``count`` data items with their contents and fill octets (reference 3.5).

    In a ``response``, an item whose return code is not success has only its head of four octets. ``names`` are notes for the
    items.
    """
    for number in range(count):
        head = cursor.take(DATA_ITEM, note=names[number] if names is not None and number < len(names) else "")
        if head is None:
            return
        size = 0
        if not response or head.number("return_code") == SUCCESS:
            size = data_size_within(head.number("transport_size"), head.number("length"), cursor.left)
        if size:
            cursor.take(CONTENT, size)
        if number + 1 < count or cursor.left == 1:
            cursor.take_fill(size)
