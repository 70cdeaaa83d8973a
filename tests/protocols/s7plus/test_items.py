from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.meaning.report.plus import in_short
from dissect.protocols.s7plus.alarms import ALARM, Alarm
from dissect.protocols.s7plus.bodies import parse_contents
from dissect.protocols.s7plus.check import check
from dissect.protocols.s7plus.check_response import check_response, notifies_refusal, refuses_items
from dissect.protocols.s7plus.contents import VariableAddress, known_address
from dissect.protocols.s7plus.hiding import said_half, shown_contents, shown_half, without_secrets
from dissect.protocols.s7plus.identification import IM0_HEAD
from dissect.protocols.s7plus.ids import HIDDEN
from dissect.protocols.s7plus.items import Half, PlusItem, join_items
from dissect.protocols.s7plus.message import parse_plus
from dissect.protocols.s7plus.objects import Attribute, PlusObject, build_elements
from dissect.protocols.s7plus.program import Program
from dissect.protocols.s7plus.session import Identity, PlusSession
from dissect.protocols.s7plus.summary import summary
from dissect.protocols.s7plus.tables import (
    CREATE_OBJECT,
    DELETE_OBJECT,
    EXPLORE,
    GET_MULTI_VARIABLES,
    GET_VAR_SUBSTREAMED,
    SET_MULTI_VARIABLES,
    SET_VAR_SUBSTREAMED,
    SET_VARIABLE,
    refuses,
)
from dissect.protocols.s7plus.value_showing import in_line, octets_text
from dissect.protocols.s7plus.value_tables import (
    ADDRESS_ARRAY,
    ARRAY,
    BLOB,
    DINT,
    INT,
    NULL,
    STRUCT,
    TIMESPAN,
    TIMESTAMP,
    UDINT,
    UINT,
    USINT,
    WSTRING,
)
from dissect.protocols.s7plus.value_tables import WORD as WORD16
from dissect.protocols.s7plus.values import Blob, Struct, Value, build_value
from dissect.wire.varint import VLQ, build_varint
from tests.cases import each
from tests.protocols.s7plus import bodies
from tests.protocols.s7plus.pdus import asked, framed, told
from tests.protocols.s7plus.strategies import OBJECTS, VALUES
from tests.protocols.s7plus.test_bodies import LEVEL, LOST, WORD
from tests.protocols.s7plus.test_program import type_of, variable
from tests.protocols.s7plus.test_session import LIST, subscribed

FIVE = Value(0, INT, 5)


def joined(
    function: int, body: bytes = b"", answer: bytes = b"", one: PlusSession | None = None, answers: int = -1
) -> list[PlusItem]:
    request = shown_half(parse_plus(framed(asked(1, function, body=body), 3))) if body else None
    code = function if answers < 0 else answers
    response = shown_half(parse_plus(framed(told(1, code, answer), 3))) if answer else None
    return join_items(request, response, one)


def told_of(items: list[PlusItem]) -> list[tuple[str, str, int]]:
    return [(item.label, item.text, item.return_code) for item in items]


def test_a_read_of_several_variables() -> None:
    body = bodies.get_multi(LEVEL, WORD)
    items = joined(GET_MULTI_VARIABLES, body, bodies.multi_got([(1, FIVE)], [(2, LOST)]))
    assert told_of(items) == [("DB3 LID 14 [CRC 0xaabbccdd]", "Int 5", 0), ("MW100", "", 0xFFF4)]
    assert [item.data for item in items] == [b"\0\5", None]
    assert told_of(joined(GET_MULTI_VARIABLES, body)) == [("DB3 LID 14 [CRC 0xaabbccdd]", "", -1), ("MW100", "", -1)]
    assert [item.return_code for item in joined(GET_MULTI_VARIABLES, body, bodies.multi_got([(1, FIVE)], []))] == [
        0,
        -1,
    ]
    more = joined(GET_MULTI_VARIABLES, body, bodies.multi_got([(7, FIVE)], []))
    assert [(item.number, item.label) for item in more] == [
        (1, "DB3 LID 14 [CRC 0xaabbccdd]"),
        (2, "MW100"),
        (7, "item 7"),
    ]


