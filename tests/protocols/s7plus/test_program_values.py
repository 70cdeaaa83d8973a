"""Values as their declaration means them, and those that contradict it: octets stay, and the contradiction is said."""

from __future__ import annotations

import json
import struct
from typing import Final

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.meaning.report.plus import item_text
from dissect.protocols.s7plus.contents import VariableAddress
from dissect.protocols.s7plus.items import PlusItem
from dissect.protocols.s7plus.objects import PlusObject
from dissect.protocols.s7plus.packed_values import CLASSIC
from dissect.protocols.s7plus.program import AddressMeaning, Program
from dissect.protocols.s7plus.program_tables import DATATYPES
from dissect.protocols.s7plus.program_times import dtl_text, long_date_text, long_duration, long_time_of_day
from dissect.protocols.s7plus.program_values import DTL_STRUCT, contradiction, program_value, program_values
from dissect.protocols.s7plus.value_tables import (
    ARRAY,
    DINT,
    INT,
    STRUCT,
    TIMESPAN,
    TIMESTAMP,
    UDINT,
    UINT,
    ULINT,
    USINT,
    VALUE_TYPES,
)
from dissect.protocols.s7plus.values import Packed, Struct, Value, build_value
from dissect.protocols.s7plus.variables import Variable
from dissect.wire.text import shortened
from tests.protocols.s7plus.strategies import variables
from tests.protocols.s7plus.test_program import type_of

TANK: Final = 0x91000007
DB: Final = 0x92000003
NEW_YEAR: Final = struct.pack(">HBBBBBBI", 2024, 12, 31, 3, 23, 59, 58, 123456789)


def variable(
    lid: int, datatype: int, kind: int = 8, at: tuple[int, int] = (0, 0), numbers: tuple[int, ...] = (), bits: int = 0
) -> Variable:
    return Variable(lid, 0, datatype, kind << 12 | bits, 0, at[0], at[1], list(numbers))


def item_of(
    value: Value, *declared: tuple[str, Variable], types: tuple[PlusObject, ...] = (), lids: tuple[int, ...] = (1,)
) -> PlusItem:
    program = Program()
    program.learn([type_of(DB, *declared), *types])
    item = PlusItem(1, VariableAddress(0, 0x8A0E0003, 2550, list(lids)), value, 0)
    item.data = build_value(value)[2:]
    item.understand(program)
    json.dumps(item.json_value, allow_nan=False)
    return item


def packed(octets: bytes, id_: int = TANK, flags: int = 2) -> Value:
    return Value(0, STRUCT, Packed(id_, 5, flags, octets))


# ---- times ----------------------------------------------------------------------------------------------------------


def test_times_of_nanoseconds() -> None:
    assert long_duration(0) == "LT#0ns"
    assert long_duration(-90_061_002_003_004) == "LT#-1d1h1m1s2ms3us4ns"
    assert long_time_of_day(3_723_000_000_004) == "LTOD#01:02:03.000000004"
    assert long_time_of_day(86_400_000_000_000) is None
    assert (long_date_text(1_700_000_000_000_000_001) or "").startswith("LDT#2023-11-14T22:13:20.000000001")
    assert long_date_text(1 << 63) is None
    assert dtl_text(NEW_YEAR) == "DTL#2024-12-31-23:59:58.123456789"
    for at, octet in ((2, 13), (2, 0), (3, 32), (5, 24), (6, 60), (7, 60), (8, 0xFF)):
        assert dtl_text(NEW_YEAR[:at] + bytes((octet,)) + NEW_YEAR[at + 1 :]) is None


@pytest.mark.parametrize(
    ("datatype", "value", "text"),
    [
        (64, Value(0, TIMESPAN, 5), "LT#5ns"),
        (65, Value(0, ULINT, 5), "LTOD#00:00:00.000000005"),
        (66, Value(0, TIMESTAMP, 0), "LDT#1970-01-01T00:00:00.000000000Z"),
        (67, packed(NEW_YEAR, DTL_STRUCT), "DTL#2024-12-31-23:59:58.123456789"),
    ],
)
def test_long_times(datatype: int, value: Value, text: str) -> None:
    item = item_of(value, ("t", variable(1, datatype)))
    assert (item.json_value, item.note) == (text, "")
    assert repr(text) in item.text


