"""SQLite: strict tables in one file, with indexes by connection and time.

Lists are JSON texts. Timestamps, ISO 8601 in UTC, are generated columns, computed from the nanoseconds when they are read.
"""

from __future__ import annotations

import errno
import sqlite3
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

from dissect.output.export.arrow import TABLES_VERSION
from dissect.output.export.cells import listed
from dissect.output.export.feed import Sink
from dissect.output.export.tables import BOOL, BYTES, INT, INTS, REAL, TEXT, WORD, WORDS, Column, Table
from dissect.output.export.transaction_rows import Row
from dissect.wire.text import encodable

_TYPES: Final = {
    INT: "INTEGER",
    REAL: "REAL",
    BOOL: "INTEGER",
    TEXT: "TEXT",
    WORD: "TEXT",
    BYTES: "BLOB",
    INTS: "TEXT",
    WORDS: "TEXT",
}
_LISTS: Final = frozenset((INTS, WORDS))


class SqliteSink(Sink):
    """Writes tables to the database ``path``. Raises `OSError` if it cannot be written."""

    def __init__(self, path: Path, tables: Iterable[Table], metadata: Mapping[str, str]) -> None:
        self._tables = tuple(tables)
        self._inserts: dict[str, str] = {}
        self._lists: dict[str, list[int]] = {}
        try:
            self._database = sqlite3.connect(path, isolation_level=None)
            # The file is new, and not yet under its final name, so no journal is needed against a crash of the machine.
            for line in ("journal_mode = OFF", "synchronous = OFF", f"user_version = {TABLES_VERSION}"):
                self._database.execute(f"PRAGMA {line}")
            self._database.execute("BEGIN")
            self._database.execute("CREATE TABLE s7dissect (key TEXT PRIMARY KEY, value TEXT) STRICT")
            self._database.executemany("INSERT INTO s7dissect VALUES (?, ?)", metadata.items())
            for table in self._tables:
                self._create(table)
        except sqlite3.Error as error:
            raise _refused(error) from error

    def take(self, table: Table, rows: Sequence[Row]) -> None:
        """Insert rows."""
        lists = self._lists[table.name]
        values: Sequence[Sequence[Any]] = [_flat(row, lists) for row in rows] if lists else rows
        try:
            self._insert(table, values)
        except UnicodeEncodeError:  # a name that UTF-8 cannot represent
            self._insert(table, [[encodable(one) if isinstance(one, str) else one for one in row] for row in values])
        except sqlite3.Error as error:
            raise _refused(error) from error

    def close(self) -> None:
        """Make the indexes, and close."""
        try:
            for table in self._tables:
                names = {column.name for column in table.columns}
                for keys in (("connection", "ts_ns"), ("transaction",)):
                    if names.issuperset(keys):
                        columns = ", ".join([f'"{key}"' for key in keys])
                        self._database.execute(f'CREATE INDEX "{table.name}_{keys[0]}" ON "{table.name}" ({columns})')
            self._database.execute("COMMIT")
            self._database.close()
        except sqlite3.Error as error:
            raise _refused(error) from error

    def abandon(self) -> None:
        """Close the database, which will be deleted."""
        with suppress(sqlite3.Error):  # the database may be the cause of the failure
            self._database.close()

    def _create(self, table: Table) -> None:
        columns = ", ".join([_declared(column) for column in table.columns])
        self._database.execute(f'CREATE TABLE "{table.name}" ({columns}) STRICT')
        stored = table.stored
        names = ", ".join([f'"{column.name}"' for column in stored])
        marks = ", ".join("?" * len(stored))
        self._inserts[table.name] = f'INSERT INTO "{table.name}" ({names}) VALUES ({marks})'  # noqa: S608 - our own names
        self._lists[table.name] = [at for at, column in enumerate(stored) if column.type in _LISTS]

    def _insert(self, table: Table, rows: Iterable[Sequence[Any]]) -> None:
        self._database.execute("SAVEPOINT rows")
        try:
            self._database.executemany(self._inserts[table.name], rows)
        except UnicodeEncodeError:
            self._database.execute("ROLLBACK TO rows")
            raise
        self._database.execute("RELEASE rows")


def _declared(column: Column) -> str:
    if not column.of:
        return f'"{column.name}" {_TYPES[column.type]}'
    second = f'"{column.of}" / 1000000000'
    text = f"strftime('%Y-%m-%dT%H:%M:%S', {second}, 'unixepoch') || printf('.%09dZ', \"{column.of}\" % 1000000000)"
    return f'"{column.name}" TEXT GENERATED ALWAYS AS ({text}) VIRTUAL'


def _flat(row: Row, lists: Sequence[int]) -> list[Any]:
    values = list(row)
    for at in lists:
        values[at] = listed(values[at]) if values[at] is not None else None
    return values


def _refused(error: sqlite3.Error) -> OSError:
    code = errno.ENOSPC if "full" in str(error) else errno.EIO
    return OSError(code, str(error))
