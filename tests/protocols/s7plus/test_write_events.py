"""What each write means: a variable, an output, a password, an order, a list of a subscription; and which writes matter."""

from __future__ import annotations

from typing import Final

import pytest

from dissect.protocols.s7plus.check import check
from dissect.protocols.s7plus.contents import VariableAddress
from dissect.protocols.s7plus.event import (
    CONFIRMED,
    LISTED,
    ORDERED,
    PASSWORD,
    RESET,
    START,
    STOP,
    STREAMED,
    WRITTEN,
    WRITTEN_OUTPUTS,
    Event,
)
from dissect.protocols.s7plus.loads import FIRMWARE, LOADED, PROTECTED
from dissect.protocols.s7plus.objects import Attribute
from dissect.protocols.s7plus.program import Program
from dissect.protocols.s7plus.session import Identity, PlusSession
from dissect.protocols.s7plus.tables import GET_MULTI_VARIABLES, SET_MULTI_VARIABLES, SET_VARIABLE
from dissect.protocols.s7plus.value_tables import ADDRESS_ARRAY, BLOB, BOOL, DINT, INT, LREAL, UDINT, WSTRING
from dissect.protocols.s7plus.values import Blob, Value, build_value
from dissect.protocols.s7plus.walk import MAX_WORK
from dissect.protocols.s7plus.writes import first_id, is_plain, judge_write, judge_writes, matters, take_write
from tests.protocols.s7plus import bodies
from tests.protocols.s7plus.bodies import QUALIFIER, end, number, rid
from tests.protocols.s7plus.pdus import asked, framed

DB3: Final = 0x8A0E0003
SUBSCRIPTION: Final = 0x70400010
FIVE: Final = Value(0, INT, 5)
STATE: Final = VariableAddress(0, 52, 2237, [3486])
#: A new list with the operating state, by the reference 9.
LIST: Final = Value(ADDRESS_ARRAY, UDINT, [0x80000000, 0, 1, 0x80040002, 9, 0, 52, 0, 2237, 3486])
#: kind, text, object and refusal of an event.
Said = tuple[str, str, int, int]


def session() -> PlusSession:
    found = PlusSession(Program(), Identity())
    found.subscriptions[SUBSCRIPTION] = {}
    return found


def said(events: list[Event]) -> list[Said]:
    return [(event.kind, event.text, event.object_id, event.refusal) for event in events]


def of_one(
    object_id: int, ids: list[int], value: Value | None, good: bool = True, streamed: bool = False
) -> tuple[list[Said], PlusSession]:
    """Judge a write of one attribute; and the same as an item of several, which has to mean the same."""
    one, events = session(), list[Event]()
    written = Attribute(0, value) if value is not None else None
    judge_write(one, events, object_id, ids, written, streamed, good)
    several, items = session(), list[Event]()
    if not streamed:
        address = VariableAddress(0, object_id, ids[0], ids[1:])
        judge_writes(several, items, [address], {1: written} if written is not None else {}, {}, False, good)
        assert said(items) == said(events)
        assert several.subscriptions == one.subscriptions
    return said(events), one


