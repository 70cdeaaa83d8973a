"""Says which structures the body of each function has (docs/s7plus.md). `parse_contents` never raises.

This is not the hot path: contents are read when they are needed. The tables at the end name the reader of each function.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from dissect.s7plus import layouts
from dissect.s7plus.contents import Contents
from dissect.s7plus.ending import read_end
from dissect.s7plus.ids import id_name
from dissect.s7plus.message import PlusPdu, fixed_part
from dissect.s7plus.notifications import read_event, read_notification
from dissect.s7plus.pieces import (
    take_addresses,
    take_count,
    take_ids,
    take_integrity_id,
    take_object_id,
    take_objects,
    take_qualifier,
    take_read_addresses,
    take_refusals,
    take_reserved,
    take_return_value,
    take_value,
    take_values,
    take_values_to_end,
)
from dissect.s7plus.tables import (
    BEGIN_SEQUENCE,
    CREATE_OBJECT,
    DELETE_OBJECT,
    END_SEQUENCE,
    EXPLORE,
    FUNCTIONS,
    GET_LINK,
    GET_MULTI_VARIABLES,
    GET_VAR_SUBSTREAMED,
    GET_VARIABLE,
    INVOKE,
    KEEP_ALIVE,
    NOTIFICATION,
    OBJECT_TAG,
    OPCODES,
    REQUEST,
    RESPONSE,
    SET_MULTI_VARIABLES,
    SET_VAR_SUBSTREAMED,
    SET_VARIABLE,
    SYSTEM_EVENT,
    V1,
    V2,
    V3,
    VERSIONS,
)
from dissect.s7plus.value_reading import read_members, read_value
from dissect.s7plus.walk import EXHAUSTED, FormatError, Walk, Wanted
from dissect.wire.varint import VLQ, VLQ64, read_varint

#: Reads the body of a function, up to the end of the PDU (`dissect.s7plus.ending`).
Reader = Callable[[Walk, Contents], None]

_DETAILS: Final = 62  # bit of the return value: an object with details follows


def parse_contents(pdu: PlusPdu, shown: bool = True, most: int = 0, wanted: Wanted | None = None) -> Contents:
    """Read the contents of a PDU, which follow its head. Never raises.

    Offsets are within ``pdu.data``. If ``shown`` is False, no parts are made. ``most`` bounds the work (`Walk`): if a PDU takes
    more, its content stays unknown (`Contents.exhausted`). ``wanted`` names what is needed; the rest is left out.
    """
    found = Contents(pdu.version, pdu.return_value, pdu.frame_starts)
    if not V1 <= pdu.version <= V3 and (pdu.version == KEEP_ALIVE or pdu.version not in VERSIONS):
        return found
    head = fixed_part(pdu)
    size = head.size if head is not None else 1
    if len(pdu.data) < size:
        return found
    walk = Walk(pdu.data, size, len(pdu.data), shown, most, wanted)
    try:
        _read(walk, found, pdu)
        walk.rest(found.malformed)
    except FormatError as fault:
        found.exhausted = fault.reason == EXHAUSTED
        walk.rest(found.malformed, None if _blank(pdu, size) else fault, "snaplen" if pdu.cut else "pdu")
    found.parts = walk.parts
    found.blobs = walk.blobs
    return found


def _blank(pdu: PlusPdu, start: int) -> bool:
    """Return whether contents are all zeros: `s7dissect anonymize` leaves such, after the return value, which it keeps."""
    octets = pdu.data
    if pdu.return_value >= 0:
        _, start = read_varint(octets, start, len(octets), VLQ64)
    return start < len(octets) and octets.count(0, start) == len(octets) - start


def _read(walk: Walk, found: Contents, pdu: PlusPdu) -> None:
    if pdu.version == SYSTEM_EVENT:
        read_event(walk)
        found.whole = True
        return
    if pdu.opcode == NOTIFICATION:
        read_notification(walk, found, pdu)
        found.whole = walk.left == 0
        return
    request: bool = pdu.opcode == REQUEST
    if not request:
        if pdu.opcode != RESPONSE and pdu.opcode not in OPCODES:
            return
        take_return_value(walk)
    reader = (_REQUESTS if request else _RESPONSES).get(pdu.function)
    if reader is None:
        return  # no capture shows such a body
    reader(walk, found)
    read_end(walk, found, pdu)
    found.whole = walk.left == 0


def is_known(pdu: PlusPdu) -> bool:
    """Return False for functions that have a name, but whose body no capture and no source describes."""
    if pdu.function not in FUNCTIONS:
        return True
    return pdu.function in (_REQUESTS if pdu.opcode == REQUEST else _RESPONSES)


# ---- functions ------------------------------------------------------------------------------------------------------


def _create_object(walk: Walk, found: Contents) -> None:
    take_object_id(walk, found)
    take_value(walk, found)
    take_reserved(walk, 4)
    if found.version == V3 or (found.version == V2 and walk.peek() != OBJECT_TAG):
        take_integrity_id(walk, found)
    take_objects(walk, found)


def _object_created(walk: Walk, found: Contents) -> None:
    at = walk.at
    count = walk.u8("count")
    walk.part(layouts.COUNT_OCTET, at)
    for _ in range(count):
        at = walk.at
        id_ = walk.number(VLQ, "object id")
        found.ids.append(id_)
        walk.part(layouts.OBJECT_ID_VLQ, at, id_name(id_) if walk.shown else "")
    if found.version == V1:
        take_objects(walk, found)


def _delete_object(walk: Walk, found: Contents) -> None:
    take_object_id(walk, found)
    take_reserved(walk, 1)
    take_qualifier(walk)


def _object_deleted(walk: Walk, found: Contents) -> None:
    take_object_id(walk, found)
    if found.return_value >> _DETAILS & 1:
        take_objects(walk, found)


def _get_multi(walk: Walk, found: Contents) -> None:
    take_read_addresses(walk, found)


def _multi_got(walk: Walk, found: Contents) -> None:
    take_values_to_end(walk, found)
    take_refusals(walk, found)


def _set_multi(walk: Walk, found: Contents) -> None:
    take_values(walk, found, take_addresses(walk, found))
    take_reserved(walk, 1)
    take_qualifier(walk)


def _multi_set(walk: Walk, found: Contents) -> None:
    take_refusals(walk, found)


def _set_variable(walk: Walk, found: Contents) -> None:
    take_object_id(walk, found)
    take_ids(walk, found, take_count(walk))
    take_value(walk, found)
    take_qualifier(walk)
    take_reserved(walk, 1)


def _get_variable(walk: Walk, found: Contents) -> None:
    take_object_id(walk, found)
    take_ids(walk, found, take_count(walk))
    take_qualifier(walk)


def _variable_got(walk: Walk, found: Contents) -> None:
    take_value(walk, found)


def _get_stream(walk: Walk, found: Contents) -> None:
    take_object_id(walk, found)
    wanted = read_value(walk, layouts.VALUE, walk.at)
    content = wanted.content
    if isinstance(content, list):
        found.ids = [id_ for id_ in content if isinstance(id_, int)]
    take_qualifier(walk)
    take_reserved(walk, 2)


def _stream_got(walk: Walk, found: Contents) -> None:
    take_reserved(walk, 1)
    take_value(walk, found)


def _set_stream(walk: Walk, found: Contents) -> None:
    _get_stream(walk, found)
    take_value(walk, found)
    # Whole frames follow, each of which is a piece of the stream. The end of the PDU is after the last one.
    starts = found.frame_starts
    while walk.at in starts:
        at = walk.at
        size = walk.counted(VLQ, "piece")
        begin = walk.at
        walk.take(size, "piece")
        found.pieces.append((begin, walk.at))
        walk.part(layouts.PIECE, at, f"{size} bytes")


def _explore(walk: Walk, found: Contents) -> None:
    at = walk.at
    found.object_id = walk.fixed(4, "object id")
    walk.number(VLQ, "id")
    walk.take(3, "explore")
    walk.part(layouts.EXPLORE_HEAD, at, id_name(found.object_id) if walk.shown else "")
    while True:
        at = walk.at
        filters = walk.u8("filters")
        count = walk.u8("id count")
        walk.part(layouts.EXPLORE_GROUP, at)
        for _ in range(filters):
            at = walk.at
            walk.take(5, "filter")
            walk.part(layouts.EXPLORE_FILTER, at)
            found.list.extend(read_members(walk))
        take_ids(walk, found, count)
        if filters == 0:
            return


def _explored(walk: Walk, found: Contents) -> None:
    take_object_id(walk, found)
    if found.version == V3:
        take_integrity_id(walk, found)
    take_objects(walk, found)


def _get_link(walk: Walk, found: Contents) -> None:
    at = walk.at
    found.object_id = walk.fixed(4, "object id")
    found.ids = [walk.number(VLQ, "relation")]
    walk.take(2, "reserved")
    note = f"{id_name(found.object_id)} {id_name(found.ids[0])}" if walk.shown else ""
    walk.part(layouts.LINK_REQUEST, at, note)


def _link_got(walk: Walk, found: Contents) -> None:
    at = walk.at
    count = walk.u8("count")
    walk.part(layouts.COUNT_OCTET, at)
    for _ in range(count):
        at = walk.at
        found.ids.append(walk.fixed(4, "object id"))
        walk.part(layouts.OBJECT_ID, at, id_name(found.ids[-1]) if walk.shown else "")


def _begin_sequence(walk: Walk, found: Contents) -> None:
    at = walk.at
    walk.u8("type")
    walk.part(layouts.SEQUENCE_TYPE, at)
    if found.version == V1:
        return
    at = walk.at
    kind = walk.fixed(2, "kind")
    walk.part(layouts.SEQUENCE_KIND, at)
    if kind != 1:
        take_object_id(walk, found)
        return
    at = walk.at
    while walk.peek() != OBJECT_TAG and walk.at - at < 2:
        walk.u8("object")
    walk.part(layouts.RESERVED, at)
    take_objects(walk, found)


def _sequence_begun(walk: Walk, found: Contents) -> None:
    if found.version == V1:
        return
    at = walk.at
    walk.take(2, "kind")
    walk.part(layouts.SEQUENCE_KIND, at)
    take_object_id(walk, found)


def _end_sequence(walk: Walk, _: Contents) -> None:
    take_reserved(walk, 2)


def _invoke(walk: Walk, found: Contents) -> None:
    at = walk.at
    found.object_id = walk.fixed(4, "sub session")
    found.method = walk.fixed(4, "method")
    walk.part(layouts.INVOKE_HEAD, at, id_name(found.method) if walk.shown else "")
    take_values_to_end(walk, found)
    take_reserved(walk, 1)


def _invoked(walk: Walk, found: Contents) -> None:
    take_return_value(walk)
    take_return_value(walk)
    if walk.peek() != 1:
        take_return_value(walk)
    take_values_to_end(walk, found)
    take_reserved(walk, 1)


def _nothing(_walk: Walk, _found: Contents) -> None:
    """There is no body: the end of the PDU follows the head or the return value."""


_REQUESTS: Final[dict[int, Reader]] = {
    EXPLORE: _explore,
    CREATE_OBJECT: _create_object,
    DELETE_OBJECT: _delete_object,
    SET_VARIABLE: _set_variable,
    GET_VARIABLE: _get_variable,
    GET_LINK: _get_link,
    SET_MULTI_VARIABLES: _set_multi,
    GET_MULTI_VARIABLES: _get_multi,
    BEGIN_SEQUENCE: _begin_sequence,
    END_SEQUENCE: _end_sequence,
    INVOKE: _invoke,
    SET_VAR_SUBSTREAMED: _set_stream,
    GET_VAR_SUBSTREAMED: _get_stream,
}

_RESPONSES: Final[dict[int, Reader]] = {
    EXPLORE: _explored,
    CREATE_OBJECT: _object_created,
    DELETE_OBJECT: _object_deleted,
    SET_VARIABLE: _nothing,
    GET_VARIABLE: _variable_got,
    GET_LINK: _link_got,
    SET_MULTI_VARIABLES: _multi_set,
    GET_MULTI_VARIABLES: _multi_got,
    BEGIN_SEQUENCE: _sequence_begun,
    END_SEQUENCE: _nothing,
    INVOKE: _invoked,
    SET_VAR_SUBSTREAMED: _nothing,
    GET_VAR_SUBSTREAMED: _stream_got,
}
