"""Transactions as CSV (docs/json.md): a row for each item."""

from __future__ import annotations

import csv
from typing import Any

from dissect.report.csv_rows import CsvRows
from dissect.report.places import Places
from dissect.report.writer import Writer
from dissect.transactions.transaction import Transaction
from dissect.wire.clock import Clock


class CsvWriter(Writer):
    """Writes the names of the columns, then a row for each item of each transaction."""

    def __init__(self, clock: Clock | None = None, verbose: bool = False) -> None:
        super().__init__(clock, verbose)
        self._rows: CsvRows = CsvRows(self.places)
        self._csv: Any = csv.writer(_Sink(self), lineterminator="")

    def begin(self, places: Places) -> None:
        """Name packets with ``places``, and begin with the names of the columns."""
        super().begin(places)
        self._rows = CsvRows(places)
        self._csv.writerow(self._rows.columns())

    def transaction(self, transaction: Transaction) -> None:
        """Add the rows of a transaction."""
        self._csv.writerows(self._rows.rows(transaction))


class _Sink:
    """The file of `csv`, which writes a row at once."""

    def __init__(self, writer: CsvWriter) -> None:
        self._writer: CsvWriter = writer

    def write(self, line: str) -> None:
        """Take a row."""
        self._writer.lines.append(line)
