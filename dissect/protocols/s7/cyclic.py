"""Cyclic services (userdata group 2): variables that are sent periodically or when they change (reference section 4.7)."""

from __future__ import annotations

from typing import Final

from dissect.protocols.s7.data_parts import RETURN_CODE, take_data_items, take_request_items
from dissect.protocols.s7.layouts import DATA_ITEM
from dissect.protocols.s7.parameters import REQUEST, RESPONSE, UserdataHead
from dissect.protocols.s7.tables import CHANGE_DRIVEN_MODIFY, CYCLIC_TIME_BASES, CYCLIC_TRANSFER, SUCCESS
from dissect.wire.layout import COUNTS_PARTS, COUNTS_REST, HOLDS_VALUE, REST, Field, Layout, plain
from dissect.wire.part import Cursor
from dissect.wire.text import hex_number

#: Unit of the interval in ms, by time base.
_BASES_MS: Final[dict[int, int]] = {0: 100, 1: 1000, 2: 10_000}

#: Wireshark reads the reserved octet as part of the count.
_RESERVED: Final = Field("reserved", 1, "0.")

#: Head of a request for cyclic or change driven transfer.
CYCLIC_REQUEST: Final = Layout(
    "cyclic request",
    "reference section 4.7",
    [
        _RESERVED,
        Field("item_count", 1, "Items that follow.", "s7comm.param.itemcount"),
        Field("time_base", 1, "Unit of the interval.", "s7comm.cyclic.interval_timebase", CYCLIC_TIME_BASES),
        Field("factor", 1, "Interval in units of the time base.", "s7comm.cyclic.interval_time", decimal=True),
    ],
)
#: Head of the values in an answer or a push.
CYCLIC_VALUES: Final = Layout(
    "cyclic values",
    "reference section 4.7",
    [
        _RESERVED,
        Field("item_count", 1, "Data items that follow.", "s7comm.param.itemcount", counts=DATA_ITEM.name),
    ],
)
CYCLIC_UNSUBSCRIBE: Final = Layout(
    "unsubscribe",
    "reference section 4.7",
    [
        Field("function", 1, "5 in captures.", "s7comm.cyclic.function"),
        Field("job", 1, "The sequence number of the answer that began it.", "s7comm.cyclic.job_id", decimal=True),
    ],
)
#: Head of a record request and of its answer; it has no interval.
RECORD_HEAD: Final = Layout(
    "data record",
    "reference section 4.7",
    [
        Field("reserved", 1, "0.", "s7comm.readrec.reserved1", means=plain),
        Field("item_count", 1, "1; devices accept no more.", "s7comm.param.itemcount"),
    ],
)
#: The transport size between the return code and the status of a data record that was read.
RECORD_TRANSPORT: Final = Layout("data record transport size", "reference section 4.7", [DATA_ITEM.fields[1]])
RECORD_STATUS: Final = Layout(
    "data record status",
    "reference section 4.7",
    [
        Field("status_length", 1, "Bytes of the status.", "s7comm.readrec.statuslen", counts=COUNTS_REST),
        Field("status", REST, "As STATUS of SFB 52.", "s7comm.readrec.status"),
    ],
)
RECORD_NO_STATUS: Final = Layout(
    "data record status",
    "reference section 4.7",
    [Field("status_length", 1, "0: no status.", "s7comm.readrec.statuslen", decimal=True)],
)
RECORD_LENGTH: Final = Layout(
    "data record length",
    "reference section 4.7",
    [Field("record_length", 2, "Bytes of the record.", "s7comm.readrec.len", counts=COUNTS_PARTS)],
)
RECORD: Final = Layout(
    "record",
    "reference section 4.7",
    [Field("record", REST, "As the module gave it.", "s7comm.readrec.data", holds=HOLDS_VALUE)],
)


def interval(time_base: int, factor: int) -> str:
    """Return the interval of a cyclic job as text, for example ``500 ms`` or ``1 s``."""
    unit = _BASES_MS.get(time_base)
    if unit is None:
        return f"{factor} x time base {time_base}"
    ms = unit * factor
    return f"{ms // 1000} s" if ms % 1000 == 0 else f"{ms} ms"


def parse_transfer(cursor: Cursor, head: UserdataHead) -> None:
    """Parse cyclic transfer, change-driven transfer and its modification: items in a request, values in an answer or push."""
    if head.continues:
        cursor.rest("continuation")
    elif head.type == REQUEST:
        part = cursor.take(CYCLIC_REQUEST)
        if part is not None:
            every = interval(part.number("time_base"), part.number("factor"))
            part.note = f"every {every}" if head.subfunction == CYCLIC_TRANSFER else f"on change, checked every {every}"
            if head.subfunction == CHANGE_DRIVEN_MODIFY:
                part.note = f"job {head.sequence}, {part.note}"
            take_request_items(cursor, part.number("item_count"))
    else:
        part = cursor.take(CYCLIC_VALUES, note=f"job {head.sequence}")
        if part is not None:
            take_data_items(cursor, part.number("item_count"), True)


def parse_unsubscribe(cursor: Cursor, head: UserdataHead) -> None:
    """Parse the request that ends a cyclic job; its answer has no payload."""
    if head.type == REQUEST:
        part = cursor.take(CYCLIC_UNSUBSCRIBE)
        if part is not None:
            part.note = f"job {part.number('job')}"


def parse_record(cursor: Cursor, head: UserdataHead) -> None:
    """Parse the reading of a data record: one item in the request, a status and the record in the answer."""
    if head.continues or head.type not in {REQUEST, RESPONSE}:
        cursor.rest("continuation" if head.continues else "")  # a push of it is not known
        return
    part = cursor.take(RECORD_HEAD)
    if part is None or part.number("item_count") < 1:
        return
    if head.type == REQUEST:
        take_request_items(cursor, part.number("item_count"))
        return
    code = cursor.take(RETURN_CODE)
    if code is None:
        return
    good = code.number("return_code") == SUCCESS
    if good:
        cursor.take(RECORD_TRANSPORT)
    else:
        code.note = f"refused: {code.text('return_code') or hex_number(code.number('return_code'), 2)}"
    if cursor.left > 0:
        status = cursor.octets[cursor.at]
        told = cursor.take(RECORD_STATUS if status else RECORD_NO_STATUS, 1 + status)
        if told is not None and told.octets("status").strip(b"\0"):
            told.note = f"STATUS {told.octets('status').hex()}"
        if status == 0:
            cursor.take_fill(1)
    length = cursor.take(RECORD_LENGTH) if good else None
    if length is not None:
        length.note = f"{length.number('record_length')} bytes"
        if length.number("record_length"):
            cursor.take(RECORD, length.number("record_length"))
