"""What is passed over is what reading finds sound, and reading it later gives the same."""

from __future__ import annotations

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from dissect.protocols.s7plus.blobs import COMPRESSED
from dissect.protocols.s7plus.cursor import Cursor, is_wanted, marks, table
from dissect.protocols.s7plus.cursor_lists import pass_names, pass_variables
from dissect.protocols.s7plus.layouts import VALUE
from dissect.protocols.s7plus.objects import (
    Attribute,
    PlusObject,
    Relation,
    build_elements,
    every_object,
    read_elements,
)
from dissect.protocols.s7plus.value_reading import read_value
from dissect.protocols.s7plus.value_tables import UDINT, VALUE_TYPES
from dissect.protocols.s7plus.values import Value, build_value
from dissect.protocols.s7plus.variables import NameList, Variable, VariableList, build_names, build_variables
from dissect.protocols.s7plus.walk import MAX_WORK, FormatError, Walk, Wanted
from dissect.wire.varint import VLQ, build_varint
from tests.cases import each
from tests.protocols.s7plus.strategies import OBJECTS, PLAIN, VALUES

_VARIABLES = VariableList(
    7, [[Variable(9, 1, 5, 0x8AC0, 0, 2, 4, [])], [Variable(10, 2, 19, 0x9AC0, 0, 254, 6, [8, 6])]]
)
_NAMES = NameList([[b"level", b""], [b"name"]])


def check(octets: bytes, end: int) -> bool:
    """Hold a value that is passed over to its reading: the same end, the same work, no fault."""
    cursor = Cursor(octets, 0, end)
    if not cursor.value(0):
        return False
    walk = Walk(octets, 0, end, False)
    budget = walk.budget
    read_value(walk, VALUE, 0)  # raises where it finds a fault
    assert (walk.at, budget - walk.budget, walk.faults, walk.blobs) == (cursor.at, cursor.spent, [], [])
    return True


@given(VALUES, st.binary(max_size=3))
def test_values_end_where_their_reading_ends(value: object, behind: bytes) -> None:
    octets = build_value(value)  # type: ignore[arg-type]
    check(octets + behind, len(octets) + len(behind))


@given(VALUES, st.data())
def test_a_value_that_is_cut_short_is_read(value: object, data: st.DataObject) -> None:
    octets = build_value(value)  # type: ignore[arg-type]
    assert not check(octets, data.draw(st.integers(0, len(octets) - 1)))


@given(st.integers(0, 255), st.integers(0, 0x18), st.binary(max_size=40))
@example(0x10, 0x18, b"\x00")
@example(0x40, 0x99, b"\x00")
@example(0x10, 0x16, b"\x00")
@example(0x10, 0x00, b"\xff\x7f")
@example(0x10, 0x0F, b"\x8f\xff\xff\xff\x7f")
def test_any_octets(flags: int, type_: int, rest: bytes) -> None:
    check(bytes((flags, type_)) + rest, len(rest) + 2)


@each("type_", [code.number for code in VALUE_TYPES])
@each("flags", [0x00, 0x10, 0x20, 0x40])
def test_most_types_are_passed_over(flags: int, type_: int) -> None:
    """One element of zeros, or one of key 1, or a structure without members, or an array of one."""
    octets = bytes((flags, type_)) + (b"\x01" if flags else b"") + bytes(12)
    passed = Cursor(octets, 0, len(octets)).value(0)
    name = VALUE_TYPES.name(type_)
    if name == "Variant":
        assert passed == (flags == 0x40)  # where it is a number
    else:
        assert passed == ((flags != 0x40 or name != "Struct") and (flags not in {0x10, 0x20} or name != "Null"))


@given(OBJECTS)
def test_objects_are_the_same_read_at_once_and_later(found: object) -> None:
    octets = build_elements([found])  # type: ignore[list-item]
    later = read_elements(Walk(octets, 0, len(octets), False))
    assert build_elements(later) == octets
    assert build_elements(read_elements(Walk(octets, 0, len(octets), True))) == octets


def wanted_of(objects: list[PlusObject], ids: frozenset[int]) -> list[tuple[int, list[tuple[int, bytes]]]]:
    """Give of each object its class and the attributes of these ids, with their octets."""
    return [
        (
            one.class_id,
            [(a.id, build_value(a.value)) for a in one.elements if isinstance(a, Attribute) and a.id in ids],
        )
        for one in every_object(objects)
    ]


@given(OBJECTS, st.data())
def test_what_nobody_wants_is_left_out_and_nothing_else(found: object, data: st.DataObject) -> None:
    assert isinstance(found, PlusObject)
    there = sorted({a.id for one in every_object([found]) for a in one.elements if isinstance(a, Attribute)})
    ids = frozenset(data.draw(st.lists(st.sampled_from(there))) if there else [])
    ids = frozenset([id_ for id_ in ids if id_ < 1 << 14])
    octets = build_elements([found])
    everything, some = (Walk(octets, 0, len(octets), False, MAX_WORK, wanted) for wanted in (None, Wanted(table(ids))))
    (whole,), (part,) = read_elements(everything), read_elements(some)
    assert isinstance(whole, PlusObject)
    assert isinstance(part, PlusObject)
    assert wanted_of([part], ids) == wanted_of([whole], ids)
    assert (some.at, some.budget) == (everything.at, everything.budget)
    assert not [one for one in every_object([part]) for r in one.elements if isinstance(r, Relation)]
    left = {a.id for one in every_object([part]) for a in one.elements if isinstance(a, Attribute)}
    assert all(id_ in ids or id_ >= 1 << 14 or not is_plain(whole, id_) for id_ in left)


