from __future__ import annotations

import json
import zlib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.protocols.s7plus.layouts import VALUE
from dissect.protocols.s7plus.value_reading import parse_content, read_value
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
from dissect.protocols.s7plus.values import Blob, Packed, Rows, Struct, Value, build_value
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


@pytest.mark.parametrize(
    ("octets", "fault"),
    [
        ("00 19 00", ("unknown_type", "type", 1, 0, 0x19)),
        ("00", ("too_short", "type", 1, 1, 0)),
        ("", ("too_short", "flags", 0, 1, 0)),
        ("10 02 05 0102", ("length_beyond", "count", 2, 5, 2)),
        ("20 02 05 0102", ("length_beyond", "count", 2, 5, 2)),
        ("00 15 03 6162", ("length_beyond", "length", 2, 3, 2)),
        ("00 14 00 03 6162", ("length_beyond", "length", 3, 3, 2)),
        ("00 14 02 01020304050607", ("too_short", "blob head", 3, 8, 7)),
        ("00 14 02 0102030405060708", ("too_short", "kind", 11, 1, 0)),
        ("00 14 02 0102030405060708 01 00", ("unknown_type", "blob kind", 11, 0, 1)),
        ("00 14 02 0102030405060708 04 00", ("unknown_type", "blob kind", 11, 0, 4)),
        ("00 14 02 0102030405060708 02 03 6162", ("length_beyond", "length", 12, 3, 2)),
        ("00 0b 01", ("too_short", "Word", 2, 2, 1)),
        ("00 0f 01020304050607", ("too_short", "LReal", 2, 8, 7)),
        ("40 02 05", ("too_short", "USInt", 3, 1, 0)),
        ("40 02 05 01", ("too_short", "key", 4, 1, 0)),
        ("40 16 05", ("too_short", "variant", 3, 1, 0)),
        ("00 16 00", ("too_short", "type", 3, 1, 0)),
        ("00 17 000001", ("too_short", "structure", 2, 4, 3)),
        ("00 17 00000001", ("too_short", "member", 6, 1, 0)),
        ("10 17 00000001 05 00", ("length_beyond", "count", 6, 5, 1)),
        ("40 17 01 000001", ("too_short", "structure", 3, 4, 3)),
        ("40 17", ("too_short", "key", 2, 1, 0)),
        ("00 17 92000001 00000000000000", ("too_short", "interface time", 6, 8, 7)),
        ("00 17 92000001 0000000000000007", ("too_short", "transport flags", 14, 1, 0)),
        ("00 17 92000001 0000000000000007 02", ("too_short", "count", 15, 1, 0)),
        ("00 17 92000001 0000000000000007 02 03 0102", ("too_short", "packed structure", 16, 3, 2)),
        ("00 17 92000001 0000000000000007 8800 03", ("too_short", "count", 17, 1, 0)),
        ("00 17 92000001 0000000000000007 8800 01 03 0102", ("too_short", "packed structure", 18, 3, 2)),
    ],
)
@pytest.mark.parametrize("shown", [True, False])
def test_what_does_not_fit_is_told_with_its_place(
    octets: str, fault: tuple[str, str, int, int, int], shown: bool
) -> None:
    with pytest.raises(FormatError) as caught:
        read(bytes.fromhex(octets), shown)
    said = caught.value
    assert (said.reason, said.field, said.at, said.needed, said.available) == fault


@pytest.mark.parametrize(
    ("octets", "cost"),
    [
        ("00 02 05", 5),
        ("00 16 00 02 05", 5),
        ("10 02 03 010203", 5 + 3),
        ("20 04 02 05 8102", 5 + 2),
        ("10 00 09", 5 + 9),  # nothing of an octet each
        ("10 15 02 0161 00", 5 + 2),
        ("40 02 05 aa 06 bb 00", 5 + 2),
        ("40 16 05 07 06 08 00", 5 + 2),
        ("00 17 0000013a 07 00 02 05 08 00 02 06 00", 5 + 2 * 5),
        ("10 17 0000013a 03 00 07 00 02 05 00 00", 5 + 3 + 5),
        ("40 17 01 0000013a 00 02 0000013a 07 00 02 05 00 00", 5 + 2 * 5 + 5),
        ("00 17 92000001 0000000000000007 02 03 010203", 5),
        ("00 14 05 0102030405060708 00 07 00 02 09 00", 5 + 5),
        ("00 14 00 02 abcd", 5),
    ],
)
def test_each_part_of_a_value_counts_as_work(octets: str, cost: int) -> None:
    wire = bytes.fromhex(octets)
    for shown in (True, False):
        _, walk = read(wire, shown)
        assert walk.left == 0
        assert walk.depth == 0
        assert walk.budget == 3 * len(wire) + 1024 - cost
        assert walk.shown is shown


