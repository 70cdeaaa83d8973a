"""Reads notifications (values, refusals and objects by the number of their item, docs/s7plus.md) and system events."""

from __future__ import annotations

from mypy_extensions import i64

from dissect.protocols.s7plus import layouts
from dissect.protocols.s7plus.contents import Contents
from dissect.protocols.s7plus.ending import read_notification_end
from dissect.protocols.s7plus.grammar import (
    FORMS,
    NOTIFIED_OBJECTS,
    NOTIFIED_VALUE,
    REFERENCED,
    REFERENCED_VLQ,
    REFUSED,
    UNNAMED,
)
from dissect.protocols.s7plus.message import SHORT_HEADS, PlusPdu
from dissect.protocols.s7plus.objects import objects_of, read_elements
from dissect.protocols.s7plus.pieces import take_item
from dissect.protocols.s7plus.tables import V1
from dissect.protocols.s7plus.value_reading import read_value
from dissect.protocols.s7plus.walk import STEP, FormatError, Walk
from dissect.wire.varint import VLQ


def read_notification(walk: Walk, found: Contents, pdu: PlusPdu) -> None:
    """Read the body of a notification. Raises `FormatError`."""
    if pdu.version == V1:
        _read_v1(walk, found)
    else:
        _read_head(walk, found, pdu)
        _items(walk, found)
        if walk.peek() > 0:
            at = walk.at
            walk.take(6, "second part")
            walk.part(layouts.SECOND_PART, at)
            _items(walk, found)
    read_notification_end(walk)


def _read_head(walk: Walk, found: Contents, pdu: PlusPdu) -> None:
    found.sequence = pdu.sequence
    at = walk.at
    if pdu.subscription_id < SHORT_HEADS:
        walk.u8("changes")
        walk.part(layouts.NOTIFICATION_HEAD_SHORT, at)
        return
    walk.number(VLQ, "sequence")
    layout = layouts.NOTIFICATION_HEAD
    if walk.peek() == 0:
        walk.take(8, "time")
        layout = layouts.NOTIFICATION_HEAD_TIMED
    walk.u8("changes")
    walk.part(layout, at)


def _read_v1(walk: Walk, found: Contents) -> None:
    """Read the V1 form, known from one source only: subscription, 4 octets, then nothing, or 4 and 2 octets and items."""
    at = walk.at
    found.object_id = walk.fixed(4, "subscription")
    walk.take(4, "unknown")
    if walk.left:
        walk.take(6, "unknown")
    walk.part(layouts.RESERVED, at)
    if walk.left:
        _items(walk, found)


def _items(walk: Walk, found: Contents) -> None:
    while True:
        at = walk.at
        kind = walk.u8("item")
        if kind == 0:
            walk.part(layouts.LIST_END, at)
            return
        form: i64 = FORMS[kind]
        if form == REFERENCED:
            reference = walk.fixed(4, "reference")
            take_item(walk, found, reference, layouts.NOTIFIED_VALUE, at)
        elif form == REFERENCED_VLQ:
            reference = walk.number(VLQ, "reference")
            take_item(walk, found, reference, layouts.NOTIFIED_VALUE_VLQ, at)
        elif form == REFUSED:
            reference = walk.fixed(4, "reference")
            walk.spend(STEP, "reference")
            found.refusals.append((reference, kind))
            walk.part(layouts.NOTIFIED_REFUSAL, at, f"{reference}: refused" if walk.shown else "")
        elif form == NOTIFIED_OBJECTS:
            walk.part(layouts.NOTIFIED_KIND, at)
            found.objects.extend(objects_of(read_elements(walk)))
        elif form == NOTIFIED_VALUE:
            found.value = read_value(walk, layouts.NOTIFIED_PLAIN, at)
        elif form == UNNAMED:
            walk.take(4, "unknown")
            walk.part(layouts.NOTIFIED_REFUSAL, at)
        else:
            raise FormatError("unknown_type", "item", at, 0, kind)


def read_event(walk: Walk) -> None:
    """Read the part after the fixed part of a system event: a text, or a value of fixed size."""
    start = walk.at
    if walk.left:
        walk.at = walk.end
        walk.part(layouts.EVENT_VALUE, start)
