from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.protocols.s7plus.bodies import parse_contents
from dissect.protocols.s7plus.contents import VariableAddress
from dissect.protocols.s7plus.event import SESSION
from dissect.protocols.s7plus.events import take
from dissect.protocols.s7plus.message import parse_plus
from dissect.protocols.s7plus.objects import Attribute, PlusObject, build_object, whole_numbers
from dissect.protocols.s7plus.program import Program
from dissect.protocols.s7plus.session import (
    MAX_SUBSCRIPTIONS,
    Counted,
    Identity,
    PlusSession,
    parse_reference_list,
    reference_lists_of,
)
from dissect.protocols.s7plus.tables import CREATE_OBJECT
from dissect.protocols.s7plus.value_tables import ADDRESS_ARRAY, STRUCT, UDINT, WSTRING
from dissect.protocols.s7plus.values import Struct, Value
from tests.protocols.s7plus import bodies
from tests.protocols.s7plus.pdus import asked, framed, told

#: The identification record of a CPU: order number, serial number, hardware revision 3, V4.5.2.
RECORD = (
    bytes.fromhex("002000380100002a")
    + b"6ES7 215-1AG40-0XB0 "
    + b"S V-E6K87654321 "
    + bytes.fromhex("0003 56040502")
    + bytes(10)
)


def session() -> PlusSession:
    return PlusSession(Program(), Identity())


def text(value: str) -> Value:
    return Value(0, WSTRING, value)


def client(**texts: str) -> PlusObject:
    ids = {"name": 233, "application": 297, "host": 298, "user": 296}
    found = [Attribute(ids[key], text(value)) for key, value in texts.items()]
    return PlusObject(211, 287, 0, 0, 0, [*found, Attribute(299, Value(0, UDINT, 2))])


def test_who_the_client_is_and_which_cpu_answers() -> None:
    one = session()
    body = bodies.create_object(
        285, Value(0, UDINT, 0), client(name="Session_1", application="HMI RT OMS+", host="panel")
    )
    one.open_session(parse_contents(parse_plus(framed(asked(1, CREATE_OBJECT, body=body), 1))))
    assert (one.session_name, one.application, one.host, one.user, one.role_name) == (
        "Session_1",
        "HMI RT OMS+",
        "panel",
        "",
        "HMI",
    )
    version = Struct(314, [(319, text("1;6ES7 215-1AG40-0XB0 ;V4.3"))])
    answer = PlusObject(288, 287, 0, 0, 0, [Attribute(306, Value(0, STRUCT, version))])
    body = b"\0\1\x87\x07" + build_object(answer) + bodies.FILL
    one.session_opened(parse_contents(parse_plus(framed(told(1, CREATE_OBJECT, body), 1))))
    assert (one.identity.order_number, one.identity.firmware) == ("6ES7 215-1AG40-0XB0", "V4.3")
    assert one.describe() == "HMI RT OMS+ on panel (panel), CPU 6ES7 215-1AG40-0XB0 V4.3"
    one.user = "Read Write"
    assert one.describe() == "HMI RT OMS+ on panel as Read Write (panel), CPU 6ES7 215-1AG40-0XB0 V4.3"


def test_the_identification_record() -> None:
    one = session()
    one.identified(RECORD[:-1])
    assert one.identity.order_number == ""
    one.identified(RECORD)
    identity = one.identity
    assert (identity.order_number, identity.serial_number, identity.firmware) == (
        "6ES7 215-1AG40-0XB0",
        "S V-E6K87654321",
        "V4.5.2",
    )


#: A reference list of a capture: MW100 and MW102 of a panel.
LIST = [
    0x80010000,
    0,
    2,
    0x80040002,
    0xFFFFFFFE,
    0,
    82,
    0xAC43DB80,
    3736,
    9,
    0x80040002,
    0xFFFFFFFF,
    0,
    82,
    0xA1D977B6,
    3736,
    10,
]


def test_a_reference_list() -> None:
    new, gone, fresh = parse_reference_list(LIST)
    assert (new, gone) == (True, [])
    assert fresh == [
        (0xFFFFFFFE, VariableAddress(0xAC43DB80, 82, 3736, [9])),
        (0xFFFFFFFF, VariableAddress(0xA1D977B6, 82, 3736, [10])),
    ]
    assert parse_reference_list([0x20000, 1, 0, 7]) == (False, [7], [])
    assert parse_reference_list(LIST[:12])[2] == fresh[:1]
    assert parse_reference_list([]) == (False, [], [])


@given(st.lists(st.integers(0, 2**32 - 1), max_size=20))
def test_no_list_raises(numbers: list[int]) -> None:
    parse_reference_list(numbers)


def subscribed(one: PlusSession, id_: int, numbers: list[int]) -> None:
    made = PlusObject(211, 1001, 0, 0, 0, [Attribute(1048, Value(ADDRESS_ARRAY, UDINT, list(numbers)))])
    request = framed(asked(1, CREATE_OBJECT, body=bodies.create_object(285, Value(0, UDINT, 0), made)), 1)
    response = framed(told(1, CREATE_OBJECT, b"\0\1" + bodies.number(id_) + bodies.FILL), 1)
    wanted = parse_contents(parse_plus(request))
    one.subscribe(wanted, parse_contents(parse_plus(response)), reference_lists_of(wanted.every))