@pytest.mark.parametrize(
    ("octets", "parts"),
    [
        ("00 16 00 17 0000013a 07 00 02 05 00", [("value", 13)]),  # what is inside a variant stays in its part
        ("00 14 05 0102030405060708 00 07 00 02 09 00", [("value", 17)]),
        (
            "10 17 0000013a 02 07 00 02 05 00 00",
            [("value", 7), ("member", 11), ("end of list", 12), ("end of list", 13)],
        ),
        (
            "40 17 01 0000013a 07 00 02 05 00 00",
            [("value", 2), ("row", 7), ("member", 11), ("end of list", 12), ("end of list", 13)],
        ),
        ("00 17 92000001 0000000000000007 02 03 010203", [("value", 6), ("packed structure", 19)]),
    ],
)
def test_a_value_is_shown_in_its_parts(octets: str, parts: list[tuple[str, int]]) -> None:
    _, walk = read(bytes.fromhex(octets))
    names = [part.layout.name for part in walk.parts]
    assert [part.end for part in walk.parts] == [end for _, end in parts]
    assert names[0] == "value"
    assert [name for name in names if name in {"member", "end of list"}] == [
        name for name, _ in parts if name in {"member", "end of list"}
    ]


def test_parts_after_a_fault_inside_a_variant_are_shown() -> None:
    for octets in ("00 16 00 19", "00 14 05 0102030405060708 00 07 00 19"):
        wire = bytes.fromhex(octets)
        walk = Walk(wire, 0, len(wire), True)
        with pytest.raises(FormatError):
            read_value(walk, VALUE, 0)
        assert walk.shown


@pytest.mark.parametrize(
    ("flags", "type_", "octets", "content"),
    [
        (0, USINT, "05", 5),
        (0, USINT, "", None),
        (0, USINT, "0506", None),
        (0x10, USINT, "02 0506", [5, 6]),
        (0x10, USINT, "03 0506", None),
        (0x40, USINT, "05 06 00", [(5, 6)]),
        (0, WSTRING, "02 4856", "HV"),
        (0, 0x19, "05", None),
        (0, REAL, "3fc00000", 1.5),
    ],
)
def test_a_content_is_read_if_the_octets_are_one(flags: int, type_: int, octets: str, content: object) -> None:
    found = parse_content(flags, type_, bytes.fromhex(octets))
    assert (found.content if found is not None else None) == content
    if found is not None:
        assert (found.flags, found.type) == (flags, type_)


@pytest.mark.parametrize(
    ("octets", "content"),
    [
        ("3f800000", 1.0),
        ("ff7fffff", -3.4028234663852886e38),
        ("00000001", 1.401298464324817e-45),
        ("7f7fffff", 3.4028234663852886e38),
        ("7f800000", float("inf")),
        ("ff800000", float("-inf")),
        ("7f800001", b"\x7f\x80\0\1"),  # a signalling NaN
        ("ffa00000", b"\xff\xa0\0\0"),
    ],
)
def test_a_single_is_its_number_or_its_octets(octets: str, content: object) -> None:
    value, _ = read(b"\0\x0e" + bytes.fromhex(octets))
    assert value.content == content
    assert build_value(value)[2:] == bytes.fromhex(octets)


