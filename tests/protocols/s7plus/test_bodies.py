from __future__ import annotations

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.protocols.s7plus.bodies import parse_contents
from dissect.protocols.s7plus.contents import Contents, VariableAddress
from dissect.protocols.s7plus.hiding import shown_contents, without_secrets
from dissect.protocols.s7plus.message import PlusPdu, parse_plus
from dissect.protocols.s7plus.objects import PlusObject, build_object
from dissect.protocols.s7plus.pieces import return_details
from dissect.protocols.s7plus.summary import summary
from dissect.protocols.s7plus.tables import (
    BEGIN_SEQUENCE,
    CREATE_OBJECT,
    DELETE_OBJECT,
    END_SEQUENCE,
    EXPLORE,
    GET_LINK,
    GET_MULTI_VARIABLES,
    GET_VAR_SUBSTREAMED,
    GET_VARIABLE,
    INIT_SSL,
    INVOKE,
    SET_MULTI_VARIABLES,
    SET_VAR_SUBSTREAMED,
    SET_VARIABLE,
)
from dissect.protocols.s7plus.value_tables import BLOB, DINT, INT, STRUCT, UDINT, USINT, WSTRING
from dissect.protocols.s7plus.values import Blob, Struct, Value, build_members, build_value
from dissect.protocols.s7plus.walk import MAX_PARTS
from tests.cases import each
from tests.protocols.s7plus import bodies
from tests.protocols.s7plus.pdus import KEEP_ALIVE, NOTIFICATION_V3, asked, event, framed, told
from tests.protocols.s7plus.strategies import OBJECTS, VALUES
from tests.protocols.s7plus.test_objects import TYPE

LEVEL = VariableAddress(0xAABBCCDD, 0x8A0E0003, 2550, [14])
WORD = VariableAddress(0, 82, 3736, [3, 100, 2])
BIT = VariableAddress(0, 80, 3736, [3, 4, 1, 5])
FIVE = Value(0, INT, 5)
LOST = 0xFFF4 | 0x8020AB0019D9 << 16
LIST = build_members([(1, FIVE)])
INNER = build_object(PlusObject(0, 1001, 0, 0, 0, []))


def contents(function: int, body: bytes, version: int = 3, answer: bool = False) -> Contents:
    data = told(1, function, body) if answer else asked(1, function, body=body)
    pdu = parse_plus(framed(data, version))
    assert not pdu.malformed
    return parse_contents(pdu)


def whole(function: int, body: bytes, version: int = 3, answer: bool = False) -> Contents:
    """Read a body and see that it is cut without gaps, up to its last octet."""
    found = contents(function, body, version, answer)
    assert found.malformed == []
    assert found.whole
    head = 10 if answer else 14
    assert [part.offset for part in found.parts] == [head, *[part.end for part in found.parts[:-1]]]
    assert found.parts[-1].end == head + len(body)
    return found


def test_reading_variables() -> None:
    found = whole(GET_MULTI_VARIABLES, bodies.get_multi(LEVEL, WORD, BIT))
    assert found.addresses == [LEVEL, WORD, BIT]
    assert found.integrity_id == 9
    assert [part.note for part in found.parts if part.layout.name == "address"] == [
        "DB3 LID 14 [CRC 0xaabbccdd]",
        "MW100",
        "I4.5",
    ]
    answer = whole(GET_MULTI_VARIABLES, bodies.multi_got([(1, FIVE)], [(2, LOST)]), answer=True)
    assert (answer.items, answer.refusals) == ([(1, FIVE)], [(2, LOST)])
    assert "2: 0x8020ab0019d9fff4 Object not found" in answer.notes


def test_reading_attributes_of_an_object() -> None:
    body = bodies.rid(52) + b"\2\2" + bodies.number(2167) + bodies.number(233) + bodies.QUALIFIER + bodies.end(1)
    found = whole(GET_MULTI_VARIABLES, body)
    assert (found.object_id, found.ids) == (52, [2167, 233])
    assert [address.label for address in found.addresses] == [
        "CPUexecUnit.OperatingStateREQ",
        "CPUexecUnit.ObjectVariableTypeName",
    ]


