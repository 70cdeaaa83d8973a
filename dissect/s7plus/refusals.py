"""Whether a response refuses items: found without reading it whole, because it is asked of every response."""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.s7plus.bodies import parse_contents
from dissect.s7plus.message import DIGEST_SIZE, SHORT_HEADS, PlusPdu
from dissect.s7plus.skipping import Skipper
from dissect.s7plus.tables import (
    GET_MULTI_VARIABLES,
    NOTIFICATION,
    REFUSED_ITEM,
    REFUSED_ITEM_3,
    SET_MULTI_VARIABLES,
    V1,
    VALUE_ITEM,
)
from dissect.s7plus.walk import MAX_WORK
from dissect.wire.varint import VLQ, VLQ64, read_varint

_FILL: Final = bytes(4)
#: Octets of an item of a notification before its value, and those of the longest end of one without a second part.
_REFERENCE: Final = 5
_LONGEST_END: Final = 5
#: Octets of a return value of 64 bits, of which all but the last have bit 7 set.
_LONGEST: Final = 9


def refuses_items(pdu: PlusPdu) -> bool:
    """Tell whether a response to a read or write of several variables refuses any of them. Never raises."""
    if pdu.function == SET_MULTI_VARIABLES:
        _, at = read_varint(pdu.body, 0, len(pdu.body), VLQ64)
        return 0 < at < len(pdu.body) and pdu.body[at] != 0
    if pdu.function != GET_MULTI_VARIABLES or _surely_none(pdu.body):
        return False
    return bool(parse_contents(pdu, False, MAX_WORK).refusals)


def notifies_refusal(pdu: PlusPdu) -> bool:
    """Tell whether a notification refuses items of its subscription. Never raises."""
    body = pdu.body
    if pdu.opcode != NOTIFICATION or (REFUSED_ITEM not in body and REFUSED_ITEM_3 not in body):
        return False
    return not _surely_notified(pdu) and bool(parse_contents(pdu, False, MAX_WORK).refusals)


def _surely_notified(pdu: PlusPdu) -> bool:
    """Pass over the values of a notification; True where nothing but values stands there, and then the end."""
    body = pdu.body
    end: i64 = len(body)
    at: i64 = 1  # behind the count of changes
    if pdu.version == V1 or end < 1:
        return False
    if pdu.subscription_id >= SHORT_HEADS:
        _, at = read_varint(body, 0, end, VLQ)
        if at < 0 or at >= end or body[at] == 0:
            return False  # damaged, or with a time
        at += 1
    skipper = Skipper(body, at, end)
    while skipper.at < end:
        at = skipper.at
        if body[at] != VALUE_ITEM:
            return body[at] == 0 and end - at <= _LONGEST_END
        skipper.at = at + _REFERENCE
        if not skipper.value(0):
            return False
    return False


def _surely_none(body: bytes) -> bool:
    """Look at the end of a body only: values, 0, refusals, 0, integrity id, four zeros.

    Two zeros before the id are the ends of both lists, unless the first is the last octet of a refusal: then eight octets with
    bit 7 stand before it.
    """
    end = len(body) - len(_FILL)
    if end > DIGEST_SIZE and body[end + 3 - DIGEST_SIZE] == DIGEST_SIZE and body[end:] != _FILL:
        end += len(_FILL) - DIGEST_SIZE - 1  # a digest in the place of the zeros
    elif end < 2 or body[end:] != _FILL:
        return False
    at = end - 1  # last octet of the id
    while at > 0 and body[at - 1] >= 0x80:
        at -= 1
    if at < _LONGEST + 1 or body[at - 1] or body[at - 2]:
        return False
    return min(body[at - _LONGEST - 1 : at - 2]) < 0x80
