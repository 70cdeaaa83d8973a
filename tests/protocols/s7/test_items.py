from __future__ import annotations

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.protocols.s7.items import (
    DataItem,
    Item,
    data_size_within,
    item_fill,
    parse_data_items,
    parse_item,
    parse_items,
)
from dissect.protocols.s7.layouts import DATA_ITEM, S7ANY_ITEM
from dissect.protocols.s7.tables import LENGTH_IN_BITS, SYNTAX_IDS, TRANSPORT_SIZES
from dissect.wire.malformed import Malformed
from tests.cases import each
from tests.engine.transactions.talk import dbw, good, item, refused, written

Fault = tuple[str, str, int, int, int, str]


def faults(told: list[Malformed]) -> list[Fault]:
    return [(fault.reason, fault.field, fault.offset, fault.needed, fault.available, fault.limit) for fault in told]


def items_of(octets: bytes, count: int, before: int = 2) -> tuple[list[Item], list[Fault]]:
    told: list[Malformed] = []
    found = parse_items(bytes(before) + octets, before, before + len(octets), count, told)
    return found, faults(told)


def data_of(octets: bytes, count: int, response: bool = True, before: int = 14) -> tuple[list[DataItem], list[Fault]]:
    told: list[Malformed] = []
    found = parse_data_items(bytes(before) + octets + b"\xff" * 9, before, before + len(octets), count, response, told)
    return found, faults(told)


def symbol(syntax_id: int, address: bytes) -> bytes:
    return bytes((0x12, len(address) + 1, syntax_id)) + address


# ---- request items --------------------------------------------------------------------------------------------------


@given(st.binary(min_size=9, max_size=9))
def test_s7any_is_its_layout(rest: bytes) -> None:
    octets = b"\x12\x0a\x10" + rest
    read = parse_item(octets, 14)
    expected = {value.field.name: value.value for value in S7ANY_ITEM.read(octets)}
    for name in ("syntax_id", "transport_size", "count", "db", "area"):
        assert getattr(read, name) == expected[name], name
    assert read.start_bit == expected["address"]
    assert (read.offset, read.octets) == (14, octets)
    assert repr(read) == f"Item({read.address!r}, count={expected['count']})"


#: Octets of one element of each transport size that has a known one (reference 3.5 and appendix).
ELEMENTS = {
    1: 1,
    2: 1,
    3: 1,
    4: 2,
    5: 2,
    6: 4,
    7: 4,
    8: 4,
    9: 2,
    10: 4,
    11: 4,
    12: 2,
    15: 8,
    0x13: 2,
    0x1C: 2,
    0x1D: 2,
    0x30: 8,
}


@pytest.mark.parametrize("count", [0, 1, 3, 0xFFFF])
def test_octets_of_a_good_answer(count: int) -> None:
    for size in range(256):
        read = parse_item(item(0x84, 1, 0, size, count), 0)
        if size not in ELEMENTS or (size == 1 and count != 1):
            assert read.size == -1
        else:
            assert read.size == ELEMENTS[size] * count
            assert read.fits(read.size)
            assert not read.fits(read.size + 1)
    assert size in TRANSPORT_SIZES or size not in ELEMENTS


def test_several_bits_fit_only_with_an_octet_each() -> None:
    read = parse_item(item(0x83, 0, 0, 1, 8), 0)
    assert read.fits(8)
    assert not read.fits(1)
    assert not read.fits(7)


def test_a_data_record_may_be_shorter_than_asked_for() -> None:
    for size in (1, 2):
        read = parse_item(item(0x01, 5, 0x200, size, 240), 0)
        assert (read.address, read.size) == ("RECORD5@512", -1)
        assert read.fits(17)


@pytest.mark.parametrize(("number", "name"), [*SYNTAX_IDS.names().items()])
def test_other_syntaxes_are_named_and_kept_as_octets(number: int, name: str) -> None:
    address = bytes.fromhex("8a0e0001")
    found, told = items_of(symbol(number, address), 1)
    assert [one.octets for one in found] == [symbol(number, address)]
    assert (found[0].syntax_id, found[0].address) == (number, f"{name}:8a0e0001")
    fields = (found[0].transport_size, found[0].count, found[0].db, found[0].area, found[0].start_bit, found[0].size)
    assert fields == (-1,) * 6
    assert told == ([("length_below", "item.length", 3, 10, 5, "item")] if number == 0x10 else [])


def test_an_unknown_syntax_is_stepped_over_by_its_length() -> None:
    found, told = items_of(symbol(0x77, b"\x01\x02") + b"\x00" + dbw(1, 0), 2)
    assert [one.address for one in found] == ["0x77:0102", "DB1.DBW0"]
    assert told == []


def test_a_longer_s7any_is_kept_as_octets() -> None:
    found, told = items_of(symbol(0x10, bytes(10)), 1)
    assert found[0].address == "S7ANY:" + "00" * 10
    assert told == [("trailing_octets", "item.length", 3, 10, 11, "item")]


