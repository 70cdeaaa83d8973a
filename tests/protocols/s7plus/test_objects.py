from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.protocols.s7plus.cursor import table
from dissect.protocols.s7plus.objects import (
    Attribute,
    PlusObject,
    Relation,
    build_elements,
    build_object,
    every_object,
    read_elements,
)
from dissect.protocols.s7plus.value_tables import (
    ADDRESS_ARRAY,
    ARRAY,
    BOOL,
    INT,
    LREAL,
    NULL,
    SPARSE_ARRAY,
    STRUCT,
    UDINT,
    WSTRING,
)
from dissect.protocols.s7plus.values import Packed, Rows, Struct, Value, build_value
from dissect.protocols.s7plus.variables import NameList, TagDescription, Variable, VariableList
from dissect.protocols.s7plus.walk import MAX_DEPTH, STEP, FormatError, Walk, Wanted
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


# ---- attributes that are read when they are needed -------------------------------------------------------------------


def later(value: Value, behind: bytes = b"\xee", before: int = 1) -> Attribute:
    """An attribute whose value is in the octets of a message, with others in front of it and behind it."""
    octets = bytes((0xEE, 0, before)) + build_value(value)
    return Attribute(7, None, octets + behind, 3, len(octets))


_NESTED = Value(0, STRUCT, Struct(9, [(319, Value(0, WSTRING, "inner"))]))
VALUES_OF_ATTRIBUTES = [
    Value(0, WSTRING, "pump"),
    Value(0, WSTRING, ""),
    Value(0, WSTRING, "x" * 200),
    Value(0, WSTRING, b"caf\xe9"),
    Value(0x80, WSTRING, "pump"),
    Value(ARRAY, WSTRING, ["a", "b"]),
    Value(0, UDINT, 5),
    Value(0, UDINT, 300),
    Value(0x80, UDINT, 5),
    Value(0, INT, -3),
    Value(0, BOOL, True),
    Value(0, LREAL, 1.5),
    Value(0, NULL, None),
    Value(ARRAY, UDINT, []),
    Value(ARRAY, UDINT, [1, 300, 2**32 - 1]),
    Value(ADDRESS_ARRAY, UDINT, [0x80000000, 0, 1]),
    Value(0x90, UDINT, [1, 300]),
    Value(ARRAY, INT, [1, -2]),
    Value(SPARSE_ARRAY, UDINT, [(1, 2)]),
    Value(0, STRUCT, Struct(314, [])),
    Value(0, STRUCT, Struct(314, [(1, Value(0, UDINT, 5)), (319, Value(0, WSTRING, "1;6ES7")), (319, _NESTED)])),
    Value(0, STRUCT, Struct(314, [(1, _NESTED), (319, Value(0, WSTRING, "x" * 200))])),
    Value(0, STRUCT, Struct(314, [(1, _NESTED)])),
    Value(0, STRUCT, Struct(314, [(319, Value(0, UDINT, 5)), (319, Value(0, WSTRING, "second"))])),
    Value(0, STRUCT, Struct(314, [(319, Value(0x80, WSTRING, "flagged"))])),
    Value(0, STRUCT, Struct(314, [(319, Value(0, UDINT, 1)), (65, Value(0, UDINT, 5))])),  # like a text of one letter
    Value(0, STRUCT, Struct(314, [(319, Value(0, WSTRING, b"caf\xe9"))])),
    Value(0x80, STRUCT, Struct(314, [(319, Value(0, WSTRING, "flagged"))])),
    Value(0, STRUCT, Packed(0x92000003, 5, 0, b"abc")),
    Value(ARRAY, STRUCT, Rows(314, [[(319, Value(0, WSTRING, "row"))]])),
]


@pytest.mark.parametrize("value", VALUES_OF_ATTRIBUTES)
def test_an_attribute_says_the_same_before_it_is_read_and_after(value: Value) -> None:
    content = value.content
    text = content.decode("utf-8", "replace") if isinstance(content, bytes) else content
    text = text if isinstance(text, str) else ""
    number = int(content) if isinstance(content, int) else -1
    numbers = [one for one in content if isinstance(one, int)] if isinstance(content, list) else []
    found = [one.content for id_, one in content.members if id_ == 319] if isinstance(content, Struct) else []
    member = found[0] if found and isinstance(found[0], str) else ""
    for behind, before in ((b"\xee", 1), (b"", WSTRING), (b"", UDINT), (b"", STRUCT)):
        for ask in (Attribute.text, Attribute.number, Attribute.numbers, lambda one: one.member(319)):
            one = later(value, behind, before)
            first = ask(one)
            assert one.value == value
            assert one.value is one.value
            assert first == ask(one) == ask(Attribute(7, value))
            assert (one.text(), one.number(), one.numbers(), one.member(319)) == (text, number, numbers, member)


def test_an_object_is_asked_for_its_attributes_by_id() -> None:
    inner = PlusObject(3, 4, 0, 0, 0, [Attribute(8, Value(0, UDINT, 8))])
    one = PlusObject(
        1, 2, 0, 0, 0, [Relation(7, 99), Attribute(7, Value(0, UDINT, 5)), inner, Attribute(7, Value(0, UDINT, 6))]
    )
    assert (one.number(7), one.holds(7), one.relation(7)) == (5, True, 99)  # the first of two
    assert (one.number(8), one.holds(8), one.relation(8), one.text(8), one.numbers(8)) == (-1, False, 0, "", [])
    assert (one.find(8), one.member(8, 1), one.objects) == (None, "", [inner])
    assert one.holds_any(frozenset((8, 7)))
    assert not one.holds_any(frozenset((8, 9)))
    assert not inner.holds_any(frozenset((7,)))


