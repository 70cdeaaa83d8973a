"""What a glance tells of a plain transaction is what reading all of it tells; everything else is left to be read."""

from __future__ import annotations

from itertools import permutations
from pathlib import Path
from typing import Final

from hypothesis import given
from hypothesis import strategies as st

import dissect
from dissect.s7plus.bodies import parse_contents
from dissect.s7plus.contents import Address, Contents
from dissect.s7plus.glance import Glance, Seen, glance
from dissect.s7plus.identification import IDENTIFICATION
from dissect.s7plus.message import parse_plus
from dissect.s7plus.objects import whole_numbers
from dissect.s7plus.plain import REQUEST_SIZE
from dissect.s7plus.refusals import glimpse
from dissect.s7plus.session import (
    CPU_EXEC_UNIT,
    CPU_PROXY,
    OPERATING_STATE,
    REFERENCE_LIST,
    SESSION_KEY,
)
from dissect.s7plus.skimming import ASKS, SOUND
from dissect.s7plus.tables import DELETE_OBJECT, GET_MULTI_VARIABLES, GET_VAR_SUBSTREAMED, REQUEST, SET_MULTI_VARIABLES
from dissect.s7plus.value_tables import ADDRESS_ARRAY, ARRAY, BLOB, DINT, INT, UDINT
from dissect.s7plus.values import Blob, Value, build_value
from dissect.transactions.transaction import Transaction
from dissect.wire.varint import VLQ64, build_varint
from tests.s7plus.bodies import addresses, delete_object, end, get_multi, get_stream, multi_got, number, rid, set_multi
from tests.s7plus.pdus import asked, framed, told
from tests.s7plus.strategies import VALUES

_STATE: Final = Address(0, CPU_EXEC_UNIT, 2237, [OPERATING_STATE])
_WORD: Final = Address(0, 82, 3736, [3, 100, 2])
_OUTPUT: Final = Address(7, 81, 3736, [15])
_TAG: Final = Address(0xABCDEF12, 0x8A0E0003, 2550, [14, 2])
_KEY: Final = Address(0, 0x386, SESSION_KEY, [])
_LISTS: Final = st.lists(st.sampled_from([_STATE, _WORD, _OUTPUT, _TAG, _KEY]), max_size=4)
#: The functions that are glanced at.
_GLANCED: Final = frozenset((GET_MULTI_VARIABLES, GET_VAR_SUBSTREAMED, SET_MULTI_VARIABLES, DELETE_OBJECT))
_LIST: Final = Value(ADDRESS_ARRAY, UDINT, [0x80010000, 0, 1, 0x80040002, 5, 0, 82, 0xAC43DB80, 3736, 9])
_OK: Final = b"\0"


def _state_of(asks: Contents, tells: Contents, function: int) -> int | None:
    """Give the operating state as all of the contents tell it, None when it was not asked for."""
    found: list[Value] = []
    streamed = function == GET_VAR_SUBSTREAMED and asks.object_id == CPU_EXEC_UNIT
    if streamed and asks.ids[-1] == OPERATING_STATE and tells.value is not None:
        found = [tells.value]
    elif function == GET_MULTI_VARIABLES:
        values = dict(tells.items)
        wanted = [
            index
            for index, one in enumerate(asks.addresses, 1)
            if one.area == CPU_EXEC_UNIT and one.lids[-1:] == [OPERATING_STATE]
        ]
        found = [values[index] for index in wanted if index in values]
    states = [value.content for value in found if isinstance(value.content, int)]
    return states[-1] if states else None


