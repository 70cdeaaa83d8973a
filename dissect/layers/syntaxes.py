"""Request items with syntaxes other than S7ANY as Scapy packets (`dissect.protocols.s7.syntaxes`)."""

from __future__ import annotations

from collections.abc import Callable

from scapy.packet import Packet

from dissect.layers.fields import FillField, Piece, PiecesField, ScapyField, header_fields
from dissect.layers.part_classes import S7_DBArea, S7_SymbolStep
from dissect.layers.parts import CLASSES, JOINED, REPEATED, S7_Part
from dissect.layers.variables import S7_Item
from dissect.protocols.s7 import syntaxes
from dissect.protocols.s7.items import SPECIFICATION
from dissect.wire.layout import Layout
from dissect.wire.part import FILL

__all__ = [
    "S7_DBReadItem",
    "S7_DriveItem",
    "S7_NCKItem",
    "S7_Symbol",
    "S7_SymbolInDB",
    "S7_SymbolInMemory",
]


def _item_fields(layout: Layout, *behind: ScapyField, **defaults: int | None) -> list[ScapyField]:
    head = header_fields(layout, {"specification": SPECIFICATION, "length": None, **defaults})
    return [*head, *behind, FillField()]


def _carve(cls: type[S7_Part], head: int) -> Callable[[Packet, bytes], list[Piece]]:
    """Return a function that cuts the rest of an item, by its length, into parts of one size after ``head`` octets."""

    def carve(pkt: Packet, s: bytes) -> list[Piece]:
        step = cls.layout.size
        end = min(len(s), pkt.length + 2 - head)
        return [(cls, s[at : at + step]) for at in range(0, end - step + 1, step)]

    return carve


class S7_NCKItem(S7_Item):
    """A variable of an NC, by area, unit, column and line. Syntax 0x82; 0x83 in metric units, 0x84 in inches."""

    name = "S7 NCK item"
    least = syntaxes.NCK_ITEM.size
    fields_desc = _item_fields(syntaxes.NCK_ITEM, syntax_id=syntaxes.NCK, line_count=1)


class S7_DriveItem(S7_Item):
    """A parameter of a drive."""

    name = "S7 DriveES item"
    least = syntaxes.DRIVE_ITEM.size
    fields_desc = _item_fields(syntaxes.DRIVE_ITEM, syntax_id=syntaxes.DRIVE_ES_ANY)


class S7_DBReadItem(S7_Item):
    """Several areas of data blocks as one item. ``area_count`` is filled in when left out."""

    name = "S7 DBREAD item"
    least = syntaxes.DB_READ_ITEM.size
    fields_desc = _item_fields(
        syntaxes.DB_READ_ITEM,
        PiecesField("areas", _carve(S7_DBArea, syntaxes.DB_READ_ITEM.size)),
        syntax_id=syntaxes.DB_READ,
    )

    def post_build(self, pkt: bytes, pay: bytes) -> bytes:
        """Fill in the length and the number of areas (Scapy's interface)."""
        if self.getfieldval("area_count") is None:
            pkt = pkt[:3] + bytes((len(self.areas),)) + pkt[4:]
        return super().post_build(pkt, pay)


class S7_Symbol(S7_Item):
    """A symbol of an S7-1200, identified by the checksum of its name and the path to it; no source describes its location."""

    name = "S7 symbol"
    least = syntaxes.SYMBOL_ELSEWHERE.size
    fields_desc = _item_fields(
        syntaxes.SYMBOL_ELSEWHERE,
        PiecesField("steps", _carve(S7_SymbolStep, syntaxes.SYMBOL_ELSEWHERE.size)),
        syntax_id=syntaxes.SYMBOL,
        reserved=0xFF,
    )


class S7_SymbolInDB(S7_Symbol):
    """A symbol in a data block."""

    name = "S7 symbol in a DB"
    least = syntaxes.SYMBOL_IN_DB.size
    fields_desc = _item_fields(
        syntaxes.SYMBOL_IN_DB,
        PiecesField("steps", _carve(S7_SymbolStep, syntaxes.SYMBOL_IN_DB.size)),
        syntax_id=syntaxes.SYMBOL,
        reserved=0xFF,
        root=0x8A0E,
    )


class S7_SymbolInMemory(S7_Symbol):
    """A symbol in inputs, outputs, bit memory, timers or counters."""

    name = "S7 symbol in memory"
    least = syntaxes.SYMBOL_IN_MEMORY.size
    fields_desc = _item_fields(
        syntaxes.SYMBOL_IN_MEMORY,
        PiecesField("steps", _carve(S7_SymbolStep, syntaxes.SYMBOL_IN_MEMORY.size)),
        syntax_id=syntaxes.SYMBOL,
        reserved=0xFF,
    )


REPEATED.update((syntaxes.DB_AREA, syntaxes.SYMBOL_STEP))
for _layout, _cls, _behind in (
    (syntaxes.NCK_ITEM, S7_NCKItem, ()),
    (syntaxes.DRIVE_ITEM, S7_DriveItem, ()),
    (syntaxes.DB_READ_ITEM, S7_DBReadItem, (syntaxes.DB_AREA,)),
    (syntaxes.SYMBOL_ELSEWHERE, S7_Symbol, (syntaxes.SYMBOL_STEP,)),
    (syntaxes.SYMBOL_IN_DB, S7_SymbolInDB, (syntaxes.SYMBOL_STEP,)),
    (syntaxes.SYMBOL_IN_MEMORY, S7_SymbolInMemory, (syntaxes.SYMBOL_STEP,)),
):
    CLASSES[_layout] = _cls
    JOINED[_layout] = (*_behind, FILL)
