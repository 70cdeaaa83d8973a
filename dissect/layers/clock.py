"""Time functions as Scapy packets (`dissect.s7.clock`)."""

from __future__ import annotations

from dissect.layers.fields import header_fields
from dissect.layers.parts import S7_Part
from dissect.s7 import clock

__all__ = ["S7_Clock"]


class S7_Clock(S7_Part):
    """The clock that a read answers with and a set sends. ``time_`` is DATE_AND_TIME, eight octets in BCD."""

    name = "S7 clock"
    layout = clock.CLOCK
    fields_desc = header_fields(clock.CLOCK, {"century": 0x19})
