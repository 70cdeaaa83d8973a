"""Arrow IPC files (Feather version 2): one for each table, read without a copy."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from dissect.export.arrow import Batches
from dissect.export.extras import needed
from dissect.export.feed import Sink
from dissect.export.tables import Table
from dissect.export.transaction_rows import Row


class ArrowSink(Sink):
    """Writes each table to a file below ``path``, or the only one to ``path`` itself (``alone``).

    Repeated texts are plain: a file, other than a stream, cannot change a dictionary between batches.
    """

    def __init__(self, path: Path, tables: Iterable[Table], alone: bool, metadata: Mapping[str, str]) -> None:
        ipc = needed("pyarrow.ipc")
        self._batches = {table.name: Batches(table, dictionaries=False, metadata=dict(metadata)) for table in tables}
        self._writers: dict[str, Any] = {}
        for name, batches in self._batches.items():
            place = path if alone else path / f"{name}.arrow"
            self._writers[name] = ipc.new_file(str(place), batches.schema)

    def take(self, table: Table, rows: Sequence[Row]) -> None:
        """Write rows as one batch."""
        self._writers[table.name].write_batch(self._batches[table.name].batch(rows))

    def close(self) -> None:
        """Write the ends of the files."""
        for writer in self._writers.values():
            writer.close()

    def abandon(self) -> None:
        """Close files of which nothing will be kept."""
        for writer in self._writers.values():
            with suppress(Exception):  # it could not be written to
                writer.close()
