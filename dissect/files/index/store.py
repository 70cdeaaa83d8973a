"""The catalogue on disk: a SQLite database with a row for each file, its connections' ends and its findings.

Names of files are stored as the bytes of the file system, which need not be text in any encoding. The catalogue can be made
again at any time, so one from a different version is emptied. Files are replaced in transactions: a concurrent reader, or one
after a crash, sees either the old or the new state.
"""

from __future__ import annotations

import errno
import os
import sqlite3
from collections.abc import Iterable, Iterator
from pathlib import Path
from types import TracebackType
from typing import Final, Self

from dissect.files.index.facts import FileFacts

#: Exceptions from reading a damaged database, including invalid UTF-8 in names and texts, and numbers out of range.
DATABASE_ERRORS: Final = (sqlite3.Error, UnicodeError, OverflowError)

#: The name of the catalogue in its folder.
NAME: Final = ".s7dissect-index.sqlite"
#: Changes with the tables below.
FORMAT: Final = 2
#: Marks the database as ours (PRAGMA application_id): "S7ix".
_MARK: Final = 0x53376978
#: Seconds to wait for another process that is writing.
_PATIENCE: Final = 10.0

_TABLES: Final = """
CREATE TABLE about (name TEXT PRIMARY KEY, value TEXT NOT NULL) STRICT;
CREATE TABLE files (
    id INTEGER PRIMARY KEY, name BLOB NOT NULL UNIQUE, size INTEGER NOT NULL, mtime_ns INTEGER NOT NULL,
    packets INTEGER NOT NULL, first_ns INTEGER NOT NULL, last_ns INTEGER NOT NULL, pdus INTEGER NOT NULL,
    connections INTEGER NOT NULL, transactions INTEGER NOT NULL, errors INTEGER NOT NULL, unanswered INTEGER NOT NULL,
    all_pairs INTEGER NOT NULL, damage TEXT NOT NULL
) STRICT;
CREATE TABLE pairs (
    file INTEGER NOT NULL REFERENCES files ON DELETE CASCADE,
    address BLOB NOT NULL, port INTEGER NOT NULL, other_address BLOB NOT NULL, other_port INTEGER NOT NULL
) STRICT;
CREATE TABLE findings (
    file INTEGER NOT NULL REFERENCES files ON DELETE CASCADE, slug TEXT NOT NULL, count INTEGER NOT NULL
) STRICT;
CREATE INDEX pairs_of ON pairs (file);
CREATE INDEX findings_of ON findings (file);
"""
_COLUMNS: Final = (
    "name", "size", "mtime_ns", "packets", "first_ns", "last_ns", "pdus", "connections", "transactions", "errors",
    "unanswered", "all_pairs", "damage",
)  # fmt: skip


class StoreError(Exception):
    """The catalogue cannot be used; the text says why and what to do. ``full`` is the error number of a full disk, else 0."""

    def __init__(self, text: str, full: int = 0) -> None:
        super().__init__(text)
        self.full = full