def test_an_index_is_not_named_as_an_object_or_a_class_of_its_number() -> None:
    labels = [
        VariableAddress(0, 201, 1081, [1]).label,
        VariableAddress(0, 201, 1037, [1001]).label,
        VariableAddress(0, 52, 2237, [3486]).label,
    ]
    assert labels == ["ObjectRoot.FreeItems.1", "ObjectRoot.SystemLimits.1001", "CPUexecUnit.DIS.OperatingState"]


def test_writing_variables() -> None:
    found = whole(SET_MULTI_VARIABLES, bodies.set_multi([(LEVEL, FIVE), (WORD, Value(0, USINT, 1))]))
    assert [value.content for _, value in found.items] == [5, 1]
    answer = whole(SET_MULTI_VARIABLES, b"\x13\x02" + b"\xff" * 8 + b"\xf4\0" + bodies.end(3), answer=True)
    assert answer.refusals == [(2, 2**64 - 12)]


def test_the_order_that_stops_a_cpu() -> None:
    found = whole(SET_VARIABLE, bodies.set_variable(52, [2167], Value(0, DINT, 1)))
    assert (found.object_id, found.ids) == (52, [2167])
    assert found.value == Value(0, DINT, 1)
    whole(SET_VARIABLE, b"\0" + bodies.end(3), answer=True)


@each(
    ("function", "body", "version", "answer"),
    [
        (CREATE_OBJECT, bodies.create_object(285, Value(0, UDINT, 0), TYPE), 1, False),
        (CREATE_OBJECT, bodies.create_object(3, Value(0, UDINT, 0), TYPE, integrity_id=161), 3, False),
        (CREATE_OBJECT, bodies.create_object(3, Value(0, UDINT, 0), TYPE, integrity_id=300), 2, False),
        (CREATE_OBJECT, bodies.create_object(3, Value(0, UDINT, 0), TYPE), 2, False),
        (CREATE_OBJECT, b"\0\2\x87\x07\x05" + INNER + bodies.FILL, 1, True),
        (CREATE_OBJECT, b"\0\1\x87\x07" + bodies.end(5), 3, True),
        (DELETE_OBJECT, bodies.delete_object(0x8A0E0003), 3, False),
        (DELETE_OBJECT, b"\0" + bodies.rid(0x386) + bodies.FILL, 3, True),
        (DELETE_OBJECT, bytes.fromhex("a080808080808080 11") + bodies.rid(0x386) + INNER + bodies.end(4), 3, True),
        (GET_VARIABLE, bodies.rid(52) + b"\1\x07" + bodies.QUALIFIER + bodies.end(4), 3, False),
        (GET_VARIABLE, b"\0" + build_value(FIVE) + bodies.end(4), 3, True),
        (GET_VAR_SUBSTREAMED, bodies.get_stream(48, [2167, 233]) + bodies.end(4), 3, False),
        (GET_VAR_SUBSTREAMED, b"\0\0" + build_value(FIVE) + bodies.end(4), 3, True),
        (EXPLORE, bodies.rid(3) + b"\0\1\1\0" + b"\0\2\x01\x07" + bodies.end(4) + b"\0", 3, False),
        (
            EXPLORE,
            bodies.rid(3) + b"\0\1\1\0" + b"\1\1\x17\0\0\4\xdf" + LIST + b"\x07\0\0" + bodies.end(4) + b"\0",
            3,
            False,
        ),
        (EXPLORE, b"\0" + bodies.rid(3) + b"\x09" + INNER + INNER + bodies.FILL, 3, True),
        (EXPLORE, b"\0" + bodies.rid(3) + INNER + bodies.FILL, 1, True),
        (GET_LINK, bodies.rid(3) + b"\x07\0\0" + bodies.end(4), 3, False),
        (GET_LINK, b"\0\2" + bodies.rid(3) + bodies.rid(4) + bodies.end(4), 3, True),
        (BEGIN_SEQUENCE, b"\1" + bodies.FILL, 1, False),
        (BEGIN_SEQUENCE, b"\1\0\1\0" + INNER + bodies.FILL, 3, False),
        (BEGIN_SEQUENCE, b"\1\0\0" + bodies.rid(3) + bodies.end(4), 3, False),
        (BEGIN_SEQUENCE, b"\0\0\0" + bodies.rid(3) + bodies.end(4), 3, True),
        (END_SEQUENCE, b"\0\0" + bodies.end(4), 3, False),
        (END_SEQUENCE, b"\0" + bodies.end(4), 3, True),
        (INVOKE, bodies.rid(0) + bodies.rid(9) + LIST + b"\0" + bodies.end(4), 3, False),
        (INVOKE, b"\0\0\0\1" + build_value(FIVE) + b"\0\0" + bodies.end(4), 3, True),
        (SET_VARIABLE, bodies.set_variable(52, [2167], FIVE, -1)[:-4] + b"\7\x20" + bytes(32), 2, False),
    ],
)
def test_every_function(function: int, body: bytes, version: int, answer: bool) -> None:
    whole(function, body, version, answer)
    head = 10 if answer else 14
    for size in range(len(body)):  # broken off anywhere: what is there is read, and nothing is lost
        found = contents(function, body[:size], version, answer)
        read = [part.offset for part in found.parts] + [head + size]
        assert read == [head, *[part.end for part in found.parts]]
    found = contents(function, body + b"\x99", version, answer)
    assert [fact.reason for fact in found.malformed] == ["trailing_octets"]
    assert found.parts[-1].layout.name == "surplus bytes"