def check(function: int, request: bytes, response: bytes) -> Seen | None:
    """Hold a glance to the reading of the same octets."""
    seen = glance(function, request, response, glimpse(request), glimpse(response), True, True)
    if seen is None:
        return None
    halves = parse_plus(request), parse_plus(response)
    asks, tells = (parse_contents(pdu, False) for pdu in halves)
    for pdu, contents in zip(halves, (asks, tells), strict=True):
        assert pdu.whole
        assert contents.whole
        assert not pdu.malformed
        assert not contents.malformed
    if not seen.matters and function == GET_VAR_SUBSTREAMED:
        asked_for = glimpse(request)
        assert asked_for & SOUND
        assert not asked_for & ASKS or (asks.object_id == CPU_PROXY and asks.ids[0] != IDENTIFICATION)
        assert _state_of(asks, tells, function) is None
        return seen
    refused = function == GET_VAR_SUBSTREAMED and not seen.good
    assert halves[1].return_value == 0 or function == DELETE_OBJECT or refused
    assert seen.good == (halves[1].return_code < 0x8000)
    assert not tells.refusals
    expected = (halves[0].session_id, halves[0].sequence, asks.integrity_id)
    assert (seen.session_id, seen.sequence, seen.integrity_id) == expected
    state = _state_of(asks, tells, function) if not refused else None
    assert (seen.state if seen.stated else None) == state
    if function == DELETE_OBJECT:
        assert seen.deleted == asks.object_id
    if function == SET_MULTI_VARIABLES:
        assert seen.authenticated == any([one.sub_area == SESSION_KEY for one in asks.addresses])
        written = dict(asks.items)
        listed = [written[index] for index, id_ in enumerate(asks.ids, 1) if id_ == REFERENCE_LIST and index in written]
        assert [seen.references or []] == ([whole_numbers(value) for value in listed] or [[]])
        assert (seen.listed, seen.references is None) == ((asks.object_id, False) if listed else (-1, True))
    record = tells.value.content if tells.value is not None else None
    identifies = function == GET_VAR_SUBSTREAMED and asks.ids[0] == IDENTIFICATION and asks.object_id == CPU_PROXY
    assert seen.record == (record.octets if identifies and isinstance(record, Blob) and not refused else b"")
    return seen


def pair(function: int, request: bytes, response: bytes, version: int = 3) -> tuple[int, bytes, bytes]:
    return (
        function,
        framed(asked(7, function, body=request), version),
        framed(told(7, function, body=response), version),
    )


def sealed(body: bytes) -> bytes:
    """A digest in the place of the zeros, as a CPU 1511 with firmware 1.0 sends it."""
    return body[:-4] + b"\x20" + bytes(range(32))


def set_many(values: list[Value], *ids: int) -> bytes:
    """Give a write of attributes of one object."""
    pairs = b"".join([number(index) + build_value(value) for index, value in enumerate(values, 1)])
    wanted = b"".join([number(id_) for id_ in ids])
    return rid(0x386) + number(len(values)) + number(len(ids)) + wanted + pairs + set_multi([])[6:]


@given(_LISTS, st.lists(VALUES, min_size=4, max_size=4), st.integers(-1, 2**32 - 1), st.sampled_from([2, 3]), st.data())
def test_reads_and_writes_of_several(
    wanted: list[Address], values: list[Value], id_: int, version: int, data: st.DataObject
) -> None:
    state = Value(0, DINT, data.draw(st.integers(-(2**31), 2**31 - 1)))
    items = [state if one is _STATE else value for one, value in zip(wanted, values, strict=False)]
    check(
        *pair(
            GET_MULTI_VARIABLES, get_multi(*wanted, integrity_id=id_), multi_got(list(enumerate(items, 1)), []), version
        )
    )
    both = list(zip(wanted, items, strict=True))
    check(*pair(SET_MULTI_VARIABLES, set_multi(both, integrity_id=id_), _OK + b"\0" + end(3), version))
    asks, tells = get_multi(*wanted, integrity_id=id_), multi_got([*enumerate(items, 1)], [], id_)
    check(*pair(GET_MULTI_VARIABLES, sealed(asks), sealed(tells), version))


