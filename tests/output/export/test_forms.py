"""Every form, read back by the tools it is for: the same rows in all of them."""

from __future__ import annotations

import csv
import json
import sqlite3
from pathlib import Path
from typing import Any, Final

import duckdb
import pandas
import polars
import pyarrow
import pyarrow.parquet
import pytest

from dissect import analyze
from dissect.output.export.forms import FORMS, ExportRequest, TableExport, UnknownFormError, target_of
from dissect.output.export.tables import TABLES, TIME, UnknownTableError
from tests.cli.support import run
from tests.meaning.report.support import ROOT
from tests.output.export.support import rows_of
from tests.promises import hostile

Capture = pytest.CaptureFixture[bytes]
ERRORS: Final = ROOT / "captures" / "item-errors.pcapng"
TRANSFER: Final = ROOT / "captures" / "transfer.pcapng"


def write(capfdbinary: Capture, *words: str | Path) -> None:
    ran = run(capfdbinary, "export", *words)
    assert ran.code == 0, ran.err


def sqlite_rows(path: Path, table: str) -> list[tuple[Any, ...]]:
    with sqlite3.connect(path) as database:
        return list(database.execute(f'SELECT * FROM "{table}" ORDER BY rowid'))


def test_all_forms_hold_the_same_rows(capfdbinary: Capture, tmp_path: Path) -> None:
    for ending in ("parquet", "duckdb", "sqlite", "csv", "arrow"):
        write(capfdbinary, ERRORS, "-o", tmp_path / f"out.{ending}")
    database = duckdb.connect(str(tmp_path / "out.duckdb"), read_only=True)
    expected, analysis = rows_of(ERRORS), analyze(ERRORS)
    for name, table in TABLES.items():
        parquet = tmp_path / "out.parquet" / f"{name}.parquet"
        counts = {
            len(expected[name]),
            database.execute(f'SELECT count(*) FROM "{name}"').fetchone()[0],
            database.execute(f"SELECT count(*) FROM '{parquet}'").fetchone()[0],
            len(sqlite_rows(tmp_path / "out.sqlite", name)),
            len(pandas.read_parquet(parquet)),
            len(pandas.read_feather(tmp_path / "out.arrow" / f"{name}.arrow")),
            polars.read_parquet(parquet).height,
            polars.read_ipc(tmp_path / "out.arrow" / f"{name}.arrow").height,
            len(pandas.read_csv(tmp_path / "out.csv" / f"{name}.csv")),
        }
        assert counts == {len(expected[name])}, name
        columns = [column.name for column in table.columns]
        assert pyarrow.parquet.read_schema(parquet).names == columns
        again = polars.read_parquet(parquet).select([column.name for column in table.stored]).rows(named=True)
        assert again == expected[name]
        described = database.execute(f'DESCRIBE "{name}"').fetchall()
        assert [row[0] for row in described] == columns
        assert {row[1] for row in described if table.columns[columns.index(row[0])].type == TIME} <= {"TIMESTAMPTZ_NS"}
    assert len(expected["transactions"]) == analysis.total > 0
    database.close()
    mark = json.loads((tmp_path / "out.parquet" / "s7dissect.json").read_text())
    assert mark["rows"] == {name: len(rows) for name, rows in expected.items()}
    assert not list(tmp_path.glob(".*"))


def test_times_are_exact_in_every_form(capfdbinary: Capture, tmp_path: Path) -> None:
    for ending in ("parquet", "sqlite", "csv"):
        write(capfdbinary, ERRORS, "-o", tmp_path / f"t.{ending}", "--only", "transactions")
    first = rows_of(ERRORS)["transactions"][0]["ts_ns"]
    text = pandas.Timestamp(first).isoformat()
    with (tmp_path / "t.csv").open(encoding="utf-8", newline="") as file:
        row = next(csv.DictReader(file))
    assert (row["ts_ns"], row["ts"]) == (str(first), f"{text}Z")
    with sqlite3.connect(tmp_path / "t.sqlite") as database:
        assert database.execute("SELECT ts, ts_ns FROM transactions").fetchone() == (f"{text}Z", first)
        assert database.execute("PRAGMA user_version").fetchone() == (2,)
    assert pandas.read_parquet(tmp_path / "t.parquet")["ts"][0] == pandas.Timestamp(first, tz="UTC")


def test_several_captures_are_divided_by_day(capfdbinary: Capture, tmp_path: Path) -> None:
    old = ROOT / "captures" / "crafted" / "plus-plant.pcapng"
    out = tmp_path / "plant.parquet"
    write(capfdbinary, TRANSFER, ERRORS, old, "-o", out)
    days = {path.name for path in (out / "transactions").iterdir()}
    assert days == {"day=2026-11-21", "day=2023-11-14"}
    expected = rows_of(TRANSFER, ERRORS, old)
    for name, rows in expected.items():
        found = duckdb.sql(f"SELECT count(*) FROM read_parquet('{out}/{name}/**', hive_partitioning=true)").fetchall()
        assert found == [(len(rows),)], name
    source = f"read_parquet('{out}/transactions/**', hive_partitioning=true)"
    days_of = duckdb.sql(
        f"SELECT DISTINCT day::VARCHAR, strftime(ts AT TIME ZONE 'UTC', '%Y-%m-%d') FROM {source}"
    ).fetchall()
    assert len(days_of) == 2
    assert all(day == real for day, real in days_of)