def test_a_summary_names_three_items_and_first_those_that_were_refused() -> None:
    body = bodies.get_multi(*[LEVEL] * 5)
    got = joined(GET_MULTI_VARIABLES, body, bodies.multi_got([(number, FIVE) for number in range(1, 6)], []))
    name = "DB3 LID 14 [CRC 0xaabbccdd]"
    assert in_short(got) == [f"{name}, {name}, {name} and 2 more"]
    answer = bodies.multi_got([(1, FIVE)], [(number, LOST) for number in range(2, 6)])
    lost = f"{name}: Object not found"
    assert in_short(joined(GET_MULTI_VARIABLES, body, answer)) == [f"4 of 5 items refused: {lost}, {lost}, {lost}, …"]


def test_a_read_that_is_refused_as_a_whole() -> None:
    answer = b"\xff" * 8 + b"\xf4\0\0" + bodies.end(3)
    items = joined(GET_MULTI_VARIABLES, bodies.get_multi(LEVEL), answer)
    assert [item.return_code for item in items] == [0xFFF4]
    assert [
        item.return_code for item in joined(GET_MULTI_VARIABLES, bodies.get_multi(LEVEL), answer, None, 0x04B1)
    ] == [-1]


def test_an_answer_that_does_not_fit_its_request_hides_nothing() -> None:
    """An item twice, one that nobody asked for, one that is left out: each is there, and what is missing is said."""
    seven = Value(0, UINT, 7)
    items = joined(GET_MULTI_VARIABLES, bodies.get_multi(LEVEL, WORD), bodies.multi_got([(1, FIVE), (1, seven)], []))
    level = "DB3 LID 14 [CRC 0xaabbccdd]"
    assert told_of(items) == [(level, "Int 5", 0), (level, "UInt 7", 0), ("MW100", "", -1)]
    assert [item.note for item in items] == ["", "", "the answer holds neither a value nor a refusal"]
    assert [item.data for item in items] == [b"\0\5", b"\0\7", None]
    items = joined(GET_MULTI_VARIABLES, bodies.get_multi(LEVEL), bodies.multi_got([(1, FIVE), (9, seven)], [(8, LOST)]))
    assert told_of(items) == [(level, "Int 5", 0), ("item 8", "", 0xFFF4), ("item 9", "UInt 7", 0)]
    assert [item.note for item in items] == ["", "the request has no such item", "the request has no such item"]


def test_a_write_of_several_variables() -> None:
    body = bodies.set_multi([(LEVEL, FIVE), (WORD, Value(0, UINT, 7))])
    items = joined(SET_MULTI_VARIABLES, body, b"\x13\2" + b"\xff" * 8 + b"\xf4\0" + bodies.end(3))
    assert told_of(items) == [("DB3 LID 14 [CRC 0xaabbccdd]", "Int 5", 0), ("MW100", "UInt 7", 0xFFF4)]


def test_one_variable() -> None:
    items = joined(SET_VARIABLE, bodies.set_variable(52, [2167], Value(0, DINT, 1)), b"\0" + bodies.end(3))
    assert told_of(items) == [("CPUexecUnit.OperatingStateREQ", "DInt 1 STOP", 0)]
    body = bodies.get_stream(52, [2237, 3486]) + bodies.end(3)
    items = joined(GET_VAR_SUBSTREAMED, body, b"\0\0" + build_value(Value(0, DINT, 8)) + bodies.end(3))
    assert told_of(items) == [("CPUexecUnit.DIS.OperatingState", "DInt 8 RUN", 0)]
    assert items[0].json_value == 8
    refused = joined(GET_VAR_SUBSTREAMED, body, b"\xff" * 8 + b"\xf4\0\0\0" + bodies.end(3))
    assert told_of(refused) == [("CPUexecUnit.DIS.OperatingState", "", 0xFFF4)]


