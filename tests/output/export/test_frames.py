"""Data frames of pandas and polars."""

from __future__ import annotations

import json
import sys
from typing import Any, Final

import pytest

import dissect
from dissect.output.export.arrow import Batches
from dissect.output.export.frames import PackedTables
from dissect.output.export.tables import TABLES
from dissect.output.export.value_columns import shown
from tests.meaning.report.support import ROOT
from tests.output.export.support import rows_of

ERRORS: Final = ROOT / "captures" / "item-errors.pcapng"
WRITE: Final = ROOT / "captures" / "nodes7-write.pcapng"


def test_frames_hold_the_rows_of_the_tables() -> None:
    expected = rows_of(ERRORS)
    panda, polar = dissect.frames(ERRORS), dissect.frames(ERRORS, library="polars")
    assert list(panda) == list(polar) == list(TABLES)
    for name, rows in expected.items():
        assert len(panda[name]) == polar[name].height == len(rows)
        assert list(panda[name].columns) == [column.name for column in TABLES[name].columns]
    transactions = panda.transactions
    assert str(transactions["latency_ns"].dtype) == "int64[pyarrow]"  # nulls or not
    assert transactions["latency_ns"].tolist() == [row["latency_ns"] for row in expected["transactions"]]
    assert polar["transactions"]["ts_ns"].to_list() == [row["ts_ns"] for row in expected["transactions"]]
    assert dissect.frames(ERRORS, library="arrow")["items"].num_rows == len(expected["items"])
    assert "transactions: " in repr(panda)
    assert len(panda) == len(TABLES)


def test_only_what_is_wanted() -> None:
    frames = dissect.frames(
        WRITE, tables=["items"], where="function == write", tags=ROOT / "captures" / "tags" / "valve.csv"
    )
    assert list(frames) == ["items"]
    assert set(frames.items["operation"]) == {"write"}
    assert "Valve.pressure" in set(frames.items["name"].dropna())


def test_one_table_may_be_named_without_a_list_and_tab_finds_the_tables() -> None:
    only = dissect.frames(ERRORS, library="arrow", tables="transactions")
    assert list(only) == ["transactions"]
    assert "transactions" in dir(only)
    assert "items" not in dir(only)


def test_wrong_names_and_missing_libraries(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(ValueError, match="did you mean pandas"):
        dissect.frames(ERRORS, library="panda")
    with pytest.raises(ValueError, match="Did you mean items"):
        dissect.frames(ERRORS, tables=["item"])
    with pytest.raises(AttributeError, match="did you mean items"):
        _ = dissect.frames(ERRORS, tables=["items"]).item
    monkeypatch.setitem(sys.modules, "polars", None)
    with pytest.raises(ImportError, match=r"dissect\.frames needs polars: pip install polars"):
        dissect.frames(ERRORS, library="polars")


def test_every_cell_of_the_notebook_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    notebook = json.loads((ROOT / "docs" / "frames.ipynb").read_text(encoding="utf-8"))
    cells = ["".join(cell["source"]) for cell in notebook["cells"] if cell["cell_type"] == "code"]
    assert len(cells) >= 7
    assert all(not cell["outputs"] for cell in notebook["cells"] if cell["cell_type"] == "code")
    monkeypatch.chdir(ROOT)
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    names: dict[str, Any] = {}
    for number, cell in enumerate(cells):
        exec(compile(cell, f"cell {number}", "exec"), names)
    assert names["latency_ms"].min() > 0
    assert len(names["latency_ms"]) == len(names["answered"]) > 0
    pressure = names["pressure"]
    assert set(pressure["operation"]) == {"write"}
    assert set(pressure["number"]) == {12.5}
    assert names["by_hour"].to_numpy().sum() == len(names["writes"]) > 0
    assert list(names["by_function"].index)
    assert names["slow"].collect().height > 0


def test_tables_that_nobody_asked_for_stay_compressed() -> None:
    table = TABLES["transactions"]
    rows = [tuple(row[column.name] for column in table.stored) for row in rows_of(ERRORS)[table.name]] * 100
    packed = PackedTables([table])
    packed.take(table, rows)
    plain = Batches(table).batch(rows)
    assert packed.table(table.name).to_batches()[0].equals(plain)
    assert 0 < sum(len(one) for one in packed._kept[table.name]) < plain.nbytes / 2
    assert packed.rows == {table.name: len(rows)}


def test_a_value_that_stays_has_number_and_text_in_each_row() -> None:
    """The text of a value is written once while the value stays."""
    path = ROOT / "captures" / "multi-items.pcapng"
    rows = list(dissect.values(path))
    table = dissect.frames(path, library="arrow", tables="values").values
    texts, numbers = table["text"].to_pylist(), table["number"].to_pylist()
    assert [shown(row.value) for row in rows] == list(zip(numbers, texts, strict=True))
    assert table["previous_number"].to_pylist() == [shown(row.previous)[0] for row in rows]
    assert any(not row.changed for row in rows)
    assert any(row.changed and not row.first for row in rows)
