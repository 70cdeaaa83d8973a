"""What a session says of its client and its CPU, and what it keeps of subscriptions."""

from __future__ import annotations

from typing import Final

import pytest

from dissect.protocols.s7plus.contents import Made, VariableAddress
from dissect.protocols.s7plus.objects import Attribute, Element, PlusObject
from dissect.protocols.s7plus.program import Program
from dissect.protocols.s7plus.session import (
    MAX_ITEMS,
    MAX_SUBSCRIPTIONS,
    Counted,
    Identity,
    PlusSession,
    crc_places,
    is_state,
    parse_reference_list,
    reference_lists_of,
)
from dissect.protocols.s7plus.states import number_in, state_in
from dissect.protocols.s7plus.value_tables import ADDRESS_ARRAY, BLOB, BOOL, LREAL, STRUCT, UDINT, WSTRING
from dissect.protocols.s7plus.values import Blob, Struct, Value
from tests.protocols.s7plus.test_program import type_of, variable
from tests.protocols.s7plus.test_session import LIST, RECORD

STATE: Final = VariableAddress(0, 52, 2237, [3486])
WORD: Final = VariableAddress(0, 82, 3736, [9])


def session() -> PlusSession:
    return PlusSession(Program(), Identity())


def text(id_: int, said: str) -> Attribute:
    return Attribute(id_, Value(0, WSTRING, said))


def made(ids: list[int], *elements: Element, class_id: int = 287) -> Made:
    return Made(ids, [PlusObject(211, class_id, 0, 0, 0, list(elements))])


# ---- the client -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("application", "name", "host", "user", "who"),
    [
        ("", "", "", "", ""),
        ("HMI RT", "Session_1", "", "", "HMI RT"),
        ("", "Session_1", "", "", "Session_1"),
        ("HMI RT", "", "panel", "", "HMI RT on panel"),
        ("", "", "panel", "", "on panel"),
        ("HMI RT", "", "", "anna", "HMI RT as anna"),
        ("", "", "", "anna", "as anna"),
        ("HMI RT", "", "panel", "anna", "HMI RT on panel as anna"),
    ],
)
def test_a_client_is_its_program_its_host_and_its_user(
    application: str, name: str, host: str, user: str, who: str
) -> None:
    one = session()
    one.open_session(made([], text(297, application), text(233, name), text(298, host), text(296, user)))
    assert one.who == one.describe() == who
    assert repr(one) == f"PlusSession({application or 'application unknown'}, Identity(unknown))"


@pytest.mark.parametrize(
    ("application", "name", "host", "role", "kind", "role_name"),
    [
        ("", "", "", -1, "", ""),
        ("", "", "", 0, "", ""),
        ("TIA", "", "", 1, "engineering", "engineering"),
        ("HMI RT", "", "", 2, "panel", "HMI"),
        ("HMI RT", "", "", 3, "", "0x3"),
        ("SIMATIC NET", "", "", 2, "OPC", "HMI"),
        ("", "SIMATIC NET S7", "", 2, "OPC", "HMI"),
        ("not SIMATIC NET", "", "", 2, "panel", "HMI"),
        ("MyOpcServer", "", "", 1, "OPC", "engineering"),
        ("client", "", "opc-1", -1, "OPC", ""),
        ("client", "OPC", "", -1, "", ""),  # the name of the session counts where the program has none
        ("", "OPC", "", -1, "OPC", ""),
    ],
)
def test_the_kind_of_a_client(application: str, name: str, host: str, role: int, kind: str, role_name: str) -> None:
    one = session()
    role_said = [Attribute(299, Value(0, UDINT, role))] if role >= 0 else []
    one.open_session(made([], text(297, application), text(233, name), text(298, host), *role_said))
    assert (one.client_kind, one.role_name, one.role) == (kind, role_name, role)


def test_a_description_has_client_and_server_as_far_as_they_are_known() -> None:
    one = session()
    one.role = 1
    assert one.describe() == "(engineering)"
    one.application = "TIA"
    assert one.describe() == "TIA (engineering)"
    one.identity.firmware = "V4.3"
    assert one.describe() == "TIA (engineering), CPU V4.3"
    one.identity.order_number = "6ES7 215"
    assert one.describe() == "TIA (engineering), CPU 6ES7 215 V4.3"
    one.identity.order_number, one.identity.firmware = "6AV2 1", ""
    assert one.describe() == "TIA (engineering), panel 6AV2 1"


def test_of_a_session_that_nobody_opened_nothing_is_known() -> None:
    one = session()
    assert (one.application, one.session_name, one.host, one.user, one.role) == ("", "", "", "", -1)
    assert (one.tls, one.challenged, one.authenticated, one.given, one.latest) == (False, False, False, set(), -1)
    assert (one.explores, one.explored, one.explored_ns, one.states, one.subscriptions) == (0, [], 0, {}, {})
    assert (one.identity.state, one.identity.role, one.identity.serial_number, one.identity.told) == (-1, -1, "", [])


