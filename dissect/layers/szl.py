"""Read SZL as Scapy packets (`dissect.s7.szl`); its records are in `szl_records` and `szl_communication`."""

from __future__ import annotations

from scapy.packet import Packet

from dissect.layers.fields import header_fields
from dissect.layers.parts import S7_Part
from dissect.layers.szl_records import S7_SZLRecordRest
from dissect.s7 import szl
from dissect.wire.layout import Field

__all__ = ["S7_SZLHead", "S7_SZLRequest"]


class S7_SZLRequest(S7_Part):
    """Asks for a system status list."""

    name = "S7 SZL request"
    layout = szl.SZL_REQUEST
    fields_desc = header_fields(szl.SZL_REQUEST)


class S7_SZLHead(S7_Part):
    """Head of a system status list, before its records.

    ``record_length`` and ``record_count`` are filled in when left out.
    """

    name = "S7 SZL head"
    layout = szl.SZL_HEAD
    fields_desc = header_fields(szl.SZL_HEAD, {"record_length": None, "record_count": None})

    def count_of(self, field: Field, behind: list[Packet], sizes: list[int]) -> int:
        """Return how many records follow, or the octets of the first one."""
        starts = [number for number, part in enumerate(behind) if not isinstance(part, S7_SZLRecordRest)]
        if field.name == "record_count":
            return len(starts)
        return sum(sizes[: starts[1]] if len(starts) > 1 else sizes)
