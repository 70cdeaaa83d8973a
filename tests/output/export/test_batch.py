"""Rows that come by columns: the same as one by one, with values as an item says them."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from dissect.engine.observer import Observer
from dissect.engine.pipeline import Options
from dissect.engine.transactions.transaction import Transaction
from dissect.files.session import Run
from dissect.output.export import feed as feeding
from dissect.output.export.arrow import Batches
from dissect.output.export.batch import Batch, Part
from dissect.output.export.feed import Sink, TableFeed
from dissect.output.export.parquet import by_days
from dissect.output.export.tables import INT, ITEMS, TRANSACTIONS, WORD, Column, Table
from dissect.output.export.transaction_rows import MOST_KNOWN, Row, Shared
from tests.meaning.report.support import ROOT
from tests.output.export.support import rows_of

FILES = sorted((ROOT / "captures").rglob("*.pcapng"))


class Compared(Sink):
    """Makes Arrow of batches as they come, and of the same rows one by one."""

    def __init__(self) -> None:
        self.batches = 0
        self.roads = [Batches(table, dictionaries) for table in (TRANSACTIONS, ITEMS) for dictionaries in (True, False)]

    def take(self, table: Table, rows: Sequence[Row]) -> None:
        assert isinstance(rows, Batch)
        self.batches += 1
        for road in self.roads:
            if road.table is table:
                by_columns = road.batch(rows)
                one_by_one = Batches(table, road.dictionaries).batch(list(rows))
                for column in by_columns.schema.names:
                    assert plain(by_columns, column) == plain(one_by_one, column), column


def plain(batch: Any, column: str) -> list[str]:
    """Return values as text: so that NaN is equal to NaN."""
    values = batch.column(column)
    return [repr(value) for value in values.to_pylist()]


def test_columns_are_those_of_rows(monkeypatch: pytest.MonkeyPatch) -> None:
    """In small batches, so that what is shared grows from one to the next."""
    monkeypatch.setattr(feeding, "ROWS", 20)
    for path in FILES:
        compared = Compared()
        run = Run([path], feed := TableFeed([TRANSACTIONS, ITEMS], compared))
        feed.begin(run.files)
        while run.step():
            pass
        feed.finish(run.pipeline, run.files)
        assert sum(feed.counts.values()) == 0 or compared.batches


class Told(Observer):
    """Keeps what every item of S7comm says of its value."""

    def __init__(self) -> None:
        super().__init__()
        self.items: list[tuple[int, int, float | None, str | None, bytes | None]] = []

    def transaction(self, transaction: Transaction) -> None:
        for index, result in enumerate(transaction.s7_results):
            value = result.value
            number = float(value) if isinstance(value, (int, float)) else None
            text = value if isinstance(value, str) else json.dumps(value) if isinstance(value, list) else None
            self.items.append((transaction.number, index, number, text, result.data))


def test_values_are_those_of_items() -> None:
    """Numbers as numbers, several as JSON; bytes, which are no numbers to most, only where they spell a text or are one."""
    kinds = set()
    for path in FILES:
        told = Told()
        run = Run([path], told, Options())
        while run.step():
            pass
        rows: dict[int, list[dict[str, Any]]] = {}
        for row in rows_of(path)["items"] if told.items else []:
            rows.setdefault(row["transaction"], []).append(row)
        for transaction, index, number, text, data in told.items:
            row = rows[transaction][index]
            assert (row["item"], row["data"]) == (index + 1, data)
            if row["type"] == "BYTE":
                continue
            assert repr(row["number"]) == repr(number)
            assert (row["text"] or "").replace(", ", ",") == (text or "").replace(", ", ",")
            kinds.add((row["type"], number is not None, text is not None))
    assert len(kinds) > 20


def test_what_is_shared_is_kept_once_and_bounded() -> None:
    shared = Shared([("none",)])
    first = shared.rows
    places = [shared.at((number,)) for number in range(MOST_KNOWN)]
    assert places == list(range(1, MOST_KNOWN + 1))
    assert shared.at((5,)) == places[5]
    assert len(shared.rows) == MOST_KNOWN + 1
    assert shared.bounded()
    assert shared.rows == [("none",)]
    assert len(first) == MOST_KNOWN + 1  # who was given it has it as it was
    assert not shared.bounded()
    assert shared.at((5,)) == 1


def test_what_rows_have_together_up_to_an_end_is_had_by_each() -> None:
    table = Table("t", "row", (Column("a", WORD, "", "", ""), Column("b", INT, "", "", "")), "b")
    ends = [2, 3, 6]
    batch = Batch(
        table, [Part(("a",), [("x",), ("y",)], [1, 0, 1], ends), Part(("b",), [(7,), (8,), (9,)], None, ends)], {}
    )
    rows = [("y", 7), ("y", 7), ("x", 8), ("y", 9), ("y", 9), ("y", 9)]
    assert list(batch) == rows
    assert len(batch) == 6
    assert [tuple(row.values()) for row in Batches(table).batch(batch).to_pylist()] == rows
    assert not Batch(table, [Part(("a",), [], [], []), Part(("b",), [], None, [])], {})


def test_a_part_made_before_serves_as_long_as_no_row_is_added() -> None:
    batches = Batches(TRANSACTIONS)
    run = Run([FILES[0]], feed := TableFeed([TRANSACTIONS], kept := Last()))
    feed.begin(run.files)
    while run.step():
        pass
    feed.finish(run.pipeline, run.files)
    own, ends, *others = kept.batch.parts
    many = [*ends.rows]
    for count in (1, 2):
        many += [(f"10.0.0.{count}", count, "10.0.0.9", 102)]
        at = [len(many) - 1] * len(kept.batch)
        made = batches.batch(Batch(TRANSACTIONS, [own, Part(ends.names, many, at), *others], {}))
        assert set(made.column("client_host").to_pylist()) == {f"10.0.0.{count}"}


class Last(Sink):
    batch: Batch

    def take(self, table: Table, rows: Sequence[Row]) -> None:
        assert isinstance(rows, Batch)
        self.batch = rows


def test_days_of_a_batch(tmp_path: Path) -> None:
    """Also of rows without a time, and of times before 1970."""
    day = 86_400_000_000_000
    row = next(iter(rows_of(FILES[0])["items"]))
    rows = [
        tuple({**row, "ts_ns": at, "item": number}.values()) for number, at in enumerate([day, 5, None, day + 1, -1])
    ]
    found = by_days(ITEMS, Batches(ITEMS).batch(rows))
    assert {name: batch.column("item").to_pylist() for name, batch in found.items()} == {
        "1970-01-02": [0, 3],
        "1970-01-01": [1],
        "__HIVE_DEFAULT_PARTITION__": [2],
        "1969-12-31": [4],
    }
