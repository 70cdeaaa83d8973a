from __future__ import annotations

import pytest

from dissect.protocols.s7plus.contents import VariableAddress
from dissect.protocols.s7plus.objects import Element, PlusObject
from dissect.protocols.s7plus.program import MAX_VARIABLES, Program, symbol
from dissect.protocols.s7plus.variables import NameList, Variable, VariableList

ACTUAL = 2550


def variable(lid: int, datatype: int = 5, kind: int = 8, crc: int = 0, numbers: tuple[int, ...] = ()) -> Variable:
    return Variable(lid, crc, datatype, kind << 12, 0, 0, 0, list(numbers))


def type_of(rid: int, *pairs: tuple[str, Variable]) -> PlusObject:
    lists: list[Element] = [
        VariableList(0, [[one for _, one in pairs]]),
        NameList([[name.encode() for name, _ in pairs]]),
    ]
    return PlusObject(rid, 511, 0, 0, 0, lists)


TANK = type_of(
    0x92000003,
    ("level", variable(9, crc=0xAABBCCDD)),
    ("valve", variable(10, 17, 12, numbers=(0, 0, 0x91000007, 0, 0, 0, 0))),
    ("history", variable(11, 5, 10, numbers=(0, 0, 0xFFFFFFFE, 8))),
    ("pump", variable(12, 17, 12, numbers=(0, 0, 0x91000099, 0, 0, 0, 0))),
)
VALVE = type_of(
    0x91000007, ("open", variable(1, 1)), ("inner", variable(2, 17, 5, numbers=(0, 0, 0x91000007, 0, 0, 0, 0)))
)
TAGS = type_of(0x90030000, ("lamp", variable(20, 1)))


def named(address: VariableAddress) -> str:
    program = Program()
    program.learn([PlusObject(3, 2520, 0, 0, 0, [TANK, VALVE]), TANK, VALVE, TAGS])
    found = program.find(address)
    return symbol(address, found) if found is not None else ""


@pytest.mark.parametrize(
    ("address", "name"),
    [
        (VariableAddress(0, 0x8A0E0003, ACTUAL, [9]), 'DB3."level"'),
        (VariableAddress(0xAABBCCDD, 0x8A0E0003, ACTUAL, [9]), 'DB3."level"'),
        (VariableAddress(0xAABBCCDE, 0x8A0E0003, ACTUAL, [9]), ""),  # the program has changed: the name is not used
        (VariableAddress(0, 0x8A0E0003, ACTUAL, [10, 1]), 'DB3."valve".open'),
        (VariableAddress(0, 0x8A0E0003, ACTUAL, [10, 2, 2, 1]), 'DB3."valve".inner.inner.open'),
        (VariableAddress(0, 0x8A0E0003, ACTUAL, [10, 7]), 'DB3."valve" LID 7'),
        (VariableAddress(0, 0x8A0E0003, ACTUAL, [11, 3]), 'DB3."history"[1]'),
        (VariableAddress(0, 0x8A0E0003, ACTUAL, [12, 1]), 'DB3."pump" LID 1'),
        (VariableAddress(0, 0x8A0E0003, ACTUAL, [13]), ""),
        (VariableAddress(0, 0x8A0E0003, ACTUAL, []), ""),
        (VariableAddress(0, 0x8A0E0004, ACTUAL, [9]), ""),
        (VariableAddress(0, 82, 3736, [20]), 'M."lamp"'),
        (VariableAddress(0, 81, 3736, [20]), ""),
        (VariableAddress(0, 52, 2167, [20]), ""),
    ],
)
def test_names(address: VariableAddress, name: str) -> None:
    assert named(address) == name


def test_a_type_that_is_sent_again_replaces_the_one_before() -> None:
    program = Program()
    address = VariableAddress(0, 0x8A0E0003, ACTUAL, [9])
    program.learn([TANK])
    program.learn([type_of(0x92000003, ("height", variable(9)))])
    found = program.find(address)
    assert found is not None
    assert found.path == '"height"'


def test_lists_that_contradict_each_other_are_left_out() -> None:
    program = Program()
    lists: list[Element] = [VariableList(0, [[variable(9)]]), NameList([[b"a", b"b"]])]
    program.learn([PlusObject(0x92000003, 511, 0, 0, 0, lists), PlusObject(0x92000003, 511, 0, 0, 0, [])])
    assert program.find(VariableAddress(0, 0x8A0E0003, ACTUAL, [9])) is None


