"""Contents made to hurt: depth, counts, arrays without end, lists that never stop.

Each is bounded and told with its place, and nothing before it is lost.
"""

from __future__ import annotations

from typing import Final

import pytest

from dissect.protocols.s7plus.bodies import parse_contents
from dissect.protocols.s7plus.contents import Contents
from dissect.protocols.s7plus.events import take
from dissect.protocols.s7plus.message import PlusPdu, parse_plus
from dissect.protocols.s7plus.program import Program
from dissect.protocols.s7plus.session import Identity, PlusSession
from dissect.protocols.s7plus.tables import (
    CREATE_OBJECT,
    EXPLORE,
    GET_MULTI_VARIABLES,
    SET_MULTI_VARIABLES,
    SET_VARIABLE,
)
from dissect.protocols.s7plus.value_tables import BLOB
from dissect.protocols.s7plus.values import Blob, Value, build_value
from dissect.protocols.s7plus.walk import MAX_DEPTH, MAX_WORK
from tests.protocols.s7plus.bodies import number, rid
from tests.protocols.s7plus.pdus import asked, framed, notified, told

#: Object and one id of a SetVariable, whose value follows.
HEAD: Final = rid(52) + b"\1" + number(2167)
STRUCT: Final = b"\0\x17\0\0\0\7\1"
VARIANT: Final = b"\0\x16"
MANY: Final = number(0xFFFFFFFF)

CASES: Final[dict[str, tuple[int, bytes, str, str]]] = {
    "structures inside each other": (SET_VARIABLE, HEAD + STRUCT * 500, "bad_value", "depth of members"),
    "variants inside each other": (SET_VARIABLE, HEAD + VARIANT * 500, "bad_value", "depth of variant"),
    "a list inside a blob that does not end": (
        SET_VARIABLE,
        HEAD + b"\0\x14\7" + bytes(8) + b"\0" + b"\7\0\2\1" * 900,
        "too_short",
        "member",
    ),
    "objects inside each other": (
        CREATE_OBJECT,
        rid(3) + b"\0\0" + bytes(4) + b"\7" + (b"\xa1" + rid(9) + b"\7\0\0") * 500,
        "bad_value",
        "depth of object",
    ),
    "an array of more than there is": (SET_VARIABLE, HEAD + b"\x10\2" + MANY, "length_beyond", "count"),
    "a text of more than there is": (SET_VARIABLE, HEAD + b"\0\x15" + MANY + b"abc", "length_beyond", "length"),
    "a blob of more than there is": (SET_VARIABLE, HEAD + b"\0\x14\0" + MANY + b"abc", "length_beyond", "length"),
    "a packed structure of more than there is": (
        SET_VARIABLE,
        HEAD + b"\0\x17" + rid(0x91000007) + bytes(8) + b"\2" + MANY + b"abc",
        "too_short",
        "packed structure",
    ),
    "arrays of nothing inside rows": (
        SET_VARIABLE,
        HEAD + b"\x10\x17" + rid(7) + number(9000) + (b"\1\x10\0" + number(3000)) * 2500 + bytes(2000),
        "count_mismatch",
        "count",
    ),
    "a sparse array that does not end": (SET_VARIABLE, HEAD + b"\x40\2" + b"\1\1" * 5000, "too_short", "key"),
    "more ids than there are": (SET_VARIABLE, rid(52) + MANY + b"\1\1", "length_beyond", "count"),
    "a type that nobody knows": (SET_VARIABLE, HEAD + b"\0\x77", "unknown_type", "type"),
    "groups that do not end": (EXPLORE, bytes(8) + b"\1\0\x17\0\0\0\7\0" * 5000, "too_short", "filters"),
    "a block of names longer than it is": (
        CREATE_OBJECT,
        rid(3) + b"\0\0" + bytes(4) + b"\7\xa1" + rid(9) + b"\7\0\0\xac\xff\xffab",
        "length_beyond",
        "block length",
    ),
    "a variable that leaves its block": (
        CREATE_OBJECT,
        rid(3) + b"\0\0" + bytes(4) + b"\7\xa1" + rid(9) + b"\7\0\0\xab\0\5" + bytes(300),
        "length_beyond",
        "variable",
    ),
}  # fmt: skip


def contents(function: int, body: bytes) -> tuple[bytes, PlusPdu, Contents]:
    octets = framed(asked(1, function, body=body), 3)
    pdu = parse_plus(octets)
    return octets, pdu, parse_contents(pdu)


