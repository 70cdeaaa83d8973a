"""Arrow IPC files (Feather version 2), one for each table; readers can map them into memory without a copy."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from dissect.output.export.arrow import Batches
from dissect.output.export.extras import needed
from dissect.output.export.feed import Sink
from dissect.output.export.tables import Table
from dissect.output.export.transaction_rows import Row


class ArrowSink(Sink):
    """Writes each table to a file in the folder ``path``; with ``alone``, the only table to the file ``path``.

    Repeated texts are not dictionary-encoded: unlike a stream, a file cannot change a dictionary between batches.
    """

    def __init__(self, path: Path, tables: Iterable[Table], alone: bool, metadata: Mapping[str, str]) -> None:
        pa, ipc = needed("pyarrow"), needed("pyarrow.ipc")
        self._batches = {table.name: Batches(table, dictionaries=False, metadata=dict(metadata)) for table in tables}
        self._writers: dict[str, Any] = {}
        # Files that must be closed here: a writer that opened its file leaves it open until it is collected, and Windows cannot
        # rename an open file.
        self._files: list[Any] = []
        for name, batches in self._batches.items():
            place = path if alone else path / f"{name}.arrow"
            self._files.append(pa.OSFile(str(place), "wb"))
            self._writers[name] = ipc.new_file(self._files[-1], batches.schema)

    def take(self, table: Table, rows: Sequence[Row]) -> None:
        """Write rows as one batch."""
        self._writers[table.name].write_batch(self._batches[table.name].batch(rows))

    def close(self) -> None:
        """Write the footers, and close the files."""
        for file in (*self._writers.values(), *self._files):
            file.close()

    def abandon(self) -> None:
        """Close the files, which will be deleted."""
        for file in (*self._writers.values(), *self._files):
            with suppress(Exception):  # the file may be the cause of the failure
                file.close()
