from __future__ import annotations

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.protocols.s7plus.layouts import VALUE
from dissect.protocols.s7plus.value_reading import read_value
from dissect.protocols.s7plus.value_showing import as_json, value_json, value_with_type
from dissect.protocols.s7plus.value_tables import (
    BLOB,
    DINT,
    LWORD,
    NULL,
    REAL,
    STRUCT,
    TIMESTAMP,
    UDINT,
    USINT,
    WSTRING,
)
from dissect.protocols.s7plus.values import Blob, Packed, Struct, Value, build_value
from dissect.protocols.s7plus.walk import MAX_DEPTH, FormatError, Walk
from tests.protocols.s7plus.strategies import VALUES


def read(octets: bytes, shown: bool = True) -> tuple[Value, Walk]:
    walk = Walk(octets, 0, len(octets), shown)
    return read_value(walk, VALUE, 0), walk


def as_text(content: object) -> str:
    return json.dumps(content, separators=(",", ":"), allow_nan=False).replace("\x7f", "\\u007f")


@pytest.mark.parametrize(
    ("octets", "type_", "content", "text"),
    [
        ("00 00", NULL, None, "Null"),
        ("00 01 01", 0x01, True, "Bool true"),
        ("80 02 05", USINT, 5, "USInt 5"),
        ("00 06 ff", 0x06, -1, "SInt -1"),
        ("00 07 fffe", 0x07, -2, "Int -2"),
        ("00 0b 00ff", 0x0B, 255, "Word 0x00ff"),
        ("00 04 8102", UDINT, 130, "UDInt 130"),
        ("00 08 7f", DINT, -1, "DInt -1"),
        ("00 0d 00000000000000ff", LWORD, 255, "LWord 0x00000000000000ff"),
        ("00 0e 42f6e979", REAL, pytest.approx(123.456, rel=1e-6), "Real 123.456"),
        ("00 10 0000000000000001", TIMESTAMP, 1, "Timestamp 1970-01-01T00:00:00.000000001Z"),
        ("00 12 00000034", 0x12, 52, "RID 52 NativeObjects.theCPUexecUnit_Rid"),
        ("00 15 03 616263", WSTRING, "abc", "WString 'abc'"),
        ("00 15 01 e9", WSTRING, b"\xe9", "WString '\ufffd'"),
        ("10 02 03 010203", USINT, [1, 2, 3], "USInt[3] 1, 2, 3"),
        ("20 04 02 05 8102", UDINT, [5, 130], "UDInt[2] 5, 130"),
        ("40 02 05 aa 06 bb 00", USINT, [(5, 0xAA), (6, 0xBB)], "USInt, sparse, 2 elements"),
    ],
)
def test_a_value(octets: str, type_: int, content: object, text: str) -> None:
    wire = bytes.fromhex(octets)
    value, walk = read(wire)
    assert (value.type, value.content, value.offset, value.end) == (type_, content, 0, len(wire))
    assert walk.left == 0
    assert [part.note for part in walk.parts] == [text]
    assert value_json(value) == as_text(as_json(value))
    assert build_value(value) == wire
    for size in range(len(wire)):
        with pytest.raises(FormatError):
            read(wire[:size])


@pytest.mark.parametrize(
    ("octets", "text"),
    [
        ("00 0e 42f6e979", "123.456"),
        ("00 0e 80000000", "-0.0"),
        ("00 0e 7f800000", '"inf"'),
        ("00 0e 7fc00001", '"nan"'),
        ("00 0e 7f800001", '"7f800001"'),
        ("00 0e 7f7fffff", "3.4028235e+38"),
        ("00 0f fff0000000000000", '"-inf"'),
        ("00 0f 3fb999999999999a", "0.1"),
        ("10 01 02 00 01", "[false,true]"),
        ("00 15 04 61227f0a", '"a\\"\\u007f\\n"'),
        ("00 15 01 e9", '"\\ufffd"'),
        ("40 02 05 01 06 02 05 03 00", '{"5":3,"6":2}'),
        ("00 17 0000013a 07 00 02 05 07 00 02 06 00", '{"id":314,"members":{"7":6}}'),
        ("10 17 0000013a 02 07 00 02 05 00 00", '{"id":314,"rows":[{"7":5},{}]}'),
        ("00 17 92000001 0000000000000007 8800 03 03 010203", '{"id":2449473537,"time":7,"octets":"010203"}'),
        ("00 14 00 02 abcd", '"abcd"'),
        ("00 14 05 0102030405060708 00 07 00 02 09 00", '{"root":5,"members":{"7":9}}'),
        ("00 16 00 02 09", "9"),
    ],
)
def test_a_value_as_json(octets: str, text: str) -> None:
    wire = bytes.fromhex(octets)
    value, walk = read(wire + b"\xffbehind")
    assert walk.at == len(wire)
    assert value_json(value) == text == as_text(as_json(value))