def test_a_dtl_says_itself_what_it_is() -> None:
    item = PlusItem(1, VariableAddress(0, 0x8A0E0009, 2550, [1]), packed(NEW_YEAR, DTL_STRUCT), 0)
    item.understand(Program())
    assert item.json_value == "DTL#2024-12-31-23:59:58.123456789"
    item = PlusItem(1, VariableAddress(0, 0x8A0E0009, 2550, [1]), packed(bytes(12), DTL_STRUCT), 0)
    item.understand(Program())
    assert item.json_value == {"id": DTL_STRUCT, "time": 5, "octets": bytes(12).hex()}


# ---- structures of the program --------------------------------------------------------------------------------------

MISFIT: Final = "its bytes do not fit the declaration"

MEMBERS: Final = (
    ("open", variable(1, 1, 8, (0, 1), bits=3)),
    ("level", variable(2, 5, 8, (2, 4))),
    ("old", variable(3, 7, 1, (6, 4))),  # kind 1: the classic offset stands first
    ("name", variable(4, 19, 9, (3, 0), (8, 10))),
    ("history", variable(5, 5, 10, (0, 0), (14, 16, 0, 2))),
    ("inner", variable(6, 17, 12, (0, 0), (18, 20, 0x91000008, 0, 0, 0, 0))),
    ("when", variable(7, 67, 12, (0, 0), (20, 22, DTL_STRUCT, 0, 0, 0, 0))),
)
INNER: Final = (("real", variable(1, 8, 8, (32 - 18, 34 - 20))),)
OPTIMISED: Final = (
    b"\x08\0" + struct.pack(">hi", -5, 7) + b"\3\2HV\0\0" + struct.pack(">hh", 1, 2) + bytes(2) + NEW_YEAR
    + struct.pack(">f", 1.5)
)  # fmt: skip
WANTED: Final = {
    "open": True,
    "level": -5,
    "old": 7,
    "name": "HV",
    "history": [1, 2],
    "inner": {"real": 1.5},
    "when": "DTL#2024-12-31-23:59:58.123456789",
}


def tank(octets: bytes, flags: int = 2) -> PlusItem:
    types = (type_of(TANK, *MEMBERS), type_of(0x91000008, *INNER))
    declared = ("tank", variable(1, 17, 12, (0, 0), (0, 0, TANK, 0, 0, 0, 0)))
    return item_of(packed(octets, flags=flags), declared, types=types)


def test_members_at_their_optimised_offsets() -> None:
    item = tank(OPTIMISED)
    assert item.note == ""
    assert item.json_value == {"id": TANK, "time": 5, "octets": OPTIMISED.hex(), "members": WANTED}
    assert item_text(item).startswith('DB3."tank" = Struct {open: true, level: -5, old: 7')


def test_members_at_their_classic_offsets() -> None:
    octets = (
        b"\0\x08\0\0" + struct.pack(">hi", -5, 7) + b"\3\2HV\0\0" + struct.pack(">hh", 1, 2) + bytes(2) + NEW_YEAR
        + struct.pack(">f", 1.5)
    )  # fmt: skip
    value = tank(octets, CLASSIC).json_value
    assert isinstance(value, dict)
    assert value["members"] == WANTED


@pytest.mark.parametrize("size", [0, 1, 7, len(OPTIMISED) - 1])
def test_too_few_octets_contradict_the_declaration(size: int) -> None:
    item = tank(OPTIMISED[:size])
    octets = build_value(packed(OPTIMISED[:size]))[2:]
    assert (item.json_value, item.data) == (None, octets)
    assert item.note == f'{MISFIT}; its address is that of DB3."tank"'
    assert item_text(item).startswith(f"DB3 LID 1 = {octets[:16].hex(' ')}")


