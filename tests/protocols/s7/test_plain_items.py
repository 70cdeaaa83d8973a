"""A block is plain exactly if its items are sound, and then what is said of it without its items is what they say."""

from __future__ import annotations

import pickle
from collections.abc import Sequence

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from dissect.engine.findings.transaction_rules import odd_address
from dissect.protocols.s7.items import WRITTEN_ELSEWHERE, WRITTEN_IO, Item, parse_data_items, parse_items, written_areas
from dissect.protocols.s7.parameters import Parameters, parse_parameters
from dissect.protocols.s7.plain_items import plain_answered_as, plain_area, plain_octets, plain_size, plainly_answered
from dissect.protocols.s7.tables import (
    ANSWER_TRANSPORT_SIZE,
    AREAS,
    ELEMENT_OCTETS,
    JOB,
    LENGTH_IN_BITS,
    RECORD_AREA,
    S7ANY,
    TRANSPORT_SIZES,
)
from dissect.wire.malformed import Malformed
from tests import build
from tests.engine.transactions.talk import dbw, item

READ = b"\x04"
WRITE = b"\x05"


def block(*items: bytes, function: bytes = READ) -> bytes:
    return function + bytes([len(items)]) + b"".join(items)


def are_plain(octets: bytes, count: int) -> bool:
    return plain_octets(octets, count) >= 0


def parsed(octets: bytes) -> Parameters:
    return parse_parameters(octets, JOB)


def items_of(octets: bytes) -> tuple[list[Item], list[Malformed]]:
    wrong: list[Malformed] = []
    return parse_items(octets, 2, len(octets), octets[1], wrong), wrong


def sound(one: Item) -> bool:
    """Return whether nothing is open about an item, by its own fields."""
    return (
        one.syntax_id == S7ANY
        and one.area in AREAS
        and one.area != RECORD_AREA
        and one.transport_size in TRANSPORT_SIZES
        and one.size >= 0
        and not odd_address(one)
    )


#: Nearly sound, so that often one thing alone is wrong.
ITEM = st.builds(
    build.any_item,
    st.one_of(st.sampled_from([1, 2, 4, 8]), st.sampled_from([*ELEMENT_OCTETS, 0x1C, 0x55])),
    st.sampled_from([1, 1, 1, 0, 2, 0xFFFF]),
    st.sampled_from([0, 0, 5, 0xFFFF]),
    st.one_of(st.sampled_from([0x84, 0x83]), st.sampled_from([0x80, 0x85, 0x1C, 0x1D, 0x1E, 0x1F, 0x01, 0x03, 0x99])),
    st.sampled_from([0, 80, 0x7FFF8, 3, 0x80000, 0xF80007]),
)


@pytest.mark.parametrize(
    ("one", "plain"),
    [
        (item(0x84, 1, 80, 2), True),
        (item(0x84, 1, 0x7FFF8, 2), True),
        (item(0x84, 1, 0x80000, 2), False),
        (item(0x84, 1, 83, 2), False),
        (item(0x84, 1, 83, 1), True),
        (item(0x84, 1, 83, 1, 2), False),
        (item(0x83, 0, 80, 4, 3), True),
        (item(0x83, 1, 80, 4, 3), False),
        (item(0x1C, 0, 3, 0x1C), True),
        (item(0x1C, 0, 0x80000, 0x1C), True),
        (item(0x1C, 1, 3, 0x1C), False),
        (item(0x1C, 0, 3, 0x04), False),
        (item(0x1E, 0, 3, 0x04), True),
        (item(0x01, 1, 80, 2), False),
        (item(0x99, 0, 80, 2), False),
        (item(0x84, 1, 80, 0x55), False),
    ],
)
def test_what_is_plain(one: bytes, plain: bool) -> None:
    assert are_plain(block(one), 1) is plain
    assert are_plain(block(dbw(1, 2), one), 2) is plain
    assert sound(items_of(block(one))[0][0]) is plain


@given(st.lists(ITEM, min_size=1, max_size=3))
def test_a_block_is_plain_exactly_if_its_items_are_sound(items: Sequence[bytes]) -> None:
    octets = block(*items)
    found, wrong = items_of(octets)
    plain = not wrong and all(sound(one) for one in found)
    assert are_plain(octets, octets[1]) is plain
    if plain:
        assert [plain_size(octets, index) for index in range(len(found))] == [one.size for one in found]
        assert [plain_area(octets, index) for index in range(len(found))] == [one.area for one in found]
        expected = [ANSWER_TRANSPORT_SIZE.get(one.transport_size, 0) for one in found]
        assert [plain_answered_as(octets, index) for index in range(len(found))] == expected


