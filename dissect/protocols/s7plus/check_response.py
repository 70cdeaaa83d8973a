"""Finds out whether a response refuses items, and whether it has the requested items.

Both are needed for every response, so it is done without parsing most responses.
"""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.protocols.s7plus.bodies import parse_contents
from dissect.protocols.s7plus.check import Check
from dissect.protocols.s7plus.contents import Contents
from dissect.protocols.s7plus.message import PlusPdu, parse_plus
from dissect.protocols.s7plus.plain import REQUEST_SIZE, data_of
from dissect.protocols.s7plus.tables import (
    GET_MULTI_VARIABLES,
    NOTIFICATION,
    PARTIAL_ERROR,
    REFUSED_ITEM,
    REFUSED_ITEM_3,
    SET_MULTI_VARIABLES,
    refuses,
)
from dissect.protocols.s7plus.walk import MAX_WORK
from dissect.wire.text import count, some
from dissect.wire.varint import VLQ, VLQ64, read_varint

#: Offset of the item count in the data of a request with a list of items.
_COUNT: Final = REQUEST_SIZE + 4
#: Maximum number of items that a text names.
_NAMED: Final = 3


def check_response(checked: Check) -> tuple[int, bool]:
    """Return the lower 16 bits of a response's return value, -1 for none, and whether it refuses anything. Never raises."""
    if checked.sound:
        code = int(checked.code)
        return code, checked.refuses or (code != 0 and refuses(code))
    pdu = checked.pdu()
    return pdu.return_code, refuses(pdu.return_code) or refuses_items(pdu)


def refuses_items(pdu: PlusPdu) -> bool:
    """Return whether a response to a read or write of several variables refuses any of them. Never raises."""
    if pdu.function == SET_MULTI_VARIABLES:
        _, at = read_varint(pdu.body, 0, len(pdu.body), VLQ64)
        return 0 < at < len(pdu.body) and read_varint(pdu.body, at, len(pdu.body), VLQ)[0] != 0  # 80 00 is 0, too
    return pdu.function == GET_MULTI_VARIABLES and bool(parse_contents(pdu, False, MAX_WORK).refusals)


def notifies_refusal(checked: Check) -> bool:
    """Return whether a notification refuses items of its subscription. Never raises."""
    if checked.sound:
        return checked.refuses
    pdu = checked.pdu()
    if pdu.opcode != NOTIFICATION or (REFUSED_ITEM not in pdu.body and REFUSED_ITEM_3 not in pdu.body):
        return False
    return bool(parse_contents(pdu, False, MAX_WORK).refusals)


def count_mismatch(function: i64, request: bytes, told: Check) -> str:
    """Return which items of a response to a read or write of several variables do not match its request; empty if all do.

    Halves that are incomplete or contradict themselves are not compared. Never raises.
    """
    if told.sound and not told.refuses:
        if function == SET_MULTI_VARIABLES:
            return ""
        if told.numbered > 0:
            data, at, end = data_of(request)
            if read_varint(data, at + _COUNT, end, VLQ)[0] == told.numbered:
                return ""
    return _compared(function, parse_plus(request), told.pdu())


def _compared(function: i64, request: PlusPdu, response: PlusPdu) -> str:
    asked = _sound_contents(function, request)
    told = _sound_contents(function, response)
    if asked is None or told is None or (refuses(response.return_code) and response.return_code != PARTIAL_ERROR):
        return ""
    wanted = range(1, len(asked.addresses) + 1)
    counts: dict[int, int] = {}
    for number in [*[number for number, _ in told.items], *[number for number, _ in told.refusals]]:
        counts[number] = counts.get(number, 0) + 1
    wrong = [f"item {number}, which was not requested" for number in counts if number not in wanted]
    wrong += [f"item {number} ({counts[number]} times)" for number in wanted if counts.get(number, 1) > 1]
    if function == GET_MULTI_VARIABLES:
        wrong += [f"no item {number}" for number in wanted if number not in counts]
    if not wrong:
        return ""
    return f"requested {count(len(wanted), 'item')}, the answer has {some(wrong, _NAMED)}"


def _sound_contents(function: i64, pdu: PlusPdu) -> Contents | None:
    """Return the contents of a PDU of this function; None if they are incomplete or contradict themselves."""
    if not pdu.whole or pdu.malformed or pdu.function != function:
        return None
    found = parse_contents(pdu, False, MAX_WORK)
    return found if found.whole and not found.malformed else None
