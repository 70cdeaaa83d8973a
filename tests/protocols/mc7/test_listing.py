"""Blocks as STL and AWL, with names, folded calls and the cross-reference."""

from __future__ import annotations

import json

from dissect.protocols.mc7.block import Block, parse_block
from dissect.protocols.mc7.folding import Callee
from dissect.protocols.mc7.listing import AWL, STL, Lister, block_lines, block_values, no_names
from dissect.protocols.mc7.source import assemble_block
from dissect.protocols.mc7.usage import cross_reference, cross_reference_lines, cross_reference_values, uses
from dissect.protocols.mc7.values import block_data
from tests.cases import each
from tests.protocols.mc7.samples import OB1_SOURCE, ob1, program


def known(blocks: list[Block]) -> Callee:
    table = {(block.kind, block.number): block for block in blocks}
    return lambda kind, number: table.get((kind, number))


def names(area: int, db: int, bit: int, bits: int) -> str:
    return {(0x81, 0, 0, 1): "start", (0x84, 10, 16, 16): "level\x1b", (0x1D, 0, 64, 16): "pulse"}.get(
        (area, db, bit, bits), ""
    )


def listed(block: Block, language: str = STL, folded: bool = True) -> list[str]:
    lister = Lister(language, names, known(program()), folded)
    return [" ".join(line.split()) for line in block_lines(block, lister)]


def test_a_block_reads_as_stl() -> None:
    lines = listed(parse_block(ob1()))
    assert lines[0] == 'ORGANIZATION_BLOCK OB1 "cycle" (AWL/STL, version 1.0, author plant, family demo)'
    assert "interface (names do not travel with a block: numbered by section)" in lines
    assert "TEMP9 : DATE_AND_TIME L 12.0" in lines
    assert "A I 0.0 // start" in lines
    assert "SD T 4 // pulse" in lines
    assert "L DBW 2 // level\\x1b" in lines
    assert "M3_1: L 0" in lines
    assert "JCN M3_1" in lines
    assert "CALL FC 5 (IN0 := MW 30, OUT0 => M 40.0)" in lines
    assert "CALL FB 7, DB7 (IN0 := MW 50, OUT0 => MW 52)" in lines
    assert not [line for line in lines if line.startswith("!")]


def test_a_block_reads_as_awl() -> None:
    lines = listed(parse_block(ob1()), AWL)
    for line in (
        "U E 0.0 // start",
        "UN T 4 // pulse",
        "SE T 5",
        "= A 4.0",
        "SPBN M3_1",
        "SPA M3_2",
        "AUF DB 10",
        "T AW 6",
    ):
        assert line in lines


def test_calls_stay_as_they_are_where_nobody_asks_for_folding() -> None:
    lines = listed(parse_block(ob1()), STL, folded=False)
    assert "UC FC 5 (P#V 22.0, P#M 40.0)" in lines
    assert "BLD 1" in lines


@each(
    ("old", "new"),
    [
        ("       UC    FC 5 (", "       +     1\n       UC    FC 5 ("),  # more than an expansion does
        ("       L     MW 30\n", "       L     MW 30\n       T     LW 26\n       L     MW 30\n"),  # moved for nobody
        ("       T     LW 22\n", "       T     LW 22\nhere:  NOP   0\n       JU    here\n"),
        ("       BLD   2\n", ""),
        ("       UC    FC 5 (P#V 22.0, P#M 40.0)\n", ""),
        ("       UC    FC 5 (", "       UC    FC 6 (P#V 22.0)\n       UC    FC 5 ("),
    ],
)
def test_what_is_more_than_a_call_is_not_folded(old: str, new: str) -> None:
    assert old in OB1_SOURCE
    lines = listed(parse_block(assemble_block(OB1_SOURCE.replace(old, new, 1))))
    assert not [line for line in lines if line.startswith("CALL FC")]
    assert [line for line in lines if line.startswith("CALL FB 7")]


def test_pointers_in_local_data_are_put_together() -> None:
    body = (
        "       BLD   1\n       =     L 20.0\n       L     W#16#1002\n       T     LW 22\n       L     8\n       T     LW 24\n"
        "       L     50\n       T     LW 26\n       L     P#DBX 4.0\n       T     LD 28\n       L     60\n       T     LW 32\n"
        "       L     P#DBX 6.0\n       T     LD 34\n       UC    FC 9 (P#V 22.0, P#V 32.0, P#V 0.0)\n       L     LW 0\n"
        "       OPN   DB 3\n       T     DBW 8\n       BLD   2\n"
    )
    source = OB1_SOURCE.replace("NETWORK 4\n", f"NETWORK 4\n{body}")
    lines = listed(parse_block(assemble_block(source)))
    assert "CALL FC 9 (P1 := P#DB50.DBX 4.0 BYTE 8, P2 := P#DB60.DBX 6.0, P3 => DB3.DBW 8)" in lines


