"""Where passing over values and objects ends: small blobs, levels, high ids, members that are not there."""

from __future__ import annotations

import zlib
from typing import Final

import pytest

from dissect.protocols.s7plus.blobs import MAX_INFLATED, may_swell
from dissect.protocols.s7plus.bodies import parse_contents
from dissect.protocols.s7plus.check import Check, check
from dissect.protocols.s7plus.cursor import Cursor, marks, table
from dissect.protocols.s7plus.message import parse_plus
from dissect.protocols.s7plus.objects import Attribute, Element, PlusObject, Relation, build_elements, build_object
from dissect.protocols.s7plus.read_objects import read_objects
from dissect.protocols.s7plus.tables import EXPLORE, SET_VARIABLE
from dissect.protocols.s7plus.value_tables import BLOB, INT, SPARSE_ARRAY, STRUCT, UDINT, WSTRING
from dissect.protocols.s7plus.values import Blob, Packed, Struct, Value, build_value
from tests.protocols.s7plus import bodies
from tests.protocols.s7plus.bodies import end, number, rid
from tests.protocols.s7plus.pdus import asked, framed, told

_FIVE: Final = Value(0, INT, 5)
#: An attribute that may be compressed, and one that may not.
COMPRESSED, PLAIN = 2544, 233


def explored(*elements: Element, bits: bytes | None = None) -> Check:
    """Check an answer to Explore with one object."""
    data = told(
        7, EXPLORE, b"\0" + rid(3) + number(9) + build_object(PlusObject(7, 9, 0, 0, 0, list(elements))) + end()
    )
    frames = [framed(data[at : at + 60_000], 3, trailer=False) for at in range(0, len(data), 60_000)]
    octets = b"".join(frames) + b"\x72\3\0\0"
    return check(octets, bits) if bits is not None else check(octets)


def zeros(count: int, size: int = -1) -> bytes:
    """Zeros, compressed; with ``size`` octets of them."""
    blob = zlib.compress(bytes(count), 9)
    while size >= 0 and len(blob) != size:
        count += 1032 if len(blob) < size else -129
        blob = zlib.compress(bytes(count), 9)
    assert may_swell(blob)
    return blob


def one(blob: bytes) -> Value:
    return Value(0, BLOB, Blob(0, blob))


# ---- compressed blobs -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("size", [40, 63, 64])
def test_a_small_blob_is_inflated_at_once(size: int) -> None:
    blob = zeros(1000, size)
    broken = blob[:-1] + bytes((blob[-1] ^ 1,))
    for value, sound in (
        (one(blob), True),
        (one(broken), False),
        (Value(SPARSE_ARRAY, BLOB, [(1, Blob(0, broken))]), False),
    ):
        assert explored(Attribute(COMPRESSED, value)).sound == sound
        assert explored(Attribute(PLAIN, value)).sound
        assert explored(Attribute(7, Value(0, STRUCT, Struct(9, [(COMPRESSED, value)])))).sound == sound
        assert explored(Attribute(7, Value(0, STRUCT, Struct(9, [(PLAIN, value)])))).sound
        nested = Struct(9, [(COMPRESSED, Value(0, STRUCT, Struct(8, [(PLAIN, _FIVE)]))), (PLAIN, value)])
        assert explored(Attribute(COMPRESSED, Value(0, STRUCT, nested))).sound
        request = bodies.set_variable(7, [PLAIN, COMPRESSED], value)
        assert check(framed(asked(7, SET_VARIABLE, body=request), 3)).sound == sound
        request = bodies.set_variable(7, [COMPRESSED, PLAIN], value)
        assert check(framed(asked(7, SET_VARIABLE, body=request), 3)).sound


def test_a_larger_blob_that_may_swell_is_left_to_be_read() -> None:
    blob = zeros(1000, 65)
    said = explored(Attribute(COMPRESSED, one(blob)))
    assert (said.sound, said.odd) == (False, True)
    assert parse_contents(said.pdu(), False).malformed == []
    noise = zlib.compress(bytes(range(256)), 9)
    assert not may_swell(noise)
    assert explored(Attribute(COMPRESSED, one(noise))).sound  # it cannot swell: what it contains is its own affair
    assert explored(Attribute(COMPRESSED, one(noise[:-1]))).sound


