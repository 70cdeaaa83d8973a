"""BSEND and USEND as Scapy packets (`dissect.s7.pbc`)."""

from __future__ import annotations

from scapy.packet import Packet

from dissect.layers.fields import header_fields
from dissect.layers.parts import S7_Part
from dissect.s7 import pbc, syntaxes
from dissect.wire.layout import Field

__all__ = ["S7_BSENDData", "S7_BSENDLength", "S7_RId", "S7_USENDData"]


class S7_BSENDLength(S7_Part):
    """Before the first piece of a BSEND only. ``total_length`` is filled in when left out."""

    name = "S7 BSEND length"
    layout = pbc.BSEND_LENGTH
    fields_desc = header_fields(pbc.BSEND_LENGTH, {"total_length": None})

    def count_of(self, field: Field, behind: list[Packet], sizes: list[int]) -> int:
        """Return the octets behind it, as they are when there is one piece only."""
        return sum(sizes)


class S7_BSENDData(S7_Part):
    """What a BSEND carries."""

    name = "S7 BSEND data"
    layout = pbc.BSEND_DATA
    fields_desc = header_fields(pbc.BSEND_DATA)


class S7_USENDData(S7_Part):
    """Before the data items of a USEND. ``item_count`` is filled in when left out."""

    name = "S7 USEND data"
    layout = pbc.USEND_DATA
    fields_desc = header_fields(pbc.USEND_DATA, {"return_code": 0xFF})


class S7_RId(S7_Part):
    """R_ID. ``length`` is filled in when left out."""

    name = "S7 R_ID"
    layout = syntaxes.PBC_ID
    fields_desc = header_fields(syntaxes.PBC_ID, {"length": 6, "syntax_id": 0x13, "specification": 0x12})
