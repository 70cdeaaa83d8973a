"""The twenty-five mistakes that people make with files of tags, each with what is said about it."""

from __future__ import annotations

import struct
import time
from pathlib import Path
from typing import Final

import pytest

import dissect
from dissect.files.session import Run
from dissect.meaning.tags import TagError, load_tags
from dissect.meaning.tags.checks import overlaps
from dissect.meaning.tags.coverage import Coverage
from dissect.meaning.tags.loading import TagSet, read_tags
from tests.cases import each
from tests.meaning.report.support import begun, read, saved
from tests.meaning.tags.support import asc_line, sdf_line, workbook
from tests.properties.messages import Item

HEAD: Final = "address,type,name\n"
BLOCK_XML: Final = (
    '<Document><Engineering version="V17"/><SW.Blocks.GlobalDB><AttributeList><Name>x</Name><Number>{}</Number>'
    "<MemoryLayout>Standard</MemoryLayout></AttributeList></SW.Blocks.GlobalDB></Document>"
)
#: Name: file, content, severity, line, and what is said.
CASES: Final[dict[str, tuple[str, str | bytes, str, int, str]]] = {
    "1 an optimised block": (
        "motor.db",
        'DATA_BLOCK "Motor"\n{ S7_Optimized_Access := \'TRUE\' }\nSTRUCT a:Int; END_STRUCT;\nBEGIN\nEND_DATA_BLOCK\n',
        "error", 1, "has S7_Optimized_Access TRUE: its members have no fixed addresses",
    ),
    "2 a block without a number": (
        "motor.db", '\ufeffDATA_BLOCK "Motor"\nSTRUCT a:Int; END_STRUCT;\nBEGIN\nEND_DATA_BLOCK\n',
        "error", 1, "DB 'Motor' has no number: add --tags-db 'Motor=10', or name the symbol table that has it too",
    ),
    "3 a type that is not there": (
        "block.awl", 'DATA_BLOCK DB 1\nSTRUCT\na : INT;\nb : "Job";\nc : UDT 7;\nEND_STRUCT;\nBEGIN\nEND_DATA_BLOCK\n',
        "error", 4, "type 'Job' is not in this or the other files; export it too (.udt)",
    ),
    "3 every one of them": (
        "block.awl", 'DATA_BLOCK DB 1\nSTRUCT\na : INT;\nb : "Job";\nc : UDT 7;\nEND_STRUCT;\nBEGIN\nEND_DATA_BLOCK\n',
        "error", 5, "type 'UDT 7' is not in this or the other files",
    ),
    "3 a type in German": (
        "block.awl", "DATA_BLOCK DB 1\nSTRUCT\na : Ganzzahl;\nEND_STRUCT;\nBEGIN\nEND_DATA_BLOCK\n",
        "error", 3, "DB 1: type 'Ganzzahl' is not in this or the other files; is INT meant?",
    ),
    "4 types in circles": (
        "block.awl",
        'TYPE "A"\nSTRUCT\nb : "B";\nEND_STRUCT\nEND_TYPE\nTYPE "B"\nSTRUCT\na : "A";\nEND_STRUCT\nEND_TYPE\n'
        'DATA_BLOCK DB 1\nSTRUCT\nx : "A";\nEND_STRUCT\nBEGIN\nEND_DATA_BLOCK\n',
        "error", 8, "contains itself: a > b > a",
    ),
    "5 the wrong encoding": (
        "tags.csv", HEAD.encode() + "DB1.DBW0,INT,Käse\n".encode("cp1252"),
        "note", 0, "is not UTF-8; read as cp1252",
    ),
    "6 two kinds of SDF": (
        "symbols.sdf", '"a","M 0.0","BOOL",""\n' + sdf_line("b", "%M0.1", "Bool"),
        "warning", 2, "9 fields where the first row has 4: this is the TIA format, read as that",
    ),
    "7 a line of ASC that is too long": (
        "symbols.asc", asc_line("a", "I", "0.0", "BOOL") + "xx\n",
        "error", 1, "has 132 characters instead of 130: expected an address in columns 29 to 39",
    ),
    "8 a different prefix in ASC": (
        "symbols.asc", asc_line("a", "I", "0.0", "BOOL") + "\n" + asc_line("b", "I", "0.1", "BOOL").replace("126,", "99,"),
        "error", 2, "begins with '99,b' instead of '126,'",
    ),
    "9 tabs in ASC": (
        "symbols.asc", asc_line("a", "I", "0.0", "BOOL") + "\n126,b\t\t\tI 0.1\tBOOL\n",
        "error", 2, "tabs instead of blanks: an editor changed the columns",
    ),
    "10 a bit above seven": ("tags.csv", HEAD + "M 10.8,BOOL,a\n", "error", 2, "M 10.8: bits are 0-7"),
    "10 no address at all": (
        "tags.xml", "<Tagtable><Tag type='Real' addr=''>leer</Tag></Tagtable>", "error", 1, "'leer' has no address",
    ),
    "11 a word with a bit": ("tags.csv", HEAD + "%MW10.1,WORD,a\n", "error", 2, "%MW10.1: a word has no bit"),
    "11 a bit without one": ("tags.csv", HEAD + "%MB10,BOOL,a\n", "error", 2, "the bit is missing for BOOL, for example M10.0"),
    "11 a number with a bit": ("tags.csv", HEAD + "%M10.1,INT,a\n", "error", 2, "INT has no bit: expected MW10"),
    "12 a width that does not fit": ("tags.csv", HEAD + "%MW4,Real,a\n", "error", 2, "%MW4 with REAL: REAL needs MD4"),
    "13 German and international names": (
        "tags.csv", HEAD + "E 0.0,BOOL,a\nM 0.0,BOOL,b\nI 0.1,BOOL,c\n",
        "warning", 4, "E 0.0 (line 2) and I 0.1 (line 4): German and international names in one file",
    ),
    "15 a name twice": (
        "tags.csv", HEAD + "MW0,INT,Level\nMW2,INT,level\n", "error", 3, "'level' is MW2, and MW0 at line 2: two tags of one name",
    ),
    "16 a word at an odd byte": (
        "tags.csv", HEAD + '"DB1,INT3",,a\nDB1.DBW5,INT,b\n', "warning", 3, "begins at an odd byte, which classic blocks do not have",
    ),
    "17 a string without a length": (
        "tags.csv", HEAD + '"DB10,S20",,a\n', "error", 2, "the length of the string is missing: DB10,S20.20 for 20 characters",
    ),
    "19 bounds the wrong way round": (
        "block.awl", "DATA_BLOCK DB 1\nSTRUCT\na : ARRAY[5..1] OF INT;\nEND_STRUCT\nBEGIN\nEND_DATA_BLOCK\n",
        "error", 3, "array bounds 5..1: the upper one is below the lower one",
    ),
    "19 a constant that nobody declares": (
        "block.awl", 'DATA_BLOCK DB 1\nSTRUCT\na : Array[0.."MAX"] of Int;\nEND_STRUCT\nBEGIN\nEND_DATA_BLOCK\n',
        "error", 3, "the array bound 'MAX' is a constant that no file declares",
    ),
    "19 too many dimensions": (
        "block.awl", "DATA_BLOCK DB 1\nSTRUCT\na : ARRAY[0..1,0..1,0..1,0..1,0..1,0..1,0..1] OF INT;\nEND_STRUCT\nBEGIN\nEND_DATA_BLOCK\n",
        "error", 3, "a has 7 dimensions: at most 6",
    ),
    "19 an array that is too large": (
        "block.awl", "DATA_BLOCK DB 1\nSTRUCT\na : ARRAY[0..32768] OF INT;\nEND_STRUCT\nBEGIN\nEND_DATA_BLOCK\n",
        "error", 3, "a has 65538 bytes: at most 65536",
    ),
    "20 a word that begins like a block": (
        "b.awl", "DATA_BLOCK#1\nDATA_BLOCK DB 1\nSTRUCT\na INT;\nEND_STRUCT\nBEGIN\nEND_DATA_BLOCK\n",
        "error", 4, "expected NAME : TYPE",
    ),
    "20 a block that is not closed": (
        "block.awl", "DATA_BLOCK DB 1\nSTRUCT\na : STRUCT\nb : INT;\nEND_STRUCT;\nEND_DATA_BLOCK\n",
        "error", 2, "END_STRUCT is missing: STRUCT of line 2 is still open at END_DATA_BLOCK",
    ),
    "21 a semicolon that is missing": (
        "block.awl", "DATA_BLOCK DB 1\nSTRUCT\na : INT := 3\nb : INT;\nEND_STRUCT\nBEGIN\nEND_DATA_BLOCK\n",
        "warning", 3, "the semicolon behind 'a' is missing",
    ),
    "15 one name twice in an object of JSON": (
        "tags.json", '{"A": "DB1,INT0", "B": "DB1,INT4",\n"A": "DB1,INT2"}', "error", 0,
        "'A' occurs twice in one object, with two values: remove one",
    ),
    "5 UTF-16 without its mark": (
        "tags.csv", (HEAD + "DB1.DBW0,INT,a\n").encode("utf-16-le"), "error", 1, "try --tags-encoding utf-16-le",
    ),
    "22 a comma in a cell without quotes": (
        "tags.csv", "address,type,name,comment\nDB1.DBW0,INT,a,slow, then fast\n", "warning", 2,
        "5 cells where the header has 4: is a cell that holds a separator without quotes? 'then fast' and what follows",
    ),
    "22 no header at all": (
        "tags.csv", "DB1.DBW0,INT,A\nDB1.DBW2,INT,B\n", "error", 1,
        "the header is 'DB1.DBW0, INT, A': expected columns Name and Address",
    ),
    "22 a header that is not there": (
        "tags.csv", "Nom,Type,Adresse\nx,INT,MW0\n", "error", 1, "the header is 'Nom, Type, Adresse': expected columns Name and Address",
    ),
    "23 an address that became a date": (
        "tags.csv", "address;type;name\n01.Feb;INT;a\n", "error", 2, "'01.Feb' is a date: a spreadsheet changed the address",
    ),
    "24 a database": ("blocks.db", b"SQLite format 3\0" + bytes(100), "error", 0, "is a SQLite database: not a file of tags"),
    "24 an archive": ("project.zap16", b"PK\x03\x04" + bytes(100), "error", 0, "is a ZIP archive, such as a TIA project archive"),
    "24 a code block": (
        "main.xml", '<Document><Engineering version="V17"/><SW.Blocks.OB ID="0"/></Document>',
        "error", 1, "SW.Blocks.OB has no variables with addresses",
    ),
    "24 a capture": ("trace.db", b"\x0a\x0d\x0d\x0a" + bytes(100), "error", 0, "not a capture file (pcap or pcapng"),
    "24 another text": ("notes.csv", "Dear all,\nthe tags\n", "error", 1, "the header is 'Dear all': expected columns"),
    "a type that is none": ("tags.csv", HEAD + "MW0,INTT,a\n", "error", 2, "type 'INTT' is not a type of S7; close to it: INT"),
    "a type in German": ("tags.csv", HEAD + "MD0,Gleitpunktzahl,a\n", "error", 2, "close to it: REAL"),
    "an address that is none": ("tags.csv", HEAD + "pump,INT,a\n", "error", 2, "'pump' is not an address: expected for example"),
    "XML with a document type": (
        "tags.xml", '<!DOCTYPE a [<!ENTITY b "c">]><Tagtable/>', "error", 1, "has a document type or entities",
    ),
    "XML in an encoding that is none": (
        "tags.xml", '<?xml version="1.0" encoding="klingon"?><Tagtable/>', "error", 1, "the encoding cannot be read: unknown encoding",
    ),
    "XML with a block number of another script": (
        "db.xml", BLOCK_XML.format("\u00b2"), "error", 1, "DB 'x' has no number",
    ),
    "XML with a block number that no block has": ("db.xml", BLOCK_XML.format("9" * 20), "error", 1, "DB 'x' has no number"),
    "XML with a bound of another script": (
        "tags.xml", '<Tagtable><Constant value="\u00b2">c</Constant><Tag type="Array[0..\u00b2] of Int" addr="%DB1.DBW0">x</Tag></Tagtable>',
        "error", 1, "x: array bounds '0..\u00b2': expected LOWEST..HIGHEST",
    ),
    "a number of thousands of digits in JSON": ("tags.json", '{"a": ' + "9" * 5000 + "}", "error", 1, "is not valid JSON: a number of too many digits"),
    "a quote that swallows the table": (
        "tags.csv", HEAD + '"MW0,INT,a\n' + "MW2,INT,b\n" * 20_000, "error", 0, "cannot be read as a table: field larger than",
    ),
    "a first line of one long cell": ("tags.csv", "a,b," + '"' + "c" * 200_000 + "\n", "error", 0, "cannot be read as a table"),
    "a first line of blanks": ("tags.csv", "   \nx,y\n", "error", 2, "the header is 'x, y': expected columns"),
    "arrays of arrays": (
        "block.db", f"DATA_BLOCK DB 1\nSTRUCT\na : {'ARRAY[0..1] OF ' * 3000}INT;\nEND_STRUCT\nBEGIN\nEND_DATA_BLOCK\n",
        "error", 3, "a has 3000 dimensions: at most 6",
    ),
    "attributes that are not closed": (
        "block.db", "DATA_BLOCK DB 1\nSTRUCT\na { x := 'TRUE' : INT;\nEND_STRUCT\nBEGIN\nEND_DATA_BLOCK\n",
        "error", 3, "{ is never closed by }: all that follows it in the file was left out",
    ),
    "a comment that is not closed": (
        "block.db", "DATA_BLOCK DB 1\nSTRUCT\na : INT; (* level\nEND_STRUCT\nBEGIN\nEND_DATA_BLOCK\n",
        "error", 3, "(* is never closed by *)",
    ),
    "an empty file": ("tags.csv", "\n", "error", 0, "is empty"),
}  # fmt: skip