def test_small_blobs_are_inflated_up_to_a_bound_that_they_share() -> None:
    blob = zeros(1000, 64)
    size = len(zlib.decompress(blob))
    count = MAX_INFLATED // size
    assert size * count <= MAX_INFLATED < size * (count + 1)
    values = [Attribute(COMPRESSED, one(blob))] * count
    assert explored(*values).sound
    assert explored(*values, values[0]).odd


# ---- levels ---------------------------------------------------------------------------------------------------------


def structure(levels: int) -> Value:
    value = _FIVE
    for _ in range(levels):
        value = Value(0, STRUCT, Struct(9, [(7, value)]))
    return value


@pytest.mark.parametrize("around", [0, 1, 31, 32, 33, 38, 39, 40])
def test_objects_and_structures_have_forty_levels_together(around: int) -> None:
    """Beyond them reading stops with a fault; structures of more than eight levels are left to be read."""
    for levels in range(11):
        held: Element = Attribute(7, structure(levels))
        for _ in range(around):
            held = PlusObject(7, 9, 0, 0, 0, [held])
        said = explored(held)
        found = parse_contents(said.pdu(), False)
        assert found.whole == (1 + around + levels <= 40), levels
        assert said.sound == (found.whole and levels <= 8), levels
        assert said.odd != said.sound


def test_elements_end_at_an_octet_that_is_no_tag_of_one() -> None:
    """Among these is the end of an object that did not begin; within an object there is no such end."""
    inner = build_object(PlusObject(7, 9, 0, 0, 0, []))
    for octets, passed, behind in (
        (b"", True, 0), (inner, True, 0), (inner + b"\0", True, 1), (inner + b"\xa5", True, 1), (b"\xa2", True, 1),
        (inner + b"\xa2" + inner, True, 1 + len(inner)), (inner[:-1], False, 0), (inner[:-1] + b"\0\xa2", False, 0),
        (b"\xa7" + inner, False, 0), (inner[:-1] + inner, False, 0),
    ):  # fmt: skip
        cursor = Cursor(octets + bytes(9), 0, len(octets))
        assert cursor.elements(marks(frozenset(), frozenset())) == passed, octets
        assert not passed or cursor.at == len(octets) - behind


# ---- ids ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("id_", [1, 127, 128, 129, 255, 256, 8191, 16_382, 16_383])
@pytest.mark.parametrize(
    "value", [_FIVE, Value(0, WSTRING, "x" * 200), Value(0x10, UDINT, [1, 2])], ids=["plain", "text", "array"]
)
def test_any_id_of_two_octets_can_be_sought(id_: int, value: Value) -> None:
    """As an attribute, as a class, and to be noted; those beside it are not taken for it."""
    near = [Attribute(other, value) for other in (id_ - 1, id_ + 1) if other > 0]
    attributes, classes = marks(frozenset((id_,)), frozenset()), marks(frozenset(), frozenset((id_,)))
    noted = marks(frozenset(), frozenset(), frozenset((id_,)))
    assert explored(*near, Attribute(id_, value), bits=attributes).met
    assert not explored(*near, bits=attributes).met
    assert explored(PlusObject(7, id_, 0, 0, 0, []), bits=classes).met
    assert not explored(PlusObject(7, id_ + 1, 0, 0, 0, []), PlusObject(id_, id_ - 1, id_, 0, 0, []), bits=classes).met
    assert not explored(Attribute(id_, value), bits=classes).met
    assert not explored(PlusObject(7, id_, 0, 0, 0, []), bits=attributes).met
    said = explored(*near, Attribute(id_, value), PlusObject(id_, 8, 0, 0, 0, []), bits=noted)
    assert not said.met
    (found,) = read_objects(said).objects
    assert [element.id for element in found.elements if isinstance(element, Attribute)] == [id_]
    held = found.find(id_)
    assert held is not None
    assert build_value(held) == build_value(value)


@pytest.mark.parametrize("id_", [16_384, 2**21, 2**32 - 1])
def test_a_higher_id_is_passed_over(id_: int) -> None:
    attributes = marks(frozenset((0, 16_383)), frozenset((0, 16_383)), frozenset((0, 16_383)))
    said = explored(Attribute(id_, _FIVE), PlusObject(7, id_, 0, 0, 0, []), Relation(id_, 5), bits=attributes)
    assert (said.sound, said.met) == (True, False)