def is_plain(found: PlusObject, id_: int) -> bool:
    """Say whether every value of an attribute is one that can be passed over."""
    each = [a for one in every_object([found]) for a in one.elements if isinstance(a, Attribute) and a.id == id_]
    octets = [build_value(attribute.value) for attribute in each]
    return all(Cursor(one, 0, len(one)).value(0) for one in octets)


@given(OBJECTS, st.data())
def test_a_fault_is_found_though_nobody_wants_the_attribute(found: object, data: st.DataObject) -> None:
    octets = build_elements([found])  # type: ignore[list-item]
    octets = octets[: data.draw(st.integers(1, len(octets) - 1))]
    faults = []
    for wanted in (None, Wanted(table(frozenset()))):
        walk = Walk(octets, 0, len(octets), False, MAX_WORK, wanted)
        with pytest.raises(FormatError) as fault:
            read_elements(walk)
        faults.append((fault.value.reason, fault.value.field, fault.value.at))
    assert faults[0] == faults[1]


def test_a_table_knows_ids_of_two_octets_and_leaves_the_others_to_be_read() -> None:
    made = table(frozenset((233, 16383)))
    assert [is_wanted(made, id_) for id_ in (232, 233, 16383, 16384, 1 << 31)] == [False, True, True, True, True]
    assert not any(is_wanted(made, id_) for id_ in COMPRESSED)


@pytest.mark.parametrize("built", [build_variables(_VARIABLES), build_names(_NAMES)])
def test_lists_are_passed_over_and_any_fault_is_read(built: bytes) -> None:
    passing = pass_variables if built == build_variables(_VARIABLES) else pass_names
    octets = built[1:]
    assert passing(octets, 0, len(octets)) == (len(octets), 2 if passing is pass_variables else 3)
    for end in range(len(octets)):
        assert passing(octets, 0, end) == (-1, 0)
    for at in range(len(octets)):
        for bit in range(8):
            changed = octets[:at] + bytes((octets[at] ^ 1 << bit,)) + octets[at + 1 :]
            end, count = passing(changed, 0, len(changed))
            whole = built[:1] + changed
            try:
                (read,) = read_elements(Walk(whole, 0, len(whole), True))
            except (FormatError, ValueError):
                assert end < 0
                continue
            assert isinstance(read, VariableList | NameList)
            assert end < 0 or (build_elements([read])[1:], read.count) == (changed[:end], count)


def test_a_list_of_nothing() -> None:
    assert pass_variables(b"\0\0", 0, 2) == pass_names(b"\0\0", 0, 2) == (2, 0)
    empty = build_variables(VariableList(0x02000080, [[]]))
    (read,) = read_elements(Walk(empty, 0, len(empty), False))
    assert isinstance(read, VariableList)
    assert (read.first, read.count, read.blocks) == (0x02000080, 0, [[]])


@given(st.lists(OBJECTS, min_size=1, max_size=2), st.binary(min_size=9, max_size=9))
def test_what_stands_behind_the_end_is_never_looked_at(found: list[PlusObject], behind: bytes) -> None:
    """Eight octets are read at once where they are there: behind each end the same is passed over as where nothing follows."""
    octets = build_elements(list(found))
    bits = marks(frozenset((7,)), frozenset(), frozenset((9, 233)))
    for end in range(max(0, len(octets) - 60), len(octets) + 1):
        alone, followed = Cursor(octets[:end], 0, end), Cursor(octets[:end] + behind, 0, end)
        alone.noted = []
        followed.noted = []
        passed = alone.elements(bits)
        assert followed.elements(bits) == passed
        if passed:
            assert (alone.at, alone.spent, alone.seen) == (followed.at, followed.spent, followed.seen)
            assert alone.noted == followed.noted


@given(
    st.lists(st.tuples(st.sampled_from([1, 127, 128, 315, 16383, 16384, 2**31]), VALUES), max_size=5),
    st.binary(min_size=9, max_size=9),
)
def test_members_are_passed_over_as_one_by_one(members: list[tuple[int, Value]], behind: bytes) -> None:
    octets = b"".join([build_varint(id_, VLQ) + build_value(value) for id_, value in members]) + b"\0"
    for end in range(len(octets) + 1):
        several, single = Cursor(octets[:end] + behind, 0, end), Cursor(octets[:end], 0, end)
        passed = several.members(0, 0)
        while (id_ := single.number()) > 0:
            if not single.value(0, 1):
                id_ = -1
                break
        assert passed == (id_ == 0)
        if passed:
            assert (several.at, several.spent) == (single.at, single.spent)


@given(st.lists(PLAIN, max_size=5) | st.lists(PLAIN | VALUES, max_size=5), st.binary(max_size=9))
@example([Value(0, UDINT, 70000)] * 4, b"")
def test_plain_values_that_are_numbered_are_passed_over_at_once(values: list[Value], behind: bytes) -> None:
    octets = b"".join([bytes((index,)) + build_value(value) for index, value in enumerate(values, 1)])
    for end in range(len(octets) + 1):
        several, single = Cursor(octets[:end] + behind, 0, end), Cursor(octets[:end], 0, end)
        fewer = Cursor(octets[:end] + behind, 0, end)
        count = several.items()
        assert fewer.items(2) == min(2, count)
        for index in range(1, count + 1):
            assert single.number() == index
            assert single.value(0)
        assert (several.at, several.spent) == (single.at, single.spent)
        assert several.at <= end
