"""Structures of the program, read from their octets: each type at its place, and what is not known or does not fit."""

from __future__ import annotations

import struct
from itertools import pairwise
from typing import Final

import pytest

from dissect.protocols.s7plus.objects import PlusObject
from dissect.protocols.s7plus.packed_values import CLASSIC, misfit, packed_members
from dissect.protocols.s7plus.program import Program
from dissect.protocols.s7plus.program_tables import DATATYPES
from dissect.protocols.s7plus.program_values import DTL_STRUCT
from dissect.protocols.s7plus.values import Packed
from dissect.protocols.s7plus.variables import Variable
from tests.protocols.s7plus.test_program import type_of

TANK: Final = 0x91000007
INNER: Final = 0x91000008
DATATYPE: Final = {row.name: row.number for row in DATATYPES}
NEW_YEAR: Final = struct.pack(">HBBBBBBI", 2024, 12, 31, 3, 23, 59, 58, 123456789)
#: What `read` says of octets that contradict the declaration, and of those of which it is unknown how to read them.
MISFIT: Final = (None, True)
UNKNOWN: Final = (None, False)


def plain(datatype: str, at: int = 0, bits: int = 0) -> Variable:
    """A variable at an offset, in both layouts."""
    return Variable(1, 0, DATATYPE[datatype], 0x8000 | bits, 0, at, at, [])


def text(datatype: str, most: int = 0) -> Variable:
    return Variable(1, 0, DATATYPE[datatype], 0x9000, 0, most, 0, [0, 0])


def array(datatype: str, count: int, most: int = 0) -> Variable:
    return Variable(1, 0, DATATYPE[datatype], 0xA000, 0, most, 0, [0, 0, 0, count])


def structure(type_id: int, datatype: str = "Struct") -> Variable:
    return Variable(1, 0, DATATYPE[datatype], 0xC000, 0, 0, 0, [0, 0, type_id, 0, 0, 0, 0])


def read(octets: bytes, *declared: Variable, flags: int = 2, types: tuple[PlusObject, ...] = ()) -> tuple[object, bool]:
    """Give the members, or the only one of them, and whether the octets contradict the declaration."""
    program = Program()
    for lid, one in enumerate(declared, 1):
        one.lid = lid
    program.learn([type_of(TANK, *[(f"v{one.lid}", one) for one in declared]), *types])
    packed = Packed(TANK, 5, flags, octets)
    found = packed_members(packed, program)
    said = found["v1"] if found is not None and len(declared) == 1 else found
    return said, misfit(packed, program)


@pytest.mark.parametrize(
    ("datatype", "octets", "member"),
    [
        ("Byte", "ff", 255),
        ("Char", "41", "A"),
        ("Word", "fffe", 0xFFFE),
        ("Int", "fffe", -2),
        ("DWord", "fffffffe", 0xFFFFFFFE),
        ("DInt", "fffffffe", -2),
        ("Real", "3dcccccd", 0.1),
        ("Real", "7f800000", "inf"),
        ("Real", "7fc00000", "nan"),
        ("Date", "0001", "D#1990-01-02"),
        ("Time_Of_Day", "0038cefc", "TOD#01:02:03.004"),
        ("Time", "fffffa24", "T#-1s500ms"),
        ("S5Time", "2150", "S5T#2m30s"),
        ("Date_And_Time", "1410251329301417", "DT#2014-10-25-13:29:30.141"),
        ("LReal", "3fb999999999999a", 0.1),
        ("LReal", "fff0000000000000", "-inf"),
        ("ULInt", "fffffffffffffffe", 2**64 - 2),
        ("LInt", "fffffffffffffffe", -2),
        ("LWord", "fffffffffffffffe", 2**64 - 2),
        ("USInt", "fe", 254),
        ("UInt", "fffe", 0xFFFE),
        ("UDInt", "fffffffe", 0xFFFFFFFE),
        ("SInt", "fe", -2),
        ("WChar", "20ac", "€"),
        ("LTime", "fffffffffffffffe", "LT#-2ns"),
        ("LTOD", "0000000000000005", "LTOD#00:00:00.000000005"),
        ("LDT", "0000000000000001", "LDT#1970-01-01T00:00:00.000000001Z"),
        ("LDT", "ffffffffffffffff", None),  # unsigned, and no clock shows it
        ("DTL", NEW_YEAR.hex(), "DTL#2024-12-31-23:59:58.123456789"),
    ],
)
def test_a_type_has_its_size_and_its_meaning(datatype: str, octets: str, member: object) -> None:
    """Behind an octet of something else, in front of another one; without its last octet it does not fit."""
    wire = b"\xee" + bytes.fromhex(octets)
    assert read(wire + b"\xee", plain(datatype, 1)) == (member, False)
    assert read(wire, plain(datatype, 1)) == (member, False)
    assert read(wire[:-1], plain(datatype, 1)) == MISFIT


