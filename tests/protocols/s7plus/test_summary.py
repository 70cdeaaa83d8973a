"""What an object is called in a line; what PDUs are about is tested with their bodies and items."""

from __future__ import annotations

import pytest

from dissect.protocols.s7plus.bodies import parse_contents
from dissect.protocols.s7plus.contents import Contents, VariableAddress
from dissect.protocols.s7plus.message import parse_plus
from dissect.protocols.s7plus.objects import Attribute, PlusObject, build_object
from dissect.protocols.s7plus.summary import object_text, references_text, single_address, summary
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
    INVOKE,
    SET_MULTI_VARIABLES,
    SET_VAR_SUBSTREAMED,
    SET_VARIABLE,
)
from dissect.protocols.s7plus.value_tables import ADDRESS_ARRAY, DINT, INT, UDINT, WSTRING
from dissect.protocols.s7plus.values import Value, build_value
from tests.protocols.s7plus import bodies
from tests.protocols.s7plus.pdus import asked, framed, notified, told


@pytest.mark.parametrize(
    ("rid", "class_id", "name", "text"),
    [
        (1, 2478, "ASRoot", "ASRoot 'ASRoot'"),
        (3, 2478, "", "ASRoot PLCProgram"),
        (211, 287, "Session", "ClassServerSession 'Session'"),
        (0x8A0E0001, 2520, "a\tb", "PLCProgram DB1 'a\\tb'"),
    ],
)
def test_an_object_is_its_class_its_id_and_its_name(rid: int, class_id: int, name: str, text: str) -> None:
    elements = [Attribute(233, Value(0, WSTRING, name))] if name else []
    assert object_text(PlusObject(rid, class_id, 0, 0, 0, list(elements))) == text


@pytest.mark.parametrize(("result", "said"), [("00", ["0x70400007"]), ("ca 82 d2 c0 80 82 a1 ff 94", [])])
def test_an_object_whose_creation_was_refused_is_not_there(result: str, said: list[str]) -> None:
    pdu = parse_plus(framed(told(1, CREATE_OBJECT, bytes.fromhex(f"{result} 01 87 82 80 80 07"))))
    assert summary(pdu, parse_contents(pdu)) == said


def test_a_request_says_what_a_new_reference_list_is_about() -> None:
    written = Value(ADDRESS_ARRAY, UDINT, [0x80020000, 1, 1, 7, 0x80140001, 2, 0, 52, 0, 2237])
    said = "0x70400008.SubscriptionReferenceList = new list: CPUexecUnit.DIS; removed: 1 reference"
    one = asked(1, SET_VARIABLE, body=bodies.set_variable(0x70400008, [1048], written))
    several = asked(
        1, SET_MULTI_VARIABLES, body=bodies.set_multi([(VariableAddress(0, 0x70400008, 1048, []), written)])
    )
    for data in (one, several):
        pdu = parse_plus(framed(data, 3))
        assert summary(pdu, parse_contents(pdu)) == [said]


#: An item, an object, a refusal: nine of each are one more than a text names.
LEVEL = VariableAddress(0, 0x8A0E0003, 2550, [14])
FIVE = Value(0, INT, 5)
LOST = 0xFFF4
OBJECT = build_object(PlusObject(211, 1001, 0, 0, 0, []))


def said_of(data: bytes) -> list[str]:
    pdu = parse_plus(framed(data, 3))
    return summary(pdu, parse_contents(pdu))


def some(said: list[str], count: int) -> list[str]:
    """The first eight of these texts, and how many others there are."""
    return said[:count] if count <= 8 else [*said[:8], f"and {count - 8} more"]


