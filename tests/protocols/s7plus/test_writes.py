"""What a sound write or notification says is found without reading all of it, and is what reading all of it finds."""

from __future__ import annotations

import struct
from typing import Final

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.protocols.s7plus.check import check
from dissect.protocols.s7plus.contents import VariableAddress
from dissect.protocols.s7plus.ending import NOTIFICATION_FILL
from dissect.protocols.s7plus.event import RUNNING, STOPPED, WRITTEN, WRITTEN_OUTPUTS, Event, Facts
from dissect.protocols.s7plus.events import _read_in_full, take
from dissect.protocols.s7plus.message import parse_plus
from dissect.protocols.s7plus.program import Program
from dissect.protocols.s7plus.session import REFERENCE_LIST, Identity, PlusSession
from dissect.protocols.s7plus.tables import SET_MULTI_VARIABLES, SET_VARIABLE, VALUE_ITEM, VALUE_ITEM_VLQ
from dissect.protocols.s7plus.value_tables import ADDRESS_ARRAY, BOOL, DINT, INT, UDINT
from dissect.protocols.s7plus.values import Value, build_value
from dissect.protocols.s7plus.writes import is_plain
from dissect.wire.varint import VLQ64, build_varint
from tests.protocols.s7plus.bodies import QUALIFIER, number, rid, set_multi, set_variable
from tests.protocols.s7plus.pdus import asked, framed, told
from tests.protocols.s7plus.strategies import VALUES

STATE: Final = VariableAddress(0, 52, 2237, [3486])
DB3: Final = 0x8A0E0003
SUBSCRIPTION: Final = 0x70400010
_LIST: Final = Value(ADDRESS_ARRAY, UDINT, [0x80000000, 0, 1, 0x80040002, 9, 0, 52, 0, 2237, 3486])
_VALUES: Final = VALUES | st.just(_LIST) | st.sampled_from([Value(0, BOOL, True), Value(0, DINT, 1), Value(0, INT, 3)])
#: Objects and areas of all kinds; attributes that say something, and others.
_OBJECTS: Final = st.sampled_from([2, 3, 16, 49, 50, 52, 80, 81, 82, DB3, 0x8A120001, SUBSCRIPTION, 0x10000000])
_IDS: Final = st.sampled_from([
    REFERENCE_LIST, 2167, 304, 1846, 1830, 3451, 7918, 2458, 2550, 2544, 2533, 3736, 233, 14, 300,
])  # fmt: skip
_WRITES: Final = st.tuples(st.builds(VariableAddress, st.just(0), _OBJECTS, _IDS, st.lists(_IDS, max_size=2)), _VALUES)


def said(events: list[Event]) -> list[tuple[str, str, int, int]]:
    return [(event.kind, event.text, event.object_id, event.refusal) for event in events]


def session() -> PlusSession:
    """A session with a subscription that reports the operating state by the reference 4."""
    found = PlusSession(Program(), Identity())
    found.subscriptions[SUBSCRIPTION] = {}
    found.change(SUBSCRIPTION, (True, [], [(4, STATE), (5, VariableAddress(0, DB3, 2550, [9]))]))
    found.identity.state = 8
    return found


def both_ways(function: int, request: bytes, answer: bytes) -> None:
    """The events of a request and its answer are those that reading all of them gives; so is what the session remembers."""
    short, full = session(), session()
    facts = take(short, function, request, answer)
    if facts is None:
        return  # a few octets say that nothing of it matters
    read = _read_in_full(full, function, parse_plus(request), check(answer) if answer else None, Facts())
    assert said(facts.events) == said(read.events)
    assert short.authenticated == full.authenticated
    assert (short.subscriptions, short.states) == (full.subscriptions, full.states)


def answered(function: int, code: int, version: int, body: bytes = b"") -> bytes:
    end = bytes(4) if version == 1 else number(16) + bytes(4)
    return framed(told(7, function, body=build_varint(code, VLQ64) + body + end), version)


@given(st.lists(_WRITES, max_size=7), st.sampled_from([-1, 0, 0x13, 0xFFF4]), st.sampled_from([1, 2, 3]))
def test_writes_of_several(writes: list[tuple[VariableAddress, Value]], code: int, version: int) -> None:
    body = set_multi(writes, -1 if version == 1 else 9)
    answer = answered(SET_MULTI_VARIABLES, code, version, b"\0") if code >= 0 else b""
    both_ways(SET_MULTI_VARIABLES, framed(asked(7, SET_MULTI_VARIABLES, body=body), version), answer)


