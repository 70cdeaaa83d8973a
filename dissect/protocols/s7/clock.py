"""Time functions (userdata group 7): the clock in a read answer and in a set request (reference section 4.12)."""

from __future__ import annotations

from typing import Final

from dissect.protocols.s7.parameters import REQUEST, RESPONSE, UserdataHead
from dissect.protocols.s7.tables import SET_CLOCK, SET_CLOCK_SECOND
from dissect.protocols.s7.values import date_and_time
from dissect.wire.layout import HOLDS_TIME, Field, Layout
from dissect.wire.part import Cursor

#: Subfunctions that set the clock.
SETTING: Final = frozenset((SET_CLOCK, SET_CLOCK_SECOND))

#: The clock: the eight octets of DATE_AND_TIME after one octet for the century, which devices fill in wrongly.
CLOCK: Final = Layout(
    "clock",
    "reference section 4.12",
    [
        Field("reserved", 1, "0.", "s7comm.data.ts_reserved"),
        Field("century", 1, "Century in BCD; unreliable, the year decides.", "s7comm.data.ts_year1", holds=HOLDS_TIME),
        Field("time", 8, "DATE_AND_TIME in BCD.", "s7comm.data.ts", means=date_and_time, holds=HOLDS_TIME),
    ],
)


def parse_clock(cursor: Cursor, head: UserdataHead) -> None:
    """Parse the payload of a time function: a clock in the answer to a read, and in the request to set."""
    setting = head.subfunction in SETTING
    if (setting and head.type == REQUEST) or (not setting and head.type == RESPONSE):
        part = cursor.take(CLOCK)
        if part is not None:
            time = part.find("time")
            unset = time is None or not any(time.octets or b"")
            part.note = part.text("time") or ("no time" if unset else "invalid time")