def test_only_the_object_of_a_session_describes_the_client() -> None:
    one = session()
    one.open_session(made([], text(297, "TIA"), class_id=1001))
    assert one.application == ""


def test_explores_are_counted_with_the_first_and_the_last() -> None:
    one = session()
    for frame in (5, 7, 9):
        one.note_explore(frame, 10 * frame)
        assert (one.explored_ns, one.explored[0], one.explored[-1]) == (10 * frame, 5, frame)
    assert (one.explores, one.explored) == (3, [5, 9])


def test_an_address_has_the_name_that_the_program_gives_it() -> None:
    one = session()
    address = VariableAddress(0, 0x8A0E0003, 2550, [9])
    assert one.label(address) == "DB3 LID 9"
    one.program.learn([type_of(0x92000003, ("level", variable(9)))])
    assert one.label(address) == 'DB3."level"'


# ---- the CPU --------------------------------------------------------------------------------------------------------


def version(said: str) -> Attribute:
    return Attribute(306, Value(0, STRUCT, Struct(314, [(319, Value(0, WSTRING, said))])))


@pytest.mark.parametrize(
    ("said", "known"),
    [
        ("1;6ES7 215-1AG40-0XB0 ;V4.3", ("6ES7 215-1AG40-0XB0", "V4.3")),
        ("2; 6ES7 ; V4.3", ("", "")),  # no version begins so
        ("1;6ES7;V4.3;more", ("", "")),
        ("6ES7;V4.3", ("", "")),
        ("1;6ES7;4.3", ("", "")),
        ("", ("", "")),
    ],
)
def test_a_cpu_says_what_it_is_when_a_session_is_opened(said: str, known: tuple[str, str]) -> None:
    one = session()
    one.session_opened(made([7], version(said)))
    identity = one.identity
    assert (identity.order_number, identity.firmware) == known
    source = "S7comm-plus session"
    wanted = [("order_number", known[0], source), ("firmware", known[1], source)] if known[0] else []
    assert identity.told == wanted
    short = f"Identity({known[0]}, {known[1]})" if known[0] else "Identity(unknown)"
    assert repr(identity) == short


def test_an_opened_session_begins_anew() -> None:
    one = session()
    one.session_opened(
        made([7, 8], Attribute(303, Value(0, BLOB, Blob(0, b"challenge"))), Attribute(299, Value(0, UDINT, 2)))
    )
    assert (one.challenged, one.authenticated, one.given, one.identity.role) == (True, False, {7}, 2)
    one.authenticated = True
    one.reads.repeats(5, 5)
    one.writes.repeats(5, 5)
    one.session_opened(made([9]))
    assert (one.challenged, one.authenticated, one.given, one.identity.role) == (False, False, {7, 9}, 2)
    assert (one.reads.sequence, one.writes.sequence, one.reads.integrity_id) == (-1, -1, -1)
    one.session_opened(made([]))
    assert one.given == {7, 9}
    one.session_opened(made([10], Attribute(299, Value(0, UDINT, 0))))
    assert one.identity.role == 0


def test_the_sessions_of_a_connection_are_bounded() -> None:
    one = session()
    for id_ in range(MAX_SUBSCRIPTIONS + 3):
        one.session_opened(made([id_]))
    assert one.given == set(range(MAX_SUBSCRIPTIONS))


@pytest.mark.parametrize(
    ("order_number", "role", "kind"),
    [
        ("", -1, ""),
        ("6ES7 215", 1, ""),
        ("6ES7 215", 2, "panel"),
        ("6AV2 124", -1, "panel"),
        ("", 2, "panel"),
        ("A6AV", -1, ""),
    ],
)
def test_a_panel_is_one_by_its_number_or_its_role(order_number: str, role: int, kind: str) -> None:
    identity = Identity()
    identity.order_number, identity.role = order_number, role
    assert identity.kind == kind


def test_a_record_is_told_whenever_it_is_read_and_what_is_told_is_bounded() -> None:
    one = session()
    one.identified(RECORD + b"\0")
    assert one.identity.told == []
    source = "I&M0 record"
    said = [
        ("order_number", "6ES7 215-1AG40-0XB0", source),
        ("serial_number", "S V-E6K87654321", source),
        ("hardware", "3", source),
        ("firmware", "V4.5.2", source),
    ]
    for times in range(1, 5):
        one.identified(RECORD)
        assert one.identity.told == said * times
    one.identified(RECORD)
    assert one.identity.told == said * 4  # nobody has taken them yet
    one.identity.told = []
    one.identified(RECORD.replace(b"6ES7 215-1AG40-0XB0", b" " * 19))
    assert one.identity.told == said[1:]
    assert one.identity.order_number == ""


