"""Parquet: a file for each table, or with several captures a folder for each, divided by day.

Row groups are written when they are full, so the memory needed does not depend on the length of the capture.
"""

from __future__ import annotations

import json
from collections import OrderedDict
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

from dissect.output.export.arrow import Batches
from dissect.output.export.extras import needed
from dissect.output.export.feed import Sink
from dissect.output.export.tables import BYTES, INT, TEXT, TIME, WORD, Table
from dissect.output.export.transaction_rows import Row
from dissect.wire.text import civil

#: Rows of a row group: DuckDB's unit of work. A group is written earlier when it has this many bytes.
ROW_GROUP: Final = 122_880
_GROUP_BYTES: Final = 64 * 1024 * 1024
#: Maximum number of files of one table that are open at once; each is for one day.
_MOST_OPEN: Final = 4
_DAY_NS: Final = 86_400_000_000_000
#: Hive's name for a partition without a value.
_NO_DAY: Final = "__HIVE_DEFAULT_PARTITION__"


class ParquetFile:
    """One Parquet file, and the batches that wait for its next row group.

    While the next row group is collected, a thread encodes and compresses the full one, which it can do without the GIL. An
    error in the thread is raised with the next row group, or when the file is closed. ``create`` makes the file: it returns a
    path, or an object with the methods write, close and discard.
    """

    def __init__(self, path: Path, batches: Batches, create: Callable[[Path], Any] | None = None) -> None:
        parquet = needed("pyarrow.parquet")
        self._pa = needed("pyarrow")
        self._batches = batches
        self._waiting: list[Any] = []
        self._rows = 0
        self._bytes = 0
        self._writes = ThreadPoolExecutor(1, "parquet")
        self._writing: Future[None] | None = None
        self._abandoned = False
        columns = batches.table.columns
        self._stream: Any = create(path) if create is not None else None
        if create is None:
            path.parent.mkdir(parents=True, exist_ok=True)
        self._writer = parquet.ParquetWriter(
            self._stream or path,
            batches.schema,
            version="2.6",
            compression="zstd",
            use_dictionary=[column.name for column in columns if column.type in {TEXT, WORD, BYTES}],
            column_encoding={column.name: "DELTA_BINARY_PACKED" for column in columns if column.type == INT},
            # Readers skip row groups by their minimum and maximum values; that only works if values grow with the rows.
            write_statistics=[name for column in columns if column.type == TIME for name in (column.name, column.of)],
        )

    def add(self, batch: Any) -> None:
        """Add a `pyarrow.RecordBatch`; write a row group when it is full."""
        self._waiting.append(batch)
        self._rows += batch.num_rows
        self._bytes += batch.nbytes
        if self._rows >= ROW_GROUP or self._bytes >= _GROUP_BYTES:
            self.write()

    def write(self) -> None:
        """Write the waiting rows as a row group."""
        if self._waiting:
            self._settle()
            self._writing = self._writes.submit(self._write, self._waiting, self._rows)
            self._waiting = []
            self._rows = self._bytes = 0

    def close(self) -> None:
        """Write the remaining rows and the footer. If that fails, the file is abandoned."""
        try:
            self.write()
            self._settle()
            self._writes.shutdown()
            self._writer.close()
            if self._stream is not None:
                self._stream.close()
        except BaseException:
            self.abandon()
            raise

    def abandon(self) -> None:
        """Close the file, which will be deleted; a second call does nothing."""
        if self._abandoned:
            return
        self._abandoned = True
        self._writes.shutdown()
        if self._stream is not None:
            self._stream.discard()
        with suppress(Exception):  # the file may be the cause of the failure
            self._writer.close()
        self._writer.is_open = False  # otherwise the writer tries to close again when it is collected, and complains

    def _write(self, batches: list[Any], rows: int) -> None:
        table = self._pa.Table.from_batches(batches, self._batches.schema).unify_dictionaries()
        self._writer.write_table(table, row_group_size=rows)

    def _settle(self) -> None:
        """Wait for the row group that is being written. Raises the error that the thread met."""
        writing, self._writing = self._writing, None
        if writing is not None:
            writing.result()


