"""DuckDB: all tables in one file. The file format depends on the DuckDB version; Parquet stays readable for longer."""

from __future__ import annotations

import errno
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from dissect.output.export.arrow import Batches
from dissect.output.export.extras import needed
from dissect.output.export.feed import Sink
from dissect.output.export.tables import Table
from dissect.output.export.transaction_rows import Row


class DuckdbSink(Sink):
    """Writes tables to the database ``path``. Raises `OSError` if it cannot be written."""

    def __init__(self, path: Path, tables: Iterable[Table], metadata: Mapping[str, str]) -> None:
        duckdb = needed("duckdb")
        self._error: type[Exception] = duckdb.Error
        self._log = path.with_name(f"{path.name}.wal")
        self._database: Any = None
        self._batches = {table.name: Batches(table, dictionaries=False) for table in tables}
        try:
            self._database = duckdb.connect(str(path))
            self._database.execute("CREATE TABLE s7dissect (key VARCHAR, value VARCHAR)")
            self._database.executemany("INSERT INTO s7dissect VALUES (?, ?)", list(metadata.items()))
            self._database.execute("BEGIN")
            for name, batches in self._batches.items():
                self._database.register("incoming", batches.schema.empty_table())
                self._database.execute(f'CREATE TABLE "{name}" AS SELECT * FROM incoming')  # noqa: S608 - our own names
                self._comment(batches.table)
        except self._error as error:
            self.abandon()  # the caller does not get this sink, so it cannot close it
            raise _refused(error) from error

    def take(self, table: Table, rows: Sequence[Row]) -> None:
        """Insert rows."""
        needed_table = self._batches[table.name].batch(rows)
        try:
            self._database.register("incoming", needed("pyarrow").Table.from_batches([needed_table]))
            self._database.execute(f'INSERT INTO "{table.name}" SELECT * FROM incoming')  # noqa: S608 - our own names
        except self._error as error:
            raise _refused(error) from error

    def close(self) -> None:
        """Write everything to the file, and close."""
        try:
            self._database.unregister("incoming")
            self._database.execute("COMMIT")
            self._database.execute("CHECKPOINT")
            self._database.close()
        except self._error as error:
            raise _refused(error) from error

    def abandon(self) -> None:
        """Close the database, which will be deleted, and delete the log that DuckDB leaves beside it."""
        if self._database is not None:
            with suppress(self._error):  # the database may be the cause of the failure
                self._database.close()
        self._log.unlink(missing_ok=True)

    def _comment(self, table: Table) -> None:
        for column in table.columns:
            about = column.about.replace("'", "''")
            self._database.execute(f'COMMENT ON COLUMN "{table.name}"."{column.name}" IS \'{about}\'')


def _refused(error: Exception) -> OSError:
    text = str(error).split("\n", 1)[0]
    return OSError(errno.ENOSPC if "space" in text or "full" in text else errno.EIO, text)
