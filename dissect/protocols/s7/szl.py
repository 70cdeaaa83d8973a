"""Read SZL (userdata group 4, subfunction 1): system status lists, requested by id and index (reference section 4.5).

An answer is a head and records, which all have the length stated in the head. A list longer than a PDU comes in several
answers, split at any octet; only the first one has the head. `dissect.engine.transactions.multipart` joins them; for a single
one, `starts_list` decides what is shown.
"""

from __future__ import annotations

from typing import Final

from dissect.protocols.s7.parameters import REQUEST, RESPONSE, UserdataHead
from dissect.protocols.s7.szl_communication import CAPABILITY_RECORDS, STATUS_RECORDS
from dissect.protocols.s7.szl_notes import extract, list_note, module_class, record_note
from dissect.protocols.s7.szl_records import COMPONENT, COMPONENT_RECORDS, RECORD, RECORD_REST, RECORDS
from dissect.protocols.s7.szl_tables import HEAD_ONLY, MODULE_CLASSES, SZL_IDS
from dissect.wire.layout import Field, Layout
from dissect.wire.octets import u16
from dissect.wire.part import Cursor, Part

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

_COMPONENTS: Final = 0x1C
_CAPABILITY: Final = 0x31
_COMMUNICATION: Final = 0x32
#: Octets of each record of these lists.
_INDEXED_SIZES: Final[dict[int, int]] = {_COMPONENTS: 34, _CAPABILITY: 40, _COMMUNICATION: 40}
#: Lists with records that continue after the known fields, in a different way for each module.
_LONGER: Final = frozenset((0xB2, 0xB3))


def stated_size(head: bytes) -> int:
    """Return the size of an SZL in octets as stated by its ``head``; -1 if that does not state one."""
    if len(head) < SZL_HEAD.size or extract(u16(head, 0)) == HEAD_ONLY:
        return -1
    return SZL_HEAD.size + u16(head, 4) * u16(head, 6)


def shortage(szl_id: int, length: int, count: int, size: int) -> str:
    """Return a text if an SZL has fewer octets of records than its head states; empty otherwise."""
    return f"SZL 0x{szl_id:04x} states {count} records of {length} bytes, {size} bytes are there"


def parse_szl(cursor: Cursor, head: UserdataHead) -> None:
    """Parse the payload of Read SZL."""
    if head.type == REQUEST:
        part = cursor.take(SZL_REQUEST)
        if part is not None:
            part.note = list_note(part.number("szl_id"), part.number("szl_index"))
    elif head.type != RESPONSE:
        cursor.rest()  # a list without a request is not known
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
    """Return whether incomplete octets begin with the head of a list, which announces more octets than there are.

    If the records of the list are known, the head must state their size. So the middle of a list is hardly ever taken for a
    head.
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
    """Return the layout of the record ``octets[at:end]`` of a list; `RECORD` if it is unknown."""
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
    """Return the size of a record by the layout of its list; 0 if it is unknown or variable."""
    partial = szl_id & 0xFF
    if partial in _LONGER:
        return 0
    size = _INDEXED_SIZES.get(partial)
    if size is not None:
        return size
    layout = RECORDS.get(partial)
    return layout.size if layout is not None and not layout.open else 0


def _take_list(cursor: Cursor, whole: bool) -> None:
    """Parse the head of a list and its records; if it is not ``whole``, it may end within a record."""
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
        _take_record(cursor, szl_id, head.number("szl_index"), length)


def _take_record(cursor: Cursor, szl_id: int, szl_index: int, size: int) -> None:
    """Parse one complete record of ``size`` octets: the known fields that fit, then the rest."""
    layout = record_layout(szl_id, cursor.octets, cursor.at, cursor.at + size)
    end = cursor.at + size
    if layout.open:
        part = Part(layout, cursor.octets, cursor.at, end)
    else:
        part = Part(layout, cursor.octets, cursor.at, min(end, cursor.at + layout.size))
    cursor.parts.append(part)
    cursor.at = part.end
    part.note = record_note(part, szl_id, szl_index)
    if cursor.at < end:
        cursor.take(RECORD_REST, end - cursor.at)