@pytest.mark.parametrize(
    ("value", "state"),
    [
        (Value(0, UDINT, 8), 8),
        (Value(0, UDINT, 0), 0),
        (Value(0, BOOL, True), -1),
        (Value(0, LREAL, 8.0), -1),
        (Value(0, WSTRING, "8"), -1),
        (Value(ADDRESS_ARRAY, UDINT, [8]), -1),
        (Value(0, STRUCT, Struct(3481, [(3482, Value(0, UDINT, 1)), (3486, Value(0, UDINT, 4))])), 4),
        (Value(0, STRUCT, Struct(3481, [(3486, Value(0, BOOL, True))])), -1),
        (Value(0, STRUCT, Struct(3481, [(3485, Value(0, UDINT, 4))])), -1),
    ],
)
def test_a_state_is_a_number_or_the_member_that_is_one(value: Value, state: int) -> None:
    assert state_in(value) == state
    assert number_in(value) == (state if not isinstance(value.content, Struct) else -1)


# ---- integrity ids --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("before", "after", "repeats"),
    [
        ((0, 0), (1, 1), False),
        ((0, 0), (1, 0), True),
        ((0, 5), (0, 5), False),  # the same request
        ((0, 5), (0, 9), False),
        ((0, 5), (0x7FFF, 6), False),
        ((0, 5), (0x7FFF, 4), True),
        ((0, 5), (0x8000, 4), False),  # from here on it is one before
        ((0, 5), (0x8000, 6), True),
        ((0xFFFF, 5), (0, 6), False),
        ((0, 0), (1, 0x7FFFFFFF), False),
        ((0, 0), (1, 0x80000000), True),  # from here on it is a lower one
        ((0, 0xFFFFFFFF), (1, 0), False),
        ((0, 0), (0xFFFF, 0xFFFFFFFF), False),
    ],
)
def test_ids_go_the_way_of_the_numbers(before: tuple[int, int], after: tuple[int, int], repeats: bool) -> None:
    counted = Counted()
    assert not counted.repeats(*before)
    assert counted.repeats(*after) == repeats
    ahead = (after[0] - before[0]) & 0xFFFF
    assert (counted.sequence, counted.integrity_id) == (after if ahead < 0x8000 else before)


def test_the_first_request_is_taken_whatever_its_number() -> None:
    counted = Counted()
    assert not counted.repeats(0xFFF0, 3)
    assert (counted.sequence, counted.integrity_id) == (0xFFF0, 3)


# ---- subscriptions --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("address", "state"),
    [
        (VariableAddress(0, 52, 2237, [3486]), True),
        (VariableAddress(0, 52, 2237, [1, 3486]), True),
        (VariableAddress(0, 52, 2237, []), True),
        (VariableAddress(0, 52, 2237, [3485]), False),
        (VariableAddress(0, 52, 2237, [3486, 1]), False),
        (VariableAddress(0, 52, 2236, []), False),
        (VariableAddress(0, 50, 2237, [3486]), False),
        (VariableAddress(0, 50, 2237, []), False),
    ],
)
def test_the_state_of_the_cpu_is_that_of_its_execution_unit(address: VariableAddress, state: bool) -> None:
    assert is_state(address) == state


ITEM: Final = [0x80040001, 7, 0, 82, 0xABC, 3736]
LONGER: Final = [0x80040003, 8, 0, 82, 0, 3736, 9, 10]


@pytest.mark.parametrize(
    ("numbers", "found"),
    [
        ([0x80000000, 0], (False, [], [])),
        ([0x80000000, 0, 0], (True, [], [])),
        ([0x7FFFFFFF, 0, 0], (False, [], [])),
        ([0, 2, 0, 5, 6], (False, [5, 6], [])),
        ([0, 2, 0, 5, 6, 7], (False, [5, 6], [])),
        ([0, 0, 1, *ITEM], (False, [], [7])),
        ([0, 0, 0, *ITEM], (False, [], [])),
        ([0, 0, 1, *ITEM, *ITEM], (False, [], [7])),
        ([0, 0, 9, *ITEM], (False, [], [7])),
        ([0, 0, 1, *ITEM[:-1]], (False, [], [])),
        ([0, 1, 2, 5, *LONGER, *ITEM], (False, [5], [8, 7])),
        ([0, 0, 2, *ITEM, *LONGER[:-1]], (False, [], [7])),
        ([0, 0, 2, *LONGER[:-1]], (False, [], [])),
        ([0, 0, 1, 0x80040000, *ITEM[1:]], (False, [], [7])),  # an item has a sub area, whatever it counts
        ([0, 0, 2, 0x80040000, *ITEM[1:], *LONGER], (False, [], [7, 8])),
    ],
)
def test_a_reference_list_is_read_as_far_as_it_fits(
    numbers: list[int], found: tuple[bool, list[int], list[int]]
) -> None:
    new, gone, fresh = parse_reference_list(numbers)
    assert (new, gone, [reference for reference, _ in fresh]) == found
    for reference, address in fresh:
        assert address == VariableAddress(0xABC if reference == 7 else 0, 82, 3736, [] if reference == 7 else [9, 10])
    places = crc_places(numbers)
    assert [numbers[place] for place in places][: len(fresh)] == [address.crc for _, address in fresh]
    assert [numbers[place - 3] for place in places][: len(fresh)] == [reference for reference, _ in fresh]