def test_a_bit_is_one_of_its_byte() -> None:
    for bit in range(8):
        bits = [plain("Bool", 1, number) for number in range(8)]
        assert read(bytes((0xFF, 1 << bit)), *bits) == ({f"v{n + 1}": n == bit for n in range(8)}, False)
        assert read(bytes((0, 1 << bit)), plain("BBOOL", 1))[0] is (bit == 0)
    assert read(b"\xff", plain("Bool", 1)) == MISFIT


@pytest.mark.parametrize(
    ("declared", "octets", "found"),
    [
        (text("String", 3), b"\3\2H\xe4", ("Hä", False)),
        (text("String", 3), b"\3\3HMI", ("HMI", False)),
        (text("String", 3), b"\3\0", ("", False)),
        (text("String"), b"\2\2HM", ("HM", False)),  # no length is declared
        (text("String"), b"\2\3HMI", MISFIT),
        (text("String", 3), b"\3\4HMI!", MISFIT),
        (text("String", 3), b"\4\2HMI", MISFIT),
        (text("String", 3), b"\3\2H", MISFIT),
        (text("String", 3), b"\3", MISFIT),
        (text("WString", 3), b"\0\3\0\2\0H\x20\xac", ("H€", False)),
        (text("WString", 3), b"\0\3\0\3\0H\0M\0I", ("HMI", False)),
        (text("WString", 3), b"\0\3\0\1\xd8\0", ("\ufffd", False)),  # half a character
        (text("WString", 300), b"\1\x2c\0\1\0H", ("H", False)),
        (text("WString", 3), b"\0\3\0\4\0H\0M\0I\0!", MISFIT),
        (text("WString", 3), b"\0\4\0\1\0H", MISFIT),
        (text("WString", 3), b"\0\3\0\2\0H\0", MISFIT),
        (text("WString", 3), b"\0\3\0", MISFIT),
    ],
)
def test_a_text_has_its_length_in_front(declared: Variable, octets: bytes, found: tuple[object, bool]) -> None:
    assert read(octets, declared) == found


@pytest.mark.parametrize(
    ("declared", "octets", "found"),
    [
        (array("Int", 3), "0001 fffe 0003", ([1, -2, 3], False)),
        (array("Int", 0), "", ([], False)),
        (array("Int", 3), "0001 fffe 00", MISFIT),
        (array("LReal", 2), "3ff8000000000000 4004000000000000", ([1.5, 2.5], False)),
        (array("String", 2, 3), "03 02 4856 00 03 01 58", (["HV", "X"], False)),
        (array("DTL", 2), (NEW_YEAR * 2).hex(), (["DTL#2024-12-31-23:59:58.123456789"] * 2, False)),
        (array("Bool", 2), "00 00 00 00", UNKNOWN),
        (array("BBOOL", 2), "00 00 00 00", UNKNOWN),
        (array("WString", 2, 3), "00" * 40, UNKNOWN),
        (plain("Variant"), "00" * 40, UNKNOWN),
    ],
)
def test_elements_follow_each_other(declared: Variable, octets: str, found: tuple[object, bool]) -> None:
    assert read(bytes.fromhex(octets), declared) == found