def test_a_digest_behind_the_data_is_plain() -> None:
    asks, tells = get_multi(_STATE), multi_got([(1, Value(0, DINT, 8))], [])
    seen = check(*pair(GET_MULTI_VARIABLES, sealed(asks), sealed(tells), 2))
    assert seen is not None
    assert (seen.state, seen.integrity_id) == (8, 9)
    # One octet too many is for who reads it all.
    assert check(*pair(GET_MULTI_VARIABLES, sealed(asks), sealed(tells) + b"\0", 2)) is None


@given(st.integers(0, 2**32 - 1), st.sampled_from([[OPERATING_STATE], [IDENTIFICATION], [2237, 3486], [300]]), VALUES)
def test_reads_of_one(object_id: int, ids: list[int], value: Value) -> None:
    for one in (object_id, CPU_PROXY, CPU_EXEC_UNIT):
        for content in (value, Value(0, DINT, 8), Value(0, BLOB, Blob(0, b"record"))):
            check(
                *pair(GET_VAR_SUBSTREAMED, get_stream(one, ids) + end(9), _OK + b"\0" + build_value(content) + end(3))
            )


def test_what_it_tells() -> None:
    seen = check(
        *pair(
            GET_MULTI_VARIABLES,
            get_multi(_WORD, _STATE),
            multi_got([(1, Value(0, INT, 5)), (2, Value(0, DINT, 8))], []),
        )
    )
    assert seen is not None
    assert (seen.state, seen.stated, seen.integrity_id) == (8, True, 9)
    stream = _OK + b"\0" + build_value(Value(0, BLOB, Blob(0, b"record"))) + end(3)
    seen = check(*pair(GET_VAR_SUBSTREAMED, get_stream(CPU_PROXY, [IDENTIFICATION]) + end(9), stream))
    assert seen is not None
    assert seen.record == b"record"
    seen = check(*pair(DELETE_OBJECT, delete_object(0x70000001), _OK + rid(0x70000001) + end()))
    assert seen is not None
    assert seen.deleted == 0x70000001
    seen = check(*pair(SET_MULTI_VARIABLES, set_many([Value(0, INT, 1)], SESSION_KEY), _OK + b"\0" + end(3)))
    assert seen is not None
    assert seen.authenticated


@given(st.lists(st.integers(0, 2**32 - 1), max_size=9), st.sampled_from([ARRAY, ADDRESS_ARRAY, 0x30, 0]), VALUES)
def test_a_list_of_references(numbers: list[int], flags: int, other: Value) -> None:
    given_list = Value(flags, UDINT, numbers) if flags else other
    for values, ids in (
        ([given_list], (REFERENCE_LIST,)),
        ([Value(0, INT, 1), given_list], (306, REFERENCE_LIST)),
        ([given_list, other], (REFERENCE_LIST, REFERENCE_LIST)),
    ):
        seen = check(*pair(SET_MULTI_VARIABLES, set_many(values, *ids), _OK + b"\0" + end(3)))
        if flags in {ARRAY, ADDRESS_ARRAY} and values[-1] is given_list:
            assert seen is not None
            assert (seen.listed, seen.references) == (0x386, numbers)


def test_a_read_that_is_refused_says_nothing_but_its_integrity_id() -> None:
    body = get_stream(CPU_PROXY, [8377]) + end(9)
    for answer in (b"\0\0\0", b"\0\0\x08\x08"):
        code = build_varint(0x8101_0000_0000_FFF4, VLQ64)
        seen = check(*pair(GET_VAR_SUBSTREAMED, body, code + answer + end(3)))
        assert seen is not None
        assert (seen.matters, seen.stated, seen.integrity_id) == (True, False, 9)
    for code in (b"\x13", b"\x11"):  # a part of it is refused; another number that is no error
        assert check(*pair(GET_VAR_SUBSTREAMED, body, code + b"\0\0\0" + end(3))) is None


