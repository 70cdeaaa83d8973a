"""Parquet files of a live run: from time to time the file of each table is completed, and a new one begun.

A file is written under a name that ends with ``.part`` and renamed when it is complete. So readers of the folder only find
complete files, even after a run that was killed.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

from dissect.output.export.arrow import Batches
from dissect.output.export.extras import check_needed, needed
from dissect.output.export.feed import Sink
from dissect.output.export.parquet import ParquetFile, by_days
from dissect.output.export.tables import Table
from dissect.output.export.transaction_rows import Row
from dissect.wire.config.saving import Saving
from dissect.wire.text import Clock

#: Octets that `RotatingSink.probe` writes.
_PROBE: Final = 64 * 1024


class RotatingSink(Sink):
    """Writes ``FOLDER/TABLE/day=YYYY-MM-DD/part-TIME-N.parquet``; `rotate` completes the present files.

    TIME is the time of the latest `rotate`, by the clock of the capture, in UTC. A failure to write does not raise: ``error``
    is the latest `OSError`; the rows of its file are counted in ``lost``, and so are further rows until `probe` has found that
    files can be written again. ``files`` counts the completed files, ``octets`` their size.

    `prepare` imports pyarrow, which starts threads: call it before the first rows.
    """

    def __init__(self, folder: Path, tables: Iterable[Table], metadata: Mapping[str, str]) -> None:
        check_needed("pyarrow", "--export")
        self._folder = folder
        self._tables = list(tables)
        self._metadata = dict(metadata)
        self._batches: dict[str, Batches] = {}
        self.error: OSError | None = None
        self.lost = 0
        self.files = 0
        self.octets = 0
        self._paused = False
        self._rows: dict[tuple[str, str], int] = {}  # rows given to each open file
        self._open: dict[tuple[str, str], tuple[Saving, ParquetFile]] = {}
        self._since = ""
        self._clock = Clock()

    def prepare(self) -> None:
        """Import everything that is needed to write. May be called twice."""
        if not self._batches:
            needed("pyarrow.parquet", "--export")
            self._batches = {table.name: Batches(table, metadata=dict(self._metadata)) for table in self._tables}
            self._try_out()

    def take(self, table: Table, rows: Sequence[Row]) -> None:
        """Write rows to the files of their days."""
        if self._paused:
            self.lost += len(rows)
            return
        for day, some in by_days(table, self._batches[table.name].batch(rows)).items():
            try:
                self._add(table, day, some)
            except OSError as error:
                self._fail((table.name, day), error, some.num_rows)

    def rotate(self, now_ns: int) -> None:
        """Complete the current files, and give them their final names."""
        self._since = self._stamp(now_ns)
        while self._open:
            key = next(iter(self._open))
            saving, file = self._open[key]
            try:
                with saving:
                    file.close()
                self.octets += Path(saving.output).stat().st_size
            except OSError as error:
                self._fail(key, error, 0)
                continue
            self.files += 1
            del self._open[key]
            self._rows.pop(key, None)

    def probe(self) -> None:
        """Find out whether files can be written again, and accept rows again if so; otherwise raise `OSError`."""
        path = self._folder / f".{os.getpid()}.probe"
        try:
            path.write_bytes(bytes(_PROBE))
        finally:
            path.unlink(missing_ok=True)
        self._paused = False

    def _add(self, table: Table, day: str, some: Any) -> None:
        key = (table.name, day)
        found = self._open.get(key)
        if found is None:
            found = self._open[key] = self._begin(table, day, some.column(table.time)[0].as_py())
        found[1].add(some)
        self._rows[key] = self._rows.get(key, 0) + some.num_rows

    def _fail(self, key: tuple[str, str], error: OSError, more: int) -> None:
        """Delete the file that cannot be written, and count its rows and ``more``."""
        self.error = error
        self._paused = True
        self.lost += self._rows.pop(key, 0) + more
        found = self._open.pop(key, None)
        if found is not None:
            found[1].abandon()
            with suppress(OSError):
                Path(found[0].path).unlink(missing_ok=True)

    def abandon(self) -> None:
        """Close the unfinished files, and delete them."""
        for saving, file in self._open.values():
            file.abandon()
            Path(saving.path).unlink(missing_ok=True)
        self._open.clear()

    def _try_out(self) -> None:
        """Write an empty row of each table to a temporary folder, so that pyarrow imports now everything that it needs."""
        with TemporaryDirectory() as folder:
            for name, batches in self._batches.items():
                file = ParquetFile(Path(folder, name), batches)
                file.add(batches.batch([(None,) * len(batches.table.stored)]))
                file.close()

    def _begin(self, table: Table, day: str, time_ns: int | None) -> tuple[Saving, ParquetFile]:
        folder = self._folder / table.name / f"day={day}"
        folder.mkdir(parents=True, exist_ok=True)
        since = self._since or self._stamp(time_ns or 0)
        number = 1
        while (path := folder / f"part-{since}-{number}.parquet").exists():
            number += 1
        saving = Saving(path)
        try:
            return saving, ParquetFile(Path(saving.path), self._batches[table.name])
        except BaseException:
            Path(saving.path).unlink(missing_ok=True)
            raise

    def _stamp(self, time_ns: int) -> str:
        return self._clock.iso(time_ns)[:19].replace("-", "").replace(":", "") + "Z"