def written(folder: Path, name: str, content: str | bytes) -> Path:
    path = folder / name
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


@pytest.mark.parametrize(
    "members", ["{ " * 60_000, "(* " * 60_000, "/* " * 60_000, "a : STRING := " + "'$" * 60_000, "a : INT;" * 20_000]
)
def test_what_is_not_closed_takes_no_longer_than_what_is(members: str, tmp_path: Path) -> None:
    began = time.perf_counter()
    read_tags([written(tmp_path, "b.db", f"DATA_BLOCK DB 1\nSTRUCT\n{members}\nEND_STRUCT\nBEGIN\nEND_DATA_BLOCK\n")])
    assert time.perf_counter() - began < 30  # it was hours for most of them


def test_blocks_within_a_comment_are_none(tmp_path: Path) -> None:
    block = "DATA_BLOCK DB {}\nSTRUCT\na : INT;\nEND_STRUCT\nBEGIN\nEND_DATA_BLOCK\n"
    text = "".join(
        [
            block.format(1),
            "(* old:\n",
            block.format(2),
            block.format(3),
            "*)\n",
            block.format(4),
            "// (* a note\n",
            block.format(5),
        ]
    )
    assert [tag.db for tag in load_tags([written(tmp_path, "b.db", text)]).tags] == [1, 4, 5]
    text = block.format(1) + "(* old:\n" + block.format(2) * 20_000
    assert [tag.db for tag in load_tags([written(tmp_path, "b.db", text)]).tags] == [1]