def test_a_string_inside_that_is_not_the_declared_one() -> None:
    for octets in (b"\2\2HV", b"\3\4HV"):
        item = tank(OPTIMISED.replace(b"\3\2HV", octets))
        assert (item.fits, item.note.partition(";")[0]) == (False, MISFIT)


def test_a_structure_whose_type_did_not_pass_keeps_its_octets_and_is_no_contradiction() -> None:
    declared = ("tank", variable(1, 17, 12, (0, 0), (0, 0, TANK, 0, 0, 0, 0)))
    item = item_of(packed(b"abc"), declared)
    assert (item.note, item.json_value) == ("", {"id": TANK, "time": 5, "octets": b"abc".hex()})
    other = item_of(packed(b"abc", 0x91000009), declared)
    assert other.note.startswith("declared as the structure 0x91000007, sent as 0x91000009; ")
    assert (other.label, other.json_value) == ("DB3 LID 1", None)


def test_structures_inside_each_other_without_end() -> None:
    types = (type_of(TANK, ("inner", variable(1, 17, 12, (0, 0), (0, 0, TANK, 0, 0, 0, 0)))),)
    item = item_of(packed(b"abc"), ("tank", variable(1, 17, 12, (0, 0), (0, 0, TANK, 0, 0, 0, 0))), types=types)
    assert item.json_value == {"id": TANK, "time": 5, "octets": b"abc".hex()}
    wide = (
        type_of(
            TANK,
            *[(f"a{n}", variable(n, 17, 13, (0, 0), (0, 0, 0, 2**32 - 1, 0, 1, TANK, 0, 0, 0, 0))) for n in range(9)],
        ),
    )
    assert item_of(packed(bytes(64)), ("tank", variable(1, 17, 12, (0, 0), (0, 0, TANK, 0, 0, 0, 0))), types=wide).value


@given(st.lists(variables(), max_size=6), st.binary(max_size=60), st.integers(0, 0x7FF))
def test_any_declaration_and_any_octets_raise_nothing(declared: list[Variable], octets: bytes, flags: int) -> None:
    pairs = [(f"v{number}", one) for number, one in enumerate(declared)]
    for one in declared:
        item = item_of(packed(octets, flags=flags), ("x", one), types=(type_of(TANK, *pairs),), lids=(one.lid,))
        item_text(item)
        one.index_text(3)


# ---- arrays, and what contradicts -----------------------------------------------------------------------------------


def test_an_array_as_it_was_declared() -> None:
    item = item_of(Value(ARRAY, DINT, [1500, -1]), ("t", variable(1, 11, 10, (0, 0), (0, 0, 0, 2))))
    assert (item.json_value, item.text) == (["T#1s500ms", "T#-1ms"], "Time[2] T#1s500ms, T#-1ms")
    ints = item_of(Value(ARRAY, INT, [1, 2]), ("t", variable(1, 5, 10, (0, 0), (0, 0, 0, 2))))
    assert (ints.json_value, ints.text, ints.note) == ([1, 2], "Int[2] 1, 2", "")


INTS: Final = variable(1, 5, 10, (0, 0), (0, 0, 0, 2))
TEXT: Final = variable(1, 19, 9, (4, 0), (0, 0))


