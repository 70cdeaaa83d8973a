from __future__ import annotations

import ast
from collections import Counter
from pathlib import Path

import pytest

import dissect
from dissect.wire.codes import CodeTable, coded

TABLE = CodeTable("test", 2, [(0x04, "Read Var", "Reads."), (0x01, "", "Has no name."), (0xF0, "Setup", "")])


def test_a_known_number() -> None:
    row = TABLE.get(0x04)
    assert row is not None
    assert (row.number, row.name, row.text) == (4, "Read Var", "Reads.")
    assert repr(row) == "Code(0x4, 'Read Var')"
    assert (TABLE.name(4), TABLE.text(4), 4 in TABLE) == ("Read Var", "Reads.", True)


@pytest.mark.parametrize(
    ("digits", "number", "text"),
    [
        (2, 0x2F, "0x2f"),
        (2, 0, "0x00"),
        (4, 0x8104, "0x8104"),
        (4, 1, "0x0001"),
        (2, 0x12345, "0x12345"),
        (1, 9, "0x9"),
    ],
)
def test_an_unknown_number_names_itself(digits: int, number: int, text: str) -> None:
    table = CodeTable("test", digits, [(5, "known", "")])
    assert table.get(number) is None
    assert (table.name(number), table.text(number), table.hex(number), number in table) == (text, "", text, False)


def test_rows_keep_their_order() -> None:
    assert [row.number for row in TABLE] == [4, 1, 0xF0]
    assert TABLE.names() == {4: "Read Var", 1: "", 0xF0: "Setup"}
    assert len(TABLE) == 3


def test_no_table_of_the_package_has_a_row_twice() -> None:
    tables = 0
    for path in Path(dissect.__file__).parent.rglob("*.py"):
        source = path.read_bytes()
        if b"CodeTable(" not in source:
            continue  # most modules: walking them all takes seconds
        for node in ast.walk(ast.parse(source)):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "CodeTable":
                rows = node.args[2] if len(node.args) > 2 else None
                if isinstance(rows, ast.List):
                    numbers = Counter(ast.unparse(row.elts[0]) for row in rows.elts if isinstance(row, ast.Tuple))
                    assert [number for number, times in numbers.items() if times > 1] == [], (
                        f"{path.name}:{node.lineno}"
                    )
                    tables += 1
    assert tables > 10


def test_a_code_with_its_name() -> None:
    assert coded("0x04", TABLE.name(4)) == "0x04 Read Var"
    assert coded("0x05", TABLE.name(5)) == "0x05 (unknown code)"
    assert [TABLE.coded(number) for number in (4, 5)] == ["0x04 Read Var", "0x05 (unknown code)"]