def test_subscriptions() -> None:
    one = session()
    subscribed(one, 0x70400001, LIST)
    assert one.address_of(0x70400001, 0xFFFFFFFF) == VariableAddress(0xA1D977B6, 82, 3736, [10])
    assert one.address_of(0x70400001, 1) is None
    assert one.address_of(0x70400002, 0xFFFFFFFF) is None
    one.change(0x70400001, parse_reference_list([0x20000, 1, 1, 0xFFFFFFFF, 0x80150002, 4, 48, 52, 0, 2237, 3486]))
    assert one.address_of(0x70400001, 0xFFFFFFFF) is None
    assert one.address_of(0x70400001, 4) == VariableAddress(0, 52, 2237, [3486])
    assert one.states == {0x70400001: [4]}
    one.change(0x70400001, parse_reference_list([0x20000, 1, 0, 4]))
    assert one.states == {}
    one.unsubscribe(0x70400001)
    assert one.address_of(0x70400001, 0xFFFFFFFE) is None


@pytest.mark.parametrize("value", [Value(0, UDINT, 5), Value(0x20, WSTRING, ["a", "b", "c", "d"])])
def test_a_list_of_another_form_changes_nothing(value: Value) -> None:
    one = session()
    subscribed(one, 1, LIST)
    one.change(1, parse_reference_list(whole_numbers(value)))
    assert len(one.subscriptions[1]) == 2


@pytest.mark.parametrize(("objects", "ids"), [(1, 2), (2, 1), (2, 2), (3, 3), (0, 1)])
def test_each_subscription_has_the_id_at_its_place(objects: int, ids: int) -> None:
    """An answer may have more ids than there are subscriptions, or fewer: what has no counterpart is left alone."""
    one = session()
    kinds = [
        PlusObject(number, 1001, 0, 0, 0, [Attribute(1048, Value(ADDRESS_ARRAY, UDINT, LIST))])
        for number in range(objects)
    ]
    kinds = kinds or [PlusObject(1, 287, 0, 0, 0, [])]
    first, *others = kinds
    body = bodies.create_object(285, Value(0, UDINT, 0), first)
    end = body.index(build_object(first)) + len(build_object(first))
    body = body[:end] + b"".join([build_object(other) for other in others]) + body[end:]
    answer = (
        b"\0" + bytes((ids,)) + b"".join([bodies.number(0x70400001 + number) for number in range(ids)]) + bodies.FILL
    )
    wanted = parse_contents(parse_plus(framed(asked(1, CREATE_OBJECT, body=body), 1)))
    heard = parse_contents(parse_plus(framed(told(1, CREATE_OBJECT, answer), 1)))
    assert (len(wanted.every), len(heard.ids)) == (len(kinds), ids)
    one.subscribe(wanted, heard, reference_lists_of(wanted.every))
    assert list(one.subscriptions) == [0x70400001 + number for number in range(min(objects, ids))]


def test_subscriptions_are_bounded() -> None:
    one = session()
    for number in range(MAX_SUBSCRIPTIONS + 10):
        subscribed(one, number, LIST)
    assert len(one.subscriptions) == MAX_SUBSCRIPTIONS
    assert 9 not in one.subscriptions


def test_a_request_repeats_when_its_integrity_id_is_not_as_far_ahead_as_its_number() -> None:
    counted = Counted()
    said = [
        counted.repeats(sequence, id_)
        for sequence, id_ in ((7, 100), (8, 101), (8, 101), (10, 102), (9, 101), (11, 102), (12, 101), (6, 103))
    ]
    # The same once more is the answer that came twice; one further back has to have a lower id, one further on a higher.
    assert said == [False, False, False, False, False, True, True, True]
    wrapped = Counted()
    assert not wrapped.repeats(0xFFFF, 0xFFFFFFFF)
    assert not wrapped.repeats(1, 0)
    assert wrapped.repeats(2, 0)


def test_a_session_among_other_objects_is_one() -> None:
    """Whatever else a request creates, and wherever it stands: the session begins, with the id of the first."""
    other = PlusObject(211, 2574, 0, 0, 0, [])
    for objects in ((client(name="S"),), (client(name="S"), other), (other, client(name="S"))):
        body = bodies.create_object(285, Value(0, UDINT, 0), objects[0])
        end = body.index(build_object(objects[0])) + len(build_object(objects[0]))
        body = body[:end] + b"".join([build_object(one) for one in objects[1:]]) + body[end:]
        ids = b"\0" + bytes((len(objects),)) + b"".join([bodies.number(0x386 + at) for at in range(len(objects))])
        one = session()
        found = take(
            one,
            CREATE_OBJECT,
            framed(asked(1, CREATE_OBJECT, body=body), 1),
            framed(told(1, CREATE_OBJECT, ids + bodies.FILL), 1),
        )
        assert found is not None
        assert [event.object_id for event in found.events if event.kind == SESSION] == [0x386], objects
        assert one.session_name == "S"