class Store:
    """A catalogue, as a context.

    An index that another ``version`` of the program wrote is emptied, because that version may have found other things. Without
    ``changes`` it must exist, and is only read. Raises `StoreError` if it cannot be opened, read or written.
    """

    def __init__(self, path: Path, version: str, changes: bool = True) -> None:
        self.path = path
        self._changes = changes
        self._about = {"format": str(FORMAT), "version": version}
        self._base: sqlite3.Connection

    def __enter__(self) -> Self:
        try:
            if self._changes:
                self._base = sqlite3.connect(self.path, timeout=_PATIENCE)
            else:
                self._base = sqlite3.connect(f"{self.path.absolute().as_uri()}?mode=ro", timeout=_PATIENCE, uri=True)
            try:
                self._prepare()
            except BaseException:
                self._base.close()
                raise
        except DATABASE_ERRORS as error:
            raise self._failed(error) from None
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._base.close()

    def _prepare(self) -> None:
        base = self._base
        base.execute("PRAGMA foreign_keys = ON")
        if self._is_current():
            return
        if not self._changes:
            raise StoreError(f"{self.path} is not of this version: `s7dissect index` brings it up to date")
        # Another process may be about to do the same: the second one finds that it is already done.
        base.execute("BEGIN IMMEDIATE")
        if not self._is_current():
            for (name,) in base.execute("SELECT name FROM sqlite_master WHERE type = 'table'").fetchall():
                base.execute(f'DROP TABLE "{name}"')
            for statement in _TABLES.split(";"):
                base.execute(statement)
            base.executemany("INSERT INTO about VALUES (?, ?)", list(self._about.items()))
            base.execute(f"PRAGMA application_id = {_MARK}")
        base.commit()

    def _is_current(self) -> bool:
        """Return whether the database is a catalogue of this version. Raises `StoreError` for a database of another program."""
        tables = self._base.execute("SELECT count(*) FROM sqlite_master").fetchone()[0]
        # After the tables: a concurrent process marks them in the same transaction.
        mark = self._base.execute("PRAGMA application_id").fetchone()[0]
        if mark != _MARK and tables:
            raise StoreError(f"{self.path} is a database of another program: choose another name with --file")
        return mark == _MARK and dict(self._base.execute("SELECT name, value FROM about")) == self._about

    def _failed(self, error: Exception) -> StoreError:
        if isinstance(error, sqlite3.OperationalError) and "locked" in str(error):
            return StoreError(f"{self.path} is being written by another process: try again when that is done")
        if isinstance(error, sqlite3.DatabaseError) and "not a database" in str(error):
            return StoreError(
                f"{self.path} is not an index of s7dissect: remove it, or choose another name with --file"
            )
        if "disk is full" in str(error):
            return StoreError(f"{self.path}: {error}", errno.ENOSPC)
        if "readonly" in str(error) or "unable to open" in str(error):
            if not self._changes:
                return StoreError(f"{self.path} cannot be read")
            return StoreError(f"{self.path} cannot be written: choose another place with --file")
        if "malformed" in str(error) or not isinstance(error, sqlite3.Error):
            return StoreError(f"{self.path} is damaged: remove it, `s7dissect index` makes it again")
        return StoreError(f"{self.path}: {error}")

    def known(self) -> dict[str, tuple[int, int]]:
        """Return the size and time of change of each file when it was read, by name."""
        try:
            rows = self._base.execute("SELECT name, size, mtime_ns FROM files").fetchall()
        except DATABASE_ERRORS as error:
            raise self._failed(error) from None
        return {os.fsdecode(name): (size, mtime_ns) for name, size, mtime_ns in rows}

    def write(self, changes: Iterable[FileFacts | str]) -> None:
        """Write the facts on files in one transaction, replacing earlier ones; for a name alone, remove the file."""
        try:
            with self._base as base:
                for change in changes:
                    name = os.fsencode(change if isinstance(change, str) else change.name)
                    base.execute("DELETE FROM files WHERE name = ?", (name,))
                    if not isinstance(change, str):
                        self._insert(name, change)
        except DATABASE_ERRORS as error:
            raise self._failed(error) from None

    def _insert(self, name: bytes, facts: FileFacts) -> None:
        base = self._base
        values = [name, *[getattr(facts, column) for column in _COLUMNS[1:]]]
        marks = ", ".join("?" * len(_COLUMNS))
        row = base.execute(f"INSERT INTO files ({', '.join(_COLUMNS)}) VALUES ({marks})", values)  # noqa: S608 - our own words
        number = row.lastrowid
        base.executemany("INSERT INTO pairs VALUES (?, ?, ?, ?, ?)", [(number, *pair) for pair in facts.pairs])
        base.executemany(
            "INSERT INTO findings VALUES (?, ?, ?)", [(number, slug, count) for slug, count in facts.findings.items()]
        )

    def files(self) -> Iterator[FileFacts]:
        """Yield the files in the order of their first packets, then of their names."""
        try:
            base = self._base
            rows = base.execute(
                f"SELECT id, {', '.join(_COLUMNS)} FROM files ORDER BY first_ns, name"  # noqa: S608 - our own words
            ).fetchall()
            for number, *values in rows:
                facts = FileFacts(**dict(zip(_COLUMNS, values, strict=True)))
                facts.name = os.fsdecode(facts.name)
                facts.all_pairs = bool(facts.all_pairs)
                facts.pairs = frozenset(
                    base.execute("SELECT address, port, other_address, other_port FROM pairs WHERE file = ?", (number,))
                )
                facts.findings = dict(
                    base.execute("SELECT slug, count FROM findings WHERE file = ? ORDER BY slug", (number,))
                )
                yield facts
        except DATABASE_ERRORS as error:
            raise self._failed(error) from None