def test_what_no_capture_shows_stays_octets() -> None:
    found = contents(INIT_SSL, b"whatever", 1)
    assert (found.malformed, found.whole, [part.layout.name for part in found.parts]) == ([], False, ["octets"])


def test_a_stream_in_several_frames() -> None:
    first = asked(
        1, SET_VAR_SUBSTREAMED, body=bodies.get_stream(3, [5]) + build_value(Value(0, BLOB, Blob(0, b"head")))
    )
    pieces = [b"\3abc", b"\4defg" + bodies.end(7)]
    frames = framed(first, 3, trailer=False) + framed(pieces[0], 3, trailer=False) + framed(pieces[1], 3)
    pdu = parse_plus(frames)
    found = parse_contents(pdu)
    assert (found.malformed, found.whole, found.integrity_id) == ([], True, 7)
    assert [pdu.data[begin:end] for begin, end in found.pieces] == [b"abc", b"defg"]
    assert frames[pdu.place(found.pieces[1][0]) :].startswith(b"defg")


def test_a_value_in_several_frames() -> None:
    data = asked(1, SET_VARIABLE, body=bodies.set_variable(52, [1], Value(0, WSTRING, "x" * 50)))
    pdu = parse_plus(framed(data[:40], 3, trailer=False) + framed(data[40:], 3))
    found = parse_contents(pdu)
    assert found.whole
    assert found.value is not None
    assert found.value.content == "x" * 50


