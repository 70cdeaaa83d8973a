"""Every format of files, each with an example of its own: what is read, and what names no place."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path
from typing import Final

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from dissect.meaning.tags import TagError, load_tags
from dissect.meaning.tags.converting import table_lines
from dissect.meaning.tags.loading import TagSet, read_tags
from dissect.meaning.tags.model import Tag
from dissect.meaning.tags.tag_file import parse_scale
from tests.meaning.tags.support import (
    TANK,
    TANK_AWL,
    TIA_HEAD,
    asc_line,
    example_files,
    sdf_line,
    tank_file,
    tia_row,
    workbook,
)

KEPWARE: Final = (
    "Tag Name,Address,Data Type,Respect Data Type,Client Access,Scan Rate,Scaling,Raw Low,Raw High,Scaled Low,Scaled High,"
    "Scaled Data Type,Clamp Low,Clamp High,Eng Units,Description,Negate Value\n"
    '"Line.Speed","DB3,REAL4",Float,1,R/W,100,,,,,,,,,rpm,"the drive",\n'
    '"Line.Level","DB3,INT8",Short,1,R/W,100,Linear,0,27648,0,100,Float,0,0,%,,\n'
    '"Other.X","N7:0",Word,1,R/W,100,,,,,,,,,,,\n'
)
OPENNESS: Final = """<?xml version="1.0" encoding="utf-8"?>
<Document><Engineering version="V18"/>
<SW.Tags.PlcTagTable ID="0"><AttributeList><Name>Main</Name></AttributeList><ObjectList>
<SW.Tags.PlcTag ID="1" CompositionName="Tags"><AttributeList><DataTypeName>Bool</DataTypeName>
<LogicalAddress>%E2.6</LogicalAddress><Name>Start</Name></AttributeList><ObjectList>
<MultilingualText ID="2" CompositionName="Comment"><ObjectList><MultilingualTextItem ID="3"><AttributeList>
<Culture>en-US</Culture><Text>push button</Text></AttributeList></MultilingualTextItem></ObjectList></MultilingualText>
</ObjectList></SW.Tags.PlcTag>
<SW.Tags.PlcUserConstant ID="4" CompositionName="UserConstants"><AttributeList><DataTypeName>Int</DataTypeName>
<Name>MAX</Name><Value>3</Value></AttributeList></SW.Tags.PlcUserConstant>
</ObjectList></SW.Tags.PlcTagTable></Document>"""
BLOCK: Final = """<Document><Engineering version="V18"/><SW.Blocks.GlobalDB ID="0"><AttributeList>
<Interface><Sections xmlns="http://www.siemens.com/automation/Openness/SW/Interface/v5"><Section Name="Static">
<Member Name="a" Datatype="Bool"><Comment><MultiLanguageText Lang="en-US">first</MultiLanguageText></Comment></Member>
<Member Name="s" Datatype="Struct"><Member Name="x" Datatype="Real"/></Member>
<Member Name="l" Datatype="Array[0..&quot;MAX&quot;] of Int"/>
</Section></Sections></Interface><MemoryLayout>Standard</MemoryLayout><Name>Box</Name><Number>9</Number>
</AttributeList></SW.Blocks.GlobalDB></Document>"""
INSTANCE: Final = """<Document><Engineering version="V18"/><SW.Blocks.InstanceDB ID="0"><AttributeList>
<InstanceOfName>Motor</InstanceOfName>
<Interface><Sections xmlns="http://www.siemens.com/automation/Openness/SW/Interface/v5"><Section Name="Input">
<Member Name="cmd" Datatype="&quot;Cmd&quot;"><Sections><Section Name="None">
<Member Name="a" Datatype="Bool"/><Member Name="b" Datatype="Int"/></Section></Sections></Member>
<Member Name="enable" Datatype="Bool"/></Section>
<Section Name="Output"><Member Name="running" Datatype="Bool"/></Section><Section Name="InOut"/>
<Section Name="Static"><Member Name="list" Datatype="Array[1..MOST] of Int"/>
<Member Name="name" Datatype="String[MOST]"/><Member Name="speed" Datatype="Real"/></Section>
<Section Name="Constant"><Member Name="MOST" Datatype="Int"><StartValue>3</StartValue></Member></Section>
</Sections></Interface><MemoryLayout>Standard</MemoryLayout><Name>Motor_DB</Name><Number>12</Number>
</AttributeList></SW.Blocks.InstanceDB></Document>"""
DIF: Final = (
    'TABLE\n0,1\n"EXCEL"\nVECTORS\n0,2\n""\nTUPLES\n0,4\n""\nDATA\n0,0\n""\n-1,0\nBOT\n1,0\n"Start"\n1,0\n"E  0.0"\n1,0\n"BOOL"\n'
    '1,0\n"a ""good"" one"\n-1,0\nBOT\n1,0\n"Tank"\n1,0\n"DB 10"\n1,0\n"FB 2"\n1,0\n""\n-1,0\nEOD\n'
)
IGNITION: Final = {
    "name": "Line", "tagType": "Folder",
    "tags": [{"name": "Run", "tagType": "AtomicTag", "opcItemPath": "ns=1;s=[plc]DB5,X0.3"}],
}  # fmt: skip
#: Name: file, content, format, tags as "name address type", counted rows.
FILES: Final[dict[str, tuple[str, str, str, dict[str, int]]]] = {
    "ASC": (
        asc_line("A symbol of 24 characters", "I", "0.0", "BOOL")[:28] + asc_line("", "I", "0.0", "BOOL")[28:] + "\r\n"
        + asc_line("Level", "PIW", "256", "WORD") + "\r\n" + asc_line("Tank", "DB", "20", "FB     20") + "\r\n"
        + asc_line("VAT_Test", "VAT", "1", "") + "\r\n",
        "STEP 7 V5 symbol table (ASC)", "A symbol of 24 character|I0.0|BOOL Level|PW256|WORD", {"blocks": 1, "variable tables": 1},
    ),
    "SDF of V5": (
        '"Start","E       0.0","BOOL","comma, and more"\n"Motor","FB 1","FB 1",""\n',
        "STEP 7 V5 symbol table (SDF)", "Start|I0.0|BOOL", {"blocks": 1},
    ),
    "SDF of TIA": (
        sdf_line("Pump", "%Q0.1", "Bool", 'a "quote", and a comma') + "\n" + sdf_line("Limit", "CONSTANT", "Int", "", "222") + "\n"
        + sdf_line("Zeit", "%T9", "Timer") + "\n",
        "TIA tag table (SDF)", "Pump|Q0.1|BOOL Zeit|T9|TIMER", {"constants": 1},
    ),
    "SEQ": ("\tE 0.0\tStart\tcomment\n\tMW 10\tLevel\t\n\n;note\n", "STEP 7 V5 symbol table (SEQ)", "Start|I0.0|BOOL Level|MW10|WORD", {}),
    "DIF": (DIF, "STEP 7 V5 symbol table (DIF)", "Start|I0.0|BOOL", {"blocks": 1}),
    "XML of TIA": (
        "\ufeff<?xml version='1.0' encoding='utf-8'?>\n<Tagtable name='t'>\n"
        "<Tag type='Word' remark='in' addr='%IW64:P'>Raw</Tag><Constant type='Int' value='5'>N</Constant></Tagtable>",
        "TIA tag table (XML)", "Raw|IW64|WORD", {"constants": 1},
    ),
    "Openness": (OPENNESS, "TIA Openness V18", "Start|I2.6|BOOL", {"constants": 1}),
    "python-snap7": (
        "tag,db,offset,type,bit\nRun,1,4,BOOL,3\nSpeed,1,6,REAL,\nName,1,10,STRING[8],\n",
        "python-snap7 tag list", "Run|DB1.DBX4.3|BOOL Speed|DB1.DBD6|REAL Name|DB1.DBB10|STRING[8]", {},
    ),
    "python-snap7 JSON": (
        '{"Run": {"db": 1, "offset": 4, "type": "BOOL", "bit": 3}, "Speed": {"db": 1, "offset": 6, "type": "REAL"}}',
        "python-snap7 tags (JSON)", "Run|DB1.DBX4.3|BOOL Speed|DB1.DBD6|REAL", {},
    ),
    "nodes7": ('{"A": "MR4", "B": "DB1,INT0.3"}', "nodes7 tag list", "A|MD4|REAL B|DB1.DBW0|INT", {}),
    "Node-RED table": ("DB1,X0.0;Start,,\nMW4;Level,,\n", "list of addresses and names", "Start|DB1.DBX0.0|BOOL Level|MW4|WORD", {}),
    "Node-RED flow": (
        '[{"type": "s7 endpoint", "vartable": [{"addr": "DB1,X0.0", "name": "Start"}]}]', "Node-RED flow", "Start|DB1.DBX0.0|BOOL", {},
    ),
    "Ignition": (json.dumps(IGNITION), "Ignition tags", "Line.Run|DB5.DBX0.3|BOOL", {}),
    "ENLYZE": (
        "DEVICE;BLOCK;VARIABLE;CODE;DATATYPE;COMMENT\nplc;DB6 (Press);force;DB6:26.0;REAL;\nplc;Symbol List;Level;MW200;WORD;\n",
        "ENLYZE S7-Project-Explorer list", "Press.force|DB6.DBD26|REAL Level|MW200|WORD", {},
    ),
    "KICS": ("ID;Varname;Connection;Address;Datatype\n1;v;c;DB575:82.0;REAL\n", "tag list", "v|DB575.DBD82|REAL", {}),
    "addresses of PLC4X": (
        'name,address\na,%DB1.DBD4:REAL\nb,%DB4:140:STRING(10)\nc,%M10.5:BOOL\nd,%DB1.DBX0.0:BOOL[8]\n', "tag list",
        "a|DB1.DBD4|REAL b|DB4.DBB140|STRING[10] c|M10.5|BOOL d|DB1.DBX0.0|BOOL", {},
    ),
    "addresses of OPC, telegraf": (
        'name,address\na,"DB1,REAL2,250"\nb,DB1.R4\nc,DB1.X4.1\nd,PIW30\ne,QB2\n', "tag list",
        "a|DB1.DBD2|REAL b|DB1.DBD4|REAL c|DB1.DBX4.1|BOOL d|PW30|WORD e|QB2|BYTE", {},
    ),
}  # fmt: skip


def text(found: TagSet) -> str:
    return " ".join([f"{tag.name}|{tag.address}|{tag.type}" for tag in found.tags])


@pytest.mark.parametrize("name", FILES)
def test_a_file_is_told_by_its_content_and_read(name: str, tmp_path: Path) -> None:
    content, kind, tags, skipped = FILES[name]
    path = tmp_path / "file.dat"
    path.write_text(content, encoding="utf-8", newline="")
    found = load_tags([path])
    assert (found.files[0].format, text(found), dict(found.files[0].skipped)) == (kind, tags, skipped)


def test_a_row_of_kepware_for_a_different_plc_is_left_out_and_its_scale_is_linear(tmp_path: Path) -> None:
    path = tmp_path / "kepware.csv"
    path.write_text(KEPWARE, encoding="utf-8")
    found = load_tags([path])
    assert text(found) == "Line.Speed|DB3.DBD4|REAL Line.Level|DB3.DBW8|INT"
    assert found.tags[1].factor == pytest.approx(100 / 27648)
    assert (found.tags[0].unit, found.tags[0].comment) == ("rpm", "the drive")
    assert [(problem.severity, problem.line) for problem in found.problems] == [("warning", 4)]


def test_a_block_takes_its_array_bound_from_the_constants_of_another_file(tmp_path: Path) -> None:
    (tmp_path / "table.xml").write_text(OPENNESS, encoding="utf-8-sig")
    (tmp_path / "block.xml").write_text(BLOCK, encoding="utf-8-sig")
    found = load_tags([tmp_path / "block.xml", tmp_path / "table.xml"])
    rows = [(tag.name, tag.address, tag.declared, tag.comment) for tag in found.tags[:3]]
    assert rows == [
        ("Box.a", "DB9.DBX0.0", "BOOL", "first"),
        ("Box.s.x", "DB9.DBD2", "REAL", ""),
        ("Box.l", "DB9.DBW6", "Array[0..3] of INT", ""),
    ]


def test_expanded_types_of_members_are_no_sections_of_an_instance(tmp_path: Path) -> None:
    # Openness writes what a type consists of inside the member that has it, and in the same words as the block itself.
    (tmp_path / "motor.xml").write_text(INSTANCE, encoding="utf-8-sig")
    (tmp_path / "cmd.udt").write_text(
        'TYPE "Cmd"\nSTRUCT\na : Bool;\nb : Int;\nEND_STRUCT;\nEND_TYPE\n', encoding="utf-8"
    )
    assert text(load_tags([tmp_path / "motor.xml", tmp_path / "cmd.udt"])) == (
        "Motor_DB.cmd.a|DB12.DBX0.0|BOOL Motor_DB.cmd.b|DB12.DBW2|INT Motor_DB.enable|DB12.DBX4.0|BOOL "
        "Motor_DB.running|DB12.DBX6.0|BOOL Motor_DB.list|DB12.DBW8|INT Motor_DB.name|DB12.DBB14|STRING[3] "
        "Motor_DB.speed|DB12.DBD20|REAL"
    )


def test_a_type_of_the_user_is_laid_out_whatever_it_is_called(tmp_path: Path) -> None:
    # HW_IO is a number of the system, HW_Status is not.
    types = "".join(
        [f'TYPE "{name}"\nSTRUCT\na : REAL;\nEND_STRUCT;\nEND_TYPE\n' for name in ("HW_Status", "Event_Log")]
    )
    block = 'DATA_BLOCK DB 3\nSTRUCT\na : HW_IO;\nb : "HW_Status";\nc : "Event_Log";\nd : INT;\nEND_STRUCT;\nEND_DATA_BLOCK\n'
    path = tmp_path / "b.db"
    path.write_text(types + block, encoding="utf-8")
    assert (
        text(load_tags([path]))
        == "DB3.a|DB3.DBW0|HW_IO DB3.b.a|DB3.DBD2|REAL DB3.c.a|DB3.DBD6|REAL DB3.d|DB3.DBW10|INT"
    )
    path.write_text(block, encoding="utf-8")
    with pytest.raises(TagError, match="type 'HW_Status' is not in this or the other files"):
        load_tags([path])


def test_a_block_that_is_one_array_has_its_elements(tmp_path: Path) -> None:
    path = tmp_path / "field.db"
    path.write_text(
        "DATA_BLOCK DB 3\n{ S7_Optimized_Access := 'FALSE' }\nNON_RETAIN\nArray[0..3] of Int\nBEGIN\n"
        "   THIS[1] := 7;\nEND_DATA_BLOCK\n",
        encoding="utf-8",
    )
    found = load_tags([path])
    assert [(tag.name, tag.address, tag.declared) for tag in found.tags] == [
        ("DB3.THIS", "DB3.DBW0", "Array[0..3] of INT")
    ]
    assert found.sizes == {3: 8}


@pytest.mark.parametrize(
    ("content", "rows"),
    [
        ("# the plant; north\n# and south\naddress,type,name\nDB1.DBW0,INT,A\n", "A|DB1.DBW0|INT"),
        ("sep=;\nName;Datentyp;Adresse\nA;Int;DB1.DBW0\n", "A|DB1.DBW0|INT"),
        ('"sep=,"\nname,type,address\nA,Int,DB1.DBW0\n', "A|DB1.DBW0|INT"),
        ('"address","type","name","unit"\n"DB1.DBW0","INT","A","bar"\n', "A|DB1.DBW0|INT"),
        ("name,address,comment\nA,DB1.DBW0,one\u2028line\nB,DB1.DBW2,an\x85other\n", "A|DB1.DBW0|WORD B|DB1.DBW2|WORD"),
        ("# a list; of nodes7\nDB1,W0;A\n# off; now\nDB1,W2;B\n", "A|DB1.DBW0|WORD B|DB1.DBW2|WORD"),
    ],
)
def test_what_stands_before_or_in_a_table_does_not_hide_its_rows(content: str, rows: str, tmp_path: Path) -> None:
    path = tmp_path / "tags.csv"
    path.write_text(content, encoding="utf-8")
    assert text(load_tags([path])) == rows


def test_a_sheet_of_the_portal_and_its_constants_are_read_and_a_bomb_is_not(tmp_path: Path) -> None:
    path = workbook(tmp_path / "t.xlsx", [TIA_HEAD, tia_row("Start", "Bool", "%I0.0", "Кнопка")])
    assert load_tags([path]).tags[0].comment == "Кнопка"
    with zipfile.ZipFile(tmp_path / "bomb.xlsx", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("[Content_Types].xml", "<x/>")
        archive.writestr("xl/big.xml", b"\0" * (8 << 20))
    with pytest.raises(TagError, match="too much for a tag table"):
        load_tags([tmp_path / "bomb.xlsx"])


def test_a_tag_of_a_structured_type_is_laid_out_from_its_address(tmp_path: Path) -> None:
    table = workbook(tmp_path / "t.xlsx", [TIA_HEAD, tia_row("M1", '"Motor"', "%M10.0")])
    source = tmp_path / "motor.udt"
    source.write_text(TANK_AWL.partition("DATA_BLOCK")[0], encoding="utf-8")
    assert text(load_tags([table, source])) == "M1.speed|MD10|REAL M1.on|M14.0|BOOL"
    with pytest.raises(TagError, match="name its source"):
        load_tags([table])


def test_utf_16_with_a_mark_is_read(tmp_path: Path) -> None:
    path = tmp_path / "tags.csv"
    path.write_bytes(TANK.encode("utf-16"))
    assert load_tags([path]).tags[2].unit == "°C"


def test_a_type_that_two_files_declare_in_two_ways_is_a_mistake(tmp_path: Path) -> None:
    one = tmp_path / "one.udt"
    one.write_text('TYPE "T"\nSTRUCT\na : INT;\nEND_STRUCT\nEND_TYPE\n', encoding="utf-8")
    two = tmp_path / "two.udt"
    two.write_text(
        'TYPE "t"\nSTRUCT\n// the same\na : INT; // but for comments\nEND_STRUCT\nEND_TYPE\n', encoding="utf-8"
    )
    assert read_tags([one, two]).problems == []
    two.write_text('TYPE "T"\nSTRUCT\na : DINT;\nEND_STRUCT\nEND_TYPE\n', encoding="utf-8")
    assert [str(problem) for problem in read_tags([one, two]).problems] == [
        f"{two}:1: type 'T' is declared differently in {one}, line 1: which one is right?"
    ]


def test_what_is_converted_reads_back_to_the_same(tmp_path: Path) -> None:
    example_files(tmp_path)
    found = load_tags([tmp_path / "symbols.asc", tmp_path / "tank.awl", tmp_path / "plc_tags.xlsx"])
    again = load_tags([tank_file(tmp_path, "\n".join(table_lines(found.tags)), "again.csv")])
    rows = [
        [(tag.name, tag.address, tag.declared, tag.step, tag.unit, tag.comment) for tag in each.tags]
        for each in (found, again)
    ]
    assert rows[0] == rows[1]


@pytest.mark.parametrize("name", ["-K1", "=A1+S1-K1", "+B2;-K1", "@x", "'quoted'", "#1", 'plain, "x"; y'])
def test_a_name_reads_back_whatever_a_spreadsheet_would_take_it_for(name: str, tmp_path: Path) -> None:
    # Devices are called so (IEC 81346); in the table a formula is made harmless.
    tag = Tag(name, 0x84, 1, 0, "INT", "INT", 16)
    tag.comment, tag.factor, tag.shift = name, 0.5, -1e-05
    again = load_tags([tank_file(tmp_path, "\n".join(table_lines([tag])), "again.csv")]).tags[0]
    assert (again.name, again.comment, again.factor, again.shift) == (name, name, 0.5, -1e-05)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.binary(max_size=300))
def test_content_of_any_kind_gives_problems_and_no_errors(tmp_path: Path, octets: bytes) -> None:
    path = tmp_path / "any"
    path.write_bytes(octets)
    assert read_tags([path]).files


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    st.lists(
        st.sampled_from(
            [
                "DATA_BLOCK",
                "DB 1",
                "STRUCT",
                "END_STRUCT",
                ";",
                "a",
                ":",
                "INT",
                "ARRAY",
                "[1..2]",
                "OF",
                "BEGIN",
                "END_DATA_BLOCK",
                "'x'",
                "{",
                "}",
                "\n",
            ]
        )
    )
)
def test_tokens_of_a_source_in_any_order_give_problems_and_no_errors(tmp_path: Path, words: list[str]) -> None:
    path = tmp_path / "any.awl"
    path.write_text("DATA_BLOCK " + " ".join(words), encoding="utf-8")
    assert read_tags([path]).files


@pytest.mark.parametrize(
    ("written", "scale"),
    [
        ("", (1, 0)),
        ("0.1", (0.1, 0)),
        ("0.1-40", (0.1, -40)),
        ("1e-3", (0.001, 0)),
        ("2+1e2", (2, 100)),
        ("-2e-3-1e-5", (-0.002, -1e-5)),
        ("0..10 = 0..5", (0.5, 0)),
    ],
)
def test_a_scale_is_a_factor_and_a_shift(written: str, scale: tuple[float, float]) -> None:
    assert parse_scale(written) == scale


@pytest.mark.parametrize(
    "written", ["x", "0", "nan", "inf", "1e999", "0.1+nan", "0..1=0..inf", "1..1=0..5", "0..1=2", "--1"]
)
def test_a_scale_that_is_none_is_refused(written: str) -> None:
    with pytest.raises(ValueError, match="expected a factor"):
        parse_scale(written)
