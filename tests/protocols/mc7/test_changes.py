"""Two versions of a block, in the words of its code."""

from __future__ import annotations

import time

from dissect.protocols.mc7.block import Block, parse_block
from dissect.protocols.mc7.changes import change_lines, change_values, compare_blocks, only_stamps
from dissect.protocols.mc7.hazards import (
    is_safety,
    new_output_writes,
    new_system_calls,
    newly_skipped_calls,
    older_than,
    summary,
    system_calls,
)
from dissect.protocols.mc7.source import assemble_block
from tests.cases import each
from tests.protocols.mc7.samples import OB1_SOURCE, TIME_1, TIME_2, fb7, ob1

_EXTRA = "NETWORK 9\n       A     I 7.0\n       =     Q 7.0\n"


def changed(*replacements: tuple[str, str]) -> Block:
    source = OB1_SOURCE
    for old, new in replacements:
        assert old in source, old
        source = source.replace(old, new, 1)
    return parse_block(assemble_block(source))


def lines(after: Block, before: Block | None = None) -> list[str]:
    return change_lines("OB1", compare_blocks(before or parse_block(ob1()), after))


def test_a_changed_time_value_is_one_line() -> None:
    assert lines(parse_block(ob1("10S"))) == ["OB1 network 2: L S5T#35S → S5T#10S"]


def test_stamps_and_checksum_have_their_own_sentence() -> None:
    after = parse_block(ob1("35S", TIME_2, 0x9999))
    assert only_stamps(compare_blocks(parse_block(ob1()), after))
    assert lines(after) == [
        "OB1: only time stamps or checksum changed, code and interface are the same",
        "OB1 time: checksum 0x1234 → 0x9999",
        "OB1 time: code 2026-02-04 12:00:00.000 → 2026-02-05 12:03:53.280",
    ]
    assert lines(parse_block(ob1())) == ["OB1: no change"]


@each(
    ("old", "new", "expected"),
    [
        ("NETWORK 3\n", f"{_EXTRA}NETWORK 3\n", ["OB1 network 3 added (2 instructions)"]),
        ("       JU    M3_2\n", "", ["OB1 network 3: JU label removed"]),
        ("JCN   M3_1", "JCN   M3_2", ["OB1 network 3: JCN goes to a different place"]),
        ("JCN   M3_1", "JC    M3_1", ["OB1 network 3: JCN label removed", "OB1 network 3: JC label added"]),
        ("L     DBW 2", "L     DBW 4", ["OB1 network 5: L DB10.DBW 2 → DB10.DBW 4"]),
        (
            "OPN   DB 10",
            "OPN   DB 11",
            ["OB1 network 5: L DB10.DBW 2 → DB11.DBW 2", "OB1 network 5: A DB10.DBX 4.0 → DB11.DBX 4.0"],
        ),
        ("L     MW 30", "L     MW 32", [
            "OB1 network 4: CALL FC 5 (P1 := MW 30, P2 := P#M 40.0) → FC 5 (P1 := MW 32, P2 := P#M 40.0)",
        ]),
        ("A     I 0.0\n", "A     I 0.0\n       UC    SFC 46 ()\n", [
            "OB1 network 1: UC SFC 46 () added", "OB1 calls: SFC46 is called now",
        ]),
        ('author = "plant"', 'author = "other"', ["OB1 header: author plant → other"]),
        ("language = 1", "language = 2", ["OB1 header: language AWL/STL → KOP/LAD"]),
        ("TEMP INT\nTEMP DATE", "TEMP REAL\nTEMP DATE", ["OB1 interface: TEMP8 INT → REAL"]),
        ("TEMP DATE_AND_TIME\n", "TEMP DATE_AND_TIME\nTEMP BOOL\n", ["OB1 interface: TEMP10 : BOOL added"]),
    ],
)  # fmt: skip
def test_each_change_is_said_in_the_words_of_the_code(old: str, new: str, expected: list[str]) -> None:
    assert lines(changed((old, new))) == expected


def test_networks_that_come_go_and_move() -> None:
    network = OB1_SOURCE[OB1_SOURCE.index("NETWORK 1\n") : OB1_SOURCE.index("NETWORK 2\n")]
    assert lines(changed((network, ""))) == ["OB1 network 1 removed (4 instructions)"]
    moved = changed((network, ""), ("NETWORK 5\n", f"{network}NETWORK 5\n"))
    assert lines(moved) == ["OB1 network 4: moved here, was network 1"]


def test_temporaries_and_offsets_of_the_compiler_do_not_count() -> None:
    after = changed(
        (
            "=     L 20.0\n       L     MW 30\n       T     LW 22",
            "=     L 24.0\n       L     MW 30\n       T     LW 26",
        ),
        ("P#V 22.0", "P#V 26.0"),
        ("NETWORK 1\n", "NETWORK 1\n       NOP   0\n"),
    )
    assert lines(after) == [
        "OB1 header: only bytes without meaning for the program changed (tables, encoding or rests of the compiler)"
    ]