def test_an_item_that_is_no_variable_specification() -> None:
    found, told = items_of(b"\x13" + dbw(1, 0)[1:], 1)
    assert [one.address for one in found] == ["DB1.DBW0"]
    assert told == [("bad_value", "item.specification", 2, 0x12, 0x13, "item")]


@each("size", range(3, 16))
@each("last", [False, True])
def test_fill_octets(size: int, last: bool) -> None:
    assert item_fill(size, last) == (1 if size % 2 and not last else 0)


@given(st.lists(st.binary(min_size=0, max_size=20), min_size=1, max_size=12))
def test_items_of_any_size_are_found_behind_their_fill_octets(addresses: list[bytes]) -> None:
    octets = b""
    for index, address in enumerate(addresses):
        one = symbol(0xB0, address)
        octets += one + (b"\xee" if len(one) % 2 and index + 1 < len(addresses) else b"")
    found, told = items_of(octets, len(addresses))
    assert [one.octets[3:] for one in found] == addresses
    assert told == []
    assert [(bytes(2) + octets)[one.offset : one.offset + len(one.octets)] for one in found] == [
        one.octets for one in found
    ]


@pytest.mark.parametrize("there", range(4))
@pytest.mark.parametrize("count", range(4))
def test_item_counts_that_lie(there: int, count: int) -> None:
    found, told = items_of(dbw(1, 0) * there, count)
    assert len(found) == min(there, count)
    if count > there:
        assert told == [("count_mismatch", "item_count", 1, count, there, "param")]
    elif count < there:
        assert told == [("trailing_octets", "items", 2 + 12 * count, 0, 12 * (there - count), "param")]
    else:
        assert told == []


def test_item_length_zero() -> None:
    found, told = items_of(b"\x12\x00\x10" + dbw(1, 0), 2)
    assert found == []
    assert told == [("length_below", "item.length", 2, 1, 0, "item")]


def test_item_of_nothing_but_its_syntax() -> None:
    found, told = items_of(b"\x12\x01\xb0", 1)
    assert ([one.address for one in found], told) == (["DBREAD:"], [])


def test_item_length_beyond_the_block() -> None:
    found, told = items_of(dbw(1, 0) + b"\x12\xff\x10\x00", 2)
    assert [one.address for one in found] == ["DB1.DBW0"]
    assert told == [("length_beyond", "item.length", 14, 257, 4, "param")]


@pytest.mark.parametrize("left", [1, 2])
def test_octets_too_few_for_an_item(left: int) -> None:
    found, told = items_of(dbw(1, 0) + b"\x12\x0a"[:left], 2)
    assert len(found) == 1
    assert told == [("count_mismatch", "item_count", 1, 2, 1, "param")]


def test_the_most_items_a_block_can_hold() -> None:
    found, told = items_of(dbw(1, 0) * 255, 255)
    assert (len(found), told) == (255, [])


@given(st.binary(max_size=60), st.integers(0, 255))
def test_any_items(octets: bytes, count: int) -> None:
    found, told = items_of(octets, count)
    assert len(found) <= count
    end = 2
    for one in found:
        assert one.offset >= end
        end = one.offset + len(one.octets)
        assert (bytes(2) + octets)[one.offset : end] == one.octets
        assert one.address
    assert end <= 2 + len(octets)
    assert len(found) == count or told


# ---- data items -----------------------------------------------------------------------------------------------------