@given(
    st.lists(st.one_of(VALUES, st.sampled_from([0x13, 0x03, 0x9B, 0x9C, 0x55])), max_size=4),
    st.sampled_from([0x00000386, 0x70000E51]),
    st.booleans(),
    st.sampled_from([1, 2, 3]),
    st.integers(0, 3),
)
def test_a_notification_that_refuses_items_is_known_by_its_check(
    items: list[object], subscription: int, timed: bool, version: int, lost: int
) -> None:
    data = b"\x33" + bodies.rid(subscription) + b"\4\0\0\0\0\0\1"
    if subscription == 0x70000E51:
        data += b"\5" + (b"\0" * 8 if timed else b"")
    data += b"\1"
    for one in items:
        reference = b"\0\0\0\x13"
        if isinstance(one, Value):
            data += b"\x92" + reference + build_value(one)
        elif isinstance(one, int):
            data += bytes((one,)) + (b"\5" + build_value(FIVE) if one == 0x9B else reference)
    data += b"\0" + bytes(4)
    octets = framed(data[: len(data) - 5 * lost], version)
    assert notifies_refusal(check(octets)) == bool(parse_contents(parse_plus(octets), False).refusals)


RECORD = IM0_HEAD + b"\0*" + b"6ES7 214-1HE30-0XB0 SZVBDYXX017685  " + bytes((0, 2)) + b"V\2\2\0" + bytes(10)


def test_an_identification_record_is_shown_as_what_it_says() -> None:
    answer = b"\0\0" + build_value(Value(0, BLOB, Blob(0, RECORD))) + bodies.end(3)
    (item,) = joined(GET_VAR_SUBSTREAMED, bodies.get_stream(49, [3753]) + bodies.end(3), answer)
    said = "6ES7 214-1HE30-0XB0, hardware 2, firmware V2.2.0, serial number SZVBDYXX017685"
    assert (item.label, item.text, item.meaning) == ("CPUproxy.3753", f"I&M0 {said}", said)
    assert item.json_value == RECORD.hex()
    (other,) = joined(GET_VAR_SUBSTREAMED, bodies.get_stream(49, [3754]) + bodies.end(3), answer)
    assert other.text == f"Blob {octets_text(RECORD)}"
    short = b"\0\0" + build_value(Value(0, BLOB, Blob(0, RECORD[:-1]))) + bodies.end(3)
    (other,) = joined(GET_VAR_SUBSTREAMED, bodies.get_stream(49, [3753]) + bodies.end(3), short)
    assert (other.text, other.meaning) == (f"Blob {octets_text(RECORD[:-1])}", "")


def test_times_that_no_program_declares_are_shown_as_such() -> None:
    def meaning(value: Value) -> str:
        (item,) = joined(GET_MULTI_VARIABLES, bodies.get_multi(WORD), bodies.multi_got([(1, value)], []))
        return item.meaning

    assert meaning(Value(0, TIMESTAMP, 1_391_557_835_393_500_000)) == "LDT#2014-02-04T23:50:35.393500000Z"
    assert meaning(Value(0, TIMESTAMP, 2**63)) == ""
    assert meaning(Value(0, TIMESPAN, -1_500_000_000)) == "LT#-1s500ms"
    assert meaning(Value(ARRAY, TIMESPAN, [1])) == ""
    assert meaning(Value(0, DINT, 5)) == ""