@pytest.mark.parametrize(
    ("declared", "lids", "value", "note"),
    [
        (variable(1, 5), (1,), Value(0, DINT, 70000), "declared Int, sent as DInt"),
        (variable(1, 5), (1,), Value(ARRAY, INT, [1]), "declared Int, sent as an array"),
        (INTS, (1,), Value(0, INT, 1), "declared an array of Int, sent as one value"),
        (INTS, (1,), Value(ARRAY, INT, [1, 2, 3]), "declared with 2 elements, sent with 3"),
        (INTS, (1, 1), Value(ARRAY, INT, [1, 2]), "declared Int, sent as an array"),
        (INTS, (1, 1), Value(0, INT, 1), ""),
        (TEXT, (1,), Value(ARRAY, USINT, [4, 1, 65, 0, 0, 0]), ""),
        (
            TEXT,
            (1,),
            Value(ARRAY, USINT, [5, 1, 65, 0, 0, 0, 0]),
            "declared String[4], sent with 7 elements that do not fit it",
        ),
        (
            TEXT,
            (1,),
            Value(ARRAY, USINT, [4, 5, 65, 0, 0, 0]),
            "declared String[4], sent with 6 elements that do not fit it",
        ),
        (TEXT, (1,), Value(ARRAY, USINT, []), "declared String[4], sent with 0 elements that do not fit it"),
        (TEXT, (1,), Value(ARRAY, UINT, [4, 1, 65, 0, 0, 0]), "declared String, sent as UInt"),
        (TEXT, (1,), Value(0, USINT, 4), "declared String, sent as USInt without elements"),
        (variable(1, 14), (1,), Value(ARRAY, USINT, [1, 2]), "declared Date_And_Time, sent with 2 bytes"),
        (variable(1, 67), (1,), Value(0, INT, 5), "declared as a structure, sent as Int"),
        (variable(1, 67), (1,), Value(0, STRUCT, Struct(9, [])), ""),
        (variable(1, 147), (1,), Value(0, INT, 5), ""),  # how it is sent is not known
        (variable(1, 40, 10, (0, 0), (0, 0, 0, 3)), (1,), Value(ARRAY, 1, [True] * 8), ""),
    ],
)
def test_what_contradicts_its_declaration_is_said(
    declared: Variable, lids: tuple[int, ...], value: Value, note: str
) -> None:
    item = item_of(value, ("t", declared), lids=lids)
    assert item.data == build_value(value)[2:]
    assert item.fits == (not note)
    if note:
        assert item.note == f'{note}; its address is that of DB3."t"{"[1]" if len(lids) > 1 else ""}'
        assert (item.label, item.json_value) == (f"DB3 LID {'.'.join([str(lid) for lid in lids])}", None)
        said = item.data.hex(" ") or "(empty)"
        assert item_text(item) == f"{item.label} = {said} ({shortened(item.note, 100)})"
    else:
        assert (item.note, item.label.startswith('DB3."t"')) == ("", True)


def test_a_checksum_that_differs_is_said_with_the_item() -> None:
    program = Program()
    level = Variable(1, 0xAABBCCDD, 5, 0x8000, 0, 0, 0, [])
    program.learn([type_of(DB, ("level", level))])
    item = PlusItem(1, VariableAddress(0x11111111, 0x8A0E0003, 2550, [1]), Value(0, INT, 5), 0)
    item.understand(program)
    assert item_text(item) == (
        "DB3 LID 1 [CRC 0x11111111] = Int 5 (CRC 0xaabbccdd in the program that passed, which differs: no name)"
    )


@pytest.mark.parametrize(
    ("whole", "value", "texts"),
    [
        (True, Value(ARRAY, TIMESPAN, [5, 6]), ["LT#5ns", "LT#6ns"]),
        (False, Value(ARRAY, TIMESPAN, [5, 6]), None),
        (True, Value(0, TIMESPAN, 5), None),
        (True, Value(0, TIMESPAN, [5, 6]), None),
        (False, Value(0, TIMESPAN, 5), None),
    ],
)
def test_elements_are_read_only_of_a_whole_array_that_was_sent_as_one(
    whole: bool, value: Value, texts: list[str] | None
) -> None:
    assert program_values(AddressMeaning("times", variable(1, 64), whole), value) == texts