@pytest.mark.parametrize(
    ("function", "body", "reason", "field"),
    [
        (
            GET_MULTI_VARIABLES,
            bodies.rid(0) + b"\1\5" + b"\0\x52\2\x07\x05" + bodies.QUALIFIER,
            "trailing_octets",
            "end",
        ),
        (
            GET_MULTI_VARIABLES,
            bodies.rid(0) + b"\1\6" + b"\0\x52\2\x07\x05" + bodies.QUALIFIER,
            "count_mismatch",
            "field count",
        ),
        (GET_MULTI_VARIABLES, bodies.rid(0) + b"\1\4\0\x52\0\0", "length_below", "id count"),
        (GET_MULTI_VARIABLES, bodies.rid(0) + b"\xff\x7f\x05\0", "length_beyond", "item count"),
        (
            SET_VARIABLE,
            bodies.set_variable(52, [1], FIVE).replace(b"\0\0\x04\xe8", b"\0\0\x04\xe9"),
            "bad_value",
            "qualifier",
        ),
    ],
)
def test_what_lies(function: int, body: bytes, reason: str, field: str) -> None:
    found = contents(function, body + (b"\1" if reason == "trailing_octets" else b""))
    (fact,) = found.malformed
    assert (fact.layer, fact.reason, fact.field) == ("s7plus", reason, field)
    assert not found.whole


def notified(items: bytes, head: bytes, subscription: int = 0x70000E51, tail: bytes = bytes(4)) -> Contents:
    data = struct.pack(">BIHHH", 0x33, subscription, 0x0400, 0, 0) + head + items + tail
    pdu = parse_plus(framed(data, 3))
    found = parse_contents(pdu)
    assert found.sequence == pdu.sequence
    return found


@pytest.mark.parametrize(
    ("head", "subscription", "sequence"),
    [
        (b"\x01\x05\x01", 0x70000E51, 5),
        (b"\x01\x81\x00\x01", 0x70000E51, 128),
        (b"\x01\x05\0\0\0\0\0\0\0\7\x01", 0x70000E51, 5),
        (b"\x07\x01", 0x00000123, 7),
    ],
)
def test_notifications(head: bytes, subscription: int, sequence: int) -> None:
    items = b"\x92\0\0\0\1" + build_value(FIVE) + b"\x9b\2" + build_value(FIVE) + b"\x13\0\0\0\3" + b"\x03\0\0\0\4"
    items += b"\x9c\0\0\0\5" + b"\x83" + build_value(FIVE) + b"\0"
    found = notified(items, head, subscription)
    assert (found.malformed, found.whole, found.sequence) == ([], True, sequence)
    assert (found.items, found.refusals) == ([(1, FIVE), (2, FIVE)], [(3, 0x13), (4, 0x03)])


def test_an_alarm() -> None:
    items = b"\x81" + INNER + b"\0"
    found = notified(b"\0" + bodies.rid(0x70000001) + b"\0\0" + items, b"\x01\x05\x01", tail=bytes(3))
    assert (found.malformed, [one.class_id for one in found.objects]) == ([], [1001])


def test_a_notification_of_a_capture() -> None:
    found = parse_contents(parse_plus(NOTIFICATION_V3))
    assert (found.malformed, found.whole, found.sequence) == ([], True, 237777)
    assert [(reference, value.type_name) for reference, value in found.items] == [(25, "Real"), (27, "Real")]


@pytest.mark.parametrize(
    "body",
    [bodies.rid(7) + bytes(4), bodies.rid(7) + bytes(10) + b"\x92\0\0\0\1" + build_value(FIVE) + b"\0" + bytes(4)],
)
def test_notifications_of_version_1(body: bytes) -> None:
    found = parse_contents(parse_plus(framed(b"\x33" + body, 1)))
    assert (found.malformed, found.whole) == ([], True)


def test_an_item_of_an_unknown_kind() -> None:
    found = notified(b"\x44abc", b"\x01\x05\x01")
    assert [(fact.reason, fact.available) for fact in found.malformed] == [("unknown_type", 0x44)]


def test_what_has_no_body() -> None:
    assert parse_contents(parse_plus(KEEP_ALIVE)).parts == []
    assert parse_contents(parse_plus(event(5))).parts == []
    (part,) = parse_contents(parse_plus(event(5, b"LOGOUT"))).parts
    assert part.octets("octets") == b"LOGOUT"
    for short in (b"", b"\x72", b"\x72\x02\0\1\x31", b"\x72\x09\0\1\x31"):
        assert parse_contents(parse_plus(short)).parts == []


