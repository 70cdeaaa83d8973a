"""Read Var and Write Var as Scapy layers: request items, data items, and the four bodies (reference section 3.5)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from scapy.fields import FieldLenField
from scapy.packet import Packet, Raw, bind_top_down

from dissect.layers.fields import (
    CodesField,
    FillField,
    ItemsField,
    OctetsField,
    Piece,
    ScapyField,
    WireLayer,
    fill_number,
    header_fields,
)
from dissect.layers.part_classes import S7_Surplus
from dissect.layers.parts import CLASSES, JOINED
from dissect.layers.s7 import BODIES, NOTE, S7, S7_Body, body_fields, carve_parameters, data_left, joined
from dissect.protocols.s7 import layouts, tables
from dissect.protocols.s7.data_parts import CONTENT
from dissect.protocols.s7.items import DATA_HEAD, SPECIFICATION, data_size_within, item_fill, parse_item
from dissect.protocols.s7.syntaxes import layout_of as layout_of_item
from dissect.protocols.s7.tables import DATA_BIT, DATA_BYTES
from dissect.wire.part import FILL, OCTETS
from dissect.wire.text import shortened

#: The most that the count of items can say.
_MOST_COUNTED: Final = 0xFF


class S7_Item(WireLayer):
    """A request item, which names a variable. ``length`` is filled in when left out.

    ``S7_Item(octets)`` gives the class that their syntax calls for; ``S7_Item()`` is an `S7_Any`.

    ``fill`` is the octet that makes an odd item even; None lets the list that holds the item decide.
    """

    name = "S7 item"
    match_subclass = True
    fields_desc = [*header_fields(layouts.ITEM_HEAD, {"specification": SPECIFICATION, "length": None})]

    @classmethod
    def dispatch_hook(cls, _pkt: bytes | None = None, *_args: Any, **_kwargs: Any) -> type[Packet]:
        """Choose the class of the item's syntax; without octets an `S7_Any` (Scapy's interface)."""
        if not _pkt:
            return S7_Any
        if len(_pkt) < layouts.ITEM_HEAD.size:
            return Raw
        octets = bytes(_pkt[: _pkt[1] + 2])
        if len(octets) >= layouts.ITEM_HEAD.size and parse_item(octets, 0).transport_size >= 0:
            return S7_Any
        layout = layout_of_item(octets)
        known = CLASSES.get(layout) if layout is not None else None
        return known if known is not None and issubclass(known, S7_Item) else S7_OtherItem

    def post_build(self, pkt: bytes, pay: bytes) -> bytes:
        """Fill in the length (Scapy's interface)."""
        if self.getfieldval("length") is None:
            fill = self.getfieldval("fill") if "fill" in self.default_fields else b""
            pkt = fill_number(pkt, 1, 1, len(pkt) - 2 - len(fill or b""), "the length of the item")
        return pkt + pay

    def describe(self) -> str:
        """Return the item as people write it, for example ``DB10.DBW4 x3``."""
        octets = bytes(self)
        return parse_item(octets[: octets[1] + 2], 0).label if octets[1] else ""

    def line(self) -> str:
        """Return one line."""
        return shortened(self.describe(), NOTE)


class S7_Any(S7_Item):
    """An item of syntax S7ANY: an area, an address in it, and how many elements of what size.

    ``address`` is the octet address times 8 plus the bit, a plain number for counters and timers. ``fill`` is the octet that
    makes an odd item even (S7ANY items are 12 octets, so they have none).
    """

    name = "S7ANY item"
    least = layouts.S7ANY_ITEM.size
    fields_desc = [
        *header_fields(
            layouts.S7ANY_ITEM,
            {
                "specification": SPECIFICATION,
                "length": layouts.S7ANY_ITEM.size - 2,
                "syntax_id": tables.S7ANY,
                "transport_size": 2,
                "count": 1,
                "area": 0x84,
            },
        ),
        FillField(),
    ]


class S7_OtherItem(S7_Item):
    """An item with an unknown syntax, or with a different size from its syntax: its address is kept in ``octets``."""

    name = "S7 item"
    least = layouts.ITEM_HEAD.size
    fields_desc = [
        *header_fields(layouts.ITEM_HEAD, {"specification": SPECIFICATION, "length": None}),
        OctetsField("octets", lambda pkt, _: pkt.length - 1),
        FillField(),
    ]


class S7_DataItem(WireLayer):
    """A data item of an answer: return code, transport size, length (bits or bytes, by transport size) and the bytes.

    ``length`` is filled in from the octets when left out; one octet of BIT counts as one bit. ``fill`` is the octet after an
    odd item that is not the last, put there when left out.
    """

    name = "S7 data item"
    least = layouts.DATA_ITEM.size
    fields_desc = [
        *header_fields(
            layouts.DATA_ITEM, {"return_code": tables.SUCCESS, "transport_size": DATA_BYTES, "length": None}
        ),
        OctetsField("octets", lambda pkt, s: data_size_within(pkt.transport_size, pkt.length, len(s))),
        FillField(),
    ]

    def post_build(self, pkt: bytes, pay: bytes) -> bytes:
        """Fill in the length (Scapy's interface)."""
        if self.getfieldval("length") is None:
            size = len(self.octets)
            if self.transport_size == DATA_BIT and size == 1:
                length = 1
            else:
                length = size * 8 if self.transport_size in tables.LENGTH_IN_BITS else size
            pkt = fill_number(pkt, 2, 2, length, "the length of the data item")
        return pkt + pay

    def line(self) -> str:
        """Return one line."""
        return f"{tables.RETURN_CODES.name(self.return_code)} {self.octets.hex()}".rstrip()


class S7_WriteDataItem(S7_DataItem):
    """A data item of a Write Var request: its return code means nothing and is 0."""

    name = "S7 write data item"
    least = layouts.DATA_ITEM.size
    fields_desc = [
        *header_fields(layouts.DATA_ITEM, {"transport_size": DATA_BYTES, "length": None}),
        *S7_DataItem.fields_desc[-2:],
    ]


def _carve_items(pkt: Packet, s: bytes) -> list[Piece]:
    """Cut the request items of a parameter block; octets after the last item are left over."""
    return [piece for piece in carve_parameters(pkt, s) if piece[0] is not S7_Surplus]


def _carve_data(
    cls: type[Packet], response: bool, count: Callable[[Packet], int]
) -> Callable[[Packet, bytes], list[Piece]]:
    """Return a function that cuts a data block into items. In a response, a refused item has only its head."""

    def carve(pkt: Packet, s: bytes) -> list[Piece]:
        end = min(len(s), data_left(pkt, s))
        items = count(pkt)
        pieces: list[Piece] = []
        at = 0
        while len(pieces) < items and at + DATA_HEAD <= end:
            size = DATA_HEAD
            if s[at] == tables.SUCCESS or not response:
                size += data_size_within(s[at + 1], int.from_bytes(s[at + 2 : at + 4], "big"), end - at - DATA_HEAD)
            size = min(size + item_fill(size, len(pieces) + 1 == items), end - at)
            pieces.append((cls, s[at : at + size]))
            at += size
        return pieces

    return carve


class _CountField(FieldLenField):
    """How many elements a list has, counted when left out."""

    def i2m(self, pkt: Packet | None, x: int | None) -> int:
        """Return the number to send (Scapy's interface). Raises ValueError for a list that is too long."""
        count = int(super().i2m(pkt, x))
        if x is None and count > _MOST_COUNTED:
            message = f"{self.name} would be {count}, more than its byte can say: send less, or set it yourself"
            raise ValueError(message)
        return count


def _variables(function: int, count_of: str) -> list[ScapyField]:
    counted = _CountField("item_count", None, count_of=count_of, fmt="B")
    return header_fields(layouts.VARIABLES_HEAD, {"function": function}, {"item_count": counted})


def _items_text(items: list[Packet]) -> str:
    return joined([item.line() if isinstance(item, S7_Item) else bytes(item).hex() for item in items])


def _codes_text(codes: list[int]) -> str:
    """Return the results of the items: how many succeeded, and the names of the refusals."""
    refused = [tables.RETURN_CODES.name(code) for code in codes if code != tables.SUCCESS]
    well = len(codes) - len(refused)
    return joined([*([f"{well} ok"] if well or not refused else []), *refused])


class S7_ReadVarRequest(S7_Body):
    """Read Var: which variables to read. ``item_count`` is filled in when left out."""

    name = "S7 Read Var request"
    least = layouts.VARIABLES_HEAD.size
    fields_desc = body_fields(*_variables(tables.READ_VAR, "items"), ItemsField("items", _carve_items))

    def detail(self) -> str:
        """Return the addresses."""
        return _items_text(self.items)


class S7_WriteVarRequest(S7_Body):
    """Write Var: which variables to write, and a data item for each. ``item_count`` is filled in when left out."""

    name = "S7 Write Var request"
    least = layouts.VARIABLES_HEAD.size
    data_fields = ("data", "data_rest")
    fields_desc = body_fields(
        *_variables(tables.WRITE_VAR, "items"),
        ItemsField("items", _carve_items),
        data=[ItemsField("data", _carve_data(S7_WriteDataItem, False, lambda pkt: int(pkt.item_count)))],
    )

    def detail(self) -> str:
        """Return the addresses."""
        return _items_text(self.items)


class S7_ReadVarAnswer(S7_Body):
    """Answer to Read Var: a data item for each requested variable. ``item_count`` is filled in when left out."""

    name = "S7 Read Var answer"
    rosctr_alone = tables.ACK_DATA
    least = layouts.VARIABLES_HEAD.size
    data_fields = ("data", "data_rest")
    fields_desc = body_fields(
        *_variables(tables.READ_VAR, "data"),
        data=[ItemsField("data", _carve_data(S7_DataItem, True, lambda pkt: int(pkt.item_count)))],
    )

    def detail(self) -> str:
        """Return the results of the items."""
        return _codes_text([item.return_code for item in self.data if isinstance(item, S7_DataItem)])


class S7_WriteVarAnswer(S7_Body):
    """Answer to Write Var: a return code for each variable. ``item_count`` is filled in when left out."""

    name = "S7 Write Var answer"
    rosctr_alone = tables.ACK_DATA
    least = layouts.VARIABLES_HEAD.size
    data_fields = ("return_codes", "data_rest")
    fields_desc = body_fields(
        *_variables(tables.WRITE_VAR, "return_codes"),
        data=[
            CodesField(
                "return_codes", tables.RETURN_CODES.names(), lambda pkt, s: min(pkt.item_count, data_left(pkt, s))
            )
        ],
    )

    def detail(self) -> str:
        """Return the results of the items."""
        return _codes_text(self.return_codes)


# In lists of parts an item is one packet, with its content and its fill octet.
CLASSES[layouts.S7ANY_ITEM] = S7_Any
CLASSES[layouts.ITEM_HEAD] = S7_OtherItem
CLASSES[layouts.DATA_ITEM] = S7_DataItem
JOINED[layouts.S7ANY_ITEM] = (FILL,)
JOINED[layouts.ITEM_HEAD] = (OCTETS, FILL)
JOINED[layouts.DATA_ITEM] = (CONTENT, FILL)

BODIES[False, tables.READ_VAR] = S7_ReadVarRequest
BODIES[True, tables.READ_VAR] = S7_ReadVarAnswer
BODIES[False, tables.WRITE_VAR] = S7_WriteVarRequest
BODIES[True, tables.WRITE_VAR] = S7_WriteVarAnswer
for _answer in (S7_ReadVarAnswer, S7_WriteVarAnswer):
    bind_top_down(S7, _answer, rosctr=tables.ACK_DATA)
