"""The compiled writers of transactions, items, values and PDUs say what the tables of facts say, over all captures of ours."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Final

import pytest

from dissect.engine.observer import Observer
from dissect.engine.transactions.transaction import Transaction
from dissect.files.session import Run
from dissect.meaning.facts.fact import Fact
from dissect.meaning.facts.pdu import ASKED, PDU
from dissect.meaning.facts.transaction import ITEM, TRANSACTION
from dissect.meaning.facts.value import VALUE
from dissect.meaning.facts.written import files_of, written
from dissect.meaning.report.words import Places
from dissect.meaning.report.writer import PduFeed
from dissect.meaning.report.writers.jsonl import JsonlWriter, TransactionLines
from dissect.meaning.select.items import ItemReader
from dissect.online.live.run import Fanout
from dissect.output.export.feed import Sink, TableFeed
from dissect.output.export.rows import Rows
from dissect.output.export.tables import ITEMS, PDUS, TRANSACTIONS, VALUES, Table
from dissect.output.export.transaction_rows import Row
from dissect.output.variables.collector import ValueCollector
from dissect.output.variables.model import ValueRow
from dissect.output.variables.writers import ValueJsonl
from dissect.wire.text import Clock
from tests.cases import each
from tests.meaning.report.support import OWN, ROOT

#: What one of these tables leaves to its writer: it needs a later room, or is the point of writing by hand.
LEFT: Final = {
    "transactions": {"pdu_ref", "about", "item_count"},
    "values": {"number", "text_value", "previous_number"},
}
#: The facts of items that tags and refusals of a whole request change, so that an item alone does not tell them.
ITEM_ALONE: Final = {"name", "refused"}
#: The facts of items that the table has in cells.
ITEM_CELLS: Final = {column.source for column in ITEMS.stored}


class _Kept(Sink):
    def __init__(self) -> None:
        self.rows: dict[str, list[Row]] = {"transactions": [], "items": [], "values": [], "pdus": []}

    def take(self, table: Table, rows: Iterable[Row]) -> None:
        self.rows[table.name] += list(rows)


class _Witness(Observer):
    """Keeps what the compiled writers are given, and the lines of transactions and of values as JSON."""

    def __init__(self) -> None:
        super().__init__()
        self.transactions: list[Transaction] = []
        self.values: list[ValueRow] = []
        self.items: list[list[Any]] = []
        self._collector = ValueCollector()

    def transaction(self, transaction: Transaction) -> None:
        self.transactions.append(transaction)
        self.items.append(list(ItemReader().items(transaction)))
        self._collector.transaction(transaction)
        self.values += list(self._collector.take())

    def connection_closed(self, connection: Any) -> None:
        self._collector.connection_closed(connection)


def _failed(observer: Observer, error: Exception) -> None:
    raise AssertionError(f"{type(observer).__name__} failed") from error


class _Read:
    def __init__(self, *paths: Path) -> None:
        kept, self.seen = _Kept(), _Witness()
        feed = TableFeed((TRANSACTIONS, ITEMS, VALUES, PDUS), kept)
        pdus = JsonlWriter()
        fan = Fanout([feed, self.seen, PduFeed(pdus)], _failed)
        run = Run(paths, fan)
        self.places = Places(run.files, len(paths) > 1)
        pdus.begin(self.places)
        feed.begin(run.files)
        while run.step():
            pass
        feed.finish(run.pipeline, run.files)
        self.rows = kept.rows
        self.made = Rows(run.files)
        lines = TransactionLines()
        if self.places.several:
            lines.locate = self.places.locate
        self.lines = [json.loads(lines.line(one)) for one in self.seen.transactions]
        values = ValueJsonl()
        values.begin(self.places)
        values.values(self.seen.values)
        self.value_lines = [json.loads(line if isinstance(line, bytes) else str(line)) for line in values.lines]
        self.pdu_lines = [json.loads(line if isinstance(line, bytes) else str(line)) for line in pdus.lines]


def by_name(table: Table, row: Row) -> dict[str, Any]:
    """Return the cells of a row by the name of their fact; two cells of one fact as a list."""
    cells: dict[str, Any] = {}
    for column, cell in zip(table.stored, row, strict=True):
        cells.setdefault(column.source, []).append(cell)
    return cells


def agree(made: Rows, table: Table, records: Iterable[object], rows: list[Row]) -> int:
    """Compare the rows of a table with those that are made of its facts; return how many cells were compared."""
    compared = 0
    for record, row in zip(records, rows, strict=True):
        told = by_name(table, made._row(table, record))
        for name, cells in by_name(table, row).items():
            if name not in LEFT[table.name]:
                assert told[name] == cells, (name, record)
                compared += 1
    return compared


def has_keys(facts: Mapping[str, Fact[Any]], line: Mapping[str, Any], several: bool) -> None:
    """Check that a JSON object has the keys of a table and no others."""
    keys = {fact.key for fact in facts.values() if fact.key}
    files = set(files_of(facts))
    assert set(line) - keys - files - {"schema"} == set()
    assert {fact.key for fact in facts.values() if fact.key and not fact.rare} <= set(line)
    assert several or not files & set(line) - keys


def tell(facts: Mapping[str, Fact[Any]], records: Iterable[object], lines: list[dict[str, Any]], places: Places) -> int:
    """Compare JSON objects with those that are made of a table; return how many values were compared."""
    told = {name: fact for name, fact in facts.items() if fact.key and fact.get is not None}
    compared = 0
    for record, line in zip(records, lines, strict=True):
        has_keys(facts, line, places.several)
        made = written(told, record, places, Clock())
        assert {key: line.get(key) for key in made} == made
        assert {fact.key for fact in told.values() if fact.key in line} <= set(made)
        compared += len(made)
    return compared


@pytest.mark.parametrize(
    "planted", [TRANSACTION["latency_ns"], VALUE["frame"], TRANSACTION["begin_time"], ITEM["byte"], ITEM["count"]]
)
def test_a_planted_difference_is_found(planted: Fact[Any], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(planted, "get", lambda _of: 17)
    with pytest.raises(AssertionError):
        compare(ROOT / "captures" / "write-areas.pcapng")


@each("paths", [(path,) for path in OWN] + [(OWN[0], OWN[4])])
def test_compiled_writers_say_what_the_tables_say(paths: tuple[Path, ...]) -> None:
    compare(*paths)


def compare(*paths: Path) -> None:
    """Read captures as one, and compare what the compiled writers say of them with the tables."""
    read = _Read(*paths)
    seen = read.seen
    assert tell(TRANSACTION, seen.transactions, read.lines, read.places) >= len(read.lines)
    assert tell(VALUE, seen.values, read.value_lines, read.places) >= len(read.value_lines)
    assert agree(read.made, TRANSACTIONS, seen.transactions, read.rows["transactions"]) >= len(read.lines)
    assert agree(read.made, VALUES, seen.values, read.rows["values"]) >= len(read.value_lines)
    for line in read.lines:
        for item in line["items"]:
            has_keys(ITEM, item, False)
    for line in read.pdu_lines:
        has_keys(PDU, line, read.places.several)
        for item in line.get("items", ()):
            assert set(item) == set(ASKED)
    told = [
        fact for name, fact in ITEM.items() if fact.get is not None and name in ITEM_CELLS and name not in ITEM_ALONE
    ]
    items = [item for some in seen.items for item in some]
    for item, row in zip(items, read.rows["items"], strict=True):
        cells = by_name(ITEMS, row)
        for fact in told:
            assert fact.get is not None
            assert cells[fact.name] == [fact.get(item)], (fact.name, item.place)