def test_a_block_as_json_says_the_same() -> None:
    blocks = program()
    values = block_values(blocks[0], Lister(STL, names, known(blocks)))
    json.dumps(values)
    assert (values["block"], values["number"], values["protected"], values["facts"]) == ("OB1", 1, False, [])
    networks = values["networks"]
    assert isinstance(networks, list)
    call = networks[3]["instructions"][0]
    assert call["call"] == {
        "block": "FC5",
        "instance": None,
        "arguments": [
            {"name": "IN0", "given": "MW 30", "taken": None}, {"name": "OUT0", "given": None, "taken": "M 40.0"},
        ],
    }  # fmt: skip
    assert networks[0]["instructions"][0] == {
        "offset": 0, "label": None, "name": "A", "operand": "I 0.0", "tag": "start", "octets": "c000",
    }  # fmt: skip


def test_a_damaged_block_shows_what_could_be_read() -> None:
    lines = listed(parse_block(ob1()[:120]))
    assert "A I 0.0 // start" in lines
    assert [line for line in lines if line.startswith("! 120 of 253 bytes")]
    lines = listed(parse_block(b"MZ" + bytes(80)))
    assert lines[-1].startswith("! not a block: expected the mark 70 70")


def test_the_cross_reference_says_who_reads_and_writes_what() -> None:
    lines = [" ".join(line.split()) for line in cross_reference_lines(program())]
    assert "Q 4.0 write: OB1 network 2" in lines
    assert "MW 22 write: OB1 network 3 (2 times)" in lines
    assert "DB10.DBW 2 read: OB1 network 5" in lines
    assert "T 4 write: OB1 network 2; read: OB1 network 1, OB1 network 2" in lines
    # Given to FC 5, whose interface says that it is an output.
    assert "M 40.0 write: OB1 network 4" in lines
    assert "FC5 called by: OB1 network 4" in lines
    values = cross_reference_values(program())
    json.dumps(values)
    calls = values["calls"]
    assert isinstance(calls, list)
    assert [(call["callee"], call["block"]) for call in calls] == [("FB7", "OB1"), ("FC5", "OB1")]


def test_what_is_given_to_an_unknown_block_is_said_to_be() -> None:
    found = [use for use in uses(parse_block(ob1())) if use.address == "M 40.0"]
    assert [(use.access, use.network) for use in found] == [("given to a block", 4)]


def test_a_block_opened_at_run_time_has_no_number() -> None:
    block = parse_block(assemble_block(OB1_SOURCE.replace("OPN   DB 10", "OPN   DB [MW 90]")))
    found, _ = cross_reference([block])
    # DB 7 is the instance of the FB that network 4 calls.
    assert [(use.address, use.db) for use in found if use.area == "DB"] == [
        ("DBW 2", -1), ("DBX 4.0", -1), ("DB7.DBW 0", 7), ("DB7.DBW 2", 7),
    ]  # fmt: skip


def test_values_of_a_data_block() -> None:
    source = (
        "[header]\nunknown_mark = 1\nlanguage = 5\nblock_kind = 10\nblock_number = 3\n\n[interface]\nkind = 5\n"
        "STAT INT\nSTAT BOOL\nSTAT BOOL\nSTAT STRUCT\n  STAT TIME\n  STAT CHAR\nSTAT ARRAY [1..2, 0..1] OF\n  STAT BYTE\n"
        "STAT STRING[4]\n\n[values]\n0005020000000fa041000102030404024f4b0000\n\n[footer]\nversion = 10\n"
    )
    values = block_data(parse_block(assemble_block(source)))
    assert [(value.name, value.bit // 8, value.bit % 8, value.type, value.text) for value in values] == [
        ("STAT0", 0, 0, "INT", "5"),
        ("STAT1", 2, 0, "BOOL", "FALSE"),
        ("STAT2", 2, 1, "BOOL", "TRUE"),
        ("STAT3.m0", 4, 0, "TIME", "T#4S"),
        ("STAT3.m1", 8, 0, "CHAR", "'A'"),
        ("STAT4", 10, 0, "ARRAY [1..2,0..1] OF BYTE", "01020304"),
        ("STAT5", 14, 0, "STRING[4]", "'OK'"),
    ]
    assert no_names(0, 0, 0, 0) == ""
