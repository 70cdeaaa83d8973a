"""Whether a response refuses items: found without reading it whole, because it is asked of every response."""

from __future__ import annotations

from typing import Final

from dissect.s7plus.bodies import parse_contents
from dissect.s7plus.message import DIGEST_SIZE, PlusPdu
from dissect.s7plus.tables import GET_MULTI_VARIABLES, SET_MULTI_VARIABLES
from dissect.s7plus.walk import MAX_WORK
from dissect.wire.varint import VLQ64, read_varint

_FILL: Final = bytes(4)
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
