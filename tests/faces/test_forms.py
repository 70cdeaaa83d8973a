"""The forms of the tables say the same, row by row: Parquet, Arrow, DuckDB, SQLite, CSV, SQL over captures, and frames.

They are written with the rows of all captures of the project, and read back by somebody else's reader.
"""

from __future__ import annotations

import csv
import json
import math
import re
import sqlite3
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import pytest

import dissect
from dissect.output.export.sql import MemorySink, Query
from dissect.output.export.tables import BOOL, BYTES, INT, INTS, REAL, TABLES, WORDS, Column, Table
from tests.cli.support import run
from tests.faces.gathering import Gathered
from tests.faces.reading import CAPTURES

Rows = list[dict[str, Any]]


def _arrow(found: Any) -> Rows:
    return list(found.to_pylist())


def parquet(folder: Path, table: Table) -> Rows:
    reader = pytest.importorskip("pyarrow.parquet")
    return _arrow(reader.read_table(folder / "parquet" / f"{table.name}.parquet"))


def arrow(folder: Path, table: Table) -> Rows:
    reader = pytest.importorskip("pyarrow.feather")
    return _arrow(reader.read_table(folder / "arrow" / f"{table.name}.arrow"))


def duckdb(folder: Path, table: Table) -> Rows:
    with pytest.importorskip("duckdb").connect(str(folder / "rows.duckdb"), read_only=True) as base:
        names = ", ".join([f'"{column.name}"' for column in table.stored])
        found = base.execute(f'SELECT {names} FROM "{table.name}"').fetchall()
    return [dict(zip([column.name for column in table.stored], row, strict=True)) for row in found]


def sqlite(folder: Path, table: Table) -> Rows:
    with sqlite3.connect(folder / "rows.sqlite") as base:
        base.row_factory = sqlite3.Row
        found = [dict(row) for row in base.execute(f'SELECT * FROM "{table.name}"')]
    base.close()
    return [_typed(row, table, _of_sqlite) for row in found]


def _of_sqlite(column: Column, value: Any) -> Any:
    if column.type in {INTS, WORDS}:
        return json.loads(value)
    return bool(value) if column.type == BOOL else value


def csv_files(folder: Path, table: Table) -> Rows:
    with (folder / "csv" / f"{table.name}.csv").open(encoding="utf-8", newline="") as file:
        return [_typed(row, table, _of_csv) for row in csv.DictReader(file)]


def _of_csv(column: Column, text: str) -> Any:
    """Return the value of a cell; of lists and texts that spreadsheets would take for formulas there is a test of their own."""
    if column.type in {INTS, WORDS}:
        return json.loads(text) if text else []
    if text == "":
        return None
    if column.type == BOOL:
        return {"true": True, "false": False}[text]
    if column.type == BYTES:
        return bytes.fromhex(text)
    return int(text) if column.type == INT else float(text) if column.type == REAL else text


def _typed(row: dict[str, Any], table: Table, read: Callable[[Column, Any], Any]) -> dict[str, Any]:
    return {
        column.name: None if row[column.name] is None else read(column, row[column.name]) for column in table.stored
    }


FORMS: Final[dict[str, Callable[[Path, Table], Rows]]] = {
    "parquet": parquet,
    "arrow": arrow,
    "duckdb": duckdb,
    "sqlite": sqlite,
    "csv": csv_files,
}


def same(value: Any, told: Any) -> bool:
    """Return whether a form has a value; not-a-number equals itself here."""
    if isinstance(value, float) and isinstance(told, float) and math.isnan(value):
        return math.isnan(told)
    return bool(value == told)


def of_csv(value: Any) -> Any:
    """Return what CSV can say of a value: texts as cells of a spreadsheet, empty ones as nothing."""
    if isinstance(value, str):
        shown = re.sub("[\x00-\x1f\x7f-\x9f]", lambda found: f"\\x{ord(found[0]):02x}", value)
        return (f"'{shown}" if shown.startswith(("=", "+", "-", "@")) else shown) or None
    return None if value == b"" else value


@pytest.mark.parametrize("name", TABLES)
@pytest.mark.parametrize("form", FORMS)
def test_a_form_has_the_rows_of_a_table(project: Gathered, form: str, name: str) -> None:
    assert project.forms is not None
    wanted = project.rows[name]
    told = FORMS[form](project.forms, TABLES[name])
    assert len(told) == len(wanted) > 0
    wrong = []
    for number, (row, theirs) in enumerate(zip(wanted, told, strict=True)):
        for column, value in row.items():
            if not same(of_csv(value) if form == "csv" else value, theirs[column]):
                wrong.append((number, column, value, theirs[column]))
    assert not wrong, f"{len(wrong)} cells of {form} differ: {wrong[:5]}"


def test_sql_and_frames_have_the_rows_of_the_tables(project: Gathered) -> None:
    """SQL over captures reads the same memory as frames do; an export is not needed for either."""
    pytest.importorskip("duckdb")
    sink = MemorySink(list(TABLES.values()))
    for name, table in TABLES.items():
        sink.take(table, [tuple(row.values()) for row in project.rows[name]])
    made = sink.tables()
    for name, table in TABLES.items():
        names = [column.name for column in table.stored if column.type != BYTES]
        columns = ", ".join([f'"{one}"' for one in names])
        result = Query(f'SELECT {columns} FROM "{name}"').run(made)
        told = list(result.rows())
        result.close()
        wanted = [[row[one] for one in names] for row in project.rows[name]]
        assert len(told) == len(wanted)
        assert [(number, row) for number, row in enumerate(wanted) if not all(map(same, row, told[number]))][:3] == []


SMALL: Final = CAPTURES / "item-errors.pcapng"


def test_the_commands_say_what_the_forms_have(project: Gathered, capfdbinary: pytest.CaptureFixture[bytes]) -> None:
    """`sql` and `dissect.frames` read a capture themselves: for one of them both have the rows that the forms have of it."""
    pytest.importorskip("duckdb")
    wanted = [row for row in project.rows["items"] if row["ts_ns"] in _times(project)]
    lines = run(capfdbinary, "sql", "-T", "jsonl", "SELECT * EXCLUDE (data, ts) FROM items", SMALL).out.splitlines()
    told = [json.loads(line) for line in lines]
    assert [{name: row[name] for name in told[0]} for row in wanted] == told
    frame = dissect.frames(SMALL, library="arrow")["items"].to_pylist()
    assert [{name: row[name] for name in wanted[0]} for row in frame] == wanted


def _times(project: Gathered) -> set[int]:
    """Return the times of the transactions of the small capture, which no other one shares."""
    return {row["ts_ns"] for row in project.rows["transactions"] if row["file"] == str(SMALL)}


def test_both_forms_of_the_logs_of_zeek_have_the_same_rows(project: Gathered) -> None:
    compared = 0
    for capture, logs in project.logs.items():
        names = {name.partition(".")[2] for name in logs}
        for name in names:
            assert logs[f"zeek.{name}"] == logs[f"zeek-json.{name}"], (capture, name)
            compared += len(logs[f"zeek.{name}"])
    assert compared > 10_000