#: How the message says values of the declared types of one element.
SENT: Final[dict[str, str]] = {
    "Bool": "Bool", "BBOOL": "Bool", "Byte": "Byte", "Word": "Word", "DWord": "DWord", "LWord": "LWord", "Char": "USInt",
    "SInt": "SInt", "USInt": "USInt", "Int": "Int", "UInt": "UInt", "DInt": "DInt", "UDInt": "UDInt", "LInt": "LInt",
    "ULInt": "ULInt", "Real": "Real", "LReal": "LReal", "Date": "UInt", "Time_Of_Day": "UDInt",
    "Time": "DInt", "S5Time": "Word", "WChar": "UInt",
    "LTime": "Timespan", "LTOD": "ULInt", "LDT": "Timestamp",
}  # fmt: skip


def test_a_value_contradicts_its_declaration_unless_it_is_sent_as_that() -> None:
    """Each declared type with each of the types of a message: one fits."""
    datatypes = {row.name: row.number for row in DATATYPES}
    types = {row.name: row.number for row in VALUE_TYPES}
    assert set(SENT.values()) <= types.keys()
    for declared, sent in SENT.items():
        found = AddressMeaning("x", variable(1, datatypes[declared]), False)
        for name in {*SENT.values()}:
            said = contradiction(found, Value(0, types[name], 1), Program())
            assert said == ("" if name == sent else f"declared {declared}, sent as {name}"), (declared, name)
    unknown = AddressMeaning("x", variable(1, datatypes["Variant"]), False)
    assert contradiction(unknown, Value(0, types["Int"], 1), Program()) == ""


def declared(datatype: str, kind: int = 8, numbers: tuple[int, ...] = (), most: int = 0) -> Variable:
    return variable(1, {row.name: row.number for row in DATATYPES}[datatype], kind, (most, 0), numbers)


def said_against(found: Variable | None, value: Value, whole: bool = False, program: Program | None = None) -> str:
    return contradiction(AddressMeaning("x", found, whole), value, program or Program())


@pytest.mark.parametrize(
    ("one", "value", "text"),
    [
        (declared("DTL"), packed(NEW_YEAR, DTL_STRUCT), ""),
        (declared("DTL"), packed(NEW_YEAR, 0x91000009), "declared as the structure 0x02000043, sent as 0x91000009"),
        (declared("DTL"), Value(0, ULINT, 5), "declared as a structure, sent as ULInt"),
        (declared("DTL", 12, (0, 0, TANK, 0, 0, 0, 0)), packed(b"a", TANK), ""),
        (
            declared("DTL", 12, (0, 0, TANK, 0, 0, 0, 0)),
            packed(NEW_YEAR, DTL_STRUCT),
            "declared as the structure 0x91000007, sent as 0x02000043",
        ),
        (declared("Struct", 12, (0, 0, TANK, 0, 0, 0, 0)), packed(b"a", TANK), ""),
        (
            declared("Struct", 12, (0, 0, TANK, 0, 0, 0, 0)),
            packed(b"a", 0x91000009),
            "declared as the structure 0x91000007, sent as 0x91000009",
        ),
        (declared("Struct", 12, (0, 0, TANK, 0, 0, 0, 0)), Value(0, STRUCT, Struct(9, [])), ""),
        (declared("Struct", 12, (0, 0, TANK, 0, 0, 0, 0)), Value(0, INT, 5), "declared as a structure, sent as Int"),
        (declared("Struct"), Value(0, INT, 5), ""),  # how one without a type is sent is not known
        (None, Value(0, INT, 5), ""),
    ],
)
def test_a_structure_is_sent_as_the_declared_one(one: Variable | None, value: Value, text: str) -> None:
    assert said_against(one, value) == text


def test_a_structure_of_another_type_that_passed_is_no_contradiction() -> None:
    """Its members can be read, and a type may have several ids."""
    program = Program()
    program.learn([type_of(0x91000009, ("a", variable(1, 5)))])
    one = declared("Struct", 12, (0, 0, TANK, 0, 0, 0, 0))
    assert said_against(one, packed(b"\0\1", 0x91000009), program=program) == ""