@pytest.mark.parametrize(
    ("type_", "octets", "number"),
    [
        (0x06, "7f", 127), (0x06, "80", -128), (0x06, "ff", -1), (0x02, "ff", 255),
        (0x07, "7fff", 32767), (0x07, "8000", -32768), (0x03, "ffff", 65535), (0x0B, "8000", 32768),
        (0x0C, "fffffffe", 2**32 - 2), (0x0D, "fffffffffffffffe", 2**64 - 2), (0x12, "fffffffe", 2**32 - 2),
        (0x10, "fffffffffffffffe", 2**64 - 2), (0x04, "8f7f", 2047), (0x13, "8f7f", 2047), (0x05, "8f7f", 2047),
        (0x08, "7e", -2), (0x09, "7e", -2), (0x11, "7e", -2), (0x05, "ff" * 9, 2**64 - 1),
        (0x01, "00", False), (0x01, "01", True), (0x01, "02", 2), (0x0A, "ff", 255),
    ],
)  # fmt: skip
def test_a_number_is_signed_by_its_type(type_: int, octets: str, number: int) -> None:
    value, walk = read(bytes((0, type_)) + bytes.fromhex(octets) + b"\xee")
    assert (value.content, walk.left) == (number, 1)
    assert isinstance(value.content, bool) == isinstance(number, bool)


SWOLLEN = zlib.compress(bytes(40))


@pytest.mark.parametrize(
    ("key", "looked_into"), [(1, True), (0x7FFFFFFF, True), (0x80000000, False), (0xFFFFFFFF, False)]
)
def test_compressed_elements_have_a_key_below_the_others(key: int, looked_into: bool) -> None:
    value = Value(0x40, BLOB, [(key, Blob(0, SWOLLEN)), (2, Blob(0, b"plain")), (3, Blob(0, SWOLLEN[:-1]))])
    wire = build_value(value)
    for id_, of_this in ((2533, True), (2534, False)):
        walk = Walk(wire, 0, len(wire), False)
        read_value(walk, VALUE, 0, "", id_)
        begin = wire.index(SWOLLEN)
        broken = wire.index(SWOLLEN[:-1], begin + 1)
        places = ([(begin, begin + len(SWOLLEN))] if looked_into else []) + [(broken, broken + len(SWOLLEN) - 1)]
        assert walk.blobs == (places if of_this else [])
        told = [(fault.reason, fault.field, fault.at) for fault in walk.faults]
        assert told == ([("bad_compression", "blob", broken)] if of_this else [])


def test_all_compressed_blobs_are_noted_though_few_are_inflated() -> None:
    """In a hurry one that cannot swell is not; those behind it are looked at all the same."""
    small = zlib.compress(b"<a>")
    value = Value(0x40, BLOB, [(1, Blob(0, small)), (2, Blob(0, SWOLLEN)), (3, Blob(0, small))])
    wire = build_value(value)
    for most in (0, 1000):
        walk = Walk(wire, 0, len(wire), False, most)
        read_value(walk, VALUE, 0, "", 2533)
        assert [wire[begin:end] for begin, end in walk.blobs] == [small, SWOLLEN, small]
        assert walk.faults == []


def test_blobs_share_what_they_may_become() -> None:
    """Of three that are inflated to 10,000 octets each the last one does not find so many left."""
    blobs = [zlib.compress(bytes(9_999) + bytes((at,))) for at in range(3)]
    wire = build_value(Value(0x40, BLOB, [(at + 1, Blob(0, blob)) for at, blob in enumerate(blobs)]))
    for allowed, left, told in ((30_000, 0, 0), (40_000, 10_000, 0), (29_999, 0, 1)):
        walk = Walk(wire, 0, len(wire), False)
        walk.inflating = allowed
        read_value(walk, VALUE, 0, "", 2533)
        assert ([fault.reason for fault in walk.faults], len(walk.blobs)) == (["too_large"] * told, 3)
        assert [fault.at for fault in walk.faults] == [wire.index(blobs[2])] * told
        assert told or walk.inflating == left


def test_a_blob_alone_is_looked_into_as_well() -> None:
    wire = build_value(Value(0, BLOB, Blob(0, SWOLLEN)))
    walk = Walk(wire, 0, len(wire), False)
    read_value(walk, VALUE, 0, "", 2533)
    assert walk.blobs == [(4, 4 + len(SWOLLEN))]