def test_lists_are_those_of_the_object_itself() -> None:
    names, variables = NameList([[b"a"], [b"b"]]), VariableList(0, [[Variable(9, 0, 5, 0x8000, 0, 0, 0, [])]])
    one = PlusObject(
        1, 511, 0, 0, 0, [names, PlusObject(2, 3, 0, 0, 0, [NameList([[b"c"]])]), variables, NameList([[b"d"]])]
    )
    assert one.names == ["a", "b", "d"]
    assert [each.lid for each in one.variables] == [9]
    assert ([len(lists) for lists in one.lists], one.lists[0][0], one.lists[1]) == ([2, 1], names, [variables])


# ---- places ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("octets", "fault"),
    [
        ("a1 00000001 02 00 00 07", ("unknown_type", "element", 8, 0xA2, 7)),
        ("a1 00000001 02 00 00", ("too_short", "end of object", 8, 1, 0)),
        ("a1 000001", ("too_short", "RID", 1, 4, 3)),
        ("a1 00000001", ("too_short", "class", 5, 1, 0)),
        ("a1 00000001 02", ("too_short", "class flags", 6, 1, 0)),
        ("a1 00000001 02 00", ("too_short", "attribute", 7, 1, 0)),
        ("a1 00000001 02 00 07", ("too_short", "attribute", 8, 1, 0)),
        ("a4", ("too_short", "relation", 1, 1, 0)),
        ("a4 07 000000", ("too_short", "relation", 2, 4, 3)),
        ("a3", ("too_short", "attribute", 1, 1, 0)),
        ("a3 07 00", ("too_short", "type", 3, 1, 0)),
        ("a3 07", ("too_short", "flags", 2, 1, 0)),
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


def test_elements_end_where_another_octet_stands() -> None:
    one = build_elements([Attribute(7, Value(0, UDINT, 5)), Relation(7, 9)])
    for behind in (b"", b"\0", b"\xa2", b"\xa5", b"\xff"):
        for shown in (True, False):
            walk = Walk(one + behind, 0, len(one + behind), shown)
            assert [type(element) for element in read_elements(walk)] == [Attribute, Relation]
            assert (walk.at, walk.depth) == (len(one), 0)


def test_objects_and_attributes_count_as_work() -> None:
    for one in (PlusObject(1, 2, 0, 0, 0, []), PlusObject(1, 2, 0, 3, 4, [])):
        octets = build_object(one)
        for shown in (True, False):
            walk = Walk(octets, 0, len(octets), shown)
            read_elements(walk)
            assert walk.budget == 3 * len(octets) + 1024 - STEP
    octets = build_elements([Attribute(7, Value(0, UDINT, 5))])
    for shown in (True, False):
        walk = Walk(octets, 0, len(octets), shown)
        read_elements(walk)
        assert walk.budget == 3 * len(octets) + 1024 - STEP


def test_an_object_keeps_its_place() -> None:
    inner = PlusObject(3, 4, 0, 0, 0, [Attribute(8, Value(0, UDINT, 8))])
    octets = build_object(PlusObject(1, 2, 0, 0, 0, [Relation(5, 6), inner]))
    (found,), walk = read(b"\xa4\x07" + bytes(4) + octets)
    assert (found.offset, found.end) == (6, 6 + len(octets))
    (held,) = found.objects
    assert octets[held.offset - 6 : held.end - 6] == build_object(inner)
    assert [part.depth for part in walk.parts] == [0, 0, 1, 1, 2, 1, 0]


def test_attributes_that_nobody_needs_are_passed_over() -> None:
    wanted = Wanted(table(frozenset((9,))))
    one = PlusObject(
        1, 2, 0, 0, 0,
        [Attribute(7, Value(0, UDINT, 5)), Relation(9, 6), Attribute(9, Value(0, UDINT, 6)), PlusObject(3, 4, 0, 0, 0, [])],
    )  # fmt: skip
    octets = build_object(one)
    walk = Walk(octets, 0, len(octets), False, 0, wanted)
    (found,) = read_elements(walk)
    assert isinstance(found, PlusObject)
    assert [type(element) for element in found.elements] == [Attribute, PlusObject]
    assert (found.holds(7), found.number(9), found.end, walk.left) == (False, 6, len(octets), 0)
    whole = Walk(octets, 0, len(octets), False)
    read_elements(whole)
    assert walk.budget == whole.budget  # it costs the same
    last = build_object(PlusObject(1, 2, 0, 0, 0, [Attribute(9, Value(0, UDINT, 6)), Attribute(7, Value(0, UDINT, 5))]))
    (found,) = read_elements(Walk(last, 0, len(last), False, 3 * STEP, wanted))
    assert isinstance(found, PlusObject)
    assert [found.number(9), found.number(7)] == [6, -1]
    for asks in (wanted, None):
        read_elements(Walk(octets, 0, len(octets), False, 4 * STEP, asks))
        with pytest.raises(FormatError) as caught:
            read_elements(Walk(octets, 0, len(octets), False, 4 * STEP - 1, asks))
        assert caught.value.reason == "exhausted"
