"""What a variable of a block says of itself, by its kind; and the lists that variables and their names come in."""

from __future__ import annotations

from typing import Final

import pytest

from dissect.protocols.s7plus.bodies import parse_contents
from dissect.protocols.s7plus.message import parse_plus
from dissect.protocols.s7plus.objects import Element, PlusObject, build_elements, read_elements
from dissect.protocols.s7plus.tables import CREATE_OBJECT
from dissect.protocols.s7plus.value_tables import UDINT
from dissect.protocols.s7plus.values import Value
from dissect.protocols.s7plus.variables import NameList, TagDescription, Variable, VariableList
from dissect.protocols.s7plus.walk import FormatError, Walk
from tests.protocols.s7plus import bodies
from tests.protocols.s7plus.pdus import asked, framed

INT: Final = 5
BBOOL: Final = 40
#: By kind: how many numbers it has, and which of them are the count of all elements, the type, and the size of an element in
#: the optimised and in the classic layout; of the first dimension, the lower bound and the count; and how many dimensions.
KINDS: Final[dict[int, tuple[int, int, int, int, int, int, int, int]]] = {
    0: (25, 9, 2, -1, -1, 13, 19, 6),
    1: (0, -1, -1, -1, -1, -1, -1, 0),
    2: (2, -1, -1, -1, -1, -1, -1, 0),
    3: (4, 3, -1, -1, -1, 2, 3, 1),
    4: (16, 3, -1, -1, -1, 4, 10, 6),
    5: (7, -1, 2, -1, -1, -1, -1, 0),
    6: (11, 3, 6, 5, 4, 2, 3, 1),
    7: (23, 3, 18, 17, 16, 4, 10, 6),
    8: (0, -1, -1, -1, -1, -1, -1, 0),
    9: (2, -1, -1, -1, -1, -1, -1, 0),
    10: (4, 3, -1, -1, -1, 2, 3, 1),
    11: (16, 3, -1, -1, -1, 4, 10, 6),
    12: (7, -1, 2, -1, -1, -1, -1, 0),
    13: (11, 3, 6, 5, 4, 2, 3, 1),
    14: (23, 3, 18, 17, 16, 4, 10, 6),
    15: (9, -1, 2, -1, -1, -1, -1, 0),
}


def of_kind(kind: int, numbers: list[int], datatype: int = INT, bits: int = 0, bit_offsets: int = 0) -> Variable:
    return Variable(7, 0, datatype, kind << 12 | bits, bit_offsets, 11, 22, numbers)


@pytest.mark.parametrize("kind", KINDS)
def test_the_numbers_of_a_variable_mean_what_its_kind_says(kind: int) -> None:
    size, count, type_, optimised, classic, lower, first, dimensions = KINDS[kind]
    numbers = list(range(1000, 1000 + size))
    one = of_kind(kind, numbers)
    assert one.is_array == (dimensions > 0)
    assert one.count == (1000 + count if count >= 0 else 0)
    assert one.type_id == (1000 + type_ if type_ >= 0 else 0)
    assert one.element_size(False) == (1000 + optimised if optimised >= 0 else 0)
    assert one.element_size(True) == (1000 + classic if classic >= 0 else 0)
    assert one.dimensions == [(1000 + lower + at, 1000 + first + at) for at in range(dimensions)]
    strings = kind in {2, 9} or (dimensions > 0 and type_ < 0)
    assert one.most_characters == (11 if strings else 0)
    if kind == 1:
        assert (one.offset(False), one.offset(True)) == (22, 11)
    elif kind == 8:
        assert (one.offset(False), one.offset(True)) == (11, 22)
    else:
        assert (one.offset(False), one.offset(True)) == (1000, 1001)


def test_lower_bounds_may_be_below_0_and_dimensions_end_where_a_count_is_0() -> None:
    for wire, lower in ((0xFFFFFFFF, -1), (0x80000000, -(2**31)), (0x7FFFFFFF, 2**31 - 1), (0, 0)):
        assert of_kind(10, [0, 0, wire, 3]).dimensions == [(lower, 3)]
        assert of_kind(11, [0, 0, 0, 6, wire, wire, *[0] * 4, 3, 2, *[0] * 4]).dimensions == [(lower, 3), (lower, 2)]


@pytest.mark.parametrize(
    ("datatype", "bit_offsets", "optimised", "classic"),
    [
        (1, 0b1101_1010, 6, 5),  # the bit of the classic layout is given
        (1, 0b1101_0010, 6, 6),  # it is not
        (1, 0b0111_1000, 6, 7),
        (BBOOL, 0b1101_1010, 2, 5),
        (BBOOL, 0b1101_0111, 7, 6),
    ],
)
def test_a_bit_has_a_number_in_each_layout(datatype: int, bit_offsets: int, optimised: int, classic: int) -> None:
    one = of_kind(8, [], datatype, 0xAC6, bit_offsets)
    assert (one.bit(False), one.bit(True)) == (optimised, classic)