def test_a_type_that_contradicts_itself_hides_no_other() -> None:
    program = Program()
    lists: list[Element] = [VariableList(0, [[variable(9)]]), NameList([[b"a", b"b"]])]
    program.learn([PlusObject(0x92000001, 511, 0, 0, 0, lists), PlusObject(1, 287, 0, 0, 0, []), TANK])
    assert program.count == 4
    program.learn([PlusObject(TANK.rid, 511, 0, 0, 0, [VariableList(0, []), NameList([])])])
    assert program.count == 4  # a description without variables does not replace one that has some


def test_what_is_remembered_is_bounded() -> None:
    program = Program()
    each = MAX_VARIABLES // 4
    for number in range(1, 8):
        program.learn([type_of(0x92000000 | number, *[(f"v{lid}", variable(lid)) for lid in range(1, each + 1)])])
    kept = [
        number
        for number in range(1, 8)
        if program.find(VariableAddress(0, 0x8A0E0000 | number, ACTUAL, [1])) is not None
    ]
    assert kept == [4, 5, 6, 7]


def test_a_type_that_is_larger_than_the_bound_is_remembered_alone() -> None:
    """The latest is always kept: what it says of its variables is read, and everything else is forgotten."""
    program = Program()
    program.learn([type_of(0x92000001, ("first", variable(1)))])
    program.learn([type_of(0x92000002, *[("v", variable(lid)) for lid in range(1, MAX_VARIABLES + 2)])])
    found = [program.find(VariableAddress(0, 0x8A0E0000 | number, ACTUAL, [1])) is not None for number in (1, 2)]
    assert (found, program.count) == ([False, True], MAX_VARIABLES + 1)


# ---- arrays, structures inside arrays, strings -----------------------------------------------------------------------

MATRIX = (0, 0, 0, 6, *(1, 0xFFFFFFFF, 0, 0, 0, 0), *(3, 2, 0, 0, 0, 0))  # [-1..0, 1..3]: the last index counts fastest
LINE = type_of(
    0x92000004,
    ("matrix", variable(1, 5, 11, numbers=MATRIX)),
    ("valves", variable(2, 17, 13, numbers=(0, 0, 1, 4, 8, 6, 0x91000007, 0, 0, 0, 0))),
    ("field", variable(3, 17, 14, numbers=(*MATRIX, 8, 6, 0x91000007, 0, 0, 0, 0))),
    ("motors", variable(4, 17, 0, numbers=(0, 0, 0x91000007, *[0] * 6, 2, 0, 0, 0, *(5, *[0] * 5), *(2, *[0] * 5)))),
    ("pump", variable(5, 17, 15, numbers=(0, 0, 0x91000007, *[0] * 6))),
    ("title", variable(6, 19, 9, numbers=(0, 0))),
    ("bits", variable(7, 40, 11, numbers=MATRIX)),
)


@pytest.mark.parametrize(
    ("lids", "path"),
    [
        ([1], '"matrix"'),
        ([1, 0], '"matrix"[-1,1]'),
        ([1, 2], '"matrix"[-1,3]'),
        ([1, 3], '"matrix"[0,1]'),
        ([1, 5], '"matrix"[0,3]'),
        ([1, 6], '"matrix" LID 6'),
        ([1, 0, 1, 2], '"matrix"[-1,1] LID 1.2'),  # only a structure has a number between index and member
        ([2, 3], '"valves"[4]'),
        ([2, 3, 1, 1], '"valves"[4].open'),
        ([2, 3, 1, 2, 1], '"valves"[4].inner.open'),
        ([2, 3, 1], '"valves"[4].open'),  # where the number between index and member is left out
        ([2, 4, 1, 1], '"valves" LID 4.1.1'),
        ([3, 4, 1, 1], '"field"[0,2].open'),
        ([4, 1, 1, 1], '"motors"[6].open'),
        ([5, 1], '"pump".open'),
        ([6], '"title"'),
        ([6, 0, 256], '"title"'),
        ([6, 2, 4], '"title" LID 2.4'),
        ([7, 2], '"bits"[-1,3]'),
        ([7, 3], '"bits" LID 3'),  # a row of bits fills its byte
        ([7, 8], '"bits"[0,1]'),
        ([7, 16], '"bits" LID 16'),
    ],
)
def test_elements_and_members(lids: list[int], path: str) -> None:
    program = Program()
    program.learn([LINE, VALVE])
    found = program.find(VariableAddress(0, 0x8A0E0004, ACTUAL, lids))
    assert found is not None
    assert found.path == path
    assert (found.variable is None) == (" LID " in path)
    assert found.whole_array == (lids == [1])