def test_a_structure_without_a_name_is_shown_with_its_members() -> None:
    state = Struct(
        3481,
        [
            (3482, Value(0, DINT, 0)),
            (3484, Value(0, WORD16, 1)),
            (3486, Value(0, DINT, 8)),
            (4055, Value(0, STRUCT, Struct(4055, [(4056, FIVE)]))),
            (4056, Value(ARRAY, UDINT, [1, 2])),
            (4057, Value(0, NULL, None)),
            (3487, Value(0, BLOB, Blob(0, b""))),
        ],
    )
    (item,) = joined(
        GET_MULTI_VARIABLES,
        bodies.get_multi(VariableAddress(0, 52, 2237, [])),
        bodies.multi_got([(1, Value(0, STRUCT, state))], []),
    )
    assert item.text == (
        "Struct {OwnState: 0, IOState: 0x0001, OperatingState: 8 RUN, 4055: Struct 4055, IOsystem: UDInt[2] 1, 2, "
        "IODevice: Null, ComponentDiagnostics: (empty)}"
    )
    state.members += [(1, FIVE), (2, FIVE)]
    assert in_line(Value(0, STRUCT, state), 0).endswith("(empty), 1: 5, …}")
    assert in_line(Value(0, STRUCT, Struct(314, [(1, FIVE)])), 0) == "Struct 314 SessionVersion"


def test_a_new_reference_list_says_what_it_subscribes_to() -> None:
    def said(numbers: list[int]) -> str:
        written = Value(ADDRESS_ARRAY, UDINT, numbers)
        (item,) = joined(SET_VARIABLE, bodies.set_variable(0x70400008, [1048], written))
        return item.text

    assert said([0x80020000, 0, 1, 0x80140001, 2, 0, 52, 0, 2237]) == "new list: CPUexecUnit.DIS"
    assert said([0x30000, 1, 1, 2, 0x80140001, 3, 0, 50, 0, 3701]) == "added: CPUcommon.3701; removed: 1 reference"
    assert said([0x30000, 2, 0, 2, 3]) == "removed: 2 references"
    many = [number for index in range(9) for number in (0x80140001, index, 0, 50, 0, 3701)]
    assert said([0x80020000, 0, 9, *many]).endswith("CPUcommon.3701 and 1 more")
    assert said([0x80020000, 0, 0]) == "UDInt[3] 2147614720, 0, 0"


def test_functions_without_items() -> None:
    assert joined(DELETE_OBJECT, bodies.delete_object(5)) == []
    assert joined(GET_MULTI_VARIABLES, answer=bodies.multi_got([(1, FIVE)], [])) == []
    assert join_items(None, None, None) == []


def test_one_address_serves_for_all_that_repeat_it() -> None:
    """As long as it is one of the last thousands, and no monster."""
    first = known_address(0, 82, 3736, [3, 100, 2])
    assert first == VariableAddress(0, 82, 3736, [3, 100, 2])
    assert known_address(0, 82, 3736, [3, 100, 2]) is first
    assert known_address(1, 82, 3736, [3, 100, 2]) != first
    long = known_address(0, 82, 3736, list(range(100)))
    assert known_address(0, 82, 3736, list(range(100))) is not long
    for number in range(5000):
        known_address(0, 82, 3736, [3, number, 4])
    assert known_address(0, 82, 3736, [3, 100, 2]) is not first


def test_a_notification_has_the_addresses_of_its_subscription() -> None:
    one = PlusSession(Program(), Identity())
    subscribed(one, 0x00000386, LIST)
    data = b"\x33" + bodies.rid(0x386) + b"\4\0\0\0\0\0\1\1"
    data += b"\x92\xff\xff\xff\xff" + build_value(FIVE) + b"\x13\xff\xff\xff\xfe\0" + bytes(4)
    half = shown_half(parse_plus(framed(data, 2)))
    assert told_of(join_items(None, half, one)) == [
        ("M LID 10 [CRC 0xa1d977b6]", "Int 5", 0),
        ("M LID 9 [CRC 0xac43db80]", "", 0x13),
    ]
    assert told_of(join_items(None, half, None))[0] == ("item 4294967295", "Int 5", 0)


