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


class _Reader:
    """What reads a PDU in place: its head, and what passes over its values."""

    __slots__ = ("head", "skipper")

    def __init__(self) -> None:
        self.head: Head = Head()
        self.skipper: Skipper = Skipper(b"", 0, 0)


#: Those that nobody uses at the moment: making one for each PDU would take as long as what it is for. Threads do not share one.
_FREE: Final[list[_Reader]] = []


def _reader() -> _Reader:
    try:
        return _FREE.pop()
    except IndexError:
        return _Reader()


def answered(octets: bytes) -> tuple[int, bool]:
    """Return what a response says: the lower 16 bits of its return value, -1 for none, and whether it refuses anything.

    Never raises.
    """
    reader = _reader()
    head = reader.head
    plain: bool = head.read(octets)
    code: i64 = 0
    if plain:
        code = head.return_code(octets)
    several: bool = plain and (head.function == GET_MULTI_VARIABLES or head.function == SET_MULTI_VARIABLES)
    none: bool = several and not refuses(code) and _surely_none(reader, octets)
    _FREE.append(reader)
    if not plain:
        pdu = parsed(octets)
        return pdu.return_code, refuses(pdu.return_code) or refuses_items(pdu)
    if refuses(code):
        return int(code), True
    return int(code), several and not none and refuses_items(parsed(octets))


def refuses_items(pdu: PlusPdu) -> bool:
    """Tell whether a response to a read or write of several variables refuses any of them. Never raises."""
    if pdu.function == SET_MULTI_VARIABLES:
        _, at = read_varint(pdu.body, 0, len(pdu.body), VLQ64)
        return 0 < at < len(pdu.body) and pdu.body[at] != 0
    return pdu.function == GET_MULTI_VARIABLES and bool(parse_contents(pdu, False, MAX_WORK).refusals)


def _surely_none(reader: _Reader, octets: bytes) -> bool:
    """Pass over the values of the response whose head was read; True where the list of refusals behind them is empty."""
    head, skipper = reader.head, reader.skipper
    end: i64 = head.end
    skipper.begin(octets, head.at + RESPONSE_SIZE, end)
    none: bool = skipper.wide() and (head.function == SET_MULTI_VARIABLES or _pass_values(skipper))
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
    reader = _reader()
    head = reader.head
    surely: bool = head.read(octets) and (head.opcode != NOTIFICATION or _surely_notified(reader, octets))
    _FREE.append(reader)
    if surely:
        return False
    pdu = parsed(octets)
    if pdu.opcode != NOTIFICATION or (REFUSED_ITEM not in pdu.body and REFUSED_ITEM_3 not in pdu.body):
        return False
    return bool(parse_contents(pdu, False, MAX_WORK).refusals)


def _surely_notified(reader: _Reader, octets: bytes) -> bool:
    """Pass over the values of the notification whose head was read; True where there is nothing but values, and the end."""
    head, skipper = reader.head, reader.skipper
    end: i64 = head.end
    skipper.begin(octets, head.at + NOTIFICATION_SIZE, end)
    sure: bool = _pass_notified(skipper, octets, end, head.subscription_id >= SHORT_HEADS)
    skipper.begin(b"", 0, 0)  # the octets are let go
    return sure


def _pass_notified(skipper: Skipper, octets: bytes, end: i64, long: bool) -> bool:
    if long and (skipper.number() < 0 or skipper.at >= end or octets[skipper.at] == 0):
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
