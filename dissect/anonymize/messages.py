"""Drafts of whole messages: S7 PDUs, S7comm-plus, TPDUs other than data, IBH-NetLink packets."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from dissect.anonymize import account
from dissect.anonymize.account import Account
from dissect.anonymize.key import Key
from dissect.anonymize.rewrite_plan import RewritePlan
from dissect.anonymize.rules import Rules
from dissect.anonymize.texts import replace_tsap
from dissect.ibh.packet import HEADER as IBH_HEADER
from dissect.ibh.packet import IbhPacket
from dissect.ibh.tables import KIND_OTHER, KIND_SERVICE
from dissect.iso.cotp import CALLED_TSAP, CALLING_TSAP, Tpdu
from dissect.iso.tables import CC, CR
from dissect.iso.upper import S7COMM, S7COMM_PLUS, TLS, classify
from dissect.s7.data_parts import CONTENT
from dissect.s7.items import DataItem, Item, parse_data_items, walk_areas
from dissect.s7.layouts import DATA_ITEM, PDU_REF
from dissect.s7.message import Pdu, parse_pdu
from dissect.s7.parameters import ACK_HEADER_SIZE, HEADER_SIZE, PROTOCOL_ID
from dissect.s7.tables import ACK_DATA, JOB, OCTET_STRING, READ_VAR, SUCCESS, USERDATA, WRITE_VAR
from dissect.s7plus.message import parse_plus
from dissect.s7plus.tables import KEEP_ALIVE, V3
from dissect.transactions.open_requests import key_of
from dissect.transactions.results import requested_items
from dissect.transactions.side import Side
from dissect.transactions.transaction import PUSH, Transaction
from dissect.wire.malformed import Malformed
from dissect.wire.octets import u16

#: Parameters of TPDUs that hold numbers of the protocol.
_NUMBERS: Final = frozenset((0x85, 0x86, 0x87, 0x88, 0x89, 0x8A, 0x8B, 0x8C, 0xC0, 0xC4, 0xC6, 0xC7, 0xF0, 0xF2))
_PLUS_HEADER: Final = 4
#: Where the reference of an S7 PDU begins and ends.
_REFERENCE: Final[int] = PDU_REF.start
_BEHIND: Final[int] = PDU_REF.stop
#: Where the lengths of an S7 PDU stand, and the size of an answer that says function and number of items, and nothing else.
_PARAM_LENGTH: Final = 6
_DATA_LENGTH: Final = 8
_PLAIN: Final = ACK_HEADER_SIZE + 2
#: How an item of an answer begins that is octets, as the areas of a DBREAD item are.
_OCTETS: Final = bytes((SUCCESS, OCTET_STRING))
#: IBH-NetLink packets without data that stay: a claim of a connection number; connections, acknowledgements and receipts.
_MAX_SERVICE: Final = 14
_MAX_NETLINK: Final = 32


def draft_tsdu(
    octets: bytes, rules: Rules, told: Account, begins: bool = True, codes: Sequence[int] = ()
) -> RewritePlan:
    """Return what becomes of a whole TSDU, or of what was captured of one.

    ``begins``: no S7comm-plus PDU is under way. ``codes``: where return codes stand inside the values of an S7 PDU.
    """
    draft = RewritePlan(octets, told)
    upper = classify(octets, 0, len(octets)) if octets else -1
    if upper == S7COMM:
        _pdu(draft, rules, codes)
    elif upper == S7COMM_PLUS:
        _plus(draft, begins)
    else:
        made = rules.scd.headers(octets) if rules.scd is not None else None
        if made is None:
            draft.zero(0, len(octets), account.TLS if upper == TLS else account.FOREIGN)
        else:
            draft.lay(made)
    return draft


def _pdu(draft: RewritePlan, rules: Rules, codes: Sequence[int]) -> None:
    octets = draft.octets
    but_reference = octets[:_REFERENCE] + octets[_BEHIND:] if len(octets) >= HEADER_SIZE else b""
    if but_reference in rules.known:
        draft.keep(0, len(octets))
        return
    items = _plain_items(octets, rules) if not codes else None
    if items is not None:
        rules.contents(draft, items)
        return
    pdu = parse_pdu(octets)
    if len(octets) < HEADER_SIZE:
        draft.keep(0, min(2, len(octets)))
        draft.zero(2, len(octets), account.UNKNOWN)
        return
    body = pdu.body
    head = min(pdu.header_size, len(octets))
    draft.keep(0, head)
    rules.parts(draft, body.parts, codes)
    end = max([part.end for part in body.parts], default=head)
    draft.zero(end, len(octets), account.UNKNOWN)
    _learn(draft, pdu, but_reference, rules)


def _plain_items(octets: bytes, rules: Rules) -> list[DataItem] | None:
    """Return the data items of a read's answer or of a write of which everything else stays, None for any other PDU.

    That is one in which nothing contradicts anything; of a write the parameters were seen before (`_learn`).
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
    told: list[Malformed] = []
    items = parse_data_items(octets, at, size, octets[head + 1], answer, told)
    return None if told else items


def _learn(draft: RewritePlan, pdu: Pdu, but_reference: bytes, rules: Rules) -> None:
    """Remember what stays as a whole of a sound request, or of the answer to a write."""
    if pdu.malformed or not draft.pieces:
        return
    begin, end, new = draft.pieces[0]
    if begin or new is not None:
        return
    asks = pdu.rosctr == JOB
    if end == len(draft.octets) and pdu.function == (READ_VAR if asks else WRITE_VAR):
        rules.know(rules.known, but_reference)
    elif asks and pdu.function == WRITE_VAR and end >= pdu.data_offset:
        rules.know(rules.known_heads, draft.octets[HEADER_SIZE : pdu.data_offset])


