"""Parquet files of a live run: from time to time the file of each table is completed, and a new one begun.

A file is written under a name that ends with ``.part`` and renamed when it is complete. So readers of the folder only find
complete files, even after a run that was killed.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

from dissect.export.arrow import Batches
from dissect.export.extras import needed
from dissect.export.feed import Sink
from dissect.export.parquet import ParquetFile, by_days
from dissect.export.tables import Table
from dissect.export.transaction_rows import Row
from dissect.wire.saving import Saving
from dissect.wire.text import Clock


class RotatingSink(Sink):
    """Writes ``FOLDER/TABLE/day=YYYY-MM-DD/part-TIME-N.parquet``; `rotate` completes the present files.

    TIME is the time of the latest `rotate`, by the clock of the capture, in UTC. Raises `OSError` if files cannot be written.
    """

    def __init__(self, folder: Path, tables: Iterable[Table], metadata: Mapping[str, str]) -> None:
        needed("pyarrow.parquet", "--export")  # now, before the process gives up its privileges
        self._folder = folder
        self._batches = {table.name: Batches(table, metadata=dict(metadata)) for table in tables}
        self._try_out()
        self._open: dict[tuple[str, str], tuple[Saving, ParquetFile]] = {}
        self._since = ""
        self._clock = Clock()

    def take(self, table: Table, rows: Sequence[Row]) -> None:
        """Write rows to the files of their days."""
        for day, some in by_days(table, self._batches[table.name].batch(rows)).items():
            found = self._open.get((table.name, day))
            if found is None:
                first_ns = some.column(table.time)[0].as_py()
                found = self._open[table.name, day] = self._begin(table, day, first_ns)
            found[1].add(some)

    def rotate(self, now_ns: int) -> None:
        """Complete the present files, and give them their final names."""
        self._since = self._stamp(now_ns)
        while self._open:
            saving, file = self._open.pop(next(iter(self._open)))
            with saving:
                file.close()

    def abandon(self) -> None:
        """Close the unfinished files, and delete them."""
        for saving, file in self._open.values():
            file.abandon()
            Path(saving.path).unlink(missing_ok=True)
        self._open.clear()

    def _try_out(self) -> None:
        """Write an empty row of each table to a temporary folder, so that pyarrow imports everything that it needs now."""
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
