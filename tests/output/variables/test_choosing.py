"""What a user names becomes places with a type: tags, their members and elements, addresses; or an error that says why not."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import pytest

from dissect.meaning.tags.loading import load_tags
from dissect.output.variables.choosing import Known, WantedError, choose, one_of
from dissect.output.variables.wanted import Wanted
from tests.cases import each
from tests.meaning.report.support import begun
from tests.output.variables.support import BYTE, db, reads, rows_of, said
from tests.properties.messages import Item

_TAGS: Final = """address,type,name
DB1.DBW0,"Array[1..3] of INT",Tank.Levels
DB1.DBX10.3,"Array[0..1, 0..7] of BOOL",Bits
DB1.DBD20,REAL,Tank.Temp
T5,TIMER,Delay
MW4,WORD,Tanker
"""
_NO_ADDRESS: Final = "such as DB10.DBD4, DB10.DBD4:REAL, MW20 or I0.1"


@pytest.fixture
def known(tmp_path: Path) -> Known:
    path = tmp_path / "tags.csv"
    path.write_text(_TAGS, encoding="utf-8")
    return Known(load_tags([path]).naming())


def places(found: list[Wanted]) -> list[tuple[str, str, int]]:
    return [(one.text, one.address, int(one.bits)) for one in found]


def test_a_tag_is_found_whatever_its_case(known: Known) -> None:
    assert places(one_of("tank.LEVELS", known)) == [("tank.LEVELS", "DB1.DBB0", 48)]
    assert places(one_of("Delay", known)) == [("Delay", "T5", 16)]


def test_a_structure_is_all_its_members_and_no_other_name_that_begins_alike(known: Known) -> None:
    assert places(one_of("Tank", known)) == [("Tank.Levels", "DB1.DBB0", 48), ("Tank.Temp", "DB1.DBD20", 32)]


def test_an_element_of_an_array(known: Known) -> None:
    for text, address, bits, number in (
        ("Tank.Levels[1]", "DB1.DBW0", 16, 0),
        ("tank.levels[3]", "DB1.DBW4", 16, 2),
        ("Bits[0,0]", "DB1.DBX10.3", 1, 0),
        ("Bits[1, 3]", "DB1.DBX11.6", 1, 11),
    ):
        (wanted,) = one_of(text, known)
        assert (wanted.address, wanted.bits) == (address, bits), text
        part = wanted.part
        assert part is not None
        assert (part.first, part.count, part.bits, part.bit) == (number, 1, bits, wanted.start % 8), text
    for text in ("Tank.Levels[0]", "Tank.Levels[4]", "Bits[2,0]", "Bits[0]"):
        with pytest.raises(WantedError, match=r"no such tag; close to it: "):
            one_of(text, known)


def test_an_element_has_its_own_values(tmp_path: Path) -> None:
    path = tmp_path / "tags.csv"
    path.write_text(_TAGS, encoding="utf-8")
    talk = begun()
    reads(talk, 1, (db(BYTE, 0, 12), bytes((0, 1, 0, 2, 0, 3, 0, 0, 0, 0, 0x08, 0x40))))
    naming = load_tags([path]).naming()
    rows = rows_of(talk, "Tank.Levels[2]", "Bits[0,0]", "Bits[1,3]", naming=naming)
    assert [(row.name, row.type, row.value) for row in rows] == [
        ("Tank.Levels[2]", "INT", 2), ("Bits[0,0]", "BOOL", True), ("Bits[1,3]", "BOOL", True),
    ]  # fmt: skip
    for names in ((), ("Tank.Levels",)):
        (levels,) = [row for row in rows_of(talk, *names, naming=naming) if row.tag == "Tank.Levels"]
        assert (levels.value, levels.data, levels.type) == ([1, 2, 3], bytes((0, 1, 0, 2, 0, 3)), "Array[1..3] of INT")
    assert [row.value for row in rows_of(talk, "Tank.Levels[3]", "Bits[0,1]", "Bits[1,2]", naming=naming)] == [
        3,
        False,
        False,
    ]


def test_an_address_that_is_exactly_a_tag_or_an_element_has_its_name(tmp_path: Path) -> None:
    path = tmp_path / "tags.csv"
    path.write_text(_TAGS, encoding="utf-8")
    naming = load_tags([path]).naming()
    talk = begun()
    reads(talk, 1, (Item(0x1D, 3, 0, 0x1D, 4), b"\0\x05\x12\x50\0\x07"))
    reads(talk, 2, (db(BYTE, 0, 12), bytes((0, 1, 0, 2, 0, 3, 0, 0, 0, 0, 0x08, 0x40))))
    for text, name, type_, value in (
        ("T5", "Delay", "TIMER", "S5T#25s"), ("DB1.DBW2", "Tank.Levels[2]", "INT", 2),
        ("DB1.DBX11.6", "Bits[1,3]", "BOOL", True), ("DB1.DBX11.5", "Bits[1,2]", "BOOL", False),
        ("DB1.DBW1", "DB1.DBW1", "WORD", 0x100), ("DB1.DBB0", "DB1.DBB0", "BYTE", 0),
    ):  # fmt: skip
        rows = rows_of(talk, text, naming=naming)
        assert [(row.name, row.type, row.value) for row in rows] == [(name, type_, value)], text


@each(
    ("text", "address", "bits", "type_"),
    [
        ("DB10.DBX3.1", "DB10.DBX3.1", 1, None),
        ("DB10.DBB3", "DB10.DBB3", 8, None),
        ("DB10.DBW3", "DB10.DBW3", 16, None),
        ("DB10.DBD3", "DB10.DBD3", 32, None),
        ("M3.4:BOOL", "M3.4", 1, "BOOL"),
        ("DB10.DBX3.0:INT", "DB10.DBW3", 16, "INT"),
        ("MX3.1", "M3.1", 1, "BOOL"),
        ("DB10,R4.2", "DB10.DBL4", 64, "REAL"),  # two REALs
        ("DB10,X4.2", "DB10.DBX4.2", 1, "BOOL"),
        ("T5 x3", "T5", 48, None),
        ("T5,3", "T5", 48, "TIMER"),
        ("C7", "C7", 16, None),
        ("DB1:3", "DB1.DBB3", 8, None),
        ("DB1:3.5", "DB1.DBX3.5", 1, None),
        ("DB1:3.0", "DB1.DBX3.0", 1, None),
        ("DB1,B0", "DB1.DBB0", 8, "BYTE"),
        ("DB1:3:REAL[2]", "DB1.DBL3", 64, "REAL"),
        ("DB1.DBX3.5 x1", "DB1.DBX3.5", 1, None),
        ("DB1,X4.2.9", "DB1.DBB4.2", 9, "BOOL"),
        ("DB1:3:STRING[9]", "DB1.DBB3", 88, "STRING[9]"),
        ("DB9.DBB0 x65536", "DB9.DBB0", 8 * 65536, None),
    ],
)
def test_a_place_and_its_type(text: str, address: str, bits: int, type_: str | None) -> None:
    (wanted,) = one_of(text, Known(None))
    assert (wanted.text, wanted.address, int(wanted.bits)) == (text, address, bits)
    assert (wanted.part.tag.type if wanted.part is not None else None) == type_
    if wanted.part is not None:
        assert wanted.part.bits == bits
        assert int(wanted.part.count) * int(wanted.part.tag.size) == bits


def test_several_reals_are_a_list_of_them() -> None:
    talk = begun()
    reads(talk, 1, (db(BYTE, 0, 12), bytes(4) + b"\x3f\x80\0\0\x40\0\0\0"))
    assert said(rows_of(talk, "DB1,R4.2")) == [("read", "DB1.DBD4", "Array[0..1] of REAL", [1.0, 2.0])]


@each("text", ["0x6041:0", "0X6041:10", "CPU.x LID 4", 'DB1."level"', "Speed", "SPEED"])
def test_words_of_which_only_the_traffic_shows_whether_they_exist(text: str) -> None:
    (wanted,) = one_of(text, Known(None, ["Speed", ""]))
    assert (wanted.word, wanted.area, wanted.part) == (text.lower(), -1, None)
    assert repr(wanted) == f"Wanted({text!r})"


@each(
    ("text", "said"),
    [
        ("DB1.DBX0.9", "DB1.DBX0.9: bits are 0-7"),
        ("DB10.DBX3", "DB10.DBX3: the bit is missing, for example DB10.DBX3.0"),
        ("DB10.DBX3.1:INT", "DB10.DBX3.1:INT: INT has no bit"),
        ("DB10.DBD4:REEL", "type 'REEL' is not a type of S7; close to it: REAL, LREAL"),
        ("DB9.DBB0 x65537", f"DB9.DBB0 x65537: not an address {_NO_ADDRESS}, and without tags= there are no names"),
        ("DB9", f"DB9: not an address {_NO_ADDRESS}, and without tags= there are no names"),
        ("DB9.DBB0 x0", f"DB9.DBB0 x0: not an address {_NO_ADDRESS}, and without tags= there are no names"),
        ("T5 x0", f"T5 x0: not an address {_NO_ADDRESS}, and without tags= there are no names"),
        ("M", f"M: not an address {_NO_ADDRESS}, and without tags= there are no names"),
        ("DB10,RW4", "DB10,RW4: RW is a little-endian type of nodes7, which has no S7 type"),
        ("z" * 60, f"{'z' * 60}: not an address {_NO_ADDRESS}, and without tags= there are no names"),
        (
            "z" * 61,
            f"{'z' * 60}… (61 characters): not an address {_NO_ADDRESS}, and without tags= there are no names",
        ),
        (f"DB10.DBX3.1:{'INT'.rjust(4)}", "DB10.DBX3.1: INT: INT has no bit"),
        (f"DB10.DBX3.1:{'INT'.rjust(60)}", f"DB10.DBX3.1:{' ' * 48}… (72 characters): INT has no bit"),
        ("DB10.DBX3.1:DINT[7]", "DB10.DBX3.1:DINT[7]: DINT has no bit"),
        ("0x6041", f"0x6041: not an address {_NO_ADDRESS}, and without tags= there are no names"),
    ],
)
def test_what_is_wrong_with_a_name(text: str, said: str) -> None:
    with pytest.raises(WantedError) as raised:
        one_of(text, Known(None, of_command=False))
    assert str(raised.value) == said


def test_an_error_says_what_may_be_given_there(known: Known) -> None:
    for names, expected in (
        (Known(None), f"zz: neither a file nor an address {_NO_ADDRESS}, and without --tags there are no names"),
        (Known(None, files=False), f"zz: not an address {_NO_ADDRESS}, and without --tags there are no names"),
        (Known(None, of_command=False), f"zz: not an address {_NO_ADDRESS}, and without tags= there are no names"),
        (known, f"zz: neither a file nor an address {_NO_ADDRESS}, nor a tag of the files of --tags"),
    ):
        with pytest.raises(WantedError) as raised:
            choose(["MW0", "zz"], names)
        assert str(raised.value) == expected
    with pytest.raises(WantedError, match=r"^Tank\.Levls: no such tag; close to it: Tank\.Levels"):
        one_of("Tank.Levls", known)


def test_what_is_named_twice_is_wanted_once(known: Known) -> None:
    assert places(choose(["MW0", "mw0", "MW2", "Tank.Temp", "Tank"], known).all) == [
        ("MW0", "MW0", 16), ("MW2", "MW2", 16), ("Tank.Temp", "DB1.DBD20", 32), ("Tank.Levels", "DB1.DBB0", 48),
    ]  # fmt: skip


def test_a_long_name_is_shortened_in_an_error(tmp_path: Path) -> None:
    path = tmp_path / "tags.csv"
    for size, shown in ((60, "a" * 60), (61, f"{'a' * 60}… (61 characters)")):
        path.write_text(f"address,type,name\nDB1.DBW0,INT,{'a' * size}\n", encoding="utf-8")
        with pytest.raises(WantedError) as raised:
            one_of("a" * (size - 1) + "b", Known(load_tags([path]).naming()))
        assert str(raised.value).partition("close to it: ")[2] == shown


def test_rows_of_an_array_of_bits_and_their_elements(tmp_path: Path) -> None:
    """Each row begins at a word of its own."""
    source = tmp_path / "press.db"
    source.write_text(
        "DATA_BLOCK \"Press\"\n{ S7_Optimized_Access := 'FALSE' }\nVERSION : 0.1\n   STRUCT\n"
        "      bits : Array[1..2, 0..8] of Bool;\n   END_STRUCT;\nBEGIN\nEND_DATA_BLOCK\n",
        encoding="utf-8",
    )
    naming = load_tags([source], numbers={"Press": 1}).naming()
    talk = begun()
    reads(talk, 1, (db(BYTE, 0, 4), b"\1\1\2\0"))
    first, second = rows_of(talk, "Press.bits", naming=naming)
    assert (first.name, first.address, first.value) == ("Press.bits[1,0..8]", "DB1.DBX0.0", [True, *[False] * 7, True])
    assert (second.name, second.address, second.value) == (
        "Press.bits[2,0..8]", "DB1.DBX2.0", [False, True, *[False] * 7],
    )  # fmt: skip
    for text, address, value in (
        ("[1,0]", "DB1.DBX0.0", True), ("[1,8]", "DB1.DBX1.0", True), ("[2,0]", "DB1.DBX2.0", False),
        ("[2, 1]", "DB1.DBX2.1", True), ("[2,8]", "DB1.DBX3.0", False),
    ):  # fmt: skip
        (row,) = rows_of(talk, f"Press.bits{text}", naming=naming)
        assert (row.name, row.address, row.value) == (f"Press.bits{text.replace(' ', '')}", address, value)
    for text in ("[0,0]", "[3,0]", "[2,9]", "[2]"):
        with pytest.raises(WantedError, match="no such tag"):
            one_of(f"Press.bits{text}", Known(naming))