def test_what_it_leaves_to_be_read() -> None:
    function, request, response = pair(
        SET_MULTI_VARIABLES, set_multi([(_OUTPUT, Value(0, INT, 5))]), _OK + b"\0" + end(3)
    )
    skimmed = glimpse(response)
    assert glance(function, request, response, -1, skimmed, False, True) is None  # the first write to outputs is told
    assert glance(function, request, response, -1, skimmed, True, False) is not None
    for id_ in (304, 1846, 1048, 2449):  # passwords, a list of references that is none, a compressed blob
        assert check(*pair(SET_MULTI_VARIABLES, set_many([Value(0, INT, 1)], id_), _OK + b"\0" + end(3))) is None
    body = get_multi(_STATE)
    item = (1, Value(0, DINT, 8))
    for answer in (
        multi_got([item], [(2, 0xFFF4)]),
        b"\x11" + multi_got([item], [])[1:],
        multi_got([(1, Value(0, INT, 8))], []),
    ):
        assert check(*pair(GET_MULTI_VARIABLES, body, answer)) is None
    twice = addresses(_STATE)[4:]
    assert (
        check(
            *pair(GET_MULTI_VARIABLES, rid(0) + number(200) + twice[1:] + body[4 + len(twice) :], multi_got([item], []))
        )
        is None
    )


@given(st.data())
def test_any_damage(data: st.DataObject) -> None:
    cases = (
        pair(
            GET_MULTI_VARIABLES,
            get_multi(_WORD, _STATE),
            multi_got([(1, Value(0, INT, 5)), (2, Value(0, DINT, 8))], []),
        ),
        pair(GET_VAR_SUBSTREAMED, get_stream(CPU_EXEC_UNIT, [2237, 3486]) + end(9), _OK + b"\0\0\x08\4" + end(3)),
        pair(SET_MULTI_VARIABLES, set_multi([(_TAG, Value(0, INT, 5))]), _OK + b"\0" + end(3), 1),
        pair(SET_MULTI_VARIABLES, set_many([Value(0, INT, 1)] * 2, SESSION_KEY, 306), _OK + b"\0" + end(3)),
        pair(SET_MULTI_VARIABLES, set_many([_LIST, _LIST], REFERENCE_LIST, 306), _OK + b"\0" + end(3)),
        pair(DELETE_OBJECT, delete_object(0x8A0E0001), _OK + rid(0x8A0E0001) + end(3), 2),
    )
    function, *halves = data.draw(st.sampled_from(cases))
    which = data.draw(st.integers(0, 1))
    octets = bytearray(halves[which])
    for _ in range(data.draw(st.integers(1, 3))):
        octets[data.draw(st.integers(0, len(octets) - 1))] = data.draw(st.integers(0, 255))
    halves[which] = bytes(octets[: data.draw(st.integers(0, len(octets)))] if data.draw(st.booleans()) else octets)
    check(function, halves[0], halves[1])


def test_captures(corpus: Path) -> None:
    """Most transactions of the shared captures are plain, and a glance tells of them what reading tells."""
    told_of = looked_at = 0
    for path in sorted((corpus / "s7plus").glob("*.pcap*")):
        for one in dissect.open(path):
            if not isinstance(one, Transaction) or not one.is_plus or one.function not in _GLANCED:
                continue
            if one.request_size and one.response_size:
                looked_at += 1
                told_of += check(one.function, one.request_octets, one.response_octets) is not None
    assert told_of > looked_at / 2 > 0, f"{told_of} of {looked_at}"


def test_nothing_is_looked_at_behind_what_is_not_plain() -> None:
    """A number without an end leaves no place to go on from; what a glance passes over next must not be looked for there."""
    request = framed(asked(1, GET_MULTI_VARIABLES, body=b"\0\0\0\0" + b"\xff" * 5))
    for steps in permutations(("four", "value", "state", "blob", "ends", "number", "count"), 3):
        half = Glance()
        half.begin(request, REQUEST, GET_MULTI_VARIABLES, REQUEST_SIZE)
        assert half.plain
        assert half.four() == 0
        assert half.number() == -1
        assert not half.expect(_OK)
        assert not half.skip(4)
        for step in steps:
            getattr(half, step)()
        assert not half.plain