@pytest.mark.parametrize("name", CASES)
def test_it_ends_and_is_told_where(name: str) -> None:
    function, body, reason, field = CASES[name]
    octets, pdu, found = contents(function, body)
    assert pdu.malformed == []
    (fact,) = found.malformed
    assert (fact.reason, fact.field) == (reason, field)
    assert 14 <= fact.offset <= len(pdu.data)
    assert not found.whole
    ends = [part.end for part in found.parts]
    assert [part.offset for part in found.parts[1:]] == ends[:-1]
    assert ends[-1] == len(pdu.data)
    assert max([part.depth for part in found.parts]) <= MAX_DEPTH + 1
    assert found.object_id == int.from_bytes(body[:4], "big")  # what stands before it is still read
    facts = take(PlusSession(Program(), Identity()), function, octets, framed(told(1, function, b"\0" + bytes(4)), 3))
    if function != EXPLORE:  # which is looked into for what its answer tells
        assert facts is not None
        assert facts.exhausted or [one.reason for one in facts.malformed] == [reason]


def test_the_finding_says_the_place() -> None:
    function, body, _, _ = CASES["an array of more than there is"]
    octets, pdu, found = contents(function, body)
    detail = str(found.malformed[0])
    assert f"count at byte {found.malformed[0].offset} announces 4294967295, the rest of the PDU has" in detail
    assert pdu.place(found.malformed[0].offset) == len(octets) - len(pdu.data) - 4 + found.malformed[0].offset


def test_nothing_is_kept_in_numbers_that_no_budget_counts() -> None:
    """A PDU of 8 MiB may hold millions of things of a few octets: none of them is free for the finding's walk."""
    few = 400
    for name, function, body in (
        ("rows without members", SET_VARIABLE, HEAD + b"\x10\x17" + rid(7) + number(few) + bytes(few)),
        ("pairs", SET_VARIABLE, HEAD + b"\x40\2" + b"\1\1" * few),
        ("structures without members", SET_VARIABLE, HEAD + b"\x40\x17" + (b"\1" + rid(7) + b"\0") * few),
        ("ids", SET_VARIABLE, rid(52) + number(few) + b"\7" * few),
        ("addresses", GET_MULTI_VARIABLES, rid(0) + number(few) + number(few) + b"\0\1\1\1" * few),
        ("LIDs", GET_MULTI_VARIABLES, rid(0) + b"\1" + number(few) + b"\0\1" + number(few) + b"\1" * few),
        ("ids of filters", EXPLORE, bytes(8) + b"\0\xff" + b"\1" * 255),
    ):
        pdu = parse_plus(framed(asked(1, function, body=body), 3))
        assert parse_contents(pdu, False, 200).exhausted, name
        assert not parse_contents(pdu, False).exhausted, name
    for name, data in (
        ("refusals", told(1, SET_MULTI_VARIABLES, b"\0" + b"\1\1" * few)),
        ("refusals of a subscription", notified()[:-1] + (b"\x13" + rid(7)) * few),
    ):
        found = parse_contents(parse_plus(framed(data, 3)), False, 200)
        assert found.exhausted, name
        assert len(found.refusals) <= 40, name


def test_one_blob_that_is_no_zlib_stream_is_enough_for_the_finding() -> None:
    blob = build_value(Value(0, BLOB, Blob(0, b"\x78\x9c" + bytes(20))))
    body = rid(3) + b"\0\0" + bytes(4) + b"\7\xa1" + rid(9) + b"\7\0\0"
    body += (b"\xa3" + number(2533) + blob) * 9 + b"\xa2" + bytes(5)
    pdu = parse_plus(framed(asked(1, CREATE_OBJECT, body=body), 3))
    assert [fact.reason for fact in parse_contents(pdu, False).malformed] == ["bad_compression"] * 9
    assert [fact.reason for fact in parse_contents(pdu, False, MAX_WORK).malformed] == ["bad_compression"]


def test_a_notification_that_repeats_one_item_without_end() -> None:
    item = b"\x92\0\0\0\1\0\2\7"
    pdu = parse_plus(framed(notified()[:-1] + item * 7000, 2))
    found = parse_contents(pdu)
    assert len(found.items) == 7000
    assert [fact.reason for fact in found.malformed] == ["too_short"]