@pytest.mark.parametrize(
    ("datatype", "value", "text"),
    [
        (19, Value(0x10, USINT, [4, 2, 72, 86, 9, 9]), "HV"),
        (62, Value(0x10, UINT, [3, 2, 0x48, 0x20AC, 9]), "H€"),
        (3, Value(0, USINT, 0x41), "A"),
        (61, Value(0, UINT, 0x20AC), "€"),
        (9, Value(0, UINT, 1), "D#1990-01-02"),
        (10, Value(0, UDINT, 3_723_004), "TOD#01:02:03.004"),
        (11, Value(0, DINT, -1500), "T#-1s500ms"),
        (12, Value(0, 0x0B, 0x2150), "S5T#2m30s"),
        (14, Value(0x10, USINT, [0x14, 0x10, 0x25, 0x13, 0x29, 0x30, 0x14, 0x17]), "DT#2014-10-25-13:29:30.141"),
        (19, Value(0x10, USINT, [4, 5, 72, 86, 9, 9]), None),  # more characters than its maximum
        (19, Value(0x10, USINT, [5, 2, 72, 86, 9, 9]), None),  # not as long as it says
        (19, Value(0x10, UINT, [3, 2, 0x48, 0x20AC, 9]), None),
        (14, Value(0x10, USINT, [0x14]), None),
        (5, Value(0x10, USINT, [4, 2, 72, 86, 9, 9]), None),
        (11, Value(0x10, DINT, [1]), None),
        (11, Value(0, UDINT, 1), None),
        (19, FIVE, None),
    ],
)
def test_values_as_the_program_means_them(datatype: int, value: Value, text: str | None) -> None:
    one = PlusSession(Program(), Identity())
    one.program.learn([type_of(0x92000003, ("name", variable(14, datatype)))])
    address = VariableAddress(0, 0x8A0E0003, 2550, [14])
    (item,) = joined(GET_MULTI_VARIABLES, bodies.get_multi(address), bodies.multi_got([(1, value)], []), one)
    if text is None:  # the declaration is contradicted: octets, and no name
        assert (item.label, item.json_value, item.fits) == ("DB3 LID 14", None, False)
        assert item.data == build_value(value)[2:]
        assert item.text == octets_text(item.data)
        assert item.note.endswith('; its address is that of DB3."name"')
    else:
        assert (item.label, item.json_value, item.note) == ('DB3."name"', text, "")
        assert repr(text) in item.text


# ---- refusals -------------------------------------------------------------------------------------------------------


@each("version", [1, 2, 3])
@each("integrity_id", [-1, 0, 9, 300, 2**31])
@each(
    ("items", "refusals"),
    [
        ([], []),
        ([(1, FIVE)], []),
        ([(1, Value(0, DINT, 0))], []),
        ([], [(1, LOST)]),
        ([(1, FIVE)], [(2, LOST)]),
        ([(1, FIVE)], [(2, 0xFFFFFFFFFFFFFF00)]),  # the last octet of its return value is 0
        ([(1, FIVE)], [(2, 0xFFFFFFFFFFFFFE00), (3, 5)]),
        ([(1, Value(0, BLOB, Blob(0, b"\xff" * 9 + b"\0")))], []),
        ([(1, Value(0, BLOB, Blob(0, b"\xff" * 9)))], []),
    ],
)
def test_refusals_are_found_without_reading_it_all(
    items: list[tuple[int, Value]], refusals: list[tuple[int, int]], integrity_id: int, version: int
) -> None:
    if version == 1 and integrity_id >= 0:
        integrity_id = -1
    pdu = framed(told(1, GET_MULTI_VARIABLES, bodies.multi_got(items, refusals, integrity_id)), version)
    assert check_response(check(pdu)) == (0, bool(refusals))
    digest = bodies.multi_got(items, refusals, max(integrity_id, 0))[:-4] + b"\x20" + bytes(range(32))
    pdu = framed(told(1, GET_MULTI_VARIABLES, digest), 2)
    assert check_response(check(pdu)) == (0, bool(refusals))


def test_a_request_says_nothing_of_an_answer() -> None:
    octets = framed(asked(1, EXPLORE, body=bodies.rid(3) + b"\0\1\1\0" + b"\0\0" + bodies.end(4)), 3)
    assert check_response(check(octets)) == (-1, False)