SPARSE: Final = 0x40


@pytest.mark.parametrize(
    ("whole", "value", "text"),
    [
        (False, Value(0, INT, 5), ""),
        (True, Value(ARRAY, INT, [5, 6]), ""),
        (True, Value(SPARSE, INT, [(1, 5)]), ""),
        (True, Value(SPARSE, INT, [(1, 5), (2, 6), (3, 7)]), ""),
        (True, Value(ARRAY, INT, [5]), "declared with 2 elements, sent with 1"),
        (True, Value(ARRAY, INT, []), "declared with 2 elements, sent with 0"),
        (True, Value(0, INT, 5), "declared an array of Int, sent as one value"),
        (False, Value(ARRAY, INT, [5, 6]), "declared Int, sent as an array"),
        (False, Value(SPARSE, INT, [(1, 5)]), "declared Int, sent as an array"),
        (True, Value(ARRAY, UINT, [5, 6]), "declared Int, sent as UInt"),
    ],
)
def test_an_array_is_sent_with_its_elements(whole: bool, value: Value, text: str) -> None:
    assert said_against(declared("Int", 10, (0, 0, 0, 2)), value, whole) == text


def test_an_array_of_bits_is_sent_with_any_number() -> None:
    for datatype in ("Bool", "BBOOL"):
        one = declared(datatype, 10, (0, 0, 0, 3))
        for count in (0, 3, 8):
            assert said_against(one, Value(ARRAY, 1, [True] * count), True) == ""
        assert said_against(one, Value(ARRAY, USINT, [1]), True) == f"declared {datatype}, sent as USInt"


@pytest.mark.parametrize(
    ("one", "value", "text"),
    [
        (declared("String", 9, (0, 0), 4), Value(ARRAY, USINT, [4, 4, 1, 2, 3, 4]), ""),
        (declared("String", 9, (0, 0), 4), Value(ARRAY, USINT, [4, 0, 1, 2, 3, 4]), ""),
        (declared("String", 9, (0, 0), 4), Value(ARRAY, USINT, [4, 5, 1, 2, 3, 4]), "String[4], sent with 6 elements"),
        (
            declared("String", 9, (0, 0), 4),
            Value(ARRAY, USINT, [5, 0, 1, 2, 3, 4, 5]),
            "String[4], sent with 7 elements",
        ),
        (declared("String", 9, (0, 0), 4), Value(ARRAY, USINT, [4, 0, 1, 2, 3]), "String[4], sent with 5 elements"),
        (declared("String", 9, (0, 0)), Value(ARRAY, USINT, [5, 0, 1, 2, 3, 4, 5]), ""),
        (declared("String", 9, (0, 0)), Value(ARRAY, USINT, [0, 0]), ""),
        (declared("String", 9, (0, 0)), Value(ARRAY, USINT, [0]), "String, sent with 1 elements"),
        (declared("String", 9, (0, 0)), Value(ARRAY, USINT, [4, 0]), "String, sent with 2 elements"),
        (declared("WString", 9, (0, 0), 2), Value(ARRAY, UINT, [2, 2, 1, 2]), ""),
        (declared("WString", 9, (0, 0), 2), Value(ARRAY, UINT, [2, 3, 1, 2]), "WString[2], sent with 4 elements"),
    ],
)
def test_a_text_is_sent_with_its_maximum_and_its_length(one: Variable, value: Value, text: str) -> None:
    wanted = f"declared {text} that do not fit it" if text else ""
    assert said_against(one, value) == wanted