@given(_OBJECTS, st.lists(_IDS, min_size=1, max_size=3), _VALUES, st.sampled_from([-1, 0, 0x13, 0xFFF4]))
def test_writes_of_one(object_id: int, ids: list[int], value: Value, code: int) -> None:
    answer = answered(SET_VARIABLE, code, 2) if code >= 0 else b""
    both_ways(SET_VARIABLE, framed(asked(7, SET_VARIABLE, body=set_variable(object_id, ids, value))), answer)


@given(st.integers(0, 3), st.sampled_from([b"\0", b"\x01\x13\0"]))
def test_attributes_of_one_object(left_out: int, refusals: bytes) -> None:
    """Several attributes of one object, some values of which may be left out or be there twice."""
    ids = [REFERENCE_LIST, 1830, 2550]
    items = [(1, _LIST), (2, Value(0, INT, 3)), (3, Value(0, INT, 4))]
    items[left_out:] = items[left_out + 1 :] + items[:1]
    head = rid(DB3) + number(len(items)) + number(len(ids)) + b"".join([number(id_) for id_ in ids])
    body = head + b"".join([number(item) + build_value(value) for item, value in items]) + b"\0" + QUALIFIER
    request = framed(asked(7, SET_MULTI_VARIABLES, body=body + number(9) + bytes(4)))
    both_ways(SET_MULTI_VARIABLES, request, answered(SET_MULTI_VARIABLES, 0, 2, refusals))


def test_a_sound_write_is_not_read_in_full() -> None:
    body = set_multi(
        [(VariableAddress(0, DB3, 2550, [9]), Value(0, INT, 3)), (VariableAddress(0, 81, 3736, [9]), Value(0, INT, 4))]
    )
    request = framed(asked(7, SET_MULTI_VARIABLES, body=body))
    assert is_plain(check(request), SET_MULTI_VARIABLES)
    assert not is_plain(check(request), SET_VARIABLE)
    facts = take(session(), SET_MULTI_VARIABLES, request, answered(SET_MULTI_VARIABLES, 0, 2, b"\0"))
    assert facts is not None
    assert [(event.kind, event.text) for event in facts.events] == [
        (WRITTEN, "DB3 LID 9 = Int 3"), (WRITTEN_OUTPUTS, "Q LID 9 = Int 4"),
    ]  # fmt: skip


#: Items of a notification: (how it begins, reference, value).
_ITEM: Final = st.tuples(
    st.sampled_from([VALUE_ITEM, VALUE_ITEM_VLQ]), st.sampled_from([4, 5, 6]), st.sampled_from([4, 6, 8])
)


def notification(items: list[tuple[int, int, int]]) -> bytes:
    found = b""
    for kind, reference, state in items:
        place = reference.to_bytes(4, "big") if kind == VALUE_ITEM else number(reference)
        found += bytes((kind,)) + place + build_value(Value(0, DINT, state))
    head = struct.pack(">BIHHHB", 0x33, SUBSCRIPTION, 0x0400, 0, 0, 1) + b"\5\1"
    return framed(head + found + b"\0" + bytes(NOTIFICATION_FILL))


@given(st.lists(_ITEM, max_size=4), st.booleans())
def test_states_in_notifications(items: list[tuple[int, int, int]], two: bool) -> None:
    """Each change of the operating state is an event, in whatever items it comes, and however many references report it."""
    one = session()
    if two:
        one.change(SUBSCRIPTION, (False, [], [(6, STATE)]))
    told_states = [state for _, reference, state in items if reference == 4 or (two and reference == 6)]
    before, wanted = 8, []
    for state in told_states:
        if state != before and state in {4, 8}:
            wanted.append(STOPPED if state == 4 else RUNNING)
        before = state
    octets = notification(items)
    assert check(octets).sound
    facts = take(one, -1, b"", octets)
    assert [event.kind for event in (facts.events if facts is not None else [])] == wanted
    assert one.identity.state == before


@pytest.mark.parametrize(("items", "place"), [([(VALUE_ITEM, 5, 4)], 0), ([(VALUE_ITEM, 4, 4)] * 2, -1)])
def test_an_item_is_sought(items: list[tuple[int, int, int]], place: int) -> None:
    found = check(notification(items))
    assert found.seek(4) == place
    assert found.seek(9) == 0
    alone = check(notification([(VALUE_ITEM, 5, 8), (VALUE_ITEM_VLQ, 4, 4)]))
    assert alone.data[alone.seek(4) :].startswith(build_value(Value(0, DINT, 4)))
