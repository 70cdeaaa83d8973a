"""Fuzz target ``pdus``: one PDU of S7comm, S7comm-plus or IBH-NetLink, read, divided into parts, decoded and shown.

The first octet chooses whether the capture cut the PDU; the PDU follows, and its own first octet gives its protocol.
"""

from __future__ import annotations

import json
from functools import cache
from typing import Final

from dissect.engine.transactions.connection import Connection
from dissect.meaning.report.pdu_json import PduLines
from dissect.meaning.report.plus import item_text
from dissect.meaning.report.tree import netlink_tree_lines, plus_tree_lines, tree_lines
from dissect.meaning.report.words import Places, message_name
from dissect.meaning.report.writers.text import pdu_line, plus_line
from dissect.protocols.ibh.packet import parse_packet
from dissect.protocols.iso.tpkt import HEADER, MAX_LENGTH
from dissect.protocols.s7.bodies import parse_joined
from dissect.protocols.s7.message import parse_pdu
from dissect.protocols.s7.parameters import PROTOCOL_ID
from dissect.protocols.s7.values import decode_value
from dissect.protocols.s7plus.bodies import parse_contents
from dissect.protocols.s7plus.check import check
from dissect.protocols.s7plus.check_response import check_response, notifies_refusal, refuses_items
from dissect.protocols.s7plus.events import take
from dissect.protocols.s7plus.hiding import shown_half
from dissect.protocols.s7plus.items import join_items
from dissect.protocols.s7plus.message import parse_plus
from dissect.protocols.s7plus.program import Program
from dissect.protocols.s7plus.session import Identity, PlusSession
from dissect.protocols.s7plus.tables import REQUEST, refuses
from dissect.testing.playback.client.permissions import Permissions
from dissect.wire.malformed import Malformed
from dissect.wire.part import Part
from dissect.wire.text import Clock
from tests.fuzz.checks import check_json, check_line, check_lines
from tests.fuzz.played import check_harmless
from tests.fuzz.turns import TURNS
from tests.meaning.report.support import begun
from tests.properties.books import Result
from tests.properties.messages import dt

CUT: Final = 1
PLUS: Final = 0x72
#: The outputs for a PDU, in turn (`tests.fuzz.turns`): its tree, its line and values, its JSON, its other properties.
TREE, LINE, JSON, MORE, THINGS = range(5)
#: Transport sizes whose values are tried on the first octets of a data item, besides the requested one.
_SIZES: Final = (0x01, 0x02, 0x03, 0x04, 0x05, 0x06, 0x07, 0x08, 0x09, 0x0A, 0x0B, 0x0C, 0x0F, 0x13, 0x1C, 0x1D, 0x30)


@cache
def _connection() -> Connection:
    return Result(begun().packets()).record.opened[0]


def _check_cover(parts: list[Part], start: int, end: int) -> None:
    """Parts follow one another, without gaps, from ``start`` to ``end``."""
    at = start
    for part in parts:
        assert part.offset == at, (part.layout.name, part.offset, at)
        assert part.end >= part.offset
        at = part.end
        for value in part.values:
            assert isinstance(value.meaning, str)
    assert at == max(start, end), (at, end)


def _check_malformed(facts: list[Malformed], size: int) -> None:
    for fact in facts:
        assert 0 <= fact.offset <= max(size, 0xFFFF + 12), str(fact)
        check_line(str(fact))


def _s7(octets: bytes, cut: bool) -> None:
    if not Permissions().refusal(octets):
        check_harmless(octets)
    pdu = parse_pdu(octets, 1, 0, 1, 0, cut)
    body = pdu.body
    size = len(octets)
    middle = min(pdu.data_offset, size)
    _check_cover(body.parameters, min(pdu.header_size, size), middle)
    _check_cover(body.data, middle, min(middle + pdu.data_length, size))
    _check_malformed([*pdu.malformed, *body.malformed], size)
    for number, item in enumerate(pdu.data_items()):
        items = pdu.parameters.items
        wanted = items[number].transport_size if number < len(items) else item.transport_size
        assert len(item.data) <= size
        decode_value(wanted, item.data)
        if TURNS.has(octets, LINE, THINGS):
            for code in _SIZES:
                decode_value(code, item.data[:64])
    assert len(pdu.return_codes()) <= size
    assert isinstance(pdu.refused, bool)
    if TURNS.has(octets, TREE, THINGS):
        packet = dt(octets) if size + HEADER + 3 <= MAX_LENGTH and not cut else b""
        check_lines(tree_lines(pdu, packet))
    if TURNS.has(octets, LINE, THINGS):
        check_line(pdu_line(pdu, _connection(), Clock(), Places([], False)))
    if TURNS.has(octets, JSON, THINGS):
        check_json(PduLines().line(pdu, _connection()))
    head = pdu.parameters.userdata
    if head is not None and TURNS.has(octets, MORE, THINGS):
        told: list[Malformed] = []
        joined = pdu.data * 2
        _check_cover(parse_joined(head.group, head.subfunction, head.type, joined, told), 0, len(joined))
        _check_malformed(told, len(joined))


def _plus(octets: bytes, cut: bool) -> None:
    pdu = parse_plus(octets, 1, 0, 1, 0, cut)
    _check_malformed(pdu.malformed, len(octets))
    if TURNS.has(octets, TREE, THINGS):
        check_lines(plus_tree_lines(pdu, b"" if cut else dt(octets)))
    if TURNS.has(octets, LINE, THINGS):
        check_line(plus_line(pdu, _connection(), Clock(), Places([], False)))
    if TURNS.has(octets, JSON, THINGS):
        check_json(PduLines().plus_line(pdu, _connection()))
    found = parse_contents(pdu)
    if found.parts:
        _check_cover(found.parts, found.parts[0].offset, len(pdu.data))
    _check_malformed(found.malformed, len(pdu.data))
    assert [value for _, value in parse_contents(pdu, shown=False).items] == [value for _, value in found.items]
    if not cut and pdu.opcode not in {REQUEST, -1}:  # this is never called for a request, or without an opcode
        checked = check(octets)
        assert check_response(checked) == (pdu.return_code, refuses(pdu.return_code) or refuses_items(pdu))
        notifies_refusal(checked)
    if not TURNS.has(octets, MORE, THINGS):
        return
    session = PlusSession(Program(), Identity())
    take(session, pdu.function, octets, b"")
    facts = take(session, pdu.function, octets, octets)
    _check_malformed(facts.malformed if facts is not None else [], len(octets))
    half = shown_half(pdu)
    for item in [*join_items(half, half, session), *join_items(None, half, session)]:
        check_line(item_text(item))
        json.dumps(item.json_value, allow_nan=False)


def _netlink(octets: bytes) -> None:
    packet = parse_packet(octets)
    check_lines(netlink_tree_lines(octets))
    assert packet.octets == octets
    check_line(message_name(packet.data))


def pdus(octets: bytes) -> None:
    """Any PDU: it is read without an exception, its parts have no gaps, all outputs for it are safe."""
    cut = bool(octets[:1] and octets[0] & CUT)
    pdu = octets[1:]
    first = pdu[0] if pdu else -1
    if first == PROTOCOL_ID:
        _s7(pdu, cut)
    elif first == PLUS:
        _plus(pdu, cut)
    else:
        _netlink(pdu)