def test_checksums_are_found_where_the_items_have_them() -> None:
    assert crc_places(LIST) == [7, 14]
    assert crc_places([0, 1, 2, 5, *LONGER, *ITEM]) == [8, 16]
    assert crc_places([0, 0, 1, *ITEM, *ITEM]) == [7]
    assert crc_places([0, 0, 0, *ITEM]) == []
    assert crc_places([0, 0, 2, *ITEM, *ITEM[:-1]]) == [7]
    assert crc_places([]) == crc_places([1]) == crc_places([1, 2]) == crc_places([0, 0, 1]) == []


def test_a_change_adds_and_removes_and_a_new_list_replaces() -> None:
    one = session()
    one.change(5, (True, [], [(1, WORD)]))
    assert (one.subscriptions, one.stamp) == ({}, 0)  # of no subscription that is known
    one.subscriptions[5] = {}
    one.change(5, (False, [], [(1, WORD), (2, STATE)]))
    assert (one.subscriptions[5], one.states) == ({1: WORD, 2: STATE}, {5: [2]})
    one.change(5, (False, [2, 99], [(3, WORD)]))
    assert (one.subscriptions[5], one.states) == ({1: WORD, 3: WORD}, {})
    one.change(5, (False, [1], [(1, STATE)]))  # removed and added again
    assert (one.subscriptions[5], one.states) == ({3: WORD, 1: STATE}, {5: [1]})
    one.change(5, (True, [3], [(4, WORD)]))
    assert (one.subscriptions[5], one.states) == ({4: WORD}, {})


def test_each_change_sets_a_number_of_its_own() -> None:
    one, other = session(), session()
    seen = []
    for session_, id_ in ((one, 5), (other, 5), (one, 6)):
        session_.subscriptions[id_] = {}
        session_.change(id_, (False, [], [(1, WORD)]))
        seen.append(session_.stamp)
    before = one.stamp
    one.unsubscribe(99)
    assert one.stamp == before
    one.unsubscribe(6)
    seen.append(one.stamp)
    assert len(set(seen)) == len(seen)
    assert min(seen) > 0


def test_a_reference_that_no_notification_can_have_reports_no_state() -> None:
    one = session()
    one.subscriptions[5] = {}
    one.change(5, (True, [], [(0, STATE), (0xFFFFFFFF, STATE), (0x100000000, STATE)]))
    assert one.states == {5: [0, 0xFFFFFFFF]}


def test_the_items_of_a_subscription_are_bounded() -> None:
    one = session()
    one.subscriptions[5] = {}
    one.change(5, (True, [], [(number, WORD) for number in range(MAX_ITEMS + 2)]))
    assert list(one.subscriptions[5]) == list(range(MAX_ITEMS))
    one.change(5, (False, [0], [(9999, STATE)]))
    assert one.address_of(5, 9999) == STATE


def test_lists_are_those_of_subscriptions() -> None:
    listed = Attribute(1048, Value(ADDRESS_ARRAY, UDINT, list(LIST)))
    objects = [PlusObject(1, class_id, 0, 0, 0, [listed]) for class_id in (1001, 287, 1001)]
    for number, one in enumerate(objects):
        one.offset = 10 * number
    assert {at: list(known) for at, known in reference_lists_of(objects).items()} == {
        0: [0xFFFFFFFE, 0xFFFFFFFF],
        20: [0xFFFFFFFE, 0xFFFFFFFF],
    }


def test_a_subscription_with_the_id_of_one_before_takes_its_place() -> None:
    one = session()
    asked = made([], Attribute(1048, Value(ADDRESS_ARRAY, UDINT, list(LIST))), class_id=1001)
    one.subscribe(asked, made([5]), reference_lists_of(asked.objects))
    other = made([], Attribute(1048, Value(ADDRESS_ARRAY, UDINT, [0, 0, 1, *ITEM])), class_id=1001)
    one.subscribe(other, made([5]), reference_lists_of(other.objects))
    assert list(one.subscriptions[5]) == [7]
    one.subscribe(made([]), made([6]), {})
    assert list(one.subscriptions) == [5]