def test_a_structure() -> None:
    wire = bytes.fromhex("00 17 0000013a 823b 00 04 00 823f 00 15 02 4856 00")
    value, walk = read(wire + b"more")
    assert walk.left == 4
    content = value.content
    assert isinstance(content, Struct)
    assert (content.id, [id_ for id_, _ in content.members]) == (314, [315, 319])
    version = content.find(319)
    assert version is not None
    assert version.content == "HV"
    assert content.find(1) is None
    assert [(part.layout.name, part.depth) for part in walk.parts] == [
        ("value", 0),
        ("member", 1),
        ("member", 1),
        ("end of list", 1),
    ]
    assert walk.parts[2].note == "319 LID_SessionVersionSystemPAOMString = WString 'HV'"
    assert as_json(value) == {"id": 314, "members": {"315": 0, "319": "HV"}}


def test_a_packed_structure_whose_count_stands_there_twice() -> None:
    wire = bytes.fromhex("00 17 92000001 0000000000000007 8800 03 03 010203")
    value, walk = read(wire)
    content = value.content
    assert isinstance(content, Packed)
    assert (content.id, content.time, content.flags, content.octets) == (0x92000001, 7, 0x400, b"\1\2\3")
    assert walk.parts[1].number("length_again") == 3


def test_a_blob_with_a_list() -> None:
    wire = bytes.fromhex("00 14 05 0102030405060708 00 07 00 02 09 00")
    content = read(wire)[0].content
    assert isinstance(content, Blob)
    assert (content.root, content.head.hex(), content.kind, content.members) == (
        5,
        "0102030405060708",
        0,
        [(7, Value(0, USINT, 9))],
    )


@pytest.mark.parametrize(
    ("octets", "reason", "field"),
    [
        ("00 19 00", "unknown_type", "type"),
        ("00 7f", "unknown_type", "type"),
        ("10 02 8fffffff7f", "length_beyond", "count"),
        ("00 15 8fffffff7f 61", "length_beyond", "length"),
        ("00 14 05 0102030405060708 07 00", "unknown_type", "blob kind"),
        ("00 04 ffffffffff00", "too_short", "UDInt"),
        ("10 17 00000001 ff7f", "length_beyond", "count"),
    ],
)
def test_what_does_not_fit(octets: str, reason: str, field: str) -> None:
    with pytest.raises(FormatError) as caught:
        read(bytes.fromhex(octets))
    assert (caught.value.reason, caught.value.field) == (reason, field)


def test_depth_is_bounded() -> None:
    nested = b"\x07\x00\x17\x00\x00\x00\x01"
    read(nested[1:] + nested * (MAX_DEPTH - 1) + b"\0" * MAX_DEPTH)
    with pytest.raises(FormatError) as caught:
        read(nested[1:] + nested * 100_000)
    assert (caught.value.field, caught.value.available) == ("depth of members", MAX_DEPTH + 1)
    with pytest.raises(FormatError):
        read(b"\x00\x16" * 100_000)


def test_elements_without_octets_cannot_be_multiplied() -> None:
    # Each array of Null claims as many elements as octets follow: a square of them in all.
    array = b"\x10\x00\x83\x7f"
    wire = b"\x00\x17\x00\x00\x00\x01" + (b"\x07" + array) * 2000
    with pytest.raises(FormatError) as caught:
        read(wire)
    assert caught.value.reason == "count_mismatch"


@given(VALUES)
def test_what_was_built_reads_back(value: Value) -> None:
    wire = build_value(value)
    for shown in (True, False):
        found, walk = read(wire + b"\xffbehind", shown)
        assert found.end == walk.at == len(wire)
        assert found == value
        assert value_with_type(found) == value_with_type(value)
        assert value_json(found) == as_text(as_json(found))
        if shown:  # without gaps
            assert [part.offset for part in walk.parts] == [0, *[part.end for part in walk.parts[:-1]]]
            assert walk.parts[-1].end == len(wire)
            assert all([part.values for part in walk.parts])


@given(VALUES, st.data())
def test_cut_anywhere_it_is_a_fault(value: Value, data: st.DataObject) -> None:
    wire = build_value(value)
    with pytest.raises(FormatError):
        read(wire[: data.draw(st.integers(0, len(wire) - 1))])


@given(st.binary(max_size=60))
def test_nothing_but_a_fault_is_raised(octets: bytes) -> None:
    try:
        value, walk = read(octets)
    except FormatError:
        return
    assert walk.at <= len(octets)
    assert read(build_value(value))[0] == value


def test_equality_is_that_of_the_octets() -> None:
    assert Value(0, USINT, 5) == Value(0, USINT, 5, 7, 8)
    assert Value(0, USINT, 5) != Value(0x80, USINT, 5)
    assert hash(Value(0, BLOB, Blob(0, b"a"))) == hash(Value(0, BLOB, Blob(0, b"a")))


@pytest.mark.parametrize(
    "value", [Value(0, STRUCT, "text"), Value(0x10, USINT, 5), Value(0x40, USINT, 5), Value(0, NULL, [1])]
)
def test_what_cannot_be_built(value: Value) -> None:
    with pytest.raises(TypeError):
        build_value(value)
