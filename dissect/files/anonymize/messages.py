"""Rewrite plans for whole messages: S7 PDUs, S7comm-plus, TPDUs other than data, IBH-NetLink packets."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from dissect.engine.transactions.open_requests import key_of
from dissect.engine.transactions.results import requested_items
from dissect.engine.transactions.side import Side
from dissect.engine.transactions.transaction import PUSH, Transaction
from dissect.files.anonymize import account
from dissect.files.anonymize.account import Account
from dissect.files.anonymize.key import Key
from dissect.files.anonymize.rewrite_plan import RewritePlan
from dissect.files.anonymize.rules import Rules
from dissect.files.anonymize.texts import replace_tsap
from dissect.protocols.ibh.packet import HEADER as IBH_HEADER
from dissect.protocols.ibh.packet import IbhPacket
from dissect.protocols.ibh.tables import KIND_OTHER, KIND_SERVICE
from dissect.protocols.iso.cotp import CALLED_TSAP, CALLING_TSAP, Tpdu
from dissect.protocols.iso.tables import CC, CR
from dissect.protocols.iso.upper import S7COMM, S7COMM_PLUS, TLS, classify
from dissect.protocols.s7.data_parts import CONTENT
from dissect.protocols.s7.items import DataItem, Item, parse_data_items, walk_areas
from dissect.protocols.s7.layouts import DATA_ITEM, PDU_REF
from dissect.protocols.s7.message import Pdu, parse_pdu
from dissect.protocols.s7.parameters import ACK_HEADER_SIZE, HEADER_SIZE, PROTOCOL_ID
from dissect.protocols.s7.tables import ACK_DATA, JOB, OCTET_STRING, READ_VAR, SUCCESS, USERDATA, WRITE_VAR
from dissect.protocols.s7plus.message import parse_plus
from dissect.protocols.s7plus.tables import KEEP_ALIVE, V3
from dissect.wire.malformed import Malformed
from dissect.wire.octets import u16

#: TPDU parameters that contain only protocol numbers.
_NUMBERS: Final = frozenset((0x85, 0x86, 0x87, 0x88, 0x89, 0x8A, 0x8B, 0x8C, 0xC0, 0xC4, 0xC6, 0xC7, 0xF0, 0xF2))
_PLUS_HEADER: Final = 4
#: Positions of the reference in an S7 PDU: begin and end.
_REFERENCE: Final[int] = PDU_REF.start
_BEHIND: Final[int] = PDU_REF.stop
#: Positions of the lengths in an S7 PDU, and the size of an answer with only function and number of items before its data.
_PARAM_LENGTH: Final = 6
_DATA_LENGTH: Final = 8
_PLAIN: Final = ACK_HEADER_SIZE + 2
#: Beginning of an answer item that consists of octets, like the areas of a DBREAD item.
_OCTETS: Final = bytes((SUCCESS, OCTET_STRING))
#: IBH-NetLink packets without data that stay: a claim of a connection number; connections, acknowledgements and receipts.
_MAX_SERVICE: Final = 14
_MAX_NETLINK: Final = 32


def plan_tsdu(
    octets: bytes, rules: Rules, counts: Account, begins: bool = True, codes: Sequence[int] = ()
) -> RewritePlan:
    """Return the plan for a whole TSDU, or for the captured part of one.

    ``begins``: no S7comm-plus PDU is incomplete. ``codes``: positions of return codes inside the values of an S7 PDU.
    """
    plan = RewritePlan(octets, counts)
    upper = classify(octets, 0, len(octets)) if octets else -1
    if upper == S7COMM:
        _pdu(plan, rules, codes)
    elif upper == S7COMM_PLUS:
        _plus(plan, begins)
    else:
        rewritten = rules.scd.headers(octets) if rules.scd is not None else None
        if rewritten is None:
            plan.zero(0, len(octets), account.TLS if upper == TLS else account.FOREIGN)
        else:
            plan.write(rewritten)
    return plan


def _pdu(plan: RewritePlan, rules: Rules, codes: Sequence[int]) -> None:
    octets = plan.octets
    but_reference = octets[:_REFERENCE] + octets[_BEHIND:] if len(octets) >= HEADER_SIZE else b""
    if but_reference in rules.known:
        plan.keep(0, len(octets))
        return
    items = _plain_items(octets, rules) if not codes else None
    if items is not None:
        rules.contents(plan, items)
        return
    pdu = parse_pdu(octets)
    if len(octets) < HEADER_SIZE:
        plan.keep(0, min(2, len(octets)))
        plan.zero(2, len(octets), account.UNKNOWN)
        return
    body = pdu.body
    head = min(pdu.header_size, len(octets))
    plan.keep(0, head)
    rules.parts(plan, body.parts, codes)
    end = max([part.end for part in body.parts], default=head)
    plan.zero(end, len(octets), account.UNKNOWN)
    _learn(plan, pdu, but_reference, rules)


def _plain_items(octets: bytes, rules: Rules) -> list[DataItem] | None:
    """Return the data items of a read answer or write if everything else in the PDU stays, None for any other PDU.

    The PDU must be consistent; for a write, its parameters must have been seen before (`_learn`).
    """
    size = len(octets)
    if size < _PLAIN:
        return None
    answer = octets[1] == ACK_DATA and octets[ACK_HEADER_SIZE] == READ_VAR
    if not answer and not (octets[1] == JOB and octets[HEADER_SIZE] == WRITE_VAR):
        return None
    head = ACK_HEADER_SIZE if answer else HEADER_SIZE
    at = head + u16(octets, _PARAM_LENGTH)
    if at + u16(octets, _DATA_LENGTH) != size or at < _PLAIN - 2 or (answer and at != _PLAIN):
        return None
    if not answer and octets[head:at] not in rules.known_heads:
        return None
    malformed: list[Malformed] = []
    items = parse_data_items(octets, at, size, octets[head + 1], answer, malformed)
    return None if malformed else items


def _learn(plan: RewritePlan, pdu: Pdu, but_reference: bytes, rules: Rules) -> None:
    """Remember the unchanged parts of a well-formed request, or of the answer to a write."""
    if pdu.malformed or not plan.pieces:
        return
    begin, end, new = plan.pieces[0]
    if begin or new is not None:
        return
    is_request = pdu.rosctr == JOB
    if end == len(plan.octets) and pdu.function == (READ_VAR if is_request else WRITE_VAR):
        rules.know(rules.known, but_reference)
    elif is_request and pdu.function == WRITE_VAR and end >= pdu.data_offset:
        rules.know(rules.known_heads, plan.octets[HEADER_SIZE : pdu.data_offset])


def _plus(plan: RewritePlan, begins: bool) -> None:
    """Keep the fields of an S7comm-plus frame that pairing needs (header, fixed part, return value); the rest is payload."""
    octets = plan.octets
    pdu = parse_plus(octets, cut=True)
    end = min(_PLUS_HEADER, len(octets))
    plan.keep(0, end)
    if begins and pdu.version != KEEP_ALIVE:
        fixed = len(pdu.data) - len(pdu.body) if pdu.body else 0
        if pdu.version == V3 and end < len(octets):
            plan.keep(end, end + 1)  # the size of the digest, which is payload
            end += 1
        start = pdu.data_offset
        if start >= end and fixed:
            plan.zero(end, start, account.PLUS)
            end = start + fixed
            if pdu.return_value >= 0:
                while end < len(octets) and octets[end] & 0x80:
                    end += 1
                end = min(end + 1, len(octets), start + fixed + 9)
            plan.keep(start, end)
    trailer = len(octets)
    if pdu.whole and octets[-_PLUS_HEADER:] == octets[:2] + b"\0\0" and trailer - _PLUS_HEADER >= end:
        trailer -= _PLUS_HEADER
    plan.zero(end, trailer, account.PLUS)
    plan.keep(trailer, len(octets))


def plan_tpdu(octets: bytes, tpdu: Tpdu, key: Key, counts: Account) -> RewritePlan:
    """Return the plan for a TPKT whose TPDU is not data: its numbers stay, TSAPs that are texts are replaced."""
    plan = RewritePlan(octets, counts)
    plan.keep(0, 4)
    end = 4
    for value in tpdu.fields:
        if not value.field.shares and value.octets is None:
            plan.keep(4 + value.offset, 4 + value.end)
            end = 4 + value.end
    for parameter in tpdu.parameters:
        start = 4 + parameter.offset + 2
        plan.keep(start - 2, start)
        end = start + len(parameter.value)
        if parameter.code in {CALLING_TSAP, CALLED_TSAP} and tpdu.type in {CR, CC}:
            plan.put(start, replace_tsap(key, parameter.value), account.TSAPS)
        elif parameter.code in _NUMBERS:
            plan.keep(start, end)
        else:
            plan.zero(start, end, account.UNKNOWN)
    if tpdu.malformed:  # an impossible length and the code next to it, of the TPDU or of a parameter
        stop = min(6 if end < 6 else end + 2 if tpdu.type in {CR, CC} else end, max(6, 5 + octets[4]), len(octets))
        plan.keep(end, stop)
        end = max(end, stop)
    plan.zero(end, len(octets), account.UNKNOWN)
    return plan


def plan_netlink(packet: IbhPacket, counts: Account) -> RewritePlan:
    """Return the plan for an IBH-NetLink packet, apart from the data of a message in it."""
    octets = packet.octets
    plan = RewritePlan(octets, counts)
    end = min(IBH_HEADER, len(octets))
    plan.keep(0, end)
    if packet.data_at:
        plan.keep(end, packet.data_at)
        plan.zero(packet.data_at + len(packet.data), len(octets), account.UNKNOWN)
    elif packet.kind != KIND_OTHER and len(octets) <= (_MAX_SERVICE if packet.kind == KIND_SERVICE else _MAX_NETLINK):
        plan.keep(end, len(octets))
    else:
        plan.zero(end, len(octets), account.UNKNOWN)
    return plan


def codes_inside(side: Side, octets: bytes) -> list[int] | None:
    """Return the positions of return codes inside the values of a message: each area of a DBREAD item has its own code.

    None if there may be some but their positions depend on the transaction: in data that a cyclic service sends, and in an
    answer whose request is missing because of a gap.
    """
    if (
        len(octets) < _PLAIN or octets[0] != PROTOCOL_ID or octets.find(_OCTETS) < 0
    ):  # `in` would raise an error first, and catch it
        return []
    if octets[1] == USERDATA:
        return None
    if octets[1] != ACK_DATA or octets[ACK_HEADER_SIZE] != READ_VAR:
        return []
    request = side.connection.open_requests[1 - side.index].find(key_of(ACK_DATA, u16(octets, _REFERENCE)))
    return _area_codes(request.parameters.items, octets) if request is not None else None


def codes_of(transaction: Transaction) -> list[int]:
    """Return the same for the answer of a transaction, or for an unsolicited message."""
    head = transaction.parameters.userdata
    if head is None:
        requested = transaction.parameters.items
    elif transaction._outcome == PUSH:
        requested = transaction.subscribed.items if transaction.subscribed is not None else []
    else:
        requested = requested_items(head, transaction.request_octets)
    return _area_codes(requested, transaction.response_octets)


def _area_codes(requested: Sequence[Item], octets: bytes) -> list[int]:
    codes: list[int] = []
    if all([item.areas is None for item in requested]):
        return codes
    number = -1
    good = False
    for part in parse_pdu(octets).body.parts:
        if part.layout is DATA_ITEM:
            number += 1
            good = part.number("return_code") == SUCCESS
        elif part.layout is CONTENT and good and 0 <= number < len(requested):
            areas = requested[number].areas
            if areas is not None:
                codes += [part.offset + int(area.offset) for area in walk_areas(areas, octets[part.offset : part.end])]
    return codes