@pytest.mark.parametrize("value", ["+-5", "\u00b2", "9" * 5000, "", "5"])
def test_a_constant_is_a_bound_where_it_is_a_number(value: str, tmp_path: Path) -> None:
    source = (
        f"FUNCTION_BLOCK FB 1\nVAR CONSTANT\nN : INT := {value};\nEND_VAR\nEND_FUNCTION_BLOCK\n"
        "DATA_BLOCK DB 1\nSTRUCT\na : ARRAY[0..N] OF INT;\nEND_STRUCT\nBEGIN\nEND_DATA_BLOCK\n"
    )
    found = read_tags([written(tmp_path, "b.scl", source)])
    said = [problem.text for problem in found.problems]
    assert said == [] if value == "5" else "the array bound 'N' is a constant that no file declares" in said[0]


def test_a_block_that_cannot_be_read_is_not_said_to_be_missing(tmp_path: Path) -> None:
    path = written(tmp_path, "b.db", 'DATA_BLOCK "Tank"\nSTRUCT\na Int;\nEND_STRUCT;\nBEGIN\nEND_DATA_BLOCK\n')
    assert [problem.line for problem in read_tags([path], numbers={"Tank": 1}).problems] == [3]
    path.write_text('DATA_BLOCK "Tank"\nSTRUCT\na : Int;\nEND_STRUCT;\nBEGIN\nEND_DATA_BLOCK\n', encoding="utf-8")
    assert [problem.text for problem in read_tags([path], numbers={"Tank": 1, "Tnak": 2}).problems] == [
        "--tags-db Tnak: no file has a data block of that name; close to it: 'Tank'"
    ]