@pytest.mark.parametrize("count", [0, 1, 8, 9, 12])
def test_eight_things_are_named_and_the_others_counted(count: int) -> None:
    several = range(1, count + 1)
    values = [f"{number}: Int 5" for number in several]
    refused = [f"{number}: 0xfff4 Object not found" for number in several]
    labels = ["DB3 LID 14"] * count
    new = ["ClassSubscription"] * count

    got = bodies.multi_got([(number, FIVE) for number in several], [])
    assert said_of(told(1, GET_MULTI_VARIABLES, got)) == some(values, count)
    lost = bodies.multi_got([], [(number, LOST) for number in several])
    assert said_of(told(1, GET_MULTI_VARIABLES, lost)) == some(refused, count)
    assert said_of(asked(1, GET_MULTI_VARIABLES, body=bodies.get_multi(*[LEVEL] * count))) == some(labels, count)
    written = bodies.set_multi([(LEVEL, FIVE)] * count)
    assert said_of(asked(1, SET_MULTI_VARIABLES, body=written)) == some([f"{label} = Int 5" for label in labels], count)
    explored = b"\0" + bodies.rid(3) + b"\x09" + OBJECT * count + bodies.FILL
    assert said_of(told(1, EXPLORE, explored)) == some(new, count)
    links = b"\0" + bytes((count,)) + bodies.rid(3) * count + bodies.end(4)
    assert said_of(told(1, GET_LINK, links)) == some(["PLCProgram"] * count, count)
    head = notified()[:-1]
    items = (b"\x92" + bodies.rid(7) + build_value(FIVE)) * count
    assert said_of(head + items + b"\0" + bytes(4)) == some(["7: Int 5"] * count, count)
    items = (b"\x13" + bodies.rid(7)) * count
    assert said_of(head + items + b"\0" + bytes(4)) == some(["7: refused"] * count, count)
    alarms = b"\0" + bodies.rid(0x70000001) + b"\0\0" + (b"\x81" + OBJECT) * count + b"\0" + bytes(3)
    assert said_of(head + alarms) == some(new, count)


def test_values_refusals_and_objects_are_counted_together() -> None:
    got = bodies.multi_got([(number, FIVE) for number in range(1, 6)], [(number, LOST) for number in range(6, 11)])
    assert said_of(told(1, GET_MULTI_VARIABLES, got)) == [
        *[f"{number}: Int 5" for number in range(1, 6)],
        *[f"{number}: 0xfff4 Object not found" for number in range(6, 9)],
        "and 2 more",
    ]
    items = (b"\x92" + bodies.rid(7) + build_value(FIVE)) * 3 + (b"\x13" + bodies.rid(8)) * 3
    alarms = b"\0" + bodies.rid(0x70000001) + b"\0\0" + (b"\x81" + OBJECT) * 3 + b"\0" + bytes(3)
    assert said_of(notified()[:-1] + items + alarms) == [
        *["7: Int 5"] * 3, *["8: refused"] * 3, *["ClassSubscription"] * 2, "and 1 more",
    ]  # fmt: skip
    created = b"\0\5" + bodies.number(7) * 5 + OBJECT * 4 + bodies.FILL
    pdu = parse_plus(framed(told(1, CREATE_OBJECT, created), 1))
    assert summary(pdu, parse_contents(pdu)) == [*["TisJobCont"] * 5, *["ClassSubscription"] * 3, "and 1 more"]


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (told(1, GET_VARIABLE, b"\0" + build_value(FIVE) + bodies.end(4)), ["Int 5"]),
        (told(1, GET_VAR_SUBSTREAMED, b"\0\0" + build_value(FIVE) + bodies.end(4)), ["Int 5"]),
        (told(1, SET_VARIABLE, b"\0" + bodies.end(4)), []),
        (told(1, DELETE_OBJECT, b"\0" + bodies.rid(0x386) + bodies.end(4)), []),
        (told(1, GET_LINK, b"\0\1" + bodies.rid(3) + bodies.end(4)), ["PLCProgram"]),
        (told(1, GET_LINK, b"\xff" * 8 + b"\xf4\1" + bodies.rid(3) + bodies.end(4)), []),
        (asked(1, DELETE_OBJECT, body=bodies.delete_object(0x8A0E0003)), ["DB3"]),
        (asked(1, EXPLORE, body=bodies.rid(3) + b"\0\1\1\0" + b"\0\2\x01\x07" + bodies.end(4) + b"\0"), ["PLCProgram"]),
        (asked(1, INVOKE, body=bodies.rid(0) + bodies.rid(8) + b"\0\0" + bodies.end(4)), ["AlarmSubsystem"]),
        (asked(1, CREATE_OBJECT, body=bodies.create_object(3, FIVE, integrity_id=1)), ["in PLCProgram"]),
        (asked(1, GET_LINK, body=bodies.rid(3) + b"\x07\0\0" + bodies.end(4)), ["PLCProgram.7"]),
        (asked(1, END_SEQUENCE, body=b"\0\0" + bodies.end(4)), []),
        (asked(1, BEGIN_SEQUENCE, body=b"\1\0\1\0" + OBJECT + bodies.FILL), ["ClassSubscription"]),
        (
            asked(1, SET_VARIABLE, body=bodies.set_variable(52, [2167], Value(0, DINT, 1))),
            ["CPUexecUnit.OperatingStateREQ = DInt 1 STOP"],
        ),
        (
            asked(1, GET_VAR_SUBSTREAMED, body=bodies.get_stream(52, [2237, 3486]) + bodies.end(3)),
            ["CPUexecUnit.DIS.OperatingState"],
        ),
    ],
)
def test_what_a_message_is_about(data: bytes, said: list[str]) -> None:
    assert said_of(data) == said


