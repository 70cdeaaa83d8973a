from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.protocols.s7plus.objects import (
    Attribute,
    PlusObject,
    Relation,
    build_elements,
    build_object,
    every_object,
    read_elements,
)
from dissect.protocols.s7plus.value_tables import WSTRING
from dissect.protocols.s7plus.values import Value
from dissect.protocols.s7plus.variables import NameList, TagDescription, Variable, VariableList
from dissect.protocols.s7plus.walk import MAX_DEPTH, FormatError, Walk
from tests.protocols.s7plus.strategies import OBJECTS

#: The type of a data block with a number and a text.
TYPE = PlusObject(
    0x92000003,
    511,
    0,
    0,
    0,
    [
        Attribute(233, Value(0, WSTRING, "tank")),
        Relation(4578, 0x8A0E0003),
        VariableList(
            0x02000080,
            [
                [
                    Variable(9, 0xAABBCCDD, 5, 0x8AC0, 0, 2, 4, []),
                    Variable(10, 0x11223344, 19, 0x9AC0, 0, 254, 6, [8, 6]),
                ]
            ],
        ),
        NameList([[b"level", b"name"]]),
    ],
)


def read(octets: bytes, shown: bool = True) -> tuple[list[PlusObject], Walk]:
    walk = Walk(octets, 0, len(octets), shown)
    return [element for element in read_elements(walk) if isinstance(element, PlusObject)], walk


def test_an_object() -> None:
    (found,), walk = read(build_object(TYPE))
    assert (found.rid, found.class_id, found.offset, found.end) == (0x92000003, 511, 0, walk.at)
    assert found.text(233) == "tank"
    assert (found.text(1), found.number(233), found.relation(4578), found.relation(1)) == ("", -1, 0x8A0E0003, 0)
    assert found.names == ["level", "name"]
    assert [(variable.lid, variable.datatype_name) for variable in found.variables] == [(9, "Int"), (10, "String")]
    assert [(part.layout.name, part.depth, part.note) for part in walk.parts] == [
        ("object", 0, "511 ClassTypeInfo, type of DB3 0x92000003"),
        ("attribute", 1, "233 ObjectVariableTypeName = WString 'tank'"),
        ("relation", 1, "4578 Block.TypeInfo → DB3"),
        ("list of variables", 1, ""),
        ("block", 2, ""),
        ("list head", 2, ""),
        ("variable", 2, "LID 9 Int"),
        ("variable", 2, "LID 10 String"),
        ("block", 2, ""),
        ("list of names", 1, ""),
        ("block", 2, ""),
        ("name", 2, "level"),
        ("name", 2, "name"),
        ("block", 2, ""),
        ("end of object", 0, ""),
    ]
    assert [value.meaning for value in walk.parts[6].values[:4]] == ["9", "0xaabbccdd", "Int", "plain, both layouts"]


def test_an_attribute_that_holds_the_object() -> None:
    held = PlusObject(1, 2, 3, 4, 5, [])
    (found,), walk = read(build_object(held))
    assert (found.attribute, found.more) == (4, 5)
    assert walk.parts[0].number("more") == 5


def test_objects_inside() -> None:
    inner = PlusObject(7, 8, 0, 0, 0, [])
    outer = PlusObject(1, 2, 0, 0, 0, [PlusObject(3, 4, 0, 0, 0, [inner])])
    (found,), _ = read(build_object(outer))
    assert [one.rid for one in every_object([found])] == [1, 3, 7]


def test_an_old_tag_description() -> None:
    octets = bytes.fromhex("08 04 6c65766c 01 07 05 00000001 09 00 00 01 02 04 00 00")
    wire = b"\xa7" + octets + b"\xa8"
    walk = Walk(wire, 0, len(wire), True)
    (found,) = read_elements(walk)
    assert isinstance(found, TagDescription)
    assert (found.name, found.datatype, found.lid, walk.left) == ("levl", 5, 9, 0)
    assert build_elements([found]) == wire
    assert [(part.layout.name, part.note) for part in walk.parts] == [
        ("tag description", "levl"),
        ("tag", "LID 9 Int"),
        ("end of tag description", ""),
    ]
    assert [part.end - part.offset for part in walk.parts] == [7, len(octets) - 6, 1]


@pytest.mark.parametrize(
    ("octets", "reason", "field"),
    [
        ("a1 00000001 02 00 00 07", "unknown_type", "element"),
        ("a1 00000001 02 00 00", "too_short", "end of object"),
        ("ab 0009 80000002 01020304", "length_beyond", "block length"),
        ("ac 0003 05 6162 0000 000000", "length_beyond", "name"),
        ("ac 0003 01 6161 0000", "length_beyond", "name"),
        ("a7 00 00 01 07 05 00000001 09 00 00 00 00", "bad_value", "end of tag description"),
    ],
)
def test_what_does_not_fit(octets: str, reason: str, field: str) -> None:
    with pytest.raises(FormatError) as caught:
        read(bytes.fromhex(octets))
    assert (caught.value.reason, caught.value.field) == (reason, field)


def test_depth_is_bounded() -> None:
    head = bytes.fromhex("a1 00000001 02 00 00")
    read(head * MAX_DEPTH + b"\xa2" * MAX_DEPTH)
    with pytest.raises(FormatError) as caught:
        read(head * 100_000)
    assert caught.value.field == "depth of object"


@given(OBJECTS)
def test_what_was_built_reads_back(one: PlusObject) -> None:
    wire = build_object(one)
    for shown in (True, False):
        (found,), walk = read(wire + b"\x01", shown)
        assert walk.at == found.end == len(wire)
        assert build_object(found) == wire
        if shown:
            assert [part.offset for part in walk.parts] == [0, *[part.end for part in walk.parts[:-1]]]
            assert all([part.values for part in walk.parts])


@given(OBJECTS, st.data())
def test_cut_anywhere_it_is_a_fault(one: PlusObject, data: st.DataObject) -> None:
    wire = build_object(one)
    with pytest.raises(FormatError):
        read(wire[: data.draw(st.integers(1, len(wire) - 1))])


@given(OBJECTS, st.data())
def test_nothing_but_a_fault_is_raised(one: PlusObject, data: st.DataObject) -> None:
    wire = bytearray(build_object(one))
    wire[data.draw(st.integers(0, len(wire) - 1))] = data.draw(st.integers(0, 255))
    try:
        found, _ = read(bytes(wire))
    except FormatError:
        return
    for element in found:
        build_object(element)
