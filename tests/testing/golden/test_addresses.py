from __future__ import annotations

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.protocols.s7.items import parse_item
from dissect.protocols.s7.tables import AREA_LETTERS, TRANSPORT_SIZES
from dissect.testing.golden.addresses import item_octets, named_item
from dissect.testing.golden.forms import ItemLine, item_text, parse_item_text, usual_size

_AREAS = sorted(AREA_LETTERS)
_TYPES = [code.number for code in TRANSPORT_SIZES]


def any_item(size: int, count: int, db: int, area: int, at: int) -> bytes:
    return struct.pack(">BBBBHHB", 0x12, 10, 0x10, size, count, db, area) + at.to_bytes(3, "big")


@given(
    st.sampled_from(_TYPES) | st.integers(0, 255),
    st.integers(0, 0xFFFF),
    st.integers(0, 0xFFFF),
    st.sampled_from(_AREAS) | st.integers(0, 255),
    st.integers(0, 0xFFFFFF),
)
def test_every_item_reads_back_to_its_octets(size: int, count: int, db: int, area: int, at: int) -> None:
    octets = any_item(size, count, db, area, at)
    assert parse_item_text(named_item(parse_item(octets, 0))).octets == octets


@given(st.sampled_from(_TYPES), st.integers(0, 9), st.sampled_from(_AREAS), st.integers(0, 0xFFFFFF))
def test_areas_and_types_of_the_tables_are_written_by_name(size: int, count: int, area: int, at: int) -> None:
    assert not named_item(parse_item(any_item(size, count, 0, area, at), 0)).startswith("item ")


@given(st.binary(min_size=1, max_size=30), st.none() | st.binary(max_size=9), st.integers(-1, 254), st.integers(0, 255))
def test_lines_of_items_of_any_syntax_read_back(rest: bytes, data: bytes | None, code: int, size: int) -> None:
    octets = bytes((0x12, len(rest))) + rest
    used = size if data is not None else usual_size(parse_item(octets, 0))
    line = ItemLine(octets, data, code, used)
    assert parse_item_text(item_text(line).partition("  # ")[0]).fields() == line.fields()


@pytest.mark.parametrize(
    ("text", "octets"),
    [
        ("DB10.DBW4 INT", "120a10050001000a84000020"),
        ("DB10.DBX4.1 BIT", "120a10010001000a84000021"),
        ("MB20 BYTE x3", "120a10020003000083" + "0000a0"),
        ("MB20 BYTE db 1", "120a10020001000183" + "0000a0"),
        ("T5 TIMER", "120a101d000100001d000005"),
        ("area0x99:B1 0x55", "120a10550001000099000008"),
        ("item <12 03 82 00 01>", "1203820001"),
    ],
)
def test_items_look_like_this(text: str, octets: str) -> None:
    line = parse_item_text(text)
    assert line.octets == bytes.fromhex(octets)
    assert item_text(line).partition("  # ")[0] == text


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("DB10.DBD4 INT", "does not fit the type"),
        ("DB10.DBW4 NUMBER", "is not a type"),
        ("DB99999.DBW4 INT", "more than an item can hold"),
        ("somewhere INT", "is not an address"),
        ("DB10.DBW4", "is not an item such as"),
        ("DB10.DBW4 INT x70000", "more than an item can hold"),
        ("item <12 05 82>", "second byte must count"),
        ("DB10.DBW4 INT refused 0x05 head <00>", "three bytes"),
    ],
)
def test_an_item_that_is_none_is_refused(text: str, why: str) -> None:
    with pytest.raises(ValueError, match=why):
        parse_item_text(text)


def test_the_address_decides_nothing_by_its_octets_alone() -> None:
    assert item_octets("DB10.DBW4", "INT", 1) != item_octets("DB10.DBW4", "WORD", 1)


def test_a_remark_stays_on_its_line() -> None:
    octets = any_item(0x13, 2, 10, 0x84, 0)
    text = item_text(ItemLine(octets, "a\n".encode("utf-16-be"), 255, 9))
    assert text == "DB10.DBW0 WCHAR x2 = <00 61 00 0a>  # a\\x0a"