@pytest.mark.parametrize(
    ("object_id", "ids", "value", "wanted"),
    [
        (DB3, [2550, 9], FIVE, (WRITTEN, "DB3 LID 9 = Int 5", 0)),
        (DB3, [2550, 9], None, (WRITTEN, "DB3 LID 9", 0)),
        (80, [3736, 9], FIVE, (WRITTEN, "I LID 9 = Int 5", 0)),
        (81, [3736, 9], FIVE, (WRITTEN_OUTPUTS, "Q LID 9 = Int 5", 0)),
        (82, [3736, 9], FIVE, (WRITTEN, "M LID 9 = Int 5", 0)),
        (DB3, [2533], FIVE, (LOADED, "DB3 (BodyDescription)", DB3)),
        (50, [3451], FIVE, (PROTECTED, "CPUcommon.CPUProtectionLevel", 50)),
        (16, [7], FIVE, (FIRMWARE, "FWpackage.7", 16)),
        (52, [2167], Value(0, DINT, 1), (STOP, "operating state request 1 STOP", 0)),
        (52, [2167], Value(0, DINT, 2), (RESET, "operating state request 2 reset retentive", 0)),
        (52, [2167], Value(0, DINT, 3), (START, "operating state request 3 RUN", 0)),
        (52, [2167], Value(0, DINT, 4), (START, "operating state request 4 redundant RUN", 0)),
        (52, [2167], Value(0, DINT, 9), (ORDERED, "operating state request DInt 9 (unknown)", 0)),
        (52, [2167], Value(0, LREAL, 1.0), (ORDERED, "operating state request LReal 1.0 (unknown)", 0)),
        (52, [2167], Value(0, BOOL, True), (ORDERED, "operating state request Bool true (unknown)", 0)),
        (0x386, [304], Value(0, BLOB, Blob(0, b"secret")), (PASSWORD, "", 0)),
        (0x386, [1846], None, (PASSWORD, "", 0)),
        (0x386, [7, 8, 304], None, (PASSWORD, "", 0)),
        (50, [7, 8, 7918], FIVE, (PROTECTED, "CPUcommon.CPUPassword", 50)),
        (SUBSCRIPTION, [1048], LIST, (LISTED, "CPUexecUnit.DIS.OperatingState", SUBSCRIPTION)),
        (2, [2458], Value(0, BOOL, True), (CONFIRMED, "", 2)),
    ],
)
def test_a_write_that_means_something_is_an_event(
    object_id: int, ids: list[int], value: Value | None, wanted: tuple[str, str, int]
) -> None:
    assert of_one(object_id, ids, value)[0] == [(*wanted, -1)]


@pytest.mark.parametrize(
    ("object_id", "ids", "value"),
    [
        (52, [2168], Value(0, DINT, 1)),
        (52, [2167], None),
        (50, [2167], Value(0, DINT, 1)),
        (SUBSCRIPTION, [1048], None),
        (SUBSCRIPTION, [1053], FIVE),
        (2, [2458], Value(0, BOOL, False)),
        (2, [2458], FIVE),
        (2, [2458], None),
        (2, [2459], Value(0, BOOL, True)),
        (3, [2458], Value(0, BOOL, True)),
        (SUBSCRIPTION, [1048], Value(ADDRESS_ARRAY, UDINT, [0x80000000, 0, 0])),
        (SUBSCRIPTION, [1048], FIVE),
        (0x8B000001, [2550, 9], FIVE),
        (0x386, [304, 7], FIVE),
        (50, [3451, 7], FIVE),
    ],
)
def test_a_write_that_means_nothing_is_no_event(object_id: int, ids: list[int], value: Value | None) -> None:
    assert of_one(object_id, ids, value)[0] == []


def test_a_list_is_taken_only_if_it_was_written() -> None:
    assert of_one(SUBSCRIPTION, [1048], LIST)[1].states == {SUBSCRIPTION: [9]}
    events, one = of_one(SUBSCRIPTION, [1048], LIST, good=False)
    assert (events, one.states) == ([], {})


def test_a_list_names_five_of_its_items() -> None:
    for count in (5, 6):
        items = [word for reference in range(count) for word in (0x80040001, reference, 0, 50, 0, 3701)]
        events, one = of_one(SUBSCRIPTION, [1048], Value(ADDRESS_ARRAY, UDINT, [0, 0, count, *items]))
        assert events == [(LISTED, ", ".join(["CPUcommon.3701"] * 5), SUBSCRIPTION, -1)]
        assert len(one.subscriptions[SUBSCRIPTION]) == count


def test_a_stream_is_told_with_what_it_writes() -> None:
    assert of_one(DB3, [2533], None, streamed=True)[0] == [
        (STREAMED, "DB3 BodyDescription", DB3, -1),
        (LOADED, "DB3 (BodyDescription)", DB3, -1),
    ]
    assert of_one(0x386, [7, 8], FIVE, streamed=True)[0] == [(STREAMED, "902.7.8", 0x386, -1)]


# ---- several in one request -----------------------------------------------------------------------------------------


def address(area: int, lid: int) -> VariableAddress:
    return VariableAddress(0, area, 2550 if area == DB3 else 3736, [lid])


def several(
    addresses: list[VariableAddress],
    refused: dict[int, int] | None = None,
    answered: bool = True,
    good: bool = True,
    one: PlusSession | None = None,
) -> list[Said]:
    events: list[Event] = []
    values = {at: Attribute(0, Value(0, INT, at)) for at in range(1, len(addresses) + 1)}
    judge_writes(one or session(), events, addresses, values, refused or {}, answered, good)
    return said(events)


