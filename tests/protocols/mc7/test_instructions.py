"""The table of instructions: each form there and back, no word in two rows, and the examples of the reference sheet."""

from __future__ import annotations

from typing import Final

from dissect.protocols.mc7.assembler import encode_line, instruction_text
from dissect.protocols.mc7.code import UNKNOWN, Instruction, decode, row_of
from dissect.protocols.mc7.instruction_tables import GERMAN, INSTRUCTIONS, MEANINGS, Row, confidence
from tests.cases import each

#: Values behind the first word that lie at borders.
_VALUES: Final = {2: (0,), 4: (0, 1, 8, 0x7FFF, 0x8000, 0xFFFF), 6: (0, 1, 0x84000008, 0x40490FDB, 0xFFFFFFFF)}
#: First octets that no instruction begins with (section 5.6).
_UNDEFINED: Final = (
    "03 06 07 08 0D 0E 0F 15 16 17 18 1E 1F 22 23 25 26 27 2A 2B 2D 2E 2F 32 33 35 36 37 3A 3B 3E 3F 40 43 45 46 47 48 4D 4E "
    "4F 50 56 57 5D 5E 5F 62 63 66 67 6A 6B 6D 6E 6F 72 73 76 77 78 7A 7B 7D 7F FA"
)


def words(row: Row) -> list[int]:
    return [first << 8 | second for first in row.firsts for second in sorted(row.seconds)]


def test_every_form_is_encoded_as_it_was_decoded() -> None:
    tried = 0
    for row in INSTRUCTIONS:
        for word in words(row):
            for value in _VALUES[row.size]:
                assert row.shape.encode(row.shape.decode(word, value), row.firsts) == (word, value), (row, hex(word))
                tried += 1
    assert tried > 50_000


def test_no_word_has_two_meanings() -> None:
    seen: dict[int, Row] = {}
    for row in INSTRUCTIONS:
        for word in words(row):
            assert word not in seen, (hex(word), row, seen[word])
            seen[word] = row
            assert row_of(word) is row
    undefined = set(range(256)) - {word >> 8 for word in seen}
    assert undefined == {int(first, 16) for first in _UNDEFINED.split()}
    assert 0.64 < len(seen) / 65536 < 0.68


def test_every_instruction_is_explained_and_every_german_name_is_one() -> None:
    names = {row.name for row in INSTRUCTIONS}
    assert names == set(MEANINGS)
    assert set(GERMAN) <= names
    assert len(set(GERMAN.values())) == len(GERMAN)
    # A German name that is another instruction's English one: only those that trap people.
    assert set(GERMAN.values()) & names == {"SE", "TAR"} & names


def test_every_text_is_read_back_in_both_languages() -> None:
    for row in INSTRUCTIONS:
        word = words(row)[-1]
        for value in _VALUES[row.size]:
            instruction = Instruction(0, row, word, value)
            for german in (False, True):
                text = instruction_text(instruction, {}, german)
                octets = encode_line(text, 1, german).octets
                again = decode(octets)[0]
                assert len(octets) <= row.size, text
                # A second form may hold the same; it reads the same again.
                assert instruction_text(again, {}, german) == text