# ---- building -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("value", "octets"),
    [
        (Value(0, BLOB, Blob(0, b"ab")), "00 14 00 02 6162"),
        (Value(0, BLOB, Blob(1, b"ab")), "00 14 01 02 6162"),
        (Value(0, BLOB, Blob(2, b"ab", b"12345678", 3)), "00 14 02 3132333435363738 03 02 6162"),
        (
            Value(0, BLOB, Blob(2, b"", b"12345678", 0, [(7, Value(0, USINT, 9))])),
            "00 14 02 3132333435363738 00 07 00 02 09 00",
        ),
        (Value(0x40, 0x16, [(5, 300)]), "40 16 05 822c 00"),
        (Value(0x40, USINT, [(5, 3), (6, 2)]), "40 02 05 03 06 02 00"),
        (Value(0, STRUCT, Packed(0x92000001, 7, 2, b"ab")), "00 17 92000001 0000000000000007 02 02 6162"),
        (Value(0, STRUCT, Packed(0x92000001, 7, 0x400, b"ab")), "00 17 92000001 0000000000000007 8800 02 02 6162"),
        (Value(0, STRUCT, Packed(0x92000001, 7, 0x3FF, b"ab")), "00 17 92000001 0000000000000007 877f 02 6162"),
        (Value(0, REAL, 1.5), "00 0e 3fc00000"),
        (Value(0, 0x0F, 1.5), "00 0f 3ff8000000000000"),
        (Value(0, REAL, b"\x7f\x80\0\1"), "00 0e 7f800001"),
        (Value(0, WSTRING, "ä"), "00 15 02 c3a4"),
        (Value(0, DINT, -1), "00 08 7f"),
        (Value(0, 0x07, -2), "00 07 fffe"),
        (Value(0x10, NULL, [None, None]), "10 00 02"),
        (Value(0, 0x16, Value(0, USINT, 5)), "00 16 00 02 05"),
        (Value(0x10, STRUCT, Rows(314, [[(7, Value(0, USINT, 5))], []])), "10 17 0000013a 02 07 00 02 05 00 00"),
    ],
)  # fmt: skip
def test_what_a_value_is_built_of(value: Value, octets: str) -> None:
    assert build_value(value) == bytes.fromhex(octets)


@pytest.mark.parametrize(
    ("type_", "number", "text"),
    [
        (USINT, 256, "256 does not fit into USInt"),
        (0x06, 128, "128 does not fit into SInt"),
        (0x03, -1, "-1 does not fit into UInt"),
    ],
)
def test_a_number_that_does_not_fit_is_not_built(type_: int, number: int, text: str) -> None:
    with pytest.raises(ValueError, match=text):
        build_value(Value(0, type_, number))


def test_what_a_value_says_of_itself() -> None:
    assert (Value(0, USINT, 5).offset, Value(0, USINT, 5).end, Blob(0, b"").end, Blob(0, b"").kind) == (0, 0, 0, -1)
    for flags, array, sparse in ((0, False, False), (0x10, True, False), (0x20, True, False), (0x40, False, True),
                                 (0x50, False, True), (0x80, False, False), (0x90, True, False)):  # fmt: skip
        one = Value(flags, USINT, [])
        assert (one.array, one.sparse) == (array, sparse)
    assert [Value(0, type_, None).type_name for type_ in (0, 0x17, 0xFF, 0x100, -1)][:2] == ["Null", "Struct"]
    assert (Value(0, 0xFF, None).type_name, Value(0, 0x100, None).type_name) == ("0xff", "0x100")
    assert repr(Value(0x10, USINT, [1])) == "Value(0x10, 0x2, [1])"
    assert Value(0, USINT, 5) != 5
    members = [(7, Value(0, USINT, 5)), (8, Value(0, USINT, 6)), (7, Value(0, USINT, 7))]
    found = Struct(1, members)
    assert (found.find(7), found.find(8), found.find(9)) == (members[0][1], members[1][1], None)