def several(kind: int, lower: list[int], counts: list[int], datatype: int = INT) -> Variable:
    total = 1
    for count in counts:
        total *= count
    bounds = [*lower, *[0] * (6 - len(lower)), *counts, *[0] * (6 - len(counts))]
    return of_kind(kind, [0, 0, 0, total, *bounds], datatype)


def test_an_element_of_one_dimension_has_one_index() -> None:
    one = of_kind(10, [0, 0, 0xFFFFFFFE, 4])
    assert [one.index_text(at) for at in range(-1, 5)] == ["", "[-2]", "[-1]", "[0]", "[1]", ""]
    assert of_kind(8, []).index_text(0) == ""


def test_the_last_index_counts_fastest() -> None:
    one = several(11, [1, 5, 7], [2, 3, 2])
    said = [one.index_text(at) for at in range(13)]
    wanted = [f"[{a},{b},{c}]" for a in (7, 8) for b in (5, 6, 7) for c in (1, 2)]
    assert said == [*wanted, ""]


@pytest.mark.parametrize(("count", "row"), [(1, 8), (7, 8), (8, 8), (9, 16), (16, 16), (17, 24)])
def test_a_row_of_bits_fills_its_bytes(count: int, row: int) -> None:
    """Only the fastest dimension is filled up."""
    one = several(11, [0, 0, 0], [count, 3, 2], BBOOL)
    assert one.index_text(count - 1) == f"[0,0,{count - 1}]"
    assert one.index_text(row) == "[0,1,0]"
    assert one.index_text(3 * row) == "[1,0,0]"
    assert one.index_text(6 * row - row + count - 1) == f"[1,2,{count - 1}]"
    assert one.index_text(6 * row) == ""
    assert [one.index_text(at) for at in range(count, row)] == [""] * (row - count)


def test_an_array_ends_with_the_count_of_its_elements() -> None:
    """Where that is less than its dimensions say, too."""
    one = of_kind(11, [0, 0, 0, 5, *[0] * 6, 2, 3, *[0] * 4])
    assert [one.index_text(at) for at in (4, 5)] == ["[2,0]", ""]


def test_bits_of_one_dimension_end_with_it() -> None:
    one = of_kind(10, [0, 0, 0, 3], BBOOL)
    assert [one.index_text(at) for at in range(5)] == ["[0]", "[1]", "[2]", "", ""]


# ---- lists ----------------------------------------------------------------------------------------------------------


def read(octets: bytes, shown: bool) -> tuple[object, Walk]:
    walk = Walk(octets, 0, len(octets), shown)
    (found,) = read_elements(walk)
    return found, walk


FEW: Final = [Variable(9, 0xAABBCCDD, 5, 0x8AC0, 0, 2, 4, []), Variable(10, 1, 19, 0x9AC0, 3, 0x1234, 0x4321, [8, 6])]


@pytest.mark.parametrize("blocks", [[], [FEW], [FEW[:1], FEW], [FEW, FEW[1:]]])
def test_a_list_of_variables_is_read_now_or_when_it_is_needed(blocks: list[list[Variable]]) -> None:
    made = VariableList(0x02000080 if blocks else 0, blocks)
    wire = build_elements([made])
    ends: list[Variable] = []
    for shown in (True, False):
        found, walk = read(wire + b"\1", shown)
        assert isinstance(found, VariableList)
        ends = [variable for block in found.blocks[-1:] for variable in block[-1:]]
        assert (walk.at, walk.depth) == (len(wire), 0)
        assert (found.first, found.count) == (made.first, sum([len(block) for block in blocks]))
        assert [[one.lid for one in block] for block in found.blocks] == [
            [one.lid for one in block] for block in blocks
        ]
        assert build_elements([found]) == wire
    (end,) = ends or [FEW[1]]
    assert (end.crc, end.datatype, end.attributes, end.bit_offsets) == (1, 19, 0x9AC0, 3)
    assert (end.offset_1, end.offset_2, end.numbers) == (0x1234, 0x4321, [8, 6])


@pytest.mark.parametrize("kind", KINDS)
def test_a_variable_is_as_long_as_its_kind_says(kind: int) -> None:
    """16 octets, and four more for each number; the next one begins behind it."""
    size = KINDS[kind][0]
    one = of_kind(kind, [0x01020304 + at for at in range(size)])
    wire = build_elements([VariableList(7, [[one, FEW[0]]])])
    assert len(wire) == 1 + 2 + 4 + 16 + 4 * size + 16 + 2
    for shown in (True, False):
        found, walk = read(wire + b"\1", shown)
        assert isinstance(found, VariableList)
        assert (walk.at, found.count, found.variables[0].numbers) == (len(wire), 2, one.numbers)
        assert [each.lid for each in found.variables] == [7, 9]