def test_created_objects_are_counted_with_the_place_where_they_are_made() -> None:
    for count in (7, 8):
        body = bodies.create_object(3, FIVE, *[PlusObject(211, 1001, 0, 0, 0, [])] * count, integrity_id=1)
        assert said_of(asked(1, CREATE_OBJECT, body=body)) == some(
            ["in PLCProgram"] + ["ClassSubscription"] * count, count + 1
        )


def test_a_stream_is_counted_in_bytes() -> None:
    first = asked(1, SET_VAR_SUBSTREAMED, body=bodies.get_stream(3, [5]) + build_value(FIVE))
    octets = framed(first, 3, False) + framed(b"\3abc", 3, False) + framed(b"\4defg" + bodies.end(7), 3)
    pdu = parse_plus(octets)
    assert summary(pdu, parse_contents(pdu)) == ["PLCProgram.5 = Int 5, 7 bytes streamed"]


def test_objects_that_end_too_soon_are_named_as_well() -> None:
    explored = b"\0" + bodies.rid(3) + b"\x09" + OBJECT * 8 + OBJECT[:-1]
    assert said_of(told(1, EXPLORE, explored)) == ["ClassSubscription"] * 8 + ["and 1 more"]


def test_only_some_of_the_items_may_have_values() -> None:
    body = bodies.set_multi([(LEVEL, FIVE), (LEVEL, FIVE), (LEVEL, FIVE)])
    body = body.replace(b"\2" + build_value(FIVE), b"\7" + build_value(FIVE))
    assert said_of(asked(1, SET_MULTI_VARIABLES, body=body)) == [
        "DB3 LID 14 = Int 5",
        "DB3 LID 14",
        "DB3 LID 14 = Int 5",
    ]


def test_a_list_names_eight_of_its_items() -> None:
    for count, more in ((8, ""), (9, " and 1 more")):
        words = [word for reference in range(count) for word in (0x80040001, reference, 0, 50, 0, 3701)]
        value = Value(ADDRESS_ARRAY, UDINT, [0, 2, count, 5, 6, *words])
        said = references_text(value, lambda address: address.label)
        assert said == f"added: {', '.join(['CPUcommon.3701'] * 8)}{more}; removed: 2 references"
    assert references_text(FIVE, lambda address: address.label) == ""


def test_a_single_address_is_that_of_one_attribute() -> None:
    found = Contents(3, -1, {})
    assert single_address(found) is None
    found.object_id = 0
    assert single_address(found) is None
    found.ids = [5, 6]
    assert single_address(found) == VariableAddress(0, 0, 5, [6])
    found.addresses = [LEVEL]
    assert single_address(found) is None
