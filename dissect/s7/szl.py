"""Read SZL (userdata group 4, subfunction 1): system status lists, asked for by id and index (reference section 4.5).

An answer is a head and records, all of the length that the head tells. The records of a list that is longer than a PDU come
in several answers, cut anywhere; only the first of them has the head. One answer alone tells as much as `starts_list` sees;
`dissect.transactions.multipart` joins them.
"""

from __future__ import annotations

from typing import Final

from dissect.s7.diagnostics import DIAGNOSTIC_EVENT, event_name, event_note
from dissect.s7.parameters import REQUEST, RESPONSE, UserdataHead
from dissect.s7.szl_communication import CAPABILITY_RECORDS, PROTECTION, STATUS_RECORDS
from dissect.s7.szl_modules import DP_MASTER, DP_MASTER_EXTENDED, MANY_STATIONS, MODULE_STATUS, STATIONS
from dissect.s7.szl_records import (
    BLANK,
    BLOCK_TYPE,
    CHARACTERISTIC,
    COMPONENT,
    COMPONENT_RECORDS,
    ETHERNET,
    IDENTIFICATION,
    LED,
    MEMORY_AREA,
    OPERATING_MODE,
    RECORD,
    RECORD_REST,
    RECORDS,
    SYSTEM_AREA,
    SZL_ID,
    version_text,
)
from dissect.s7.szl_tables import HEAD_ONLY, INDEXES, MODULE_CLASSES, SZL_IDS
from dissect.wire.layout import Field, Layout
from dissect.wire.octets import u16
from dissect.wire.part import Cursor, Part
from dissect.wire.text import hex_number

_ID: Final = Field("szl_id", 2, "Which list, and which extract of it.", "s7comm.data.userdata.szl_id", SZL_IDS)
_INDEX: Final = Field("szl_index", 2, "What to pick from the list, 0 nothing.", "s7comm.data.userdata.szl_index")

SZL_REQUEST: Final = Layout("SZL request", "reference section 4.5", [_ID, _INDEX])
SZL_HEAD: Final = Layout(
    "SZL head",
    "reference section 4.5",
    [
        _ID,
        _INDEX,
        Field("record_length", 2, "Bytes of each record.", "s7comm.data.userdata.szl_id.partlist_len", decimal=True),
        Field(
            "record_count", 2, "Records of the whole list.", "s7comm.data.userdata.szl_id.partlist_cnt", decimal=True
        ),
    ],
)

#: Lists of small records that say something only together; their records have no note.
_PLAIN: Final = (SZL_ID, CHARACTERISTIC, RECORD)

_COMPONENTS: Final = 0x1C
_CAPABILITY: Final = 0x31
_COMMUNICATION: Final = 0x32
#: Octets of every record of these lists.
_INDEXED_SIZES: Final[dict[int, int]] = {_COMPONENTS: 34, _CAPABILITY: 40, _COMMUNICATION: 40}


def module_class(szl_id: int) -> int:
    """Return the kind of module that a list is of (`MODULE_CLASSES`)."""
    return szl_id >> 12


def extract(szl_id: int) -> int:
    """Return which part of the partial list an id is for, 0xF for its head alone."""
    return (szl_id >> 8) & 0xF


def stated_size(head: bytes) -> int:
    """Return how many octets an SZL has whose first octets are ``head``, by its own head; -1 where that says nothing."""
    if len(head) < SZL_HEAD.size or extract(u16(head, 0)) == HEAD_ONLY:
        return -1
    return SZL_HEAD.size + u16(head, 4) * u16(head, 6)


def shortage(szl_id: int, length: int, count: int, size: int) -> str:
    """Return in words that an SZL has fewer octets of records than its head states."""
    return f"SZL 0x{szl_id:04x} states {count} records of {length} bytes, {size} bytes are there"


def list_note(szl_id: int, index: int) -> str:
    """Return what a list is for a person, for example ``SZL 0x0131 communication capability, index 1 general``."""
    told = f"SZL {hex_number(szl_id, 4)}"
    row = SZL_IDS.get(szl_id)
    if row is not None:
        told += f" {row.name}"
    if module_class(szl_id):
        told += f" ({MODULE_CLASSES.name(module_class(szl_id))})"
    part = extract(szl_id)
    if part == HEAD_ONLY:
        told += ", head only"
    table = INDEXES.get(szl_id & 0xFF)
    if index and table is not None and part not in {0, HEAD_ONLY} and index in table:
        return f"{told}, {table.name(index)}"
    return f"{told}, index {hex_number(index, 4)}" if index else told


def parse_szl(cursor: Cursor, head: UserdataHead) -> None:
    """Cut the payload of Read SZL."""
    if head.type == REQUEST:
        part = cursor.take(SZL_REQUEST)
        if part is not None:
            part.note = list_note(part.number("szl_id"), part.number("szl_index"))
    elif head.type != RESPONSE:
        cursor.rest()  # a list that nobody asked for is not known
    elif head.last_data_unit == 0:
        if head.data_unit_ref:
            cursor.rest("continuation")
        else:
            _take_list(cursor, True)
    elif starts_list(cursor):
        _take_list(cursor, False)
    else:
        cursor.rest("continuation")


def starts_list(cursor: Cursor) -> bool:
    """Tell whether octets of which more are to come begin a list: a head is there and announces more than there is.

    A list whose records are known has to announce records of their size; so the middle of a list hardly ever looks like one.
    """
    if cursor.left < SZL_HEAD.size:
        return False
    szl_id = u16(cursor.octets, cursor.at)
    length = u16(cursor.octets, cursor.at + 4)
    count = u16(cursor.octets, cursor.at + 6)
    known = record_size(szl_id)
    return (
        module_class(szl_id) in MODULE_CLASSES
        and extract(szl_id) != HEAD_ONLY
        and (known == 0 or known == length)
        and length * count > cursor.left - SZL_HEAD.size
    )