def test_refusals_of_a_write() -> None:
    good = framed(told(1, SET_MULTI_VARIABLES, b"\0\0" + bodies.end(3)), 3)
    bad = framed(told(1, SET_MULTI_VARIABLES, b"\0\1\5\0" + bodies.end(3)), 3)
    assert [check_response(check(pdu)) for pdu in (good, bad)] == [(0, False), (0, True)]


def several(values: list[Value]) -> bytes:
    """The values of an answer, with an end that may be any."""
    return bodies.multi_got([*enumerate(values, 1)], [], 5)


@given(
    st.one_of(st.binary(max_size=60), st.lists(VALUES, max_size=3).map(several)),
    st.sampled_from([GET_MULTI_VARIABLES, SET_MULTI_VARIABLES, EXPLORE]),
    st.sampled_from([1, 2, 3]),
    st.integers(0, 6),
)
def test_what_a_response_says_is_found_in_place_as_by_reading_it(
    body: bytes, function: int, version: int, lost: int
) -> None:
    octets = framed(told(1, function, body), version)
    octets = octets[: len(octets) - lost]
    pdu = parse_plus(octets)
    assert check_response(check(octets)) == (pdu.return_code, refuses(pdu.return_code) or refuses_items(pdu))


# ---- secrets --------------------------------------------------------------------------------------------------------

PASSWORD = b"\xabSECRET-SECRET-20-OCT"


def hidden(octets: bytes) -> str:
    """Give everything that is shown of a PDU."""
    pdu = parse_plus(octets)
    found, spans = shown_contents(pdu)
    assert PASSWORD in octets
    assert spans
    clean = without_secrets(pdu, spans)
    assert PASSWORD not in clean
    assert len(clean) == len(octets)
    items = join_items(shown_half(pdu), None, None)
    said = [*found.notes, *summary(pdu, found), *[f"{item.text} {item.json_value} {item.data!r}" for item in items]]
    return "; ".join(said)


@pytest.mark.parametrize(
    "data",
    [
        asked(1, SET_VARIABLE, body=bodies.set_variable(0x386, [304], Value(0, BLOB, Blob(0, PASSWORD)))),
        asked(1, SET_VARIABLE, body=bodies.set_variable(0x386, [1846], Value(0, BLOB, Blob(0, PASSWORD)))),
        asked(
            1,
            SET_MULTI_VARIABLES,
            body=bodies.set_multi(
                [(WORD, FIVE), (VariableAddress(0, 0x386, 304, []), Value(0, BLOB, Blob(0, PASSWORD)))]
            ),
        ),
        asked(
            1,
            SET_VARIABLE,
            body=bodies.set_variable(50, [7], Value(0, STRUCT, Struct(9, [(7918, Value(0, BLOB, Blob(0, PASSWORD)))]))),
        ),
        asked(
            1,
            SET_VARIABLE,
            body=bodies.set_variable(
                50, [7918], Value(0, STRUCT, Struct(9, [(1, Value(0, BLOB, Blob(0, PASSWORD))), (2, FIVE)]))
            ),
        ),
        asked(
            1,
            CREATE_OBJECT,
            body=bodies.create_object(
                1,
                Value(0, USINT, 0),
                PlusObject(1, 2, 0, 0, 0, [Attribute(3449, Value(0, WSTRING, PASSWORD))]),
                integrity_id=1,
            ),
        ),
    ],
)
@pytest.mark.parametrize("version", [2, 3])
def test_what_could_be_turned_into_a_password_is_not_shown(data: bytes, version: int) -> None:
    said = hidden(framed(data, version))
    assert "SECRET" not in said
    assert PASSWORD.hex(" ") not in said
    assert HIDDEN in said


def test_everything_else_is_shown() -> None:
    pdu = parse_plus(framed(asked(1, SET_VARIABLE, body=bodies.set_variable(52, [2167], FIVE)), 3))
    assert shown_contents(pdu)[1] == []
    assert without_secrets(pdu, []) == pdu.octets


