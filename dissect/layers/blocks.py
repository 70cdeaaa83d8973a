"""Block functions as Scapy packets (`dissect.s7.blocks`)."""

from __future__ import annotations

from dissect.layers.fields import header_fields
from dissect.layers.parts import S7_Part
from dissect.s7 import blocks

__all__ = ["S7_BlockCount", "S7_BlockHeader", "S7_BlockInfo", "S7_BlockTypeWanted", "S7_BlockWanted", "S7_ListedBlock"]


class S7_BlockCount(S7_Part):
    """An entry of the answer to list blocks."""

    name = "S7 blocks of a type"
    layout = blocks.BLOCK_COUNT
    fields_desc = header_fields(blocks.BLOCK_COUNT, {"block_type": b"0A"})


class S7_BlockTypeWanted(S7_Part):
    """What a request to list the blocks of a type names."""

    name = "S7 block type"
    layout = blocks.TYPE_WANTED
    fields_desc = header_fields(blocks.TYPE_WANTED, {"block_type": b"0A"})


class S7_ListedBlock(S7_Part):
    """An entry of the answer to list blocks of a type."""

    name = "S7 block"
    layout = blocks.LISTED_BLOCK
    fields_desc = header_fields(blocks.LISTED_BLOCK)


class S7_BlockWanted(S7_Part):
    """What a request of block info names."""

    name = "S7 block name"
    layout = blocks.BLOCK_WANTED
    fields_desc = header_fields(
        blocks.BLOCK_WANTED, {"block_type": b"0A", "block_number": b"00001", "file_system": b"A"}
    )


class S7_BlockInfo(S7_Part):
    """The answer to block info. ``info_length`` is filled in when left out."""

    name = "S7 block info"
    layout = blocks.INFO
    fields_desc = header_fields(
        blocks.INFO, {"constant": 0x0100, "unknown_info": 0x2200, "mark": b"pp", "unknown_mark": 1}
    )


class S7_BlockHeader(S7_Part):
    """The header of a block where it is transferred; Wireshark does not look into blocks."""

    name = "S7 block header"
    layout = blocks.HEADER
    fields_desc = header_fields(blocks.HEADER, {"mark": b"pp", "unknown_mark": 1})
