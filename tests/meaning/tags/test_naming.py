"""Items become tags: whole, in part, several in one; the octets between them stay visible."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any, Final

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.engine.transactions.naming import NamedValue
from dissect.meaning.tags.index import TagIndex
from dissect.meaning.tags.loading import load_tags
from dissect.meaning.tags.model import Tag
from dissect.meaning.tags.naming import TagNaming
from dissect.meaning.tags.values import decode_typed
from dissect.protocols.s7.items import Item, ItemResult, parse_item
from tests.cases import each

TANK: Final = """address,type,name,unit,scale,comment
DB1.DBD0,REAL,Tank.Level,m,,level
DB1.DBX4.0,BOOL,Tank.Pump,,,
DB1.DBX4.3,BOOL,Tank.Valve,,,
DB1.DBW6,INT,Tank.Temp,°C,0.1-40,
DB1.DBB10,STRING[6],Tank.Name,,,
DB1.DBW20,INT[4],Tank.Curve,,,
MB10,BYTE,Flags,,,
T5,S5TIME,Delay,,,
C3,COUNTER,Parts,pcs,,
"""


def item(area: int, db: int, bit: int, count: int, transport: int = 2) -> Item:
    """Return an S7ANY item."""
    return parse_item(struct.pack(">BBBBHHB", 0x12, 10, 0x10, transport, count, db, area) + bit.to_bytes(3, "big"), 0)


@pytest.fixture
def tank(tmp_path: Path) -> TagNaming:
    path = tmp_path / "tank.csv"
    path.write_text(TANK, encoding="utf-8")
    return load_tags([path]).naming()


def told(values: list[NamedValue]) -> list[tuple[Any, ...]]:
    return [(each.name or each.address, each.value, each.unit or each.remark) for each in values]


def named(naming: TagNaming, what: Item, data: bytes) -> list[tuple[Any, ...]]:
    return told(naming.named(ItemResult(what, 0xFF, data, None)))


def test_an_item_of_bytes_is_its_tags_and_what_stands_between_them(tank: TagNaming) -> None:
    data = struct.pack(">fBxhxx", 3.5, 0b1001, 1250) + b"\x06\x02ab\0\0\0\0"
    assert named(tank, item(0x84, 1, 0, len(data)), data) == [
        ("Tank.Level", 3.5, "m"),
        ("Tank.Pump", True, ""),
        ("Tank.Valve", True, ""),
        ("DB1.DBB5", None, ""),
        ("Tank.Temp", 85.0, "°C"),
        ("DB1.DBB8", None, ""),
        ("Tank.Name", "ab", ""),
    ]


def test_bits_of_an_octet_that_no_tag_has_are_shown_when_one_is_set(tank: TagNaming) -> None:
    values = tank.named(ItemResult(item(0x84, 1, 32, 1), 0xFF, b"\x81", None))
    assert told(values) == [
        ("Tank.Pump", True, ""),
        ("Tank.Valve", False, ""),
        ("DB1.DBB4", None, "bits beside the tags"),
    ]
    assert values[2].data == b"\x80"


def test_an_item_of_exactly_one_tag_and_an_item_of_one_bit(tank: TagNaming) -> None:
    assert named(tank, item(0x84, 1, 0, 1, 8), struct.pack(">f", -1.25)) == [("Tank.Level", -1.25, "m")]
    assert named(tank, item(0x84, 1, 35, 1, 1), b"\x01") == [("Tank.Valve", True, "")]
    assert named(tank, item(0x83, 0, 82, 1, 1), b"\x01") == [("Flags.%X2", True, "bit 2 of BYTE")]


def test_a_bit_of_a_word_has_the_number_it_has_in_the_word(tank: TagNaming) -> None:
    assert named(tank, item(0x84, 1, 48, 1, 1), b"\x01")[0][0] == "Tank.Temp.%X8"
    assert named(tank, item(0x84, 1, 56, 1, 1), b"\x00")[0][:2] == ("Tank.Temp.%X0", False)


def test_a_part_of_a_tag_has_its_octets_and_no_value(tank: TagNaming) -> None:
    values = tank.named(ItemResult(item(0x84, 1, 16, 3), 0xFF, b"\x40\x41\x01", None))
    assert told(values) == [("Tank.Level", None, "m"), ("Tank.Pump", True, ""), ("Tank.Valve", False, "")]
    assert (values[0].whole, values[0].data, values[0].remark) == (False, b"\x40\x41", "bytes 2 to 3 of 4")


def test_elements_of_an_array_are_named_by_their_indexes(tank: TagNaming) -> None:
    data = struct.pack(">4h", 1, -2, 3, 4)
    assert named(tank, item(0x84, 1, 160, 8), data) == [("Tank.Curve", [1, -2, 3, 4], "")]
    assert named(tank, item(0x84, 1, 176, 4), data[:4]) == [("Tank.Curve[1..2]", [1, -2], "")]
    assert named(tank, item(0x84, 1, 176, 1, 5), data[2:4]) == [("Tank.Curve[1]", -2, "")]
    assert [row[0] for row in named(tank, item(0x84, 1, 168, 2), b"\0\0")] == ["Tank.Curve[0]", "Tank.Curve[1]"]


def test_timers_and_counters_are_found_by_their_number(tank: TagNaming) -> None:
    assert named(tank, item(0x1D, 0, 5, 1, 0x1D), b"\x21\x00") == [("Delay", "S5T#1m40s", "")]
    assert named(tank, item(0x1C, 0, 2, 2, 0x1C), b"\x00\x01\x01\x23") == [("C2", None, ""), ("Parts", 123, "pcs")]


def test_an_item_without_a_tag_or_of_a_different_block_has_no_names(tank: TagNaming) -> None:
    assert named(tank, item(0x84, 2, 0, 4), b"\0\0\0\0") == []
    assert named(tank, item(0x84, 1, 800, 4), b"\0\0\0\0") == []


def test_a_refused_item_has_names_and_no_values(tank: TagNaming) -> None:
    values = tank.named(ItemResult(item(0x84, 1, 0, 4), 0x0A, None, None))
    assert [(value.name, value.value, value.data) for value in values] == [("Tank.Level", None, b"")]


def test_a_text_whose_lengths_cannot_be_is_no_value(tank: TagNaming) -> None:
    value = tank.named(ItemResult(item(0x84, 1, 80, 8), 0xFF, b"\xff\x02abcdef", None))[0]
    assert (value.value, value.remark, value.data) == (None, "no valid STRING[6]", b"\xff\x02abcdef")


@each(
    ("kind", "octets", "value"),
    [
        ("SINT", "80", -128),
        ("USINT", "80", 128),
        ("UINT", "8000", 32768),
        ("INT", "8000", -32768),
        ("DINT", "ffffffff", -1),
        ("UDINT", "ffffffff", 4294967295),
        ("LINT", "8000000000000000", -(1 << 63)),
        ("ULINT", "ffffffffffffffff", (1 << 64) - 1),
        ("LREAL", "3ff8000000000000", 1.5),
        ("REAL", "3dcccccd", 0.1),
        ("TIME", "fffffc18", "T#-1s"),
        ("LTIME", "00000000000003e9", "LT#1us1ns"),
        ("S5TIME", "3999", "S5T#2h46m30s"),
        ("S5TIME", "0a00", None),
        ("DATE", "0000", "D#1990-01-01"),
        ("TIME_OF_DAY", "05265bff", "TOD#23:59:59.999"),
        ("TIME_OF_DAY", "05265c00", None),
        ("LTIME_OF_DAY", "00004e94914effff", "LTOD#23:59:59.999999999"),
        ("DATE_AND_TIME", "2402291200000001", "DT#2024-02-29-12:00:00.000"),
        ("DATE_AND_TIME", "2302291200000001", None),
        ("LDT", "0000000000000001", "LDT#1970-01-01-00:00:00.000000001"),
        ("DTL", "07e8021d05173b3b00000005", "DTL#2024-02-29-23:59:59.000000005"),
        ("DTL", "07e80d1d05173b3b00000005", None),
        ("COUNTER", "0999", 999),
        ("COUNTER", "0a99", None),
        ("STRING", "04026162ffff", "ab"),
        ("STRING", "04056162ffff", None),
        ("WSTRING", "000200010416ffff", "Ж"),
        ("WSTRING", "000300010416ffff", None),
        ("WCHAR", "0416", "Ж"),
        ("CHAR", "41", "A"),
        ("FSTRING", "414200", "AB"),
        ("POINTER", "000184000025", "P#DB1.DBX4.5"),
        ("ANY", "1002000a000184000020", "P#DB1.DBX4.0 BYTE 10"),
        ("BLOCK_DB", "0007", 7),
        ("OCTETS", "0102", None),
    ],
)
def test_octets_have_the_value_of_their_type(kind: str, octets: str, value: object) -> None:
    assert decode_typed(kind, bytes.fromhex(octets)) == value


PLACES: Final = st.lists(
    st.tuples(st.integers(0, 120), st.sampled_from([1, 8, 16, 32]), st.integers(1, 4)), min_size=1, max_size=12
)


@given(PLACES, st.integers(0, 15), st.integers(1, 20))
def test_every_bit_of_an_item_is_a_tag_or_shown_beside_them(
    places: list[tuple[int, int, int]], first: int, size: int
) -> None:
    tags = []
    for number, (start, bits, count) in enumerate(places):
        at = start if bits == 1 else start // 8 * 8
        tag = Tag(f"t{number}", 0x83, 0, at, "BOOL" if bits == 1 else "BYTE", "x", bits)
        tag.count = count
        tag.dims = [(0, count - 1)] if count > 1 else []
        tags.append(tag)
    cover = TagIndex(tags).cover(0x83, 0, first * 8, size * 8)
    expected = set()
    for tag in tags:
        expected |= {bit for bit in range(tag.start, tag.end) if first * 8 <= bit < (first + size) * 8}
    if cover is None:
        assert not expected
        return
    seen = set()
    for part in cover.parts:
        seen |= set(range(first * 8 + part.bit, first * 8 + part.bit + part.bits))
        if part.whole:
            begin = part.tag.start + part.first * part.tag.step
            assert first * 8 + part.bit == begin
    assert seen == expected
    free = {8 * (first + at + number) + bit for at, count in cover.free for number in range(count) for bit in range(8)}
    masked = {8 * (first + at) + bit for at, mask in cover.masks for bit in range(8) if mask >> bit & 1}
    assert free.isdisjoint(seen)
    assert free | masked | seen == set(range(first * 8, (first + size) * 8))
