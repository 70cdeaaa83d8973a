"""`TableFeed`: an observer that makes rows of the wanted tables, and passes them on to a sink some thousands at a time."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from typing import Any, Final

from dissect.engine.acts.act import Act
from dissect.engine.findings.bounds import KEPT
from dissect.engine.findings.reporter import Finding
from dissect.engine.observer import Observer
from dissect.engine.pipeline import Pipeline
from dissect.engine.stations.facts import Fact
from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.operation import Operation
from dissect.engine.transactions.payloads import ScdMessage
from dissect.engine.transactions.side import Side
from dissect.engine.transactions.transaction import Transaction
from dissect.meaning.inventory.collector import Inventory
from dissect.meaning.select.things import Context
from dissect.output.export import pdu_columns, value_columns
from dissect.output.export.batch import Batch, Part
from dissect.output.export.item_columns import ASKED, BEGIN, CODE, ROUTE, Collected, ItemColumns
from dissect.output.export.pdu_columns import PduColumns
from dissect.output.export.rows import Rows
from dissect.output.export.tables import (
    ACTS,
    CONNECTIONS,
    DEVICES,
    FINDING_COUNTS,
    FINDINGS,
    ITEMS,
    OPERATIONS,
    PDUS,
    TRANSACTIONS,
    VALUES,
    Table,
)
from dissect.output.export.transaction_rows import ENDS, FILE, FUNCTION, OWN, STATE, Row, TransactionColumns
from dissect.output.export.value_columns import ValueColumns
from dissect.output.variables.collector import ValueCollector
from dissect.packets.source.packet import SourceFile

#: This many rows of a table are passed on together; items earlier, when their PDUs have this many bytes.
ROWS: Final = 8192
_MOST_BYTES: Final = 16 * 1024 * 1024
#: The tables with most rows, which are collected column by column.
_BULK: Final = (TRANSACTIONS, ITEMS, VALUES, PDUS)


class Sink(ABC):
    """Takes the rows of tables and writes or keeps them."""

    @abstractmethod
    def take(self, table: Table, rows: Sequence[Row]) -> None:
        """Take rows of a table, each with the values of its stored columns; ``rows`` may be a `Batch`."""


class TableFeed(Observer):
    """Makes rows of ``tables`` and passes them on to ``sink``; ``counts`` are the rows of each table so far.

    Call `begin` before the first packet and `finish` after the last one, which adds the rows that are known only then. `flush`
    passes on the rows that wait.
    """

    def __init__(self, tables: Iterable[Table], sink: Sink) -> None:
        super().__init__()
        self.tables = tuple(tables)
        names = {table.name for table in self.tables}
        self.wants_pdus = PDUS.name in names
        self.counts = dict.fromkeys([table.name for table in self.tables], 0)
        self._sink = sink
        self._context = Context()
        self._waiting: dict[str, list[Row]] = {table.name: [] for table in self.tables if table not in _BULK}
        self._connections = self._waiting.get(CONNECTIONS.name)
        self._operations = self._waiting.get(OPERATIONS.name)
        self._acts = self._waiting.get(ACTS.name)
        self._findings = self._waiting.get(FINDINGS.name)
        self._finding_counts = self._waiting.get(FINDING_COUNTS.name)
        self._collector = ValueCollector()
        self._devices = self._waiting.get(DEVICES.name)
        self._inventory = Inventory()
        self._collect([])

    def begin(self, files: Sequence[SourceFile]) -> None:
        """Set the files of the run, by which packets are named; more may be added later."""
        self._collect(files)

    def count_from(self, before: int) -> None:
        """Number findings and PDUs on from ``before``."""
        self._made.count_from(before)
        if self._pdus is not None:
            self._pdus.number = before

    def _collect(self, files: Sequence[SourceFile]) -> None:
        self._made = Rows(files)
        self._transactions = TransactionColumns(self._made.transactions)
        self._items = ItemColumns(self._made.transactions, self._made.other_items, ROWS, _MOST_BYTES)
        self._values = ValueColumns(self._made.transactions) if VALUES in self.tables else None
        self._pdus = PduColumns(self._made.transactions) if PDUS in self.tables else None
        self._collected: Collected | None = None
        if TRANSACTIONS in self.tables or ITEMS in self.tables:
            transactions = self._transactions if TRANSACTIONS in self.tables else None
            items = self._items if ITEMS in self.tables else None
            self._collected = Collected(transactions, items, self._made.item_count, ROWS)

    def flush(self) -> None:
        """Pass on the rows that wait."""
        for table in self.tables:
            rows = self._waiting.get(table.name)
            some = rows if rows is not None else self._batch(table)
            if some:
                self.counts[table.name] += len(some)
                self._sink.take(table, some)
            if rows:
                rows.clear()
        self._transactions.clear()
        self._items.clear()
        if self._values is not None:
            self._values.clear()
        if self._pdus is not None:
            self._pdus.clear()

    def _batch(self, table: Table) -> Batch:
        """Return the rows that were collected of a table in `_BULK`."""
        if self._values is not None and table is VALUES:
            return _values(self._values)
        if self._pdus is not None and table is PDUS:
            return _pdus(self._pdus)
        if table is TRANSACTIONS:
            done = self._transactions
            parts = [
                Part(OWN, done.own),
                Part(ENDS, done.ends.rows, done.ends_at),
                Part(FUNCTION, done.functions.rows, done.functions_at),
                Part(STATE, done.states.rows, done.states_at),
            ]
            return Batch(table, parts, {})
        items = self._items
        parts = [
            Part(BEGIN, items.begins, None, items.ends),
            Part(ROUTE, items.routes.rows, items.routes_at, items.ends),
            Part(ASKED, items.asked.rows, items.asked_at),
            Part(CODE, items.codes.rows, items.codes_at),
        ]
        columns: dict[str, Sequence[Any]] = {
            "item": items.numbers,
            "name": items.names,
            "number": items.values,
            "text": items.texts,
            "spelled": items.spelled,
            "data": items.data,
        }
        return Batch(table, parts, columns)

    def finish(self, pipeline: Pipeline, files: Sequence[SourceFile]) -> None:
        """Pass on the remaining rows, when ``pipeline`` has read ``files`` to their end."""
        if self._devices is not None:
            self._inventory.take(pipeline, list(files))
            self._devices += [self._made.device(device) for device in self._inventory.devices]
        if self._finding_counts is not None:
            counters = pipeline.counters
            self._finding_counts += self._made.finding_counts(
                pipeline.exchange.ledger, counters.earliest_ns, counters.latest_ns
            )
        self.flush()

    def connection_opened(self, connection: Connection) -> None:
        """Remember a connection for its findings."""
        if self._findings is not None:
            self._context.opened(connection)

    def connection_closed(self, connection: Connection) -> None:
        """Add the row of a connection."""
        if self._values is not None:
            self._collector.connection_closed(connection)
        if self._devices is not None:
            self._inventory.connection_closed(connection)
        if self._findings is not None:
            self._context.closed(connection)
        if self._connections is not None:
            self._add(self._connections, self._made.connection(connection))

    def transaction(self, transaction: Transaction) -> None:
        """Add the rows of a transaction and of its items."""
        if self._devices is not None:
            self._inventory.transaction(transaction)
        if self._values is not None:
            self._collector.transaction(transaction)
            full = False
            for row in self._collector.take():
                full = self._values.add(row) >= ROWS
            if full:
                self.flush()
        if self._collected is not None and self._collected.add(transaction):
            self.flush()

    def operation(self, operation: Operation) -> None:
        """Add the row of an operation."""
        if self._devices is not None:
            self._inventory.operation(operation)
        if self._operations is not None:
            self._add(self._operations, self._made.operation(operation))

    def act(self, act: Act) -> None:
        """Add the row of an act."""
        if self._devices is not None:
            self._inventory.act(act)
        if self._acts is not None:
            self._add(self._acts, self._made.act(act))

    def fact(self, fact: Fact) -> None:
        """Take a fact that a device stated."""
        if self._devices is not None:
            self._inventory.fact(fact)

    def finding(self, finding: Finding) -> None:
        """Add the row of a finding."""
        if self._findings is not None and finding.room == KEPT:
            self._add(self._findings, self._made.finding(finding, self._context.connection(int(finding.connection))))

    def pdu(self, frame: int, time_ns: int, side: Side, octets: bytes, cut: bool) -> None:
        """Add the row of an S7 PDU."""
        if self._pdus is not None:
            at = int(frame), int(time_ns), side.connection, int(side.index)
            if self._pdus.pdu(*at, octets, cut) >= ROWS:
                self.flush()

    def plus_pdu(self, frame: int, time_ns: int, side: Side, octets: bytes, cut: bool) -> None:
        """Add the row of an S7comm-plus PDU."""
        if self._pdus is not None:
            at = int(frame), int(time_ns), side.connection, int(side.index)
            if self._pdus.plus_pdu(*at, octets, cut) >= ROWS:
                self.flush()

    def scd(self, frame: int, time_ns: int, side: Side, found: ScdMessage) -> None:
        """Add the row of an SCD message from a connection of its own."""
        if self._pdus is not None and self._pdus.scd(found, side.connection) >= ROWS:
            self.flush()

    def _add(self, rows: list[Row], row: Row) -> None:
        rows.append(row)
        if len(rows) >= ROWS:
            self.flush()


def _values(found: ValueColumns) -> Batch:
    parts = [
        Part(value_columns.ROUTE, found.routes.rows, found.routes_at),
        Part(value_columns.VARIABLE, found.variables.rows, found.variables_at),
        Part(FILE, found.packets.files.rows, found.packets.files_at),
    ]
    columns: dict[str, Sequence[Any]] = {
        "frame": found.packets.frames,
        "ts_ns": found.times,
        "number": found.numbers,
        "text": found.texts,
        "data": found.data,
        "changed": found.changed,
        "previous_number": found.previous,
        "remark": found.remarks,
    }
    return Batch(VALUES, parts, columns)


def _pdus(found: PduColumns) -> Batch:
    parts = [
        Part(pdu_columns.ROUTE, found.routes.rows, found.routes_at),
        Part(pdu_columns.KIND, found.kinds.rows, found.kinds_at),
        Part(FILE, found.packets.files.rows, found.packets.files_at),
    ]
    columns: dict[str, Sequence[Any]] = {
        "pdu": found.numbers,
        "frame": found.packets.frames,
        "ts_ns": found.times,
        "pdu_ref": found.references,
        "bytes": found.sizes,
        "malformed": found.malformed,
    }
    return Batch(PDUS, parts, columns)
