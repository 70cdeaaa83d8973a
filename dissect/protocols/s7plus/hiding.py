"""Finds secrets in a PDU (passwords, and data from which they could be computed), so that they are never shown.

An answer to a challenge is the SHA-1 of the password, mixed with the challenge: with both, passwords can be tried. Other
secrets are hashes and keys that a download brings to the CPU. All outputs read contents through `shown_contents`.
"""

from __future__ import annotations

from typing import Final

from dissect.protocols.s7plus.alarms import ATTRIBUTES
from dissect.protocols.s7plus.blobs import COMPRESSED
from dissect.protocols.s7plus.bodies import parse_contents
from dissect.protocols.s7plus.contents import Contents
from dissect.protocols.s7plus.cursor import table
from dissect.protocols.s7plus.ids import HIDDEN, SECRETS, is_secret
from dissect.protocols.s7plus.items import READS, Half
from dissect.protocols.s7plus.layouts import ATTRIBUTE, ITEM_VALUE, MEMBER, PIECE, VALUE
from dissect.protocols.s7plus.message import PlusPdu
from dissect.protocols.s7plus.session import NAME, REFERENCE_LIST
from dissect.protocols.s7plus.tables import GET_VAR_SUBSTREAMED, REQUEST, SET_VAR_SUBSTREAMED
from dissect.protocols.s7plus.value_tables import BLOB, STRUCT, VARIANT, WSTRING
from dissect.protocols.s7plus.values import Blob, Member, Rows, Struct, Value
from dissect.protocols.s7plus.walk import MAX_PARTS, Wanted
from dissect.wire.layout import HOLDS_VALUE
from dissect.wire.part import Part

#: Parts that are needed for a line about a PDU: all items; of the attributes of objects only names, subscribed items and
#: alarms. Attributes that may be compressed are read as well, to find their faults.
_SAID: Final = Wanted(table(ATTRIBUTES | COMPRESSED | {NAME, REFERENCE_LIST}), written=True)

#: Requests that name an attribute by a value, which comes before the value of the attribute.
_LISTS: Final = frozenset((GET_VAR_SUBSTREAMED, SET_VAR_SUBSTREAMED))

#: Contents without secrets, and (offset, end) of each secret within the octets of their PDU.
Shown = tuple[Contents, list[tuple[int, int]]]


def shown_contents(pdu: PlusPdu, shown: bool = True, wanted: Wanted | None = None) -> Shown:
    """Return the contents of a PDU without secrets, and (offset, end) of each secret within ``pdu.octets``.

    If ``shown`` is False, there are no parts and no offsets. ``wanted`` as for `parse_contents`. Never raises.
    """
    found = parse_contents(pdu, shown, wanted=wanted)
    secret = _secret_items(found) if pdu.opcode == REQUEST and (shown or found.items) else set()
    named = pdu.opcode == REQUEST and bool(found.ids) and found.ids[-1] in SECRETS
    lists = pdu.function in _LISTS  # the first value states what is read or written
    spans: list[tuple[int, int]] = []
    above = -1  # depth of the secret that contains the current parts; -1 for none
    for part in found.parts:
        if above >= 0 and part.depth > above:
            _hide(part, part.offset, part.end, pdu, spans)
            continue
        above = -1
        if lists and part.layout is VALUE:
            lists = False
        elif _is_secret(part, secret, named):
            above = part.depth
            content = part.find("octets") if part.layout is PIECE else part.holding(HOLDS_VALUE)
            if content is not None:
                _hide(part, int(content.offset), int(content.end), pdu, spans)
    if pdu.opcode == REQUEST and len(found.parts) > MAX_PARTS:
        rest = found.parts[-1]  # it is not known where secrets are in it
        spans.append((pdu.place(rest.offset), pdu.place(rest.end - 1) + 1))
    if found.value is not None and (named or (_may_hold(found.value) and _holds_secret(found.value))):
        found.value = Value(0, WSTRING, HIDDEN)
    if secret or (found.items and _may_hold_any(found)):
        found.items = [
            (number, Value(0, WSTRING, HIDDEN) if number in secret or _holds_secret(value) else value)
            for number, value in found.items
        ]
    return found, spans