@pytest.mark.parametrize(
    ("datatype", "value", "text"),
    [
        ("String", Value(ARRAY, UINT, [0, 0]), "declared String, sent as UInt"),
        ("String", Value(0, USINT, 4), "declared String, sent as USInt without elements"),
        ("String", Value(SPARSE, USINT, [(1, 4)]), "declared String, sent as USInt without elements"),
        ("WString", Value(ARRAY, USINT, [0, 0]), "declared WString, sent as USInt"),
        ("Date_And_Time", Value(ARRAY, USINT, [1] * 8), ""),
        ("Date_And_Time", Value(ARRAY, USINT, [1] * 7), "declared Date_And_Time, sent with 7 bytes"),
        ("Date_And_Time", Value(ARRAY, USINT, [1] * 9), "declared Date_And_Time, sent with 9 bytes"),
        ("Date_And_Time", Value(0, TIMESTAMP, 1), "declared Date_And_Time, sent as Timestamp without elements"),
    ],
)
def test_what_is_sent_as_an_array_has_elements(datatype: str, value: Value, text: str) -> None:
    assert said_against(declared(datatype, 9, (0, 0)), value) == text


def test_several_texts_in_an_array_are_not_judged() -> None:
    one = declared("String", 10, (0, 0, 0, 2), 4)
    assert said_against(one, Value(ARRAY, USINT, [1, 2, 3]), True) == ""
    assert said_against(one, Value(ARRAY, UINT, [1, 2, 3]), True) == "declared String, sent as UInt"


@pytest.mark.parametrize(
    ("one", "whole", "value", "text"),
    [
        (declared("Time"), False, Value(0, DINT, -1500), "T#-1s500ms"),
        (declared("Time"), False, Value(0, DINT, True), "T#1ms"),
        (declared("Int"), False, Value(0, INT, 5), None),
        (declared("Char"), False, Value(0, USINT, 0x41), "A"),
        (declared("Date"), False, Value(0, UINT, 1), "D#1990-01-02"),
        (declared("String", 9, (0, 0), 4), False, Value(ARRAY, USINT, [4, 2, 72, 0xE4, 9, 9]), "Hä"),
        (declared("String", 9, (0, 0), 4), False, Value(ARRAY, USINT, [4, 0, 72, 86, 9, 9]), ""),
        (declared("WString", 9, (0, 0), 4), False, Value(ARRAY, UINT, [4, 2, 0xD800, 0x48, 9, 9]), "\ufffdH"),
        (declared("Date_And_Time"), False, Value(ARRAY, USINT, [1] * 7), None),
        (declared("Time", 10, (0, 0, 0, 2)), True, Value(ARRAY, DINT, [1, 2]), None),
        (None, False, Value(0, INT, 5), None),
    ],
)
def test_a_value_has_the_text_of_its_declaration(
    one: Variable | None, whole: bool, value: Value, text: str | None
) -> None:
    assert program_value(AddressMeaning("x", one, whole), value) == text
    assert program_value(None, value) is None


def test_a_dtl_is_known_by_its_structure_and_its_size() -> None:
    content = packed(NEW_YEAR, DTL_STRUCT)
    assert program_value(None, content) == "DTL#2024-12-31-23:59:58.123456789"
    for other in (packed(NEW_YEAR, TANK), packed(NEW_YEAR[:-1], DTL_STRUCT), packed(NEW_YEAR + b"\0", DTL_STRUCT)):
        assert program_value(None, other) is None


@pytest.mark.parametrize(
    ("datatype", "value", "texts"),
    [
        ("Time", Value(ARRAY, DINT, [1, -1500]), ["T#1ms", "T#-1s500ms"]),
        ("Time", Value(ARRAY, UDINT, [1]), None),
        ("Time", Value(0x40, DINT, [(1, 5)]), None),
        ("Int", Value(ARRAY, INT, [1]), None),
        ("LTOD", Value(ARRAY, ULINT, [5, 2**63]), ["LTOD#00:00:00.000000005", None]),
    ],
)
def test_the_elements_of_an_array_have_texts(datatype: str, value: Value, texts: list[str | None] | None) -> None:
    found = AddressMeaning("x", declared(datatype, 10, (0, 0, 0, 2)), True)
    assert program_values(found, value) == texts
    assert program_values(None, value) is None
    assert program_values(AddressMeaning("x", None, True), value) is None
