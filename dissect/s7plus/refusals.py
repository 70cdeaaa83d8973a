"""Whether a response or a notification refuses items: found without reading it whole, because it is asked of every one."""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.s7plus.bodies import parse_contents
from dissect.s7plus.message import PlusPdu, parsed
from dissect.s7plus.program import CODE, TYPE_INFO
from dissect.s7plus.skimming import REFUSES, SOUND, WORDS, skim
from dissect.s7plus.skipping import marks
from dissect.s7plus.tables import (
    GET_MULTI_VARIABLES,
    NOTIFICATION,
    REFUSED_ITEM,
    REFUSED_ITEM_3,
    SET_MULTI_VARIABLES,
    refuses,
)
from dissect.s7plus.walk import MAX_WORK
from dissect.wire.varint import VLQ64, read_varint

#: What objects hold that matters: the code of a block, or the names of variables.
_MARKS: Final = marks(CODE, frozenset((TYPE_INFO,)))


def glimpse(octets: bytes) -> i64:
    """Return what `dissect.s7plus.skimming.skim` says of a PDU, `MET` for the code of a block or the names of variables."""
    return skim(octets, _MARKS)


def answered(octets: bytes, skimmed: i64) -> tuple[int, bool]:
    """Return what a response says: the lower 16 bits of its return value, -1 for none, and whether it refuses anything.

    ``skimmed`` is what `glimpse` says of it. Never raises.
    """
    if skimmed & SOUND:
        code: int = skimmed >> WORDS
        return code, refuses(code) or skimmed & REFUSES != 0
    pdu = parsed(octets)
    return pdu.return_code, refuses(pdu.return_code) or refuses_items(pdu)


def refuses_items(pdu: PlusPdu) -> bool:
    """Tell whether a response to a read or write of several variables refuses any of them. Never raises."""
    if pdu.function == SET_MULTI_VARIABLES:
        _, at = read_varint(pdu.body, 0, len(pdu.body), VLQ64)
        return 0 < at < len(pdu.body) and pdu.body[at] != 0
    return pdu.function == GET_MULTI_VARIABLES and bool(parse_contents(pdu, False, MAX_WORK).refusals)


def notifies_refusal(octets: bytes, skimmed: i64) -> bool:
    """Tell whether a notification refuses items of its subscription; ``skimmed`` as for `answered`. Never raises."""
    if skimmed & SOUND:
        return skimmed & REFUSES != 0
    pdu = parsed(octets)
    if pdu.opcode != NOTIFICATION or (REFUSED_ITEM not in pdu.body and REFUSED_ITEM_3 not in pdu.body):
        return False
    return bool(parse_contents(pdu, False, MAX_WORK).refusals)