#: Code of the sheet, in STL and AWL.
EXAMPLES: Final = (
    ("8100", "A M 0.1", "U M 0.1"),
    ("a200", "AN M 0.2", "UN M 0.2"),
    ("9200", "S M 0.2", "S M 0.2"),
    ("c102", "A I 2.1", "U E 2.1"),
    ("d982", "= Q 2.1", "= A 2.1"),
    ("5205", "L IW 5", "L EW 5"),
    ("5385", "T QW 5", "T AW 5"),
    ("7e670018", "T LD 24", "T LD 24"),
    ("7e020100", "L PIW 256", "L PEW 256"),
    ("7e060100", "T PQW 256", "T PAW 256"),
    ("41600014", "= L 20.0", "= L 20.0"),
    ("00410006", "A DBX 6.1", "U DBX 6.1"),
    ("79da0510", "= DIX [AR2,P#162.0]", "= DIX [AR2,P#162.0]"),
    ("be410008", "L DBB [AR1,P#1.0]", "L DBB [AR1,P#1.0]"),
    ("fb180010", "A [AR2,P#2.0]", "U [AR2,P#2.0]"),
    ("fb020008", "L W [AR1,P#1.0]", "L W [AR1,P#1.0]"),
    ("ba640004", "L DBB [LD 4]", "L DBB [LD 4]"),
    ("bbbb0004", "T MD [MD 4]", "T MD [MD 4]"),
    ("bf36000a", "L T [MW 10]", "L T [MW 10]"),
    ("300c1200", "L S5T#20S", "L S5T#20S"),
    ("300c0350", "L S5T#3S500MS", "L S5T#3S500MS"),
    ("3003fffb", "L -5", "L -5"),
    ("3007abcd", "L W#16#ABCD", "L W#16#ABCD"),
    ("30054142", "L 'AB'", "L 'AB'"),
    ("300a0000", "L D#1990-1-1", "L D#1990-1-1"),
    ("30080123", "L C#123", "L C#123"),
    ("30020005", "L 2#101", "L 2#101"),
    ("300601ff", "L B#(1,255)", "L B#(1,255)"),
    ("380140490fdb", "L 3.1415927e+000", "L 3.1415927e+000"),
    ("38014b000000", "L 8.388608e+006", "L 8.388608e+006"),
    ("3803ffffffff", "L L#-1", "L L#-1"),
    ("380484000040", "L P#DBX 8.0", "L P#DBX 8.0"),
    ("380900000faa", "L T#4S10MS", "L T#4S10MS"),
    ("3809fffffc18", "L T#-1S", "L T#-1S"),
    ("380b02932e01", "L TOD#12:0:0.001", "L TOD#12:0:0.001"),
    ("2040", "OPN DB 64", "AUF DB 64"),
    ("fb790007", "OPN DI 7", "AUF DI 7"),
    ("fb74002e700b0002", "UC SFC 46 ()", "UC SFC 46 ()"),
    ("3d05700b000487000010", "UC FC 5 (P#V 2.0)", "UC FC 5 (P#V 2.0)"),
    ("fb4c", "L DBNO", "L DBNO"),
    ("ffe0", "A BR", "U BIE"),
    ("ff82", "O ==0", "O ==0"),
    ("2120", ">I", ">I"),
    ("39c0", "<=D", "<=D"),
    ("0000", "NOP 0", "NOP 0"),
    ("ffff", "NOP 1", "NOP 1"),
    ("1067", "BLD 103", "BLD 103"),
    ("58000005", "+ 5", "+ 5"),
    ("600500000005", "+ L#5", "+ L#5"),
    ("6834000f", "AW W#16#F", "UW W#16#F"),
    ("fed7", "SRD 23", "SRD 23"),
    ("1c05", "SE T 5", "SV T 5"),
    ("2405", "SD T 5", "SE T 5"),
    ("1405", "SF T 5", "SA T 5"),
    ("6c07", "CU C 7", "ZV Z 7"),
    ("fe0b84000000", "LAR2 P#DBX 0.0", "LAR2 P#DBX 0.0"),
    ("fe030000ff00", "LAR1 P#8160.0", "LAR1 P#8160.0"),
    ("fe6f0014", "TAR2 LD 20", "TAR2 LD 20"),
    ("fe01", "LAR1 AR2", "LAR1 AR2"),
    ("fbcb0004", "L P##PAR4", "L P##PAR4"),
    ("0600", "DW W#16#0600", "DW W#16#0600"),
    ("06", "DB B#16#06", "DB B#16#06"),
)


@each(("octets", "stl", "awl"), EXAMPLES)
def test_an_example_reads_in_both_languages_and_back(octets: str, stl: str, awl: str) -> None:
    (instruction,) = decode(bytes.fromhex(octets))
    assert " ".join(instruction_text(instruction, {}).split()) == stl
    assert " ".join(instruction_text(instruction, {}, True).split()) == awl
    assert encode_line(stl).octets.hex() == octets
    assert encode_line(awl, 0, True).octets.hex() == octets


def test_what_has_no_form_of_its_own_is_shown_in_digits() -> None:
    shown = [" ".join(instruction_text(decode(bytes.fromhex(octets))[0], {}).split()) for octets in (
        "300c0abc", "300c4100", "30081abc", "38017fc00000", "3801ff800000", "30050001", "380b05265c00",
    )]  # fmt: skip
    assert shown == [
        "L W#16#ABC", "L W#16#4100", "L W#16#1ABC", "L DW#16#7FC00000", "L DW#16#FF800000", "L W#16#1", "L DW#16#5265C00",
    ]  # fmt: skip


def test_a_list_that_is_none_is_left_as_a_jump() -> None:
    whole = decode(bytes.fromhex("3d05700b000487000010"))
    assert [(each.name, each.size) for each in whole] == [("UC", 10)]
    for octets in ("3d05700b0003870000106500", "3d05700b00048700", "3d05700b0000", "3d05700bffff"):
        found = decode(bytes.fromhex(octets))
        assert found[0].list is None
        assert [each.name for each in found[:2]] == ["UC", "JU"]


def test_confidence_follows_what_was_met() -> None:
    assert confidence(0x3D, 5) == "C"
    assert confidence(0xB8, 1) == "2"
    assert confidence(0xFB, 0xCA) == "1"
    assert confidence(0x68, 0x3A) == "2"
    assert row_of(0x0600) is UNKNOWN
