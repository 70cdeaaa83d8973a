"""What is passed over is what reading finds sound, and reading it later gives the same."""

from __future__ import annotations

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from dissect.s7plus.layouts import VALUE
from dissect.s7plus.objects import build_elements, read_elements
from dissect.s7plus.skipping import Skipper, pass_names, pass_variables
from dissect.s7plus.value_reading import read_value
from dissect.s7plus.value_tables import VALUE_TYPES
from dissect.s7plus.values import build_value
from dissect.s7plus.variables import NameList, Variable, VariableList, build_names, build_variables
from dissect.s7plus.walk import FormatError, Walk
from tests.s7plus.strategies import OBJECTS, VALUES

_VARIABLES = VariableList(
    7, [[Variable(9, 1, 5, 0x8AC0, 0, 2, 4, [])], [Variable(10, 2, 19, 0x9AC0, 0, 254, 6, [8, 6])]]
)
_NAMES = NameList([[b"level", b""], [b"name"]])


def check(octets: bytes, end: int) -> bool:
    """Hold a value that is passed over to its reading: the same end, the same work, no fault."""
    skipper = Skipper(octets, 0, end)
    if not skipper.value(0):
        return False
    walk = Walk(octets, 0, end, False)
    budget = walk.budget
    read_value(walk, VALUE, 0)  # raises where it finds a fault
    assert (walk.at, budget - walk.budget, walk.faults, walk.blobs) == (skipper.at, skipper.spent, [], [])
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


@pytest.mark.parametrize("type_", [code.number for code in VALUE_TYPES])
@pytest.mark.parametrize("flags", [0x00, 0x10, 0x20, 0x40])
def test_most_types_are_passed_over(flags: int, type_: int) -> None:
    """One element of zeros, or one of key 1, or a structure without members."""
    octets = bytes((flags, type_)) + (b"\x01" if flags else b"") + bytes(12)
    passed = Skipper(octets, 0, len(octets)).value(0)
    name = VALUE_TYPES.name(type_)
    assert passed == (
        name != "Variant" and (flags == 0 or name != "Struct") and (flags not in {0x10, 0x20} or name != "Null")
    )


@given(OBJECTS)
def test_objects_are_the_same_read_at_once_and_later(found: object) -> None:
    octets = build_elements([found])  # type: ignore[list-item]
    later = read_elements(Walk(octets, 0, len(octets), False))
    assert build_elements(later) == octets
    assert build_elements(read_elements(Walk(octets, 0, len(octets), True))) == octets


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