def test_a_request_to_read_a_password_is_shown_as_it_is() -> None:
    octets = framed(asked(1, GET_VAR_SUBSTREAMED, body=bodies.get_stream(50, [7921]) + bodies.end(3)), 3)
    pdu = parse_plus(octets)
    found, spans = shown_contents(pdu)
    assert found.ids == [7921]
    assert spans == []
    assert HIDDEN not in "; ".join([*summary(pdu, found), *[part.note for part in found.parts]])


def test_a_password_that_is_streamed_is_not_shown_and_its_attribute_is() -> None:
    first = asked(
        1,
        SET_VAR_SUBSTREAMED,
        body=bodies.get_stream(50, [7921]) + build_value(Value(0, BLOB, Blob(0, PASSWORD))),
    )
    piece = build_varint(len(PASSWORD), VLQ) + PASSWORD
    octets = framed(first, 3, False) + framed(piece, 3, False) + framed(piece + bodies.end(3), 3)
    pdu = parse_plus(octets)
    found, spans = shown_contents(pdu)
    assert pdu.whole
    assert not found.malformed
    assert len(found.pieces) == 2
    clean = without_secrets(pdu, spans)
    assert octets.count(PASSWORD) == 3
    assert clean.count(PASSWORD) == 0
    # The value has its root and its length with it.
    assert sum(end - begin for begin, end in spans) == 3 * len(PASSWORD) + 2
    assert bodies.get_stream(50, [7921]) in clean


def test_a_password_that_is_read_back_is_not_shown() -> None:
    body = bodies.get_stream(50, [7918]) + bodies.end(3)
    (item,) = joined(
        GET_VAR_SUBSTREAMED, body, b"\0\0" + build_value(Value(0, BLOB, Blob(0, PASSWORD))) + bodies.end(3)
    )
    assert (item.json_value, item.data, item.text) == (HIDDEN, None, HIDDEN)
    address = VariableAddress(0, 50, 7919, [])
    (item,) = joined(
        GET_MULTI_VARIABLES, bodies.get_multi(address), bodies.multi_got([(1, Value(0, BLOB, Blob(0, PASSWORD)))], [])
    )
    assert (item.json_value, item.data) == (HIDDEN, None)


def _said_of(half: Half) -> tuple[object, ...]:
    found = half.contents
    items = [
        (item.label, item.text, item.json_value, item.data, item.return_code) for item in join_items(half, None, None)
    ]
    alarms = [Alarm(one).as_dict() for one in found.objects if one.class_id == ALARM]
    faults = [fact.as_dict() for fact in found.malformed]
    return summary(half.pdu, found), items, alarms, faults, found.integrity_id, found.whole


@given(
    st.lists(OBJECTS, max_size=3), st.sampled_from((CREATE_OBJECT, EXPLORE)), st.integers(0, 200), st.integers(0, 255)
)
def test_a_line_says_the_same_though_attributes_are_left_out(
    objects: list[PlusObject], function: int, at: int, octet: int
) -> None:
    body = build_elements(list(objects))
    if at < len(body):  # wrong somewhere, perhaps
        body = body[:at] + bytes((octet,)) + body[at + 1 :]
    answer = b"\0\0\0\1" + b"\1" + body + bytes(4)
    for pdu in (
        told(1, function, answer),
        asked(1, function, body=bytes.fromhex("0000011f 000400 00000000 00") + body),
    ):
        whole = parse_plus(framed(pdu, 3))
        assert _said_of(said_half(whole)) == _said_of(shown_half(whole))


def test_written_values_are_all_said() -> None:
    body = bodies.set_multi([(VariableAddress(0, 0x386, 48, []), FIVE), (WORD, FIVE)])
    pdu = parse_plus(framed(asked(1, SET_MULTI_VARIABLES, body=body), 3))
    assert _said_of(said_half(pdu)) == _said_of(shown_half(pdu))
    assert len(said_half(pdu).contents.items) == 2
