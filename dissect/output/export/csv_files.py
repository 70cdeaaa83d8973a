"""CSV: a file for each table, UTF-8 with a header, lines ended by CR LF (RFC 4180)."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, TextIO

from dissect.output.export.cells import Cells
from dissect.output.export.feed import Sink
from dissect.output.export.tables import Table
from dissect.output.export.transaction_rows import Row


class CsvSink(Sink):
    """Writes each table to a file in the folder ``path``; with ``alone``, the only table to the file ``path``."""

    def __init__(self, path: Path, tables: Iterable[Table], alone: bool) -> None:
        self._files: dict[str, TextIO] = {}
        self._writers: dict[str, Any] = {}
        self._cells: dict[str, Cells] = {}
        for table in tables:
            place = path if alone else path / f"{table.name}.csv"
            file = self._files[table.name] = place.open("w", encoding="utf-8", errors="backslashreplace", newline="")
            writer = self._writers[table.name] = csv.writer(file)
            writer.writerow([column.name for column in table.columns])
            self._cells[table.name] = Cells(table.columns)

    def take(self, table: Table, rows: Sequence[Row]) -> None:
        """Write rows."""
        cells = self._cells[table.name]
        self._writers[table.name].writerows([cells.row(row) for row in rows])

    def close(self) -> None:
        """Close the files."""
        for file in self._files.values():
            file.close()

    def abandon(self) -> None:
        """Close the files, which will be deleted."""
        for file in self._files.values():
            with suppress(OSError):  # there may be no room for data that are still buffered
                file.close()