def test_writes_of_one_kind_with_one_result_are_one_event() -> None:
    areas = [DB3, 81, DB3, 82, 81]
    found = several([address(area, 9) for area in areas])
    assert found == [
        (WRITTEN, "DB3 LID 9 = Int 1, DB3 LID 9 = Int 3, M LID 9 = Int 4", 0, 0),
        (WRITTEN_OUTPUTS, "Q LID 9 = Int 2, Q LID 9 = Int 5", 0, 0),
    ]
    found = several([address(DB3, lid) for lid in range(1, 5)], {2: 0xFFF4, 3: 0xFFF4, 4: 0xFFE0})
    assert found == [
        (WRITTEN, "DB3 LID 1 = Int 1", 0, 0),
        (WRITTEN, "DB3 LID 2 = Int 2, DB3 LID 3 = Int 3", 0, 0xFFF4),
        (WRITTEN, "DB3 LID 4 = Int 4", 0, 0xFFE0),
    ]


def test_an_item_that_means_nothing_hides_no_other() -> None:
    nothing = VariableAddress(0, 50, 7, [])
    assert several([nothing, address(DB3, 9), nothing, address(DB3, 8)]) == [
        (WRITTEN, "DB3 LID 9 = Int 2, DB3 LID 8 = Int 4", 0, 0)
    ]


def test_without_an_answer_only_what_was_refused_has_a_result() -> None:
    found = several([address(DB3, 1), address(DB3, 2)], {2: 0xFFF4}, answered=False)
    assert [refusal for *_, refusal in found] == [-1, 0xFFF4]
    assert several([VariableAddress(0, 50, 3451, [])]) == [(PROTECTED, "CPUcommon.CPUProtectionLevel", 50, 0)]


def test_five_variables_are_named_and_the_others_counted() -> None:
    for count, more in ((5, ""), (6, " and 1 more"), (12, " and 7 more")):
        ((_, text, _, _),) = several([address(DB3, lid) for lid in range(1, count + 1)])
        assert text == ", ".join([f"DB3 LID {lid} = Int {lid}" for lid in range(1, 6)]) + more


@pytest.mark.parametrize(
    ("refused", "good", "before", "after"),
    [
        ({}, True, False, True),
        ({}, False, False, False),
        ({1: 0xFFF4}, True, False, False),
        ({2: 0xFFF4}, True, False, True),
        ({}, False, True, True),
    ],
)
def test_a_client_is_authenticated_by_a_key_that_was_written(
    refused: dict[int, int], good: bool, before: bool, after: bool
) -> None:
    one = session()
    one.authenticated = before
    several([VariableAddress(0, 0x386, 1830, []), address(50, 7)], refused, True, good, one)
    assert one.authenticated == after


def test_a_list_that_was_refused_is_not_taken() -> None:
    for refused, states in (({}, {SUBSCRIPTION: [9]}), ({1: 0xFFF4}, {})):
        one, events = session(), list[Event]()
        listed = VariableAddress(0, SUBSCRIPTION, 1048, [])
        judge_writes(one, events, [listed], {1: Attribute(0, LIST)}, refused, True, True)
        assert one.states == states
        assert len(events) == len(states)


# ---- which requests are judged so -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("object_id", "first", "wanted"),
    [
        (52, 7, True),
        (80, 7, True),
        (84, 7, True),
        (79, 7, False),
        (85, 7, False),
        (51, 7, False),
        (2, 7, True),
        (16, 7, True),
        (3, 7, False),
        (DB3, 7, True),
        (0x89FD0001, 7, True),
        (0x89FC0001, 7, False),
        (0x8A320001, 7, True),
        (0x8A330001, 7, False),
        (0x386, 7, False),
        (0x386, 304, True),
        (0x386, 1846, True),
        (0x386, 1048, True),
        (0x386, 3451, True),
        (0x386, 7921, True),
        (0x386, 7922, False),
        (0x386, 0, False),
        (0x386, -1, False),
        (0x386, 8191, False),
        (0x386, 8192, False),
        (0x386, 0xFFFFFFFF, False),
    ],
)
def test_a_write_of_one_attribute_matters_by_its_object_or_its_id(object_id: int, first: int, wanted: bool) -> None:
    assert matters(object_id, first) == wanted
    if first >= 0:
        one = check(framed(asked(7, SET_VARIABLE, body=bodies.set_variable(object_id, [first, 9], FIVE))))
        assert (one.sound, first_id(one)) == (True, first)