def test_a_checksum_that_differs_is_told() -> None:
    program = Program()
    program.learn([TANK])
    wrong = VariableAddress(0xAABBCCDE, 0x8A0E0003, ACTUAL, [9])
    assert program.find(wrong) is None
    assert program.doubt(wrong) == "CRC 0xaabbccdd in the program that passed, which differs: no name"
    for address in (
        VariableAddress(0xAABBCCDD, 0x8A0E0003, ACTUAL, [9]),
        VariableAddress(7, 0x8A0E0004, ACTUAL, [9]),
        VariableAddress(7, 52, 7, []),
    ):
        assert program.doubt(address) == ""


NO_BOUNDS = (0, 0, 0, 6, *[0] * 12)
BBOOL = 40


@pytest.mark.parametrize(
    "declared",
    [variable(7, 5), variable(7, 5, 11, numbers=NO_BOUNDS), variable(7, BBOOL, 11, numbers=NO_BOUNDS)],
    ids=["a number", "an array without a dimension", "bits without a dimension"],
)
@pytest.mark.parametrize("lids", [[7, 0], [7, 3], [7, 0, 1]])
def test_an_element_of_what_is_no_array_has_no_index(declared: Variable, lids: list[int]) -> None:
    """The address goes on where the declaration ends: its numbers stay, and no brackets are made up."""
    program = Program()
    program.learn([type_of(0x92000004, ("one", declared))])
    found = program.find(VariableAddress(0, 0x8A0E0004, ACTUAL, lids))
    assert found is not None
    assert (found.path, found.variable) == (f'"one" LID {".".join(map(str, lids[1:]))}', None)
    assert declared.index_text(lids[1]) == ""


def test_members_of_structures_are_listed_and_those_of_elements_are_not() -> None:
    """An address of an element needs its index, which a list of variables does not have."""
    program = Program()
    program.learn([LINE, VALVE])
    listed = [one.name for one in program.symbols()]
    assert 'DB4."pump".open' in listed
    assert 'DB4."valves"' in listed
    assert [name for name in listed if name.startswith(('DB4."valves".', 'DB4."field".', 'DB4."motors".'))] == []


# ---- what is remembered ----------------------------------------------------------------------------------------------


def test_variables_are_counted_as_types_come_and_go() -> None:
    program, other = Program(), Program()
    program.learn([TANK, VALVE])
    assert program.count == 6
    program.learn([type_of(0x92000003, ("level", variable(9)))])
    assert program.count == 3
    other.learn([TANK, TAGS])
    program.adopt(other)
    assert program.count == 4  # what it knows stays as it is
    lamp, valve = VariableAddress(0, 82, 3736, [20]), VariableAddress(0, 0x8A0E0003, ACTUAL, [10, 1])
    assert (program.find(lamp) is None, program.find(valve) is None) == (False, True)
    program.adopt(other)
    assert (program.count, other.count) == (4, 5)


def test_each_change_sets_a_number_of_its_own() -> None:
    one, other = Program(), Program()
    assert (one.stamp, other.stamp) == (0, 0)
    seen = []
    for program, told in ((one, TANK), (other, TANK), (one, VALVE), (one, TANK)):
        program.learn([told])
        seen.append(program.stamp)
    one.learn([PlusObject(3, 2520, 0, 0, 0, [TAGS])])  # no type, whatever is in it
    one.learn([])
    one.adopt(other)
    assert one.stamp == seen[-1]
    other.adopt(one)
    seen.append(other.stamp)
    assert len(set(seen)) == len(seen)
    assert min(seen) > 0


def test_the_meaning_of_an_address_follows_the_types() -> None:
    """What was found, or not found, is sought again when a type has come, has changed or has gone."""
    program = Program()
    address, tag = VariableAddress(0, 0x8A0E0003, ACTUAL, [9]), VariableAddress(0, 82, 3736, [20])
    for told, path in (
        ([VALVE], None),
        ([TANK], '"level"'),
        ([type_of(0x92000003, ("height", variable(9)))], '"height"'),
        ([type_of(0x92000003, ("height", variable(10)))], None),
    ):
        program.learn(told)
        found = program.find(address)
        assert (found.path if found is not None else None) == path
    assert program.find(tag) is None
    program.learn([TAGS])
    assert program.find(tag) is not None