def test_memory_is_handed_on_as_row_groups_fill(tmp_path: Path) -> None:
    from dissect.output.export.parquet import ROW_GROUP, ParquetSink

    table = TABLES["items"]
    (row,) = [tuple(row.values()) for row in rows_of(ERRORS)["items"][:1]]
    sink = ParquetSink(tmp_path / "items.parquet", [table], True, False, {})
    for _ in range(31):
        sink.take(table, [row] * 8192)
    written = (tmp_path / "items.parquet").stat().st_size
    assert written > 1000  # the first group is in the file when the second begins to be written
    sink.close()
    file = pyarrow.parquet.ParquetFile(tmp_path / "items.parquet")
    assert file.metadata.num_rows == 31 * 8192
    assert file.metadata.num_row_groups == 3
    assert file.metadata.row_group(0).num_rows == ROW_GROUP
    assert file.metadata.row_group(0).column(0).compression == "ZSTD"
    group = file.metadata.row_group(2)
    columns = [group.column(number) for number in range(group.num_columns)]
    ranged = {column.path_in_schema for column in columns if column.statistics is not None}
    assert ranged == {"ts", "ts_ns"}  # what a reader leaves out row groups by


def test_what_goes_wrong_while_a_row_group_is_written_is_raised(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A thread writes it: the next row group, or the end of the file, hears of it."""
    from dissect.output.export.arrow import Batches
    from dissect.output.export.parquet import ParquetFile

    batches = Batches(TABLES["devices"])
    for end in (ParquetFile.write, ParquetFile.close):
        file = ParquetFile(tmp_path / "devices.parquet", batches)

        def full(*_: object, **__: object) -> None:
            raise OSError(28, "No space left on device")

        monkeypatch.setattr(file._writer, "write_table", full)
        file.add(pyarrow.RecordBatch.from_pylist([{}], batches.schema))
        file.write()
        file.add(pyarrow.RecordBatch.from_pylist([{}], batches.schema))
        with pytest.raises(OSError, match="No space left"):
            end(file)
        file.abandon()


def test_naughty_strings_come_back_as_they_were(capfdbinary: Capture, tmp_path: Path) -> None:
    path = hostile.write(tmp_path / "hostile.pcapng")
    expected = rows_of(path)
    for ending in ("parquet", "duckdb", "sqlite", "csv", "arrow"):
        form, place, folder = target_of(str(tmp_path / f"out.{ending}"), [], 1)
        if folder:
            Path(place).mkdir()
        export = form.open(ExportRequest(Path(place), folder, [], [str(path)], "0"))
        assert isinstance(export, TableExport)
        for name, rows in expected.items():
            export.sink.take(TABLES[name], [tuple(row.values()) for row in rows])
        export.close()
    database = duckdb.connect(str(tmp_path / "out.duckdb"), read_only=True)
    with sqlite3.connect(tmp_path / "out.sqlite") as lite:
        for name, text in (
            ("operations", "subject"),
            ("findings", "detail"),
            ("items", "text"),
            ("transactions", "about"),
        ):
            wanted = [row[text] for row in expected[name]]
            assert [row[0] for row in database.execute(f"SELECT {text} FROM {name}").fetchall()] == wanted
            assert [row[0] for row in lite.execute(f"SELECT {text} FROM {name} ORDER BY rowid")] == wanted
            assert polars.read_parquet(tmp_path / "out.parquet" / f"{name}.parquet")[text].to_list() == wanted
            assert polars.read_ipc(tmp_path / "out.arrow" / f"{name}.arrow")[text].to_list() == wanted
    database.close()
    cells = 0
    for file in (tmp_path / "out.csv").glob("*.csv"):
        content = file.read_bytes()
        assert not set(content) & {*range(10), 11, 12, *range(14, 32), 127}
        with file.open(encoding="utf-8", newline="") as lines:
            for row in csv.reader(lines):
                for value in row:
                    assert not value.startswith(("=", "+", "@", "\t")), value
                    cells += value.startswith("'")
    assert cells > 5


def test_forms_by_ending_and_by_prefix() -> None:
    assert target_of("a.parquet", [], 1)[1:] == ("a.parquet", True)
    assert target_of("a.parquet", ["items"], 1)[1:] == ("a.parquet", False)
    assert target_of("a.parquet", ["items"], 2).folder
    assert target_of("parquet:a", ["items"], 1)[1:] == ("a", True)
    assert target_of("C:\\x\\a.DB", [], 1)[0].name == "sqlite"
    assert target_of("dir.csv/", [], 1)[0].name == "csv"
    for form in FORMS:
        with pytest.raises(UnknownFormError, match="not written to standard output"):
            target_of(f"{form}:-", [], 1)
    with pytest.raises(UnknownFormError, match=r"Write s3://bucket/dir\.parquet or parquet:s3://bucket/dir"):
        target_of("s3://bucket/dir/", [], 1)
    assert target_of("parquet:s3://bucket/dir", [], 1).path == "s3://bucket/dir"
    with pytest.raises(UnknownFormError, match=r"Did you mean \.parquet"):
        target_of("a.parqet", [], 1)
    with pytest.raises(UnknownFormError, match="Did you mean sqlite"):
        target_of("sqllite:a", [], 1)
    with pytest.raises(UnknownFormError, match="names no file"):
        target_of("csv:", [], 1)
    with pytest.raises(UnknownTableError, match=r"no part .* in .*Did you mean operations"):
        target_of("a.csv", ["operation"], 1)
    assert all(form.endings or form.parts for form in FORMS.values())