class ParquetSink(Sink):
    """Writes tables to Parquet: to the file ``path`` (``alone``), to a file for each, or with ``by_day`` to a folder for each.

    ``empty``: write a file for a table without rows, too. ``create`` makes files, as for `ParquetFile`; ``part`` is in the
    names of the files in folders, before their number.
    """

    def __init__(
        self,
        path: Path,
        tables: Iterable[Table],
        alone: bool,
        by_day: bool,
        metadata: Mapping[str, str],
        empty: bool = True,
        create: Callable[[Path], Any] | None = None,
        part: str = "part",
    ) -> None:
        self._path = path
        self._alone = alone
        self._by_day = by_day
        self._empty = empty
        self._create = create
        self._part = part
        self._batches = {table.name: Batches(table, metadata=dict(metadata)) for table in tables}
        self._open: OrderedDict[tuple[str, str], ParquetFile] = OrderedDict()
        self._parts: dict[tuple[str, str], int] = {}
        if by_day:
            return
        try:
            for name in self._batches:
                self._file(name, "")  # a table without rows has a file too, with its columns
        except BaseException:
            self.abandon()  # the caller does not get this sink, so it cannot close it
            raise

    def take(self, table: Table, rows: Sequence[Row]) -> None:
        """Write rows to the file of their table, or to those of their days."""
        batch = self._batches[table.name].batch(rows)
        if not self._by_day:
            self._file(table.name, "").add(batch)
            return
        for day, some in by_days(table, batch).items():
            self._file(table.name, day).add(some)

    def close(self) -> None:
        """Write the remaining rows, and close the files."""
        for name in self._batches:
            if self._by_day and self._empty and not any(key[0] == name for key in self._parts):
                self._file(name, _NO_DAY)
        for file in self._open.values():
            file.close()

    def abandon(self) -> None:
        """Close the files, which will be deleted."""
        for file in self._open.values():
            file.abandon()
        self._open.clear()

    def _file(self, name: str, day: str) -> ParquetFile:
        file = self._open.get((name, day))
        if file is None:
            mine = [key for key in self._open if key[0] == name]
            if len(mine) >= _MOST_OPEN:
                self._open.pop(mine[0]).close()
            number = self._parts[name, day] = self._parts.get((name, day), 0) + 1
            file = ParquetFile(self._place(name, day, number), self._batches[name], self._create)
            self._open[name, day] = file
        return file

    def _place(self, name: str, day: str, number: int) -> Path:
        if self._alone:
            return self._path
        if not self._by_day:
            return self._path / f"{name}.parquet"
        return self._path / name / f"day={day}" / f"{self._part}-{number:04}.parquet"


def by_days(table: Table, batch: Any) -> dict[str, Any]:
    """Return a `pyarrow.RecordBatch` divided by day (UTC), by the column ``table.time``; rows keep their order."""
    found: dict[int | None, list[int]] = {}
    for at, time_ns in enumerate(batch.column(table.time).to_pylist()):
        found.setdefault(time_ns // _DAY_NS if time_ns is not None else None, []).append(at)
    if len(found) == 1:
        return {_day_text(day): batch for day in found}
    return {_day_text(day): batch.take(needed("pyarrow").array(some)) for day, some in found.items()}


def _day_text(day: int | None) -> str:
    if day is None:
        return _NO_DAY
    year, month, of_month = civil(day)
    return f"{year:04}-{month:02}-{of_month:02}"


def metadata_of(version: str, files: Iterable[str]) -> dict[str, str]:
    """Return the metadata of every file: the version of this package, and the captures."""
    return {"s7dissect.version": version, "s7dissect.files": json.dumps(list(files))}
