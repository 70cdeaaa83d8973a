"""Whether a response refuses items: found without reading it whole, because it is asked of every response."""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.s7plus.bodies import parse_contents
from dissect.s7plus.message import SHORT_HEADS, PlusPdu, parsed
from dissect.s7plus.plain import NOTIFICATION_SIZE, RESPONSE_SIZE, Head
from dissect.s7plus.skipping import Skipper
from dissect.s7plus.tables import (
    GET_MULTI_VARIABLES,
    NOTIFICATION,
    REFUSED_ITEM,
    REFUSED_ITEM_3,
    SET_MULTI_VARIABLES,
    VALUE_ITEM,
    refuses,
)
from dissect.s7plus.walk import MAX_WORK
from dissect.wire.varint import VLQ64, read_varint

#: Octets of an item of a notification before its value, and those of the longest end of one without a second part.
_REFERENCE: Final = 5
_LONGEST_END: Final = 5

#: One of each for all PDUs: making them for each would take as long as what they are for.
_HEAD: Final = Head()
_SKIPPER: Final = Skipper(b"", 0, 0)


def answered(octets: bytes) -> tuple[int, bool]:
    """Return what a response says: the lower 16 bits of its return value, -1 for none, and whether it refuses anything.

    Never raises.
    """
    if not _HEAD.read(octets):
        pdu = parsed(octets)
        return pdu.return_code, refuses(pdu.return_code) or refuses_items(pdu)
    code: i64 = _HEAD.return_code(octets)
    function: i64 = _HEAD.function
    if refuses(code):
        return int(code), True
    if function != GET_MULTI_VARIABLES and function != SET_MULTI_VARIABLES:
        return int(code), False
    if _surely_none(octets, function):
        return int(code), False
    return int(code), refuses_items(parsed(octets))


def refuses_items(pdu: PlusPdu) -> bool:
    """Tell whether a response to a read or write of several variables refuses any of them. Never raises."""
    if pdu.function == SET_MULTI_VARIABLES:
        _, at = read_varint(pdu.body, 0, len(pdu.body), VLQ64)
        return 0 < at < len(pdu.body) and pdu.body[at] != 0
    return pdu.function == GET_MULTI_VARIABLES and bool(parse_contents(pdu, False, MAX_WORK).refusals)


def _surely_none(octets: bytes, function: i64) -> bool:
    """Pass over the values of the response that was read last; True where the list of refusals behind them is empty."""
    skipper = _SKIPPER
    end: i64 = _HEAD.end
    skipper.begin(octets, _HEAD.at + RESPONSE_SIZE, end)
    none: bool = skipper.wide() and (function == SET_MULTI_VARIABLES or _pass_values(skipper))
    at: i64 = skipper.at
    none = none and skipper.spent <= MAX_WORK and at < end and octets[at] == 0
    skipper.begin(b"", 0, 0)  # the octets are let go
    return none


def _pass_values(skipper: Skipper) -> bool:
    """Pass over numbers and values up to the number 0."""
    number = skipper.number()
    while number > 0:
        if not skipper.value(0):
            return False
        number = skipper.number()
    return number == 0


def notifies_refusal(octets: bytes) -> bool:
    """Tell whether a notification refuses items of its subscription. Never raises."""
    if _HEAD.read(octets) and (_HEAD.opcode != NOTIFICATION or _surely_notified(octets)):
        return False
    pdu = parsed(octets)
    if pdu.opcode != NOTIFICATION or (REFUSED_ITEM not in pdu.body and REFUSED_ITEM_3 not in pdu.body):
        return False
    return bool(parse_contents(pdu, False, MAX_WORK).refusals)


def _surely_notified(octets: bytes) -> bool:
    """Pass over the values of the notification that was read last; True where nothing but values stands there, and the end."""
    skipper = _SKIPPER
    end: i64 = _HEAD.end
    skipper.begin(octets, _HEAD.at + NOTIFICATION_SIZE, end)
    sure: bool = _pass_notified(skipper, octets, end)
    skipper.begin(b"", 0, 0)
    return sure


def _pass_notified(skipper: Skipper, octets: bytes, end: i64) -> bool:
    if _HEAD.subscription_id >= SHORT_HEADS and (skipper.number() < 0 or skipper.at >= end or octets[skipper.at] == 0):
        return False  # damaged, or with a time
    skipper.at += 1  # the count of changes
    while skipper.at < end:
        at: i64 = skipper.at
        if octets[at] != VALUE_ITEM:
            return octets[at] == 0 and end - at <= _LONGEST_END
        skipper.at = at + _REFERENCE
        if not skipper.value(0):
            return False
    return False