def test_work_is_that_of_reading_in_objects_too() -> None:
    held = PlusObject(
        7, 9, 0, 0, 0,
        [Attribute(7, _FIVE), Attribute(300, Value(0x10, UDINT, [1, 2, 300])), Relation(7, 5), PlusObject(8, 9, 0, 5, 6, [])],
    )  # fmt: skip
    octets = build_elements([held])
    cursor = Cursor(octets, 0, len(octets))
    assert cursor.elements(marks(frozenset(), frozenset()))
    assert cursor.spent == 4 * 5 + 3  # two objects and two values, three elements
    skipped = Cursor(octets, 8, len(octets))
    skipped.attributes(table(frozenset((300,))), 1)
    assert (octets[skipped.at :][:1], skipped.spent) == (b"\xa3", 5)
    skipped = Cursor(octets, 8, len(octets))
    skipped.attributes(table(frozenset()), 1)
    assert (octets[skipped.at :][:1], skipped.spent) == (b"\xa1", 13)
    first = build_elements([Attribute(0, _FIVE), Attribute(16_383, _FIVE), Attribute(16_384, _FIVE)])
    skipped = Cursor(first, 0, len(first))
    skipped.attributes(table(frozenset()), 0)
    assert (first[skipped.at :], skipped.spent) == (
        build_elements([Attribute(16_384, _FIVE)]),
        10,
    )  # any other id is read


@pytest.mark.parametrize("cut", range(1, 9))
def test_an_attribute_or_relation_that_breaks_off_is_left_to_be_read(cut: int) -> None:
    for last in (Attribute(300, _FIVE), Relation(300, 5)):
        octets = build_elements([Attribute(7, _FIVE)]) + build_elements([last])
        begin = len(build_elements([Attribute(7, _FIVE)]))
        for behind in (b"", bytes(9)):
            stop = min(begin + cut, len(octets))
            cursor = Cursor(octets[:stop] + behind, 0, stop)
            cursor.attributes(table(frozenset()), 0)
            assert cursor.at == (stop if stop == len(octets) else begin)
            assert cursor.spent == (10 if stop == len(octets) and isinstance(last, Attribute) else 5)
            again = Cursor(octets[:stop] + behind, 0, stop)
            assert again.elements(marks(frozenset(), frozenset())) == (stop == len(octets))


# ---- members --------------------------------------------------------------------------------------------------------

_TEXT: Final = Value(0, WSTRING, "V4.3")


def test_what_follows_a_structure_is_not_taken_for_its_members() -> None:
    """The text behind it could be read as a value and the member that is sought."""
    looks_like_it = Value(0, WSTRING, b"\x02x\x82\x3f\0\x15\1Z")
    first = Attribute(306, Value(0, STRUCT, Struct(314, [(318, _TEXT)])))
    (found,) = read_objects(explored(first, Attribute(2, looks_like_it))).objects
    assert found.member(306, 319) == ""


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (Value(0, STRUCT, Struct(314, [(319, _TEXT)])), "V4.3"),
        (Value(0, STRUCT, Struct(314, [(1, _FIVE), (318, _TEXT), (2**31, _TEXT), (319, _TEXT), (319, _FIVE)])), "V4.3"),
        (Value(0, STRUCT, Struct(314, [(7, Value(0, STRUCT, Struct(9, [(319, _FIVE)]))), (319, _TEXT)])), "V4.3"),
        (Value(0, STRUCT, Struct(314, [(318, _TEXT)])), ""),
        (Value(0, STRUCT, Struct(314, [])), ""),
        (Value(0, STRUCT, Struct(314, [(319, _FIVE), (319, _TEXT)])), ""),
        (Value(0, STRUCT, Struct(314, [(319, Value(0, WSTRING, b"caf\xe9"))])), ""),
        (Value(0, STRUCT, Packed(0x92000007, 5, 2, b"\x82\x3f\0\x15\4V4.3\0")), ""),
        (Value(0, STRUCT, Packed(0x92000007, 0x823F001504560000, 2, b"abc")), ""),
        (_TEXT, ""),
    ],
)  # fmt: skip
def test_a_member_is_found_without_reading_the_others(value: Value, text: str) -> None:
    said = explored(Attribute(306, value), Attribute(233, Value(0, WSTRING, "behind it")))
    assert said.sound
    (found,) = read_objects(said).objects
    assert found.member(306, 319) == text
    assert found.text(233) == "behind it"
    (whole,) = parse_contents(parse_plus(said.octets), False).objects
    assert whole.member(306, 319) == text