@each("length", ["LEN", "#LEN", '"LEN"'])
def test_the_length_of_a_string_may_be_a_constant(length: str, tmp_path: Path) -> None:
    source = f"DATA_BLOCK DB 1\nSTRUCT\na : STRING[{length}];\nb : INT;\nEND_STRUCT\nBEGIN\nEND_DATA_BLOCK\n"
    paths = [
        written(tmp_path, "b.scl", source),
        written(tmp_path, "k.sdf", sdf_line("Len", "CONSTANT", "Int", value="10")),
    ]
    assert [(tag.address, tag.type) for tag in load_tags(paths).tags] == [
        ("DB1.DBB0", "STRING[10]"),
        ("DB1.DBW12", "INT"),
    ]
    with pytest.raises(TagError, match="a: the length 'LEN' is a constant that no file declares: name the tag table"):
        load_tags(paths[:1])


@each("name", CASES)
def test_a_mistake_is_reported_with_its_line_and_what_to_do(name: str, tmp_path: Path) -> None:
    file, content, severity, line, text = CASES[name]
    path = written(tmp_path, file, content)
    found = read_tags([path])
    assert [
        problem
        for problem in found.problems
        if (problem.severity, problem.line) == (severity, line) and text in problem.text
    ], [str(problem) for problem in found.problems]
    if severity == "error":
        with pytest.raises(TagError, match=r"."):
            load_tags([path])
    else:
        load_tags([path])