def shown_half(pdu: PlusPdu) -> Half:
    """Return a PDU with its contents, without secrets and without parts."""
    return Half(pdu, shown_contents(pdu, shown=False)[0])


def said_half(pdu: PlusPdu) -> Half:
    """Return the same as `shown_half`, with only those attributes of objects that lines about transactions name."""
    return Half(pdu, shown_contents(pdu, False, _SAID)[0])


def reads_secret(asked: Half) -> bool:
    """Return whether a request reads an attribute that is not shown: its answer contains a secret, but does not say so."""
    found = asked.contents
    if asked.pdu.opcode != REQUEST or asked.pdu.function not in READS:
        return False
    return (bool(found.ids) and found.ids[-1] in SECRETS) or bool(_secret_items(found))


def shown_answer(pdu: PlusPdu, asked: PlusPdu | None) -> Shown:
    """Return `shown_contents` of an answer, None if there is no request; if it requests a secret, all values are secrets."""
    found, spans = shown_contents(pdu)
    if asked is None or not reads_secret(shown_half(asked)):
        return found, spans
    for part in found.parts:
        content = part.holding(HOLDS_VALUE)
        if content is not None:
            _hide(part, int(content.offset), int(content.end), pdu, spans)
    if found.value is not None:
        found.value = Value(0, WSTRING, HIDDEN)
    found.items = [(number, Value(0, WSTRING, HIDDEN)) for number, _ in found.items]
    return found, spans


def _may_hold_any(found: Contents) -> bool:
    for _, value in found.items:  # noqa: SIM110 - nearly every PDU is asked, and a call of any() takes longer
        if _may_hold(value):
            return True
    return False


def _may_hold(value: Value) -> bool:
    """Return whether a value has a type that may contain other values."""
    type_ = value.type
    return type_ == STRUCT or type_ == BLOB or type_ == VARIANT


def _secret_items(found: Contents) -> set[int]:
    """Return the numbers of the items that write a secret."""
    return {
        number
        for number, address in enumerate(found.addresses, 1)
        if (address.lids[-1] if address.lids else address.sub_area) in SECRETS
    }


def _holds_secret(value: Value) -> bool:
    """Return whether a secret is anywhere inside a value."""
    content = value.content
    if isinstance(content, Value):
        return _holds_secret(content)
    if isinstance(content, Struct):
        return _any_secret(content.members)
    if isinstance(content, Blob):
        return _any_secret(content.members)
    if isinstance(content, Rows):
        return any([_any_secret(row) for row in content.rows])
    if value.type == STRUCT and isinstance(content, list):
        return any([isinstance(one, Struct) and _any_secret(one.members) for _, one in content])
    return False


def _any_secret(members: list[Member]) -> bool:
    for id_, value in members:  # noqa: SIM110 - as above
        if is_secret(id_) or (_may_hold(value) and _holds_secret(value)):
            return True
    return False


def _is_secret(part: Part, items: set[int], named: bool) -> bool:
    layout = part.layout
    if layout is ATTRIBUTE or layout is MEMBER:
        return part.number("id") in SECRETS
    if layout is ITEM_VALUE:
        return part.number("number") in items
    return named and (layout is VALUE or layout is PIECE)


def _hide(part: Part, begin: int, end: int, pdu: PlusPdu, spans: list[tuple[int, int]]) -> None:
    name, equals, _ = part.note.partition(" = ")
    part.note = f"{name} = {HIDDEN}" if equals else HIDDEN
    if begin < end:
        spans.append((pdu.place(begin), pdu.place(end - 1) + 1))


def without_secrets(pdu: PlusPdu, spans: list[tuple[int, int]]) -> bytes:
    """Return the octets of a PDU with zeros in place of secrets, also for digests of frames within a secret."""
    octets = pdu.octets
    for begin, end in spans:
        octets = b"".join((octets[:begin], bytes(end - begin), octets[end:]))
    return octets