def test_values_of_a_data_block_are_compared_by_declaration() -> None:
    source = (
        "[header]\nunknown_mark = 1\nlanguage = 5\nblock_kind = 10\nblock_number = 3\n\n[interface]\nkind = 5\n"
        "STAT INT\nSTAT BOOL\nSTAT REAL\nSTAT STRING[4]\nSTAT ARRAY [1..2] OF\n  STAT BYTE\n\n"
        "[values]\n{}\n\n[footer]\nversion = 10\n"
    )
    before = parse_block(assemble_block(source.format("000501004120000004024f4b00000102")))
    after = parse_block(assemble_block(source.format("0007010041a0000004024f4b00000103")))
    assert change_lines("DB3", compare_blocks(before, after)) == [
        "DB3 values: STAT0 (0.0) 5 → 7",
        "DB3 values: STAT2 (4.0) 1.000000e+001 → 2.000000e+001",
        "DB3 values: STAT4[2] (15.0) B#16#2 → B#16#3",
    ]


def test_changes_as_json() -> None:
    (value,) = change_values(compare_blocks(parse_block(ob1()), parse_block(ob1("10S"))))
    assert value == {
        "about": "network", "network": 2, "before": "L S5T#35S", "after": "L S5T#10S", "text": "L S5T#35S → S5T#10S",
    }  # fmt: skip


def test_texts_of_the_wire_are_escaped() -> None:
    octets = bytearray(ob1())
    octets[-36:-28] = b"\x1b[31mx\x07\0"
    assert lines(parse_block(bytes(octets))) == ["OB1 header: author plant → \\x1b[31mx\\x07"]


def test_long_blocks_are_compared_in_bounded_time() -> None:
    def block(first: str, second: str) -> Block:
        body = "".join(f"       A     I {n % 50}.{n % 8}\n       {first if n % 3 else second}\n" for n in range(4000))
        source = OB1_SOURCE[: OB1_SOURCE.index("NETWORK 1")] + "NETWORK 1\n" + body + "       BE\n"
        return parse_block(assemble_block(source + OB1_SOURCE[OB1_SOURCE.index("\n[tables]") :]))

    begin = time.process_time()
    found = compare_blocks(block("=     Q 1.0", "=     Q 2.0"), block("=     Q 3.0", "S     Q 2.0"))
    assert found
    assert time.process_time() - begin < 20


def test_calls_that_stop_delete_or_copy_are_seen() -> None:
    before = parse_block(ob1())
    after = changed(
        ("A     I 0.0\n", "A     I 0.0\n       UC    SFC 46 ()\n       UC    SFC 20 (P#V 0.0, P#V 4.0, P#V 8.0)\n")
    )
    assert [call.text for call in system_calls(after)] == [
        "OB1 network 1 calls SFC46 STP, which stops the CPU",
        "OB1 network 1 calls SFC20 BLKMOV, which copies memory to an address it is given",
    ]
    assert system_calls(before) == []
    assert [call.number for call in new_system_calls(before, after)] == [46, 20]
    assert new_system_calls(after, after) == []


def test_new_writes_to_outputs_are_seen() -> None:
    before = parse_block(ob1())
    after = changed(("NETWORK 3\n", f"{_EXTRA}NETWORK 3\n"))
    assert [(use.address, use.network) for use in new_output_writes(before, after)] == [("Q 7.0", 3)]
    assert new_output_writes(before, before) == []
    assert new_output_writes(after, before) == []


def test_a_new_jump_over_a_call_is_seen() -> None:
    before = parse_block(ob1())
    after = changed(
        ("NETWORK 4\n", "NETWORK 4\n       JU    over\n"),
        ("       CDB\n       BLD   4\n", "       CDB\n       BLD   4\nover:  NOP   0\n"),
    )
    found = newly_skipped_calls(before, after, frozenset({"FB7"}))
    assert [(each.jump, each.callee, each.safety) for each in found] == [("JU", "FC5", False), ("JU", "FB7", True)]
    assert newly_skipped_calls(after, after) == []
    assert not is_safety(parse_block(fb7()))


def test_older_code_that_replaces_newer_is_seen() -> None:
    first, second = parse_block(ob1("35S", TIME_1)), parse_block(ob1("35S", TIME_2))
    assert older_than(second, first) == "code of 2026-02-04 12:00:00.000 replaces code of 2026-02-05 12:03:53.280"
    assert older_than(first, second) == ""
    assert older_than(first, parse_block(b"")) == ""


def test_a_summary_has_three_lines() -> None:
    after = changed(("OPN   DB 10", "OPN   DB 11"), ("S5T#35S", "S5T#10S"), ("A     I 0.1", "A     I 0.2"))
    assert summary("OB1", compare_blocks(parse_block(ob1()), after)) == [
        "OB1 network 2: A I 0.1 → I 0.2", "OB1 network 2: L S5T#35S → S5T#10S", "OB1: and 2 more changes",
    ]  # fmt: skip
    assert summary("OB1", compare_blocks(parse_block(ob1()), parse_block(ob1("35S", TIME_2)))) == []