def test_5_an_encoding_that_was_asked_for_and_is_wrong_names_the_byte_and_its_line(tmp_path: Path) -> None:
    path = written(tmp_path, "tags.csv", HEAD.encode() + b"MW0,INT,K\xc4se\n")
    with pytest.raises(TagError, match=r"tags\.csv:2: byte 0xC4 is not utf-8.*--tags-encoding cp1252"):
        load_tags([path], encoding="utf-8")
    assert load_tags([path], encoding="cp1251").tags[0].name == "KДse"


def test_7_a_line_that_lost_its_blanks_is_padded(tmp_path: Path) -> None:
    found = read_tags([written(tmp_path, "symbols.asc", asc_line("Level", "MW", "10", "INT").rstrip())])
    assert [(tag.name, tag.address, tag.type) for tag in found.tags] == [("Level", "MW10", "INT")]


def test_14_an_overlap_is_a_note_and_no_mistake(tmp_path: Path) -> None:
    found = load_tags([written(tmp_path, "tags.csv", HEAD + "%MW10,WORD,A\n%M11.2,BOOL,B\n%MW12,INT,C\n")])
    listed, count = overlaps(found.tags)
    assert ([str(each) for each in listed], count) == (["A (MW10) and B (M11.2) share MB11"], 1)


def test_15_one_tag_in_two_files_is_no_mistake(tmp_path: Path) -> None:
    one = written(tmp_path, "one.csv", HEAD + "MW0,INT,Level\n")
    two = written(tmp_path, "two.csv", HEAD + "MW0,INT,Level\n")
    assert len(load_tags([one, two]).tags) == 1