@given(st.sampled_from([0, 3, 4, 5, 6, 7, 9, 0xFF]), st.integers(0, 0xFFFF), st.integers(0, 0xFFFF))
def test_what_a_length_counts(transport_size: int, length: int, room: int) -> None:
    bits = -(-length // 8)
    if transport_size == 6:  # octets for some, bits for others: what is there decides
        assert data_size_within(6, length, room) == (length if length <= room else bits)
    else:
        expected = bits if transport_size in LENGTH_IN_BITS else length
        assert data_size_within(transport_size, length, room) == expected


@given(st.integers(0, 255), st.integers(0, 255), st.integers(0, 40))
def test_data_item_is_its_layout(return_code: int, transport_size: int, length: int) -> None:
    octets = bytes((return_code, transport_size, 0, length)) + bytes(range(40))
    found, _ = data_of(octets, 1, False)
    expected = {value.field.name: value.value for value in DATA_ITEM.read(octets)}
    assert len(found) == 1
    for name in ("return_code", "transport_size", "length"):
        assert getattr(found[0], name) == expected[name], name
    assert found[0].data == octets[4 : 4 + data_size_within(transport_size, length, 40)]
    assert found[0].offset == 14


@given(st.lists(st.binary(max_size=9), min_size=1, max_size=10), st.booleans())
def test_data_items_are_found_behind_their_fill_octets(contents: list[bytes], pads_the_last: bool) -> None:
    octets = b""
    for index, content in enumerate(contents):
        octets += good(9, content)
        if len(content) % 2 and (index + 1 < len(contents) or pads_the_last):
            octets += b"\xee"
    found, told = data_of(octets, len(contents))
    assert [one.data for one in found] == contents
    assert told == []  # one client pads the last item too


@pytest.mark.parametrize("extra", [1, 2])
def test_what_follows_the_last_item(extra: int) -> None:
    """One octet may follow an odd one, none an even one."""
    for content in (b"\x01", b"\x01\x02"):
        _, told = data_of(good(9, content) + bytes(extra), 1)
        if extra == 1 and len(content) % 2:
            assert told == []
        else:
            assert told == [("trailing_octets", "data items", 18 + len(content), 0, extra, "data")]


@each("code", [0x00, 0x01, 0x03, 0x05, 0x06, 0x07, 0x0A, 0xFE])
@each("length", [0, 4, 0xFFFF])
@each("transport_size", [0, 4, 9])
def test_an_item_in_error_is_four_octets_whatever_its_length_says(code: int, length: int, transport_size: int) -> None:
    error = bytes((code, transport_size)) + length.to_bytes(2, "big")
    found, told = data_of(good(4, b"\x12\x34") + error + error + good(9, b"\x56"), 4)
    assert [(one.return_code, one.length, one.data) for one in found] == [
        (0xFF, 16, b"\x12\x34"),
        (code, length, b""),
        (code, length, b""),
        (0xFF, 1, b"\x56"),
    ]
    assert told == []


def test_in_a_request_the_length_holds_whatever_the_return_code() -> None:
    found, told = data_of(b"\x0a\x04\x00\x10\x12\x34" + written(9, b"\x56"), 2, False)
    assert [(one.return_code, one.data) for one in found] == [(0x0A, b"\x12\x34"), (0, b"\x56")]
    assert told == []


@pytest.mark.parametrize(("length", "content"), [(4, b"\x01\x02\x03\x04"), (32, b"\x01\x02\x03\x04"), (12, bytes(12))])
def test_double_integers_are_measured_by_what_is_there(length: int, content: bytes) -> None:
    found, told = data_of(bytes((0xFF, 6)) + length.to_bytes(2, "big") + content, 1)
    assert ([one.data for one in found], told) == ([content], [])


@pytest.mark.parametrize("there", range(4))
@pytest.mark.parametrize("count", range(4))
def test_data_item_counts_that_lie(there: int, count: int) -> None:
    found, told = data_of(good(4, b"\x12\x34") * there, count)
    assert len(found) == min(there, count)
    if count > there:
        assert told == [("count_mismatch", "data items", 14 + 6 * there, count, there, "data")]
    elif count < there:
        assert told == [("trailing_octets", "data items", 14 + 6 * count, 0, 6 * (there - count), "data")]
    else:
        assert told == []


def test_data_length_beyond_the_block_gives_what_is_there() -> None:
    found, told = data_of(good(4, b"\x12\x34") + b"\xff\x09\x00\x09abc", 3)
    assert [one.data for one in found] == [b"\x12\x34", b"abc"]
    assert told == [("length_beyond", "data.length", 20, 9, 3, "data")]


@given(st.binary(max_size=60), st.integers(0, 255), st.booleans())
def test_any_data_items(octets: bytes, count: int, response: bool) -> None:
    found, told = data_of(octets, count, response)
    assert len(found) <= count
    assert all(after.offset >= one.offset + 4 + len(one.data) for one, after in itertools.pairwise(found))
    assert sum(4 + len(one.data) for one in found) <= len(octets)
    assert len(found) == count or told
    assert all(fault[5] == "data" for fault in told)


def test_data_items_begin_where_they_are_said_to() -> None:
    found, told = data_of(refused(5), 1, before=100)
    assert ([one.offset for one in found], told) == ([100], [])


def test_the_areas_of_a_dbread_item_are_items_of_their_own() -> None:
    octets = bytes.fromhex("120cb002 0200440160 0100480030")
    (item_,), told = items_of(octets, 1)
    assert told == []
    assert item_.areas is not None
    assert [(area.db, area.start_bit, area.count, area.size, area.address) for area in item_.areas] == [
        (0x44, 8 * 0x160, 2, 2, "DB68.DBB352"),
        (0x48, 8 * 0x30, 1, 1, "DB72.DBB48"),
    ]
    assert [area.octets for area in item_.areas] == [octets[4:9], octets[9:14]]
    (short,), _ = items_of(bytes.fromhex("120bb002 0200440160 01004800"), 1)
    assert short.areas is None


def test_an_item_of_no_octets_fits_none_and_no_more() -> None:
    nothing = parse_item(dbw(1, 0, 0), 0)
    assert (nothing.size, nothing.label) == (0, "DB1.DBW0 x0")
    assert [nothing.fits(size) for size in (0, 1, 2)] == [True, False, False]
