"""Diagnostic messages: entries of the diagnostic buffer, read as an SZL or pushed as a message.

Reference section 4.5 (list 0x00a0) and 4.9 (userdata group 4, subfunction 3).
"""

from __future__ import annotations

from typing import Final

from dissect.protocols.s7.diagnostic_tables import EVENT_CLASSES, EVENTS
from dissect.protocols.s7.parameters import PUSH, UserdataHead
from dissect.protocols.s7.values import date_and_time
from dissect.wire.codes import CodeTable
from dissect.wire.layout import HOLDS_TIME, Field, Layout
from dissect.wire.part import Cursor, Part
from dissect.wire.text import hex_number

#: Whether an event came or went.
DIRECTIONS: Final = CodeTable("direction of an event", 1, [(0, "going", ""), (1, "coming", "")])

_EVENT: Final = "s7comm.cpu.diag_msg.eventid"

#: An entry of the diagnostic buffer.
DIAGNOSTIC_EVENT: Final = Layout(
    "diagnostic event",
    "reference section 4.5",
    [
        Field("event_class", 2, "Event class.", f"{_EVENT}.class", EVENT_CLASSES, (0xF000, 12)),
        Field("external_error", 2, "External error.", f"{_EVENT}.ident.exterr", None, (0x0800, 11), True),
        Field("internal_error", 2, "Internal error.", f"{_EVENT}.ident.interr", None, (0x0400, 10), True),
        Field(
            "in_buffer", 2, "Entered into the diagnostic buffer.", f"{_EVENT}.ident.diagbuf", None, (0x0200, 9), True
        ),
        Field("coming", 2, "Coming or going.", f"{_EVENT}.ident.entleave", DIRECTIONS, (0x0100, 8), True),
        Field("event_number", 2, "Number within the class.", f"{_EVENT}.nr", None, (0x00FF, 0), True),
        Field("priority_class", 1, "Priority class.", "s7comm.cpu.diag_msg.prioclass", decimal=True),
        Field("ob", 1, "OB number.", "s7comm.cpu.diag_msg.obnumber", decimal=True),
        Field("data_id", 2, "DatID: what the information is.", "s7comm.cpu.diag_msg.datid"),
        Field("info1", 2, "Additional information 1.", "s7comm.cpu.diag_msg.info1"),
        Field("info2", 4, "Additional information 2.", "s7comm.cpu.diag_msg.info2"),
        Field("time", 8, "Time stamp, DATE_AND_TIME in BCD.", "s7comm.data.ts", means=date_and_time, holds=HOLDS_TIME),
    ],
)


#: Events of class 4 about mode transitions and H systems that state a STOP.
_STOPS: Final = frozenset((0x4303, 0x4304, 0x430A, 0x430D, 0x430F, 0x43D3, 0x45D8, 0x45D9, 0x45DA, 0x49D2, 0x49D4))
#: All other events of class 4 that state a STOP: their upper octet is one of these, and their lower octet is below
#: `_NO_STOP_FROM`, where the events of firmware and H systems begin.
_STOP_EVENTS: Final = frozenset((0x45, 0x49))
_NO_STOP_FROM: Final = 0xB0


def states_stop(event_id: int) -> bool:
    """Return whether an event states that a CPU goes to STOP, and why."""
    return event_id in _STOPS or (event_id >> 8 in _STOP_EVENTS and event_id & 0xFF < _NO_STOP_FROM)


def event_name(event_id: int) -> str:
    """Return the name of an event, or of its class if the event is unknown."""
    row = EVENTS.get(event_id)
    return row.name if row is not None else EVENT_CLASSES.name(event_id >> 12)


def event_id(part: Part) -> int:
    """Return the event id of a `DIAGNOSTIC_EVENT`, which is divided among its first fields; -1 if the part is too short."""
    return part.leading(2)


def event_note(part: Part) -> str:
    """Return the text for an entry of the diagnostic buffer, for example ``0x4302 STARTUP to RUN, DT#2023-…``."""
    number = event_id(part)
    if number < 0:
        return ""
    time = part.text("time")
    told = f"{hex_number(number, 4)} {event_name(number)}"
    return f"{told}, {time}" if time else told


def parse_diagnostic_message(cursor: Cursor, head: UserdataHead) -> None:
    """Parse the payload of a diagnostic message: one pushed entry of the diagnostic buffer."""
    if head.type != PUSH:
        cursor.rest()  # only pushes are known
        return
    part = cursor.take(DIAGNOSTIC_EVENT)
    if part is not None:
        part.note = event_note(part)
