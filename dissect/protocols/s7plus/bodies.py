"""Reads the contents of a PDU by the elements in `dissect.protocols.s7plus.grammar`. `parse_contents` never raises.

This is not the hot path: contents are read only when they are needed.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from dissect.protocols.s7plus import layouts
from dissect.protocols.s7plus.contents import Contents
from dissect.protocols.s7plus.ending import read_end
from dissect.protocols.s7plus.grammar import DETAILS_BIT, ELEMENTS, END, body_of
from dissect.protocols.s7plus.ids import id_name
from dissect.protocols.s7plus.message import PlusPdu, fixed_part
from dissect.protocols.s7plus.notifications import read_event, read_notification
from dissect.protocols.s7plus.pieces import (
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
from dissect.protocols.s7plus.tables import (
    FUNCTIONS,
    KEEP_ALIVE,
    NOTIFICATION,
    OBJECT_TAG,
    OPCODES,
    REQUEST,
    RESPONSE,
    SYSTEM_EVENT,
    V1,
    V2,
    V3,
    VERSIONS,
)
from dissect.protocols.s7plus.value_reading import read_members, read_value
from dissect.protocols.s7plus.walk import EXHAUSTED, FormatError, Walk, Wanted
from dissect.wire.varint import VLQ, VLQ64, read_varint

#: Reads an element of a body.
Reader = Callable[[Walk, Contents], None]


def parse_contents(pdu: PlusPdu, shown: bool = True, most: int = 0, wanted: Wanted | None = None) -> Contents:
    """Read the contents of a PDU, which follow its head. Never raises.

    Offsets are within ``pdu.data``. If ``shown`` is False, no parts are made. ``most`` limits the work (`Walk`): if a PDU needs
    more, its content stays unknown (`Contents.exhausted`). ``wanted`` names the needed parts; the others are omitted.
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
    """Return whether contents are all zeros, as `s7dissect anonymize` leaves them, after the return value, which it keeps."""
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
    place = body_of(pdu.function, request)
    if place == 0:
        return  # no capture shows such a body
    while ELEMENTS[place] != END:
        _READERS[ELEMENTS[place]](walk, found)
        place += 1
    read_end(walk, found, pdu)
    found.whole = walk.left == 0


def is_known(pdu: PlusPdu) -> bool:
    """Return False for functions that have a name, but whose body is not described by any capture or source."""
    return pdu.function not in FUNCTIONS or body_of(pdu.function, pdu.opcode == REQUEST) > 0


# ---- elements (dissect.protocols.s7plus.grammar), in the order of their numbers
# ---------------------------------------------------


def _qualifier(walk: Walk, _: Contents) -> None:
    take_qualifier(walk)


def _targets(walk: Walk, found: Contents) -> None:
    found.expected = take_addresses(walk, found)


def _written(walk: Walk, found: Contents) -> None:
    take_values(walk, found, found.expected)


def _ids(walk: Walk, found: Contents) -> None:
    take_ids(walk, found, take_count(walk))


def _path(walk: Walk, found: Contents) -> None:
    content = read_value(walk, layouts.VALUE, walk.at).content
    if isinstance(content, list):
        found.ids = [id_ for id_ in content if isinstance(id_, int)]


def _reserved_1(walk: Walk, _: Contents) -> None:
    take_reserved(walk, 1)


def _reserved_2(walk: Walk, _: Contents) -> None:
    take_reserved(walk, 2)


def _reserved_4(walk: Walk, _: Contents) -> None:
    take_reserved(walk, 4)


def _objects_v1(walk: Walk, found: Contents) -> None:
    if found.version == V1:
        take_objects(walk, found)


def _details(walk: Walk, found: Contents) -> None:
    if found.return_value >> DETAILS_BIT & 1:
        take_objects(walk, found)


def _integrity_v3(walk: Walk, found: Contents) -> None:
    if found.version == V3:
        take_integrity_id(walk, found)


def _integrity_early(walk: Walk, found: Contents) -> None:
    if found.version == V3 or (found.version == V2 and walk.peek() != OBJECT_TAG):
        take_integrity_id(walk, found)


def _made(walk: Walk, found: Contents) -> None:
    at = walk.at
    count = walk.u8("count")
    walk.part(layouts.COUNT_OCTET, at)
    for _ in range(count):
        at = walk.at
        id_ = walk.number(VLQ, "object id")
        found.ids.append(id_)
        walk.part(layouts.OBJECT_ID_VLQ, at, id_name(id_) if walk.shown else "")


def _from(walk: Walk, found: Contents) -> None:
    at = walk.at
    found.object_id = walk.fixed(4, "object id")
    walk.number(VLQ, "id")
    walk.take(3, "explore")
    walk.part(layouts.EXPLORE_HEAD, at, id_name(found.object_id) if walk.shown else "")


def _groups(walk: Walk, found: Contents) -> None:
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


def _link(walk: Walk, found: Contents) -> None:
    at = walk.at
    found.object_id = walk.fixed(4, "object id")
    found.ids = [walk.number(VLQ, "relation")]
    walk.take(2, "reserved")
    note = f"{id_name(found.object_id)} {id_name(found.ids[0])}" if walk.shown else ""
    walk.part(layouts.LINK_REQUEST, at, note)


def _linked(walk: Walk, found: Contents) -> None:
    at = walk.at
    count = walk.u8("count")
    walk.part(layouts.COUNT_OCTET, at)
    for _ in range(count):
        at = walk.at
        found.ids.append(walk.fixed(4, "object id"))
        walk.part(layouts.OBJECT_ID, at, id_name(found.ids[-1]) if walk.shown else "")


def _sequence(walk: Walk, found: Contents) -> None:
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


def _begun(walk: Walk, found: Contents) -> None:
    if found.version == V1:
        return
    at = walk.at
    walk.take(2, "kind")
    walk.part(layouts.SEQUENCE_KIND, at)
    take_object_id(walk, found)


def _call(walk: Walk, found: Contents) -> None:
    at = walk.at
    found.object_id = walk.fixed(4, "sub session")
    found.method = walk.fixed(4, "method")
    walk.part(layouts.INVOKE_HEAD, at, id_name(found.method) if walk.shown else "")


def _return(walk: Walk, _: Contents) -> None:
    take_return_value(walk)


def _return_or_item(walk: Walk, _: Contents) -> None:
    if walk.peek() != 1:
        take_return_value(walk)


def _stream(walk: Walk, found: Contents) -> None:
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


def _end(_walk: Walk, _found: Contents) -> None:
    """The end of a row is not an element."""


#: The reader of each element, by its number.
_READERS: Final[tuple[Reader, ...]] = (
    _end, take_read_addresses, _qualifier, take_values_to_end, take_refusals, take_object_id, _ids, take_value,
    _targets, _written, _path, _reserved_1, _reserved_2, _reserved_4, take_objects, _objects_v1, _details,
    _integrity_v3, _integrity_early, _made, _from, _groups, _link, _linked, _sequence, _begun, _call, _return,
    _return_or_item, _stream,
)  # fmt: skip