def test_a_pdu_that_the_capture_cut() -> None:
    octets = framed(asked(1, GET_MULTI_VARIABLES, body=bodies.get_multi(LEVEL)))[:30]
    (fact,) = parse_contents(parse_plus(octets, cut=True)).malformed
    assert fact.limit == "snaplen"


FUNCTIONS = st.sampled_from(
    [EXPLORE, CREATE_OBJECT, DELETE_OBJECT, SET_VARIABLE, GET_VARIABLE, GET_LINK, SET_MULTI_VARIABLES, GET_MULTI_VARIABLES,
     BEGIN_SEQUENCE, END_SEQUENCE, INVOKE, SET_VAR_SUBSTREAMED, GET_VAR_SUBSTREAMED, INIT_SSL, 0x9999]
)  # fmt: skip
BODIES = st.one_of(
    st.binary(max_size=60),
    st.tuples(st.binary(max_size=12), VALUES.map(build_value), st.binary(max_size=6)).map(b"".join),
    st.tuples(st.just(b"\0\0\0\3\0\4\0\0\0\0\0"), OBJECTS.map(build_object), st.just(bytes(4))).map(b"".join),
)


@given(FUNCTIONS, BODIES, st.integers(1, 3), st.sampled_from([0x31, 0x32, 0x33, 0x02]), st.integers(0, 60))
def test_never_raises_and_leaves_no_gaps(function: int, body: bytes, version: int, opcode: int, cut: int) -> None:
    data = bytes((opcode,)) + asked(1, function, body=body)[1:]
    frames = framed(data[:cut], version, trailer=False) + framed(data[cut:], version)
    pdu: PlusPdu = parse_plus(frames)
    found = parse_contents(pdu)
    if found.parts:
        assert [part.offset for part in found.parts[1:]] == [part.end for part in found.parts[:-1]]
        assert found.parts[-1].end == len(pdu.data)
    assert parse_contents(pdu, shown=False).parts == []
    assert len(found.malformed) <= 1
    for part in found.parts:
        assert part.values or part.end == part.offset


def test_a_structure_in_an_answer() -> None:
    value = Value(0, STRUCT, Struct(314, [(319, Value(0, WSTRING, "1;6ES7 215-1AG40-0XB0 ;V4.3"))]))
    found = whole(GET_VAR_SUBSTREAMED, b"\0\0" + build_value(value) + bodies.end(4), answer=True)
    assert "319 LID_SessionVersionSystemPAOMString = WString '1;6ES7 215-1AG40-0XB0 ;V4.3'" in found.notes


@pytest.mark.parametrize(
    ("function", "answer"),
    [(SET_VARIABLE, False), (CREATE_OBJECT, False), (GET_MULTI_VARIABLES, True), (CREATE_OBJECT, True)],
)
def test_contents_that_were_made_anonymous_are_no_contents(function: int, answer: bool) -> None:
    found = contents(function, (b"\0" if answer else b"") + bytes(50), answer=answer)
    assert (found.malformed, found.whole, found.parts[-1].layout.name) == ([], False, "octets")


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0, "0 OK"),
        (17, "0x11 Message session pre-legitimated"),
        (0x8104, "0x8104 (unknown code)"),
        (
            0xA6059400096DFF95,
            "0xa6059400096dff95 Service not allowed; Service not allowed; from object management, line 2413",
        ),
        (
            0xA03388000081FFE0,
            "0xa03388000081ffe0 Invalid attribute ID; Invalid attribute identifier; from object management, line 129",
        ),
        (
            0x4000800000000011,
            "0x4000800000000011 Message session pre-legitimated; from object management, line 0; details follow",
        ),
    ],
)
def test_what_a_return_value_says(value: int, text: str) -> None:
    """Values of captures."""
    assert return_details(value) == text