def _plus(draft: RewritePlan, begins: bool) -> None:
    """Keep of an S7comm-plus frame what pairs it: header, fixed part and return value; everything behind is a content."""
    octets = draft.octets
    pdu = parse_plus(octets, cut=True)
    end = min(_PLUS_HEADER, len(octets))
    draft.keep(0, end)
    if begins and pdu.version != KEEP_ALIVE:
        fixed = len(pdu.data) - len(pdu.body) if pdu.body else 0
        if pdu.version == V3 and end < len(octets):
            draft.keep(end, end + 1)  # the size of the digest, which is a content
            end += 1
        start = pdu.data_offset
        if start >= end and fixed:
            draft.zero(end, start, account.PLUS)
            end = start + fixed
            if pdu.return_value >= 0:
                while end < len(octets) and octets[end] & 0x80:
                    end += 1
                end = min(end + 1, len(octets), start + fixed + 9)
            draft.keep(start, end)
    trailer = len(octets)
    if pdu.whole and octets[-_PLUS_HEADER:] == octets[:2] + b"\0\0" and trailer - _PLUS_HEADER >= end:
        trailer -= _PLUS_HEADER
    draft.zero(end, trailer, account.PLUS)
    draft.keep(trailer, len(octets))


def draft_tpdu(octets: bytes, tpdu: Tpdu, key: Key, told: Account) -> RewritePlan:
    """Return what becomes of a TPKT whose TPDU is not data: its numbers stay, its TSAPs are replaced where they are texts."""
    draft = RewritePlan(octets, told)
    draft.keep(0, 4)
    end = 4
    for value in tpdu.fields:
        if not value.field.shares and value.octets is None:
            draft.keep(4 + value.offset, 4 + value.end)
            end = 4 + value.end
    for parameter in tpdu.parameters:
        start = 4 + parameter.offset + 2
        draft.keep(start - 2, start)
        end = start + len(parameter.value)
        if parameter.code in {CALLING_TSAP, CALLED_TSAP} and tpdu.type in {CR, CC}:
            draft.put(start, replace_tsap(key, parameter.value), account.TSAPS)
        elif parameter.code in _NUMBERS:
            draft.keep(start, end)
        else:
            draft.zero(start, end, account.UNKNOWN)
    if tpdu.malformed:  # a length that cannot be and the code beside it: of the TPDU, or of a parameter
        stop = min(6 if end < 6 else end + 2 if tpdu.type in {CR, CC} else end, max(6, 5 + octets[4]), len(octets))
        draft.keep(end, stop)
        end = max(end, stop)
    draft.zero(end, len(octets), account.UNKNOWN)
    return draft


def draft_netlink(packet: IbhPacket, told: Account) -> RewritePlan:
    """Return what becomes of an IBH-NetLink packet around the data of a message that it may carry."""
    octets = packet.octets
    draft = RewritePlan(octets, told)
    end = min(IBH_HEADER, len(octets))
    draft.keep(0, end)
    if packet.data_at:
        draft.keep(end, packet.data_at)
        draft.zero(packet.data_at + len(packet.data), len(octets), account.UNKNOWN)
    elif packet.kind != KIND_OTHER and len(octets) <= (_MAX_SERVICE if packet.kind == KIND_SERVICE else _MAX_NETLINK):
        draft.keep(end, len(octets))
    else:
        draft.zero(end, len(octets), account.UNKNOWN)
    return draft


def codes_inside(side: Side, octets: bytes) -> list[int] | None:
    """Return where return codes stand inside the values of a message: an area of a DBREAD item has one of its own.

    None where that may be, and is known only when the transaction of the message is: of what a cyclic service sends, and of
    an answer whose request stands behind a gap.
    """
    if len(octets) < _PLAIN or octets[0] != PROTOCOL_ID or _OCTETS not in octets:
        return []
    if octets[1] == USERDATA:
        return None
    if octets[1] != ACK_DATA or octets[ACK_HEADER_SIZE] != READ_VAR:
        return []
    asked = side.connection.open_requests[1 - side.index].find(key_of(ACK_DATA, u16(octets, _REFERENCE)))
    return _area_codes(asked.parameters.items, octets) if asked is not None else None


def codes_of(transaction: Transaction) -> list[int]:
    """Return the same of the answer of a transaction, or of what was sent unasked."""
    head = transaction.parameters.userdata
    if head is None:
        asked = transaction.parameters.items
    elif transaction._outcome == PUSH:
        asked = transaction.subscribed.items if transaction.subscribed is not None else []
    else:
        asked = requested_items(head, transaction.request_octets)
    return _area_codes(asked, transaction.response_octets)


def _area_codes(asked: Sequence[Item], octets: bytes) -> list[int]:
    found: list[int] = []
    if all([item.areas is None for item in asked]):
        return found
    number = -1
    good = False
    for part in parse_pdu(octets).body.parts:
        if part.layout is DATA_ITEM:
            number += 1
            good = part.number("return_code") == SUCCESS
        elif part.layout is CONTENT and good and 0 <= number < len(asked):
            areas = asked[number].areas
            if areas is not None:
                found += [part.offset + int(area.offset) for area in walk_areas(areas, octets[part.offset : part.end])]
    return found