@pytest.mark.parametrize(
    ("kind", "numbers"),
    [
        (6, [1, 1, 0, 2, 4, 3, INNER, 0, 0, 0, 0]),
        (13, [1, 1, 0, 2, 4, 3, INNER, 0, 0, 0, 0]),
        (7, [1, 1, 0, 2, *[0] * 6, 2, *[0] * 5, 4, 3, INNER, 0, 0, 0, 0]),
        (14, [1, 1, 0, 2, *[0] * 6, 2, *[0] * 5, 4, 3, INNER, 0, 0, 0, 0]),
    ],
)
def test_structures_in_an_array_have_a_size_in_each_layout(kind: int, numbers: list[int]) -> None:
    inner = type_of(INNER, ("in", plain("Int")))
    declared = Variable(1, 0, DATATYPE["Struct"], kind << 12, 0, 0, 0, numbers)
    octets = b"\xee" + bytes.fromhex("0001 ee 0002 0003")
    assert read(octets, declared, types=(inner,)) == ([{"in": 1}, {"in": 2}], False)
    assert read(octets, declared, flags=2 | CLASSIC, types=(inner,)) == ([{"in": 1}, {"in": 0x0200}], False)
    numbers[numbers.index(INNER) - 1] = 0  # its size is not known
    assert read(octets, declared, types=(inner,)) == UNKNOWN


def test_a_dtl_is_known_by_its_type_or_its_structure() -> None:
    for declared in (structure(DTL_STRUCT), structure(DTL_STRUCT, "DTL"), structure(INNER, "DTL")):
        assert read(NEW_YEAR, declared) == ("DTL#2024-12-31-23:59:58.123456789", False)
        assert read(NEW_YEAR[:-1], declared) == MISFIT
    assert read(NEW_YEAR, structure(INNER)) == UNKNOWN


def nested(levels: int) -> tuple[object, bool]:
    """Read structures inside each other, so many with the outermost one."""
    ids = [TANK, *[0x91000100 + level for level in range(1, levels)]]
    types = [type_of(type_id, ("v1", structure(below))) for type_id, below in pairwise(ids[1:])]
    leaf = type_of(ids[-1], ("v1", plain("Int")))
    found, wrong = read(b"\0\7", structure(ids[1]), types=(*types, leaf))
    while isinstance(found, dict):
        levels -= 1
        found = found["v1"]
    assert levels == 1 or found is None
    return found, wrong


def test_structures_inside_each_other_are_read_to_a_depth() -> None:
    """Eight inside the first one; deeper ones keep their octets, as no capture shows them."""
    assert nested(2) == (7, False)
    assert nested(9) == (7, False)
    assert nested(10) == UNKNOWN


def test_members_and_elements_are_bounded() -> None:
    """5000 of them: an array counts itself and each element, a variable counts as its only element too."""
    assert read(bytes(5000), array("USInt", 4999)) == ([0] * 4999, False)
    assert read(bytes(5000), array("USInt", 5000)) == UNKNOWN
    found, wrong = read(bytes(1), *[plain("USInt") for _ in range(2500)])
    assert (isinstance(found, dict), wrong) == (True, False)
    assert read(bytes(1), *[plain("USInt") for _ in range(2501)]) == UNKNOWN


def test_the_classic_layout_is_a_flag() -> None:
    declared = Variable(1, 0, DATATYPE["Int"], 0x8000, 0, 0, 2, [])
    for flags, member in ((0, 1), (2, 1), (0x400, 1), (CLASSIC, 2), (CLASSIC | 0x402, 2)):
        assert read(b"\0\1\0\2", declared, flags=flags) == (member, False)


def test_a_type_that_was_not_captured_is_unknown() -> None:
    assert packed_members(Packed(TANK, 5, 2, b"abc"), Program()) is None
    assert not misfit(Packed(TANK, 5, 2, b"abc"), Program())