def test_18_a_count_behind_a_dot_is_told_from_a_bit(tmp_path: Path) -> None:
    found = load_tags([written(tmp_path, "tags.csv", HEAD + '"DB1,INT0.3",,a\n"DB1,X14.0.8",,b\n"DB1,S20.30",,c\n')])
    assert [(tag.address, tag.declared) for tag in found.tags] == [
        ("DB1.DBW0", "Array[0..2] of INT"),
        ("DB1.DBX14.0", "Array[0..7] of BOOL"),
        ("DB1.DBB20", "STRING[30]"),
    ]


def test_22_a_sheet_with_moved_and_missing_columns_is_read_and_one_without_the_needed_ones_is_not(
    tmp_path: Path,
) -> None:
    good = workbook(tmp_path / "good.xlsx", [["Comment", "Logical Address", "Name"], ["start", "%I0.0", "Start"]])
    assert [(tag.name, tag.address, tag.type, tag.comment) for tag in load_tags([good]).tags] == [
        ("Start", "I0.0", "BOOL", "start")
    ]
    bad = workbook(tmp_path / "bad.xlsx", [["Nom", "Adresse logique"], ["Start", "%I0.0"]])
    with pytest.raises(TagError, match="the header is 'Nom, Adresse logique'"):
        load_tags([bad])


def test_23_semicolons_and_decimal_commas_are_detected_and_told(tmp_path: Path) -> None:
    found = load_tags([written(tmp_path, "tags.csv", "Adresse;Typ;Name;Einheit;Skalierung\nDB1.DBW0;INT;a;°C;0,1\n")])
    assert (found.tags[0].type, found.tags[0].factor, found.tags[0].unit) == ("INT", 0.1, "°C")
    assert "decimal commas are read as points" in found.problems[0].text
    # What Excel calls Unicode text.
    path = tmp_path / "unicode.txt"
    path.write_text("Adresse\tDatentyp\tName\tscale\nDB1.DBW0\tINT\ta\t0,1\n", encoding="utf-16")
    assert load_tags([path]).tags[0].factor == 0.1


def test_24_a_workbook_of_hmi_tags_is_named(tmp_path: Path) -> None:
    path = workbook(tmp_path / "HMITags.xlsx", [["Name", "Connection"]], sheet="Hmi Tags")
    with pytest.raises(TagError, match=r"has no sheet 'PLC Tags', but Hmi Tags \(HMI tags\): export the PLC tag table"):
        load_tags([path])


def test_25_a_capture_that_reads_behind_the_end_of_a_block_contradicts_its_source(tmp_path: Path) -> None:
    path = written(
        tmp_path, "b.awl", "DATA_BLOCK DB 10\nSTRUCT\na : ARRAY[0..42] OF INT;\nEND_STRUCT\nBEGIN\nEND_DATA_BLOCK\n"
    )
    talk = begun()
    read(talk, 2, Item(2, 4, 10, 0x84, 8 * 120), bytes(4))
    read(talk, 3, Item(2, 4, 10, 0x84, 8 * 200), 0x05)  # refused: no contradiction
    read(talk, 4, Item(2, 4, 10, 0x84, 0), bytes(4))
    capture = saved(tmp_path / "c.pcapng", talk.packets())
    coverage = Coverage(load_tags([path]))
    run = Run([capture], coverage)
    while run.step():
        pass
    assert coverage.disagreements() == [
        "DB10 'DB10' has 86 bytes in the source, but 1 items that end beyond them were answered, up to byte 123: the source is "
        "not that of the running program, or DB10 is a different block"
    ]
    row = coverage.areas[0x84, 10]
    assert (row.items, row.named, row.octets, row.covered) == (3, 1, 12, 4)
    assert coverage.unknown == {"DB10.DBB120 x4": 1, "DB10.DBB200 x4": 1}


