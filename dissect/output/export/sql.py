"""SQL over the tables: DuckDB queries Arrow tables in memory, without a file in between."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

from dissect.output.export.arrow import Batches
from dissect.output.export.extras import needed
from dissect.output.export.feed import Sink
from dissect.output.export.tables import TABLES, Table
from dissect.output.export.transaction_rows import Row
from dissect.wire.config.hints import close_names

_WORD: Final = re.compile(r"\w+")
#: DuckDB's error for a table that does not exist, and its suggestion of another table.
_MISSING: Final = re.compile(r"Table with name (\S+) does not exist!")
_OTHERS: Final = re.compile(r'Did you mean "[^"]*"\?')
#: This many rows of a result are fetched together.
_FETCH: Final = 8192


class SqlError(ValueError):
    """DuckDB's error for a query, with its lines unchanged: a caret marks the place."""


class MemorySink(Sink):
    """A sink that keeps tables in memory, as Arrow."""

    def __init__(self, tables: Sequence[Table]) -> None:
        self._batches = {table.name: Batches(table) for table in tables}
        self._kept: dict[str, list[Any]] = {table.name: [] for table in tables}

    def take(self, table: Table, rows: Sequence[Row]) -> None:
        """Keep rows."""
        self._kept[table.name].append(self._batches[table.name].batch(rows))

    def tables(self) -> dict[str, Any]:
        """Return a `pyarrow.Table` of each table."""
        pa = needed("pyarrow")
        return {
            name: pa.Table.from_batches(self._kept[name], batches.schema) for name, batches in self._batches.items()
        }


def named_tables(sql: str) -> list[Table]:
    """Return the tables whose names occur in a query: it cannot read any others."""
    words = {word.lower() for word in _WORD.findall(sql)}
    return [table for name, table in TABLES.items() if name in words]


class Query:
    """A query. It is tried on empty tables first, so that errors show before hours of reading.

    ``files``: the SQL may use files and the network. ``variables`` are the values that ``getvariable`` returns. Raises
    `SqlError`, and `MissingLibraryError` without DuckDB.
    """

    def __init__(self, sql: str, files: bool = False, variables: Mapping[str, str] | None = None) -> None:
        self.sql = sql
        self._files = files
        self._variables = dict(variables or {})
        self.tables = named_tables(sql)
        if not files:  # a query that writes a file must not run twice
            self._try()

    def run(self, tables: dict[str, Any]) -> Result:
        """Return the result of the query; ``tables`` are Arrow tables by name. Raises `SqlError`."""
        duckdb = needed("duckdb", "sql")
        connection = self._connect(tables)
        try:
            return Result(connection, connection.sql(self.sql), duckdb.Error)
        except duckdb.Error as error:
            connection.close()
            raise SqlError(_said(error)) from None

    def _try(self) -> None:
        duckdb = needed("duckdb", "sql")
        connection = self._connect(MemorySink(self.tables).tables())
        try:
            connection.execute(self.sql)  # unlike `sql`, its errors name the place in the line
        except duckdb.Error as error:
            raise SqlError(_said(error)) from None
        finally:
            connection.close()

    def _connect(self, tables: dict[str, Any]) -> Any:
        connection = needed("duckdb", "sql").connect(":memory:", config=_settings(self._files))
        connection.execute("SET TimeZone = 'UTC'")
        for name, value in self._variables.items():
            connection.execute(f"SET VARIABLE {name} = ?", [value])
        if not self._files:
            connection.execute("SET lock_configuration = true")
        for name, table in tables.items():
            connection.register(name, table)
        return connection


def _settings(files: bool) -> dict[str, str]:
    """Return locked settings for DuckDB: no access to this program's variables, and without ``files`` to files and network."""
    settings = {
        "python_enable_replacements": "false",
        "autoinstall_known_extensions": "false",
        "autoload_known_extensions": "false",
    }
    if not files:
        settings["enable_external_access"] = "false"
    return settings


def _said(error: Exception) -> str:
    """Return DuckDB's error; for a table that does not exist, with a guess among our tables instead of DuckDB's."""
    text = str(error).replace("\t", "    ").strip("\n")
    missing = _MISSING.search(text)
    if missing is None:
        return text
    near = close_names(missing[1].lower(), TABLES)
    hint = f"Did you mean {' or '.join(near)}?" if near else f"There are {', '.join(TABLES)}."
    return _OTHERS.sub(hint, text, count=1) if _OTHERS.search(text) else f"{text}\n{hint}"


class Result:
    """The result of a query: ``columns`` are names, `rows` plain values, times as ISO 8601 text. It can be read once."""

    def __init__(self, connection: Any, relation: Any, error: type[Exception]) -> None:
        self._connection = connection
        self._error = error
        self._reader = relation.to_arrow_reader(_FETCH) if relation is not None else None
        self.columns: list[str] = list(self._reader.schema.names) if self._reader is not None else []

    def rows(self) -> Iterator[list[Any]]:
        """Yield each row. Raises `SqlError` for errors that depend on values, such as a failed conversion."""
        if self._reader is None:
            return
        try:
            for batch in self._reader:
                yield from map(list, zip(*[_plain(column) for column in batch.columns], strict=True))
        except (self._error, OSError) as error:
            raise SqlError(_said(error)) from None
        finally:
            self.close()

    def close(self) -> None:
        """Close the database."""
        self._connection.close()


def _plain(column: Any) -> list[Any]:
    """Return a column as plain Python values that can be written as JSON or text."""
    pa = needed("pyarrow")
    kind = column.type
    if pa.types.is_timestamp(kind) and kind.tz is not None:  # of the session, which is in UTC
        column = column.cast(pa.timestamp(kind.unit))
    if pa.types.is_timestamp(kind) or pa.types.is_time(kind) or pa.types.is_date(kind) or pa.types.is_interval(kind):
        return list(column.cast(pa.string()).to_pylist()) if not pa.types.is_interval(kind) else _texts(column)
    if pa.types.is_dictionary(kind):
        return _plain(column.dictionary_decode())
    if pa.types.is_decimal(kind):
        return [_number(value) for value in column.to_pylist()]
    if pa.types.is_binary(kind) or pa.types.is_large_binary(kind):
        return [value.hex() if value is not None else None for value in column.to_pylist()]
    if pa.types.is_duration(kind) or pa.types.is_nested(kind):
        return _nested(column) if pa.types.is_nested(kind) else _texts(column)
    return list(column.to_pylist())


def _texts(column: Any) -> list[Any]:
    return [str(value.as_py()) if value.is_valid else None for value in column]


def _nested(column: Any) -> list[Any]:
    pa = needed("pyarrow")
    if pa.types.is_list(column.type):
        return [_plain(value.values) if value.is_valid else None for value in column]
    return _texts(column)


def _number(value: Any) -> Any:
    if value is None:
        return None
    return int(value) if value == value.to_integral_value() else float(value)