def test_the_parts_of_a_pdu_are_bounded() -> None:
    members = b"\x07\0\0" * (MAX_PARTS + 1000)
    value = b"\0\x17\0\0\0\1" + members + b"\0"
    body = bodies.rid(52) + b"\1\x07" + value + bodies.QUALIFIER + b"\0" + bodies.end(9)
    pdu = PlusPdu(b"", 0, 0, 0, 0)
    pdu.version, pdu.opcode, pdu.function, pdu.whole = 3, 0x31, SET_VARIABLE, True
    pdu.data = asked(1, SET_VARIABLE, body=body)
    found = parse_contents(pdu)
    assert (found.malformed, found.whole, len(found.parts)) == ([], True, MAX_PARTS + 1)
    assert found.parts[-1].layout.name == "octets"
    assert found.parts[-1].end == len(pdu.data)
    # Of the parts before them there are four, and behind them the ends of two lists, the qualifier, an octet and the id.
    said = found.parts[-1].note
    assert said.endswith("more parts (values, addresses, ids …) left out of this view")
    assert 1000 < int(said.split()[0]) < 1020


def test_items_behind_the_last_part_are_counted_and_not_kept() -> None:
    body = bodies.multi_got([(1, Value(0, USINT, 0))] * (MAX_PARTS + 500), [])
    pdu = PlusPdu(b"", 0, 0, 0, 0)
    pdu.version, pdu.opcode, pdu.function, pdu.whole = 2, 0x32, GET_MULTI_VARIABLES, True
    pdu.data = told(1, GET_MULTI_VARIABLES, body)
    found = parse_contents(pdu)
    assert (found.malformed, found.whole, len(found.parts)) == ([], True, MAX_PARTS + 1)
    assert (len(found.items), found.item_count) == (MAX_PARTS - 2, MAX_PARTS + 500)
    assert summary(pdu, found)[-1] == f"and {MAX_PARTS + 492} more"
    whole = parse_contents(pdu, shown=False)
    assert (len(whole.items), whole.items_left_out) == (MAX_PARTS + 500, 0)
    assert summary(pdu, whole) == summary(pdu, found)


def test_octets_behind_the_last_part_of_a_request_are_not_shown() -> None:
    """They may hold a password, which only a part would tell."""
    secret = bodies.number(1846) + b"\0\x15\4word"
    members = b"\x07\0\0" * MAX_PARTS + secret
    value = b"\0\x17\0\0\0\1" + members + b"\0"
    body = bodies.rid(52) + b"\1\x07" + value + bodies.QUALIFIER + b"\0" + bodies.end(9)
    data = asked(1, SET_VARIABLE, body=body)
    frames = [data[at : at + 60000] for at in range(0, len(data), 60000)]
    pdu = parse_plus(b"".join([framed(frame, 2, trailer=frame is frames[-1]) for frame in frames]))
    found, spans = shown_contents(pdu)
    assert len(found.parts) == MAX_PARTS + 1
    assert spans[-1] == (pdu.place(found.parts[-1].offset), len(pdu.octets) - 4)  # up to the trailer
    shown = without_secrets(pdu, spans)
    assert (b"word" in pdu.octets, b"word" in shown, len(shown)) == (True, False, len(pdu.octets))


def test_the_work_on_a_pdu_can_be_bounded() -> None:
    pdu = parse_plus(
        framed(asked(1, CREATE_OBJECT, body=bodies.create_object(3, FIVE, *[TYPE] * 50, integrity_id=1)), 3)
    )
    assert len(parse_contents(pdu, False).objects) == 50
    assert len(parse_contents(pdu, False, 10_000).objects) == 50
    bounded = parse_contents(pdu, False, 100)
    assert (bounded.objects, bounded.malformed, bounded.whole) == ([], [], False)
    assert parse_contents(pdu, True, 100).parts[-1].end == len(pdu.data)