def test_a_type_is_that_of_its_block_or_area() -> None:
    """A block has the number of its type, and an area its place in the order of I, Q, M, C and T."""
    areas = {1: 80, 2: 81, 3: 82, 4: 83, 5: 84}
    program = Program()
    program.learn([type_of(0x90000000 | place << 16, (f"a{area}", variable(20))) for place, area in areas.items()])
    program.learn([type_of(kind << 24 | 3, ("other", variable(20))) for kind in (0x91, 0x93, 0x94, 0x95)])
    for area, letter in ((80, "I"), (81, "Q"), (82, "M"), (83, "C"), (84, "T")):
        address = VariableAddress(0, area, 3736, [20])
        found = program.find(address)
        assert found is not None
        assert symbol(address, found) == f'{letter}."a{area}"'
    for area in (79, 85, 0x8A0E0003, 0x8A120003, 0x8A0E0000):
        assert program.find(VariableAddress(0, area, ACTUAL, [20])) is None
    program.learn([type_of(0x92000003, ("block", variable(20)))])
    assert program.find(VariableAddress(0, 0x8A0E0003, ACTUAL, [20])) is not None
    assert program.find(VariableAddress(0, 0x8A120003, ACTUAL, [20])) is None
    assert Program().find(VariableAddress(0, 82, 3736, [20])) is None


def test_variables_are_listed_with_their_addresses() -> None:
    program = Program()
    program.learn([TAGS, TANK, VALVE, type_of(0x93000001, ("fb", variable(1)))])
    listed = [(one.name, one.address, one.declared) for one in program.symbols()]
    assert listed[:4] == [
        ('M."lamp"', "M LID 20", "Bool"),
        ('DB3."level"', "DB3 LID 9", "Int"),
        ('DB3."valve"', "DB3 LID 10", "Struct"),
        ('DB3."valve".open', "DB3 LID 10.1", "Bool"),
    ]
    assert listed[4] == ('DB3."valve".inner', "DB3 LID 10.2", "Struct")
    assert listed[-2:] == [
        ('DB3."history"', "DB3 LID 11", "Array[-2..5] of Int"),
        ('DB3."pump"', "DB3 LID 12", "Struct"),
    ]


def test_structures_inside_each_other_are_listed_to_a_depth() -> None:
    program = Program()
    program.learn([type_of(0x92000001, ("a", variable(1, 17, 12, numbers=(0, 0, 0x91000007, 0, 0, 0, 0)))), VALVE])
    names = [one.name for one in program.symbols()]
    deepest = 'DB1."a"' + ".inner" * 7
    assert f"{deepest}.open" in names
    assert f"{deepest}.inner" in names
    assert f"{deepest}.inner.open" not in names
    assert len(names) == 1 + 8 * 2


def test_bounds_of_several_dimensions_are_in_the_order_of_the_program() -> None:
    program = Program()
    program.learn([LINE])
    declared = {one.name: one.declared for one in program.symbols()}
    assert declared['DB4."matrix"'] == "Array[-1..0,1..3] of Int"
    assert declared['DB4."valves"'] == "Array[1..4] of Struct"
    assert declared['DB4."title"'] == "String"


def test_an_array_inside_an_element_has_its_own_index() -> None:
    inner = type_of(0x91000009, ("list", variable(1, 5, 10, numbers=(0, 0, 0, 4))))
    outer = type_of(0x92000006, ("rows", variable(1, 17, 13, numbers=(0, 0, 0, 4, 8, 6, 0x91000009, 0, 0, 0, 0))))
    program = Program()
    program.learn([outer, inner])
    for lids, path, whole in (
        ([1, 2, 1, 1], '"rows"[2].list', True),
        ([1, 2, 1, 1, 3], '"rows"[2].list[3]', False),
        ([1, 2, 1, 1, 4], '"rows"[2].list LID 4', False),
        ([1, 2], '"rows"[2]', False),
        ([1], '"rows"', True),
    ):
        found = program.find(VariableAddress(0, 0x8A0E0006, ACTUAL, lids))
        assert found is not None
        assert (found.path, found.whole_array) == (path, whole)


@pytest.mark.parametrize(
    ("declared", "sent", "lids", "same"),
    [
        (0xAA, 0xAA, [9], True),
        (0xAA, 0xAB, [9], False),
        (0, 0xAB, [9], True),
        (0xAA, 0, [9], True),
        (0xAA, 0xAB, [9, 1], True),  # of members the rule is not known
    ],
)
def test_a_checksum_differs_only_where_there_are_two(declared: int, sent: int, lids: list[int], same: bool) -> None:
    program = Program()
    program.learn([type_of(0x92000003, ("level", variable(9, crc=declared)))])
    address = VariableAddress(sent, 0x8A0E0003, ACTUAL, lids)
    assert (program.find(address) is not None) == same
    assert bool(program.doubt(address)) == (not same)
    assert Program().doubt(address) == ""


def test_the_members_of_a_type_are_in_their_order() -> None:
    program = Program()
    program.learn([VALVE])
    assert [name for name, _ in program.members(0x91000007) or []] == ["open", "inner"]
    assert program.members(0x91000008) is None
