"""Finds out whether a response refuses items, and whether it has the items that were requested.

Both are needed for every response, so that most responses are not parsed for it.
"""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.s7plus.bodies import parse_contents
from dissect.s7plus.contents import Contents
from dissect.s7plus.message import PlusPdu, parsed
from dissect.s7plus.plain import REQUEST_SIZE, data_of
from dissect.s7plus.program import CODE, TYPE_INFO
from dissect.s7plus.session import ASKED_OF_OBJECTS
from dissect.s7plus.skimming import CODES, PLACE, REFUSES, SOUND, VALUES, WORDS, skim, skim_again
from dissect.s7plus.skipping import marks
from dissect.s7plus.tables import (
    GET_MULTI_VARIABLES,
    NOTIFICATION,
    PARTIAL_ERROR,
    REFUSED_ITEM,
    REFUSED_ITEM_3,
    SET_MULTI_VARIABLES,
    refuses,
)
from dissect.s7plus.walk import MAX_WORK
from dissect.wire.text import count
from dissect.wire.varint import VLQ, VLQ64, read_varint

#: What matters in objects: code of a block, names of variables; and the attributes that are read.
MARKS: Final = marks(CODE, frozenset((TYPE_INFO,)), ASKED_OF_OBJECTS)
#: Offset of the item count in the data of a request with a list of items.
_COUNT: Final = REQUEST_SIZE + 4
#: How many items a text names.
_NAMED: Final = 3


def glimpse(octets: bytes) -> i64:
    """Return the result of `dissect.s7plus.skimming.skim`; `MET` stands for code of a block or names of variables."""
    return skim(octets, MARKS)


def reads_again(octets: bytes, asked: bytes, read: i64) -> bool:
    """Return whether a request certainly reads the same as the read before; `glimpse` would then return ``read`` for it.

    ``asked`` are the octets of the addresses in the read before, ``read`` is the result of `glimpse` for it.
    """
    return read & SOUND != 0 and skim_again(octets, asked, read >> PLACE)


def answered(octets: bytes, skimmed: i64) -> tuple[int, bool]:
    """Return the lower 16 bits of a response's return value, -1 for none, and whether the response refuses anything.

    ``skimmed`` is the result of `glimpse`. Never raises.
    """
    if skimmed & SOUND:
        code: int = (skimmed >> WORDS & CODES) - 1
        return code, refuses(code) or skimmed & REFUSES != 0
    pdu = parsed(octets)
    return pdu.return_code, refuses(pdu.return_code) or refuses_items(pdu)


def refuses_items(pdu: PlusPdu) -> bool:
    """Return whether a response to a read or write of several variables refuses any of them. Never raises."""
    if pdu.function == SET_MULTI_VARIABLES:
        _, at = read_varint(pdu.body, 0, len(pdu.body), VLQ64)
        return 0 < at < len(pdu.body) and read_varint(pdu.body, at, len(pdu.body), VLQ)[0] != 0  # 80 00 is 0, too
    return pdu.function == GET_MULTI_VARIABLES and bool(parse_contents(pdu, False, MAX_WORK).refusals)


def notifies_refusal(octets: bytes, skimmed: i64) -> bool:
    """Return whether a notification refuses items of its subscription; ``skimmed`` as for `answered`. Never raises."""
    if skimmed & SOUND:
        return skimmed & REFUSES != 0
    pdu = parsed(octets)
    if pdu.opcode != NOTIFICATION or (REFUSED_ITEM not in pdu.body and REFUSED_ITEM_3 not in pdu.body):
        return False
    return bool(parse_contents(pdu, False, MAX_WORK).refusals)


def count_mismatch(function: i64, request: bytes, response: bytes, skimmed: i64) -> str:
    """Return which items of a response to a read or write of several variables do not match its request; empty if all do.

    ``skimmed`` is the result of `glimpse` for the response. Halves that are incomplete or contradict themselves are not
    compared. Never raises.
    """
    if skimmed & SOUND:
        if function == SET_MULTI_VARIABLES and not skimmed & REFUSES:
            return ""
        data, at, end = data_of(request)
        if skimmed >> VALUES > 0 and read_varint(data, at + _COUNT, end, VLQ)[0] == skimmed >> VALUES:
            return ""
    return _compared(function, parsed(request), parsed(response))


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
    more = f" and {len(wrong) - _NAMED} more" if len(wrong) > _NAMED else ""
    return f"requested {count(len(wanted), 'item')}, the answer has {', '.join(wrong[:_NAMED])}{more}"


def _sound_contents(function: i64, pdu: PlusPdu) -> Contents | None:
    """Return the contents of a PDU of this function; None if they are incomplete or contradict themselves."""
    if not pdu.whole or pdu.malformed or pdu.function != function:
        return None
    found = parse_contents(pdu, False, MAX_WORK)
    return found if found.whole and not found.malformed else None