def record_layout(szl_id: int, octets: bytes, at: int, end: int) -> Layout:
    """Return the layout of the record ``octets[at:end]`` of a list; `RECORD` when it is not known."""
    partial = szl_id & 0xFF
    if partial not in _INDEXED_SIZES:
        return RECORDS.get(partial, RECORD)
    if end - at < 2:
        return RECORD
    index = u16(octets, at)
    if partial == _COMPONENTS:
        return COMPONENT_RECORDS.get(index & 0xFF, COMPONENT)
    known = CAPABILITY_RECORDS if partial == _CAPABILITY else STATUS_RECORDS
    return known.get(index, RECORD)


def record_size(szl_id: int) -> int:
    """Return the octets that a record of a list has by its layout, 0 when it is not known or open."""
    partial = szl_id & 0xFF
    size = _INDEXED_SIZES.get(partial)
    if size is not None:
        return size
    layout = RECORDS.get(partial)
    return layout.size if layout is not None and not layout.open else 0


def _take_list(cursor: Cursor, whole: bool) -> None:
    """Cut the head of a list and its records; one that is not ``whole`` may end within a record."""
    head = cursor.take(SZL_HEAD)
    if head is None:
        return
    szl_id = head.number("szl_id")
    length = head.number("record_length")
    count = head.number("record_count")
    head.note = list_note(szl_id, head.number("szl_index"))
    if extract(szl_id) == HEAD_ONLY or length == 0:
        return
    for number in range(count):
        if cursor.left == 0:
            if whole:
                cursor.tell("count_mismatch", "record_count", count, number)
            return
        if cursor.left < length:
            if whole:
                cursor.tell("too_short", "SZL record", length, cursor.left)
            cursor.rest("first bytes of a record")
            return
        _take_record(cursor, szl_id, length)


def _take_record(cursor: Cursor, szl_id: int, size: int) -> None:
    """Cut one record of ``size`` octets, which are there: the fields that fit, and what stands behind those known."""
    layout = record_layout(szl_id, cursor.octets, cursor.at, cursor.at + size)
    end = cursor.at + size
    if layout.open:
        part = Part(layout, cursor.octets, cursor.at, end)
    else:
        part = Part(layout, cursor.octets, cursor.at, min(end, cursor.at + layout.size))
    cursor.parts.append(part)
    cursor.at = part.end
    part.note = record_note(part)
    if cursor.at < end:
        cursor.take(RECORD_REST, end - cursor.at)


def record_note(part: Part) -> str:
    """Return what a record says to a person in a few words; empty where it takes the whole record to say anything."""
    layout = part.layout
    if layout in _PLAIN:
        return ""
    if layout is DIAGNOSTIC_EVENT:
        return event_note(part)
    if layout is IDENTIFICATION:
        return _identification(part)
    if layout is LED:
        return _led(part)
    if layout is OPERATING_MODE:
        return _operating_mode(part)
    if layout is PROTECTION:
        level = part.text("level") or str(part.number("level"))
        return f"protection {part.number('level')} ({level}), switch {part.text('switch')}"
    if layout is ETHERNET:
        return f"{part.text('ip_address')}, {part.text('mac_address')}"
    if layout is STATIONS or layout is MANY_STATIONS:
        return f"stations {part.text('stations')}"
    return _counted(part)


def _counted(part: Part) -> str:
    """Return the note of a record that has a number of something, or a text."""
    layout = part.layout
    if layout is MEMORY_AREA:
        return f"{_name(part, 'index')} {part.number('memory_size')} bytes"
    if layout is SYSTEM_AREA:
        return f"{_name(part, 'index')} {part.number('quantity')}"
    if layout is BLOCK_TYPE:
        return f"{_name(part, 'index')}: at most {part.number('blocks')}"
    if layout is MODULE_STATUS:
        return f"module at {hex_number(max(0, part.number('place')), 4)}/{hex_number(max(0, part.number('slot')), 4)}"
    if layout is DP_MASTER or layout is DP_MASTER_EXTENDED:
        return f"DP master system {part.number('system_id')}"
    text = part.text("text")
    if text:
        return f"{_name(part, 'index')} {text}"
    return _name(part, "index") if part.find("index") is not None else ""


def _name(part: Part, field: str) -> str:
    """Return the meaning of a field, or its number."""
    return part.text(field) or hex_number(max(0, part.number(field)), 4)


def _identification(part: Part) -> str:
    """Return the order number and the version, for example ``6ES7 315-2EH14-0AB0, basic firmware V3.2.6``."""
    number = part.text("order_number")
    version = part.number("version")
    release = part.number("release")
    told = _name(part, "index")
    major = version_text(version) if version > 0 else ""
    if major and release >= 0:
        told += f" {major}.{release >> 8}.{release & 0xFF}"
    elif release >= 0 and release != BLANK:
        told += f" version {release}"
    return f"{number}, {told}" if number else told


def _led(part: Part) -> str:
    """Return an LED and what it does, for example ``RUN on``."""
    flashing = part.number("flashing")
    state = _name(part, "state")
    return f"{_name(part, 'led')} {state}" + (f", {_name(part, 'flashing')}" if flashing > 0 else "")


def _operating_mode(part: Part) -> str:
    """Return the mode and how it came about, for example ``RUN, before: STARTUP, event 0x4302 STARTUP to RUN``."""
    event = part.number("event")
    told = part.text("mode") or f"mode {part.number('mode')}"
    if part.number("previous") > 0:
        told += f", before: {_name(part, 'previous')}"
    return f"{told}, event {hex_number(event, 4)} {event_name(event)}" if event > 0 else told