def test_a_write_of_nothing_has_no_first_id() -> None:
    one = check(framed(asked(7, SET_VARIABLE, body=bodies.set_variable(52, [], FIVE))))
    assert (one.sound, first_id(one)) == (True, -1)
    events: list[Event] = []
    take_write(session(), events, one, True, True)
    assert events == []


def test_only_a_sound_write_of_its_function_is_plain() -> None:
    written = framed(asked(7, SET_MULTI_VARIABLES, body=bodies.set_multi([(address(DB3, 9), FIVE)])))
    assert is_plain(check(written), SET_MULTI_VARIABLES)
    assert not is_plain(check(written), SET_VARIABLE)
    assert not is_plain(check(written[:-5] + b"\1" + written[-4:]), SET_MULTI_VARIABLES)
    got = framed(asked(7, GET_MULTI_VARIABLES, body=bodies.get_multi(address(DB3, 9))))
    assert not is_plain(check(got), SET_MULTI_VARIABLES)


def test_a_write_that_could_take_too_much_work_is_not_plain() -> None:
    """Of each octet four steps at most: a quarter of the limit in octets is read in any case."""
    head = len(asked(1, SET_VARIABLE, body=bodies.set_variable(DB3, [2550, 9], Value(0, WSTRING, ""))))
    for spare, plain in ((0, True), (1, False)):
        text = "x" * (MAX_WORK // 4 - head - 2 + spare)  # the length of a text of so many has two octets more
        data = asked(1, SET_VARIABLE, body=bodies.set_variable(DB3, [2550, 9], Value(0, WSTRING, text)))
        assert len(data) == MAX_WORK // 4 + spare
        frames = [data[at : at + 60_000] for at in range(0, len(data), 60_000)]
        octets = b"".join([framed(frame, trailer=frame is frames[-1]) for frame in frames])
        assert is_plain(check(octets), SET_VARIABLE) == plain


def taken(octets: bytes, answered: bool = True, good: bool = True) -> list[Said]:
    events: list[Event] = []
    one = check(octets)
    assert one.sound
    take_write(session(), events, one, answered, good)
    return said(events)


def test_values_are_found_in_the_request() -> None:
    pairs = [(address(DB3, 9), FIVE), (VariableAddress(0, 52, 2167, []), Value(0, DINT, 1)), (address(81, 3), FIVE)]
    octets = framed(asked(7, SET_MULTI_VARIABLES, body=bodies.set_multi(pairs)), 3)
    assert taken(octets) == [
        (WRITTEN, "DB3 LID 9 = Int 5", 0, 0),
        (STOP, "operating state request 1 STOP", 0, 0),
        (WRITTEN_OUTPUTS, "Q LID 3 = Int 5", 0, 0),
    ]
    assert [refusal for *_, refusal in taken(octets, answered=False)] == [-1] * 3
    one = framed(asked(7, SET_VARIABLE, body=bodies.set_variable(52, [2167], Value(0, DINT, 3))), 3)
    assert taken(one) == [(START, "operating state request 3 RUN", 0, -1)]


def test_a_value_of_no_item_is_none_of_the_write() -> None:
    """Numbers of items begin with 1, and end with the addresses."""
    one = address(DB3, 9)
    head = bodies.addresses(one, one)
    for first, second, text in ((1, 2, "DB3 LID 9 = Int 5, DB3 LID 9 = Int 6"), (2, 3, "DB3 LID 9, DB3 LID 9 = Int 5")):
        pairs = number(first) + build_value(FIVE) + number(second) + build_value(Value(0, INT, 6))
        octets = framed(asked(7, SET_MULTI_VARIABLES, body=head + pairs + b"\0" + QUALIFIER + end(9)))
        assert taken(octets) == [(WRITTEN, text, 0, 0)]


def test_attributes_of_one_object_are_written_like_variables() -> None:
    body = rid(50) + b"\2\2" + number(3451) + number(7) + b"\1" + build_value(FIVE) + b"\2" + build_value(FIVE)
    octets = framed(asked(7, SET_MULTI_VARIABLES, body=body + b"\0" + QUALIFIER + end(9)))
    assert taken(octets) == [(PROTECTED, "CPUcommon.CPUProtectionLevel", 50, 0)]