def test_every_area_with_the_known_transport_sizes() -> None:
    for area in range(256):
        for size in (*ELEMENT_OCTETS, 0x00, 0x10, 0xFF):
            octets = block(item(area, 0, 0, size))
            assert are_plain(octets, 1) is sound(items_of(octets)[0][0]), (area, size)


@given(st.binary(max_size=40))
@example(b"\x04\x00")
@example(block(dbw(1, 2)) + b"\x00")
@example(block(dbw(1, 2))[:-1])
@example(b"\x04\x02" + dbw(1, 2))
@example(block(b"\x13" + dbw(1, 2)[1:]))
@example(block(b"\x12\x0b" + dbw(1, 2)[2:]))
@example(block(b"\x12\x0a\x11" + dbw(1, 2)[3:]))
def test_no_block_with_a_fault_is_plain(octets: bytes) -> None:
    found = parsed(b"\x04" + octets[1:])
    if found.malformed or not found.items:
        assert not found.plain


@given(st.lists(ITEM, min_size=1, max_size=4), st.sampled_from([READ, WRITE]))
def test_what_is_said_of_a_block_is_what_its_items_say(items: Sequence[bytes], function: bytes) -> None:
    octets = block(*items, function=function)
    found = parsed(octets)
    wanted = [max(one.size, 0) for one in items_of(octets)[0]]
    assert found.known_items == len(items)
    assert [found.size_of(index) for index in range(len(items))] == [one.size for one in found.items]
    if function == WRITE:
        assert found.written == written_areas(found.items)
    else:
        assert found.answer_size == 14 + sum(4 + size + size % 2 for size in wanted) - wanted[-1] % 2


def test_where_a_plain_write_goes() -> None:
    def written(*items: bytes) -> int:
        return parsed(block(*items, function=WRITE)).written

    inside, outside = item(0x83, 0, 8, 2), item(0x82, 0, 8, 2)
    assert written(inside) == WRITTEN_ELSEWHERE
    assert written(outside) == WRITTEN_IO
    assert written(inside, outside) == WRITTEN_IO | WRITTEN_ELSEWHERE


def test_items_of_a_plain_block_are_made_once_and_when_asked_for() -> None:
    found = parsed(block(dbw(1, 2), dbw(3, 4, 5)))
    assert found.plain
    assert not found.unjudged
    assert [one.label for one in found.items] == ["DB1.DBW2", "DB3.DBW4 x5"]
    assert found.items is found.items
    assert [one.offset for one in found.items] == [2, 14]


def test_a_copy_of_a_plain_block_has_its_items() -> None:
    found = pickle.loads(pickle.dumps(parsed(block(dbw(1, 2)))))
    assert [one.label for one in found.items] == ["DB1.DBW2"]


CODES = st.sampled_from([0xFF] * 8 + [0x0A, 0])
ANSWERED = st.lists(
    st.tuples(
        st.sampled_from([1, 2, 3, 4, 6, 8, 0x0A, 0x1C]), st.integers(0, 3), CODES, st.sampled_from([0] * 8 + [1])
    ),
    min_size=1,
    max_size=3,
)


@given(ANSWERED, st.sampled_from([b"", b"", b"\0", b"\0\0"]), st.integers(0, 1), st.booleans())
def test_an_answer_is_plain_exactly_if_its_data_items_are_good(
    told: list[tuple[int, int, int, int]], behind: bytes, cut: int, filled: bool
) -> None:
    items, data = [], b""
    for size, number, code, wrong in told:
        asked = 1 if size == 1 else number
        items.append(build.any_item(size, asked, 0, 0x1C if size == 0x1C else 0x83, 0))
        octets = ELEMENT_OCTETS[size] * asked + wrong
        transport = ANSWER_TRANSPORT_SIZE.get(size, 4)
        length = octets * 8 if transport in LENGTH_IN_BITS else octets
        data += b"\0" * (len(data) % 2) + bytes([code, transport]) + length.to_bytes(2, "big") + bytes(octets)
    data += (b"\0" * (len(data) % 2) if filled else b"") + behind
    data = data[: len(data) - cut]
    octets_asked = block(*items)
    assert are_plain(octets_asked, len(items))
    wrong_data: list[Malformed] = []
    found = parse_data_items(b"**" + data, 2, 2 + len(data), len(items), True, wrong_data)
    good = (
        not wrong_data
        and all(each.return_code == 0xFF for each in found)
        and [len(each.data) for each in found] == [each.size for each in items_of(octets_asked)[0]]
        and all(
            ANSWER_TRANSPORT_SIZE.get(one[0], -1) == each.transport_size for one, each in zip(told, found, strict=True)
        )
    )
    assert plainly_answered(octets_asked, b"**" + data + b"***", 2, 2 + len(data)) is good