@pytest.mark.parametrize(
    "more",
    [
        '<x:row r="1048576"><x:c r="XFD1048576"><x:v>1</x:v></x:c></x:row>',
        "<x:row r = '1048576'><x:c s='>' \n r = 'CV1048576'><x:v>1</x:v></x:c></x:row>",
        f'<x:row r="1048576">{"<x:c><x:v>1</x:v></x:c>" * 100}</x:row>',
        '<x:row r="1048576"><x:c r="XFC1048576" s="1"/><x:c><x:v>1</x:v></x:c></x:row>',
        '<x:row r="1048576"><x:c r="XFD1048576" s="/>"><x:v>1</x:v></x:c></x:row>',
        '<x:row r="1048576"><x:c r="XFD1048576" t="s"/></x:row>',
        f'{"<!-- far -->" * 200_000}<x:row r="1048576"><x:c r="XFD1048576"><x:v>1</x:v></x:c></x:row>',
    ],
)
def test_a_cell_far_from_all_others_is_told_before_the_library_makes_room_for_all_between(
    more: str, tmp_path: Path
) -> None:
    rows = [["Name", "Logical Address"], ["Start", "%I0.0"]]
    found = read_tags([workbook(tmp_path / "far.xlsx", rows, more=more)])
    assert [problem.text.partition(" column")[0] for problem in found.problems] == [
        "a sheet reaches to row 1048576 and"
    ]
    near = '<x:row r="70000"><x:c r="CV70000"/></x:row>'
    assert [tag.name for tag in load_tags([workbook(tmp_path / "near.xlsx", rows, more=near)]).tags] == ["Start"]


@pytest.mark.parametrize(
    "cell", ['<x:c r="XFD{0}" s="3"/>', "<x:c s='3' r='XFD{0}' ></x:c>", '<x:c r="XFD{0}"/><x:c/>']
)
def test_cells_that_have_but_a_style_are_no_cells(cell: str, tmp_path: Path) -> None:
    rows = [["Name", "Logical Address"], ["Start", "%I0.0"]]
    styled = "".join([f'<x:row r="{row}">{cell.format(row)}</x:row>' for row in (*range(3, 20_000), 1048576)])
    found = load_tags([workbook(tmp_path / "styled.xlsx", rows, more=styled)])
    assert [(tag.name, tag.address) for tag in found.tags] == [("Start", "I0.0")]


def test_a_tag_outside_its_block_is_a_mistake(tmp_path: Path) -> None:
    source = written(tmp_path, "b.awl", "DATA_BLOCK DB 10\nSTRUCT\na : INT;\nEND_STRUCT\nBEGIN\nEND_DATA_BLOCK\n")
    table = written(tmp_path, "t.csv", HEAD + "DB10.DBW2,INT,b\n")
    with pytest.raises(
        TagError, match=r"t\.csv:2: b \(DB10\.DBW2\) ends at byte 3: outside DB10 'DB10', which has 2 bytes"
    ):
        load_tags([source, table])


def test_nothing_is_half_applied(tmp_path: Path) -> None:
    good = written(tmp_path, "good.csv", HEAD + "MW0,INT,a\n")
    bad = written(tmp_path, "bad.csv", HEAD + "MW0,INTT,b\n%MW0.9,INT,c\n,INT,d\n")
    with pytest.raises(TagError) as raised:
        next(iter(dissect.open(saved(tmp_path / "x.pcapng", begun().packets()), tags=[good, bad])))
    assert [problem.line for problem in raised.value.problems] == [2, 3, 4]


@pytest.mark.parametrize("size", [0, 1, 3, 7, 20])
def test_files_of_any_octets_never_raise_anything_but_problems(size: int, tmp_path: Path) -> None:
    for start in (
        b"",
        b"126,",
        b'"a","',
        b"<",
        b"TABLE\n",
        b"\t",
        b"{",
        b"DATA_BLOCK ",
        b"PK[Content_Types].xml",
        b"tag,db,offset,type\n",
    ):
        found: TagSet = read_tags([written(tmp_path, "x", start + struct.pack(">Q", 0x22C40A0D09FF3B2C) * size)])
        assert found.files