@pytest.mark.parametrize("blocks", [[], [[b"level"]], [[b"a", b""], [b"\xe4", b"n" * 255]]])
def test_a_list_of_names_is_read_now_or_when_it_is_needed(blocks: list[list[bytes]]) -> None:
    wire = build_elements([NameList(blocks)])
    for shown in (True, False):
        found, walk = read(wire + b"\1", shown)
        assert isinstance(found, NameList)
        assert (walk.at, walk.depth) == (len(wire), 0)
        assert (found.count, found.blocks) == (sum([len(block) for block in blocks]), blocks)
        assert found.names == [name.decode("utf-8", "replace") for block in blocks for name in block]


@pytest.mark.parametrize(
    ("octets", "fault"),
    [
        ("ab 0009 80000002 01020304", ("length_beyond", "block length", 1, 9, 8)),
        ("ab 0001 80", ("too_short", "first", 3, 4, 1)),
        # Variables of 16 and 24 octets, in blocks that end one octet before they do.
        ("ab 0013 00000000 09000000 01020304 05 8000 00 0000 0000", ("length_beyond", "variable", 7, 16, 15)),
        (
            "ab 001b 00000000 09000000 01020304 05 9000 00 0000 0000" + "00" * 8,
            ("length_beyond", "variable", 7, 24, 23),
        ),
        ("ac 0004 05 6162 0000 000000", ("length_beyond", "name", 3, 7, 4)),
        ("ac 0003 01 6161 0000", ("length_beyond", "name", 3, 3, 3)),
        ("ac 0004 01 6100 0000", ("length_beyond", "name", 6, 2, 1)),
    ],
)
@pytest.mark.parametrize("shown", [True, False])
def test_a_list_that_does_not_fit_is_told_with_its_place(
    octets: str, fault: tuple[str, str, int, int, int], shown: bool
) -> None:
    with pytest.raises(FormatError) as caught:
        read(bytes.fromhex(octets), shown)
    said = caught.value
    assert (said.reason, said.field, said.at, said.needed, said.available) == fault


def test_variables_and_names_count_as_work() -> None:
    """Of 100 variables with their names each costs as much as a value."""
    lists: list[Element] = [VariableList(0, [[FEW[0]] * 100]), NameList([[b"n"] * 100])]
    for one in lists:
        body = bodies.create_object(3, Value(0, UDINT, 0), PlusObject(1, 2, 0, 0, 0, [one]), integrity_id=1)
        pdu = parse_plus(framed(asked(1, CREATE_OBJECT, body=body), 3))
        assert parse_contents(pdu, False, 499).exhausted
        assert not parse_contents(pdu, False, 600).exhausted
        assert parse_contents(pdu, True, 499).exhausted


# ---- the form of firmware 2 -----------------------------------------------------------------------------------------

#: A number and a signed number, of two octets each, so that one that is not read shows.
LONG: Final = b"\x81\x01"
BELOW: Final = b"\xff\x7e"


def description(kind: int, dimensions: int = 0) -> bytes:
    """A description with all that its kind says, without its tags."""
    said = bytes((kind,)) + b"\4levl" + b"\1\7" + b"\5" + bytes(4) + b"\x81\x09" + LONG
    if kind & 0x0C:
        said += LONG * 2
    said += LONG * 2
    if kind & 3 == 1:
        said += LONG * 2
    elif kind & 3 == 2:
        said += BELOW + LONG * 3
    elif kind & 3 == 3:
        said += LONG * 2 + bytes((dimensions,)) + (BELOW + LONG) * dimensions
    return said + (LONG * 2 if kind & 8 else b"")


@pytest.mark.parametrize("kind", range(16))
@pytest.mark.parametrize("dimensions", [0, 1, 2])
def test_an_old_description_has_the_fields_of_its_kind(kind: int, dimensions: int) -> None:
    said = description(kind, dimensions)
    wire = b"\xa7" + said + b"\xa8"
    for shown in (True, False):
        found, walk = read(wire + b"\1", shown)
        assert isinstance(found, TagDescription)
        assert (found.octets, found.name, found.datatype, found.lid, walk.at) == (said, "levl", 5, 137, len(wire))
    for size in range(1, len(wire)):
        with pytest.raises(FormatError):
            read(wire[:size], False)


def test_an_old_description_without_its_end_is_told_with_its_place() -> None:
    said = description(0)
    with pytest.raises(FormatError) as caught:
        read(b"\xa7" + said + b"\xa9", False)
    fault = caught.value
    assert (fault.reason, fault.field) == ("bad_value", "end of tag description")
    assert (fault.at, fault.needed, fault.available) == (1 + len(said), 0xA8, 0xA9)


def test_an_old_description_is_shown_in_its_parts() -> None:
    said = description(0x0B, 1)
    _, walk = read(b"\xa7" + said + b"\xa8", True)
    assert [(part.layout.name, part.depth, part.offset, part.end) for part in walk.parts] == [
        ("tag description", 0, 0, 7),
        ("tag", 1, 7, 1 + len(said)),
        ("end of tag description", 0, 1 + len(said), 2 + len(said)),
    ]
