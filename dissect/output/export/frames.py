"""The tables as data frames of pandas or polars, made from Arrow tables that are kept in memory compressed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final

from dissect.engine.pipeline import Options
from dissect.files.session import KeyLogFiles, Tags, reading_of
from dissect.output.export.arrow import Batches
from dissect.output.export.extras import needed
from dissect.output.export.feed import Sink, TableFeed
from dissect.output.export.tables import Table, chosen_tables
from dissect.output.export.transaction_rows import Row
from dissect.packets.source.given import Source
from dissect.wire.config.hints import close_names
from dissect.wire.text import encodable

if TYPE_CHECKING:
    from dissect.meaning.select import Where

#: The codecs, the best first: pyarrow may be built without either. zstd takes 20 MB where lz4 takes 35, for 5 % more CPU.
_CODECS: Final = ("zstd", "lz4")
_NONE: Final[Mapping[str, Any]] = MappingProxyType({})


class PackedTables(Sink):
    """A sink that keeps each batch of rows as a compressed Arrow stream; ``rows`` are the numbers of rows by table.

    ``kept`` and ``counted``: what another one holds, of which this one is a copy.
    """

    def __init__(
        self,
        tables: Sequence[Table],
        kept: Mapping[str, Sequence[bytes]] = _NONE,
        counted: Mapping[str, int] = _NONE,
    ) -> None:
        self._tables = tuple(tables)
        pa = needed("pyarrow")
        needed("pyarrow.ipc")
        self._pa = pa
        codec = next((name for name in _CODECS if pa.Codec.is_available(name)), None)
        self._options = pa.ipc.IpcWriteOptions(compression=codec)
        self._batches = {table.name: Batches(table) for table in tables}
        self._kept: dict[str, list[bytes]] = {table.name: list(kept.get(table.name, ())) for table in tables}
        self.rows = {table.name: counted.get(table.name, 0) for table in tables}

    def __reduce__(self) -> tuple[Any, ...]:
        return _copy, ([table.name for table in self._tables], self._kept, self.rows)

    def take(self, table: Table, rows: Sequence[Row]) -> None:
        """Keep rows; derived columns are made again when they are needed."""
        whole = self._batches[table.name].batch(rows)
        stored = whole.select([column.name for column in table.stored])
        out = self._pa.BufferOutputStream()
        with self._pa.ipc.new_stream(out, stored.schema, options=self._options) as stream:
            stream.write_batch(stored)
        self._kept[table.name].append(out.getvalue().to_pybytes())  # the buffer of a stream is up to twice as large
        self.rows[table.name] += len(rows)
        self._pa.default_memory_pool().release_unused()  # it keeps what the batch took, some 10 MB

    def table(self, name: str) -> Any:
        """Return a table as a `pyarrow.Table`."""
        pa, batches = self._pa, self._batches[name]
        found = []
        for packed in self._kept[name]:
            with pa.ipc.open_stream(packed) as stream:
                found += [batches.with_derived(batch) for batch in stream]
        return pa.Table.from_batches(found, batches.schema)


def _copy(names: Sequence[str], kept: Mapping[str, Sequence[bytes]], counted: Mapping[str, int]) -> PackedTables:
    return PackedTables(chosen_tables(names), kept, counted)


#: The libraries whose frames can be made.
LIBRARIES: Final = ("pandas", "polars", "arrow")


class Frames:
    """Data frames by the names of their tables: ``frames["items"]`` or ``frames.items``; iterating yields the names.

    A frame is made when it is first accessed; until then the rows of its table are kept compressed.
    """

    def __init__(self, tables: PackedTables, library: str) -> None:
        self._tables = tables
        self._library = library
        self._made: dict[str, Any] = {}

    def __repr__(self) -> str:
        return f"Frames({', '.join([f'{name}: {rows}' for name, rows in self._tables.rows.items()])})"

    def __reduce__(self) -> tuple[Any, ...]:
        return Frames, (self._tables, self._library)

    def __iter__(self) -> Any:
        return iter(self._tables.rows)

    def __len__(self) -> int:
        return len(self._tables.rows)

    def __dir__(self) -> list[str]:
        """Return the names of the tables, too, so that interactive completion offers them."""
        return sorted([*super().__dir__(), *self._tables.rows])

    def __getitem__(self, name: str) -> Any:
        """Return the frame of a table. Raises KeyError for a table that was not read."""
        names = self._tables.rows
        if name not in names:
            near = close_names(name, names)
            hint = f"; did you mean {' or '.join(near)}?" if near else f"; there are {', '.join(names)}"
            raise KeyError(f"no table {encodable(name)!r}{hint}")
        if name not in self._made:
            self._made[name] = _frame(self._tables.table(name), self._library)
        return self._made[name]

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        try:
            return self[name]
        except KeyError as error:
            raise AttributeError(error.args[0]) from None


def frames(
    path: Source,
    *more: Source,
    library: str = "pandas",
    tables: Sequence[str] | str = (),
    where: str | Where | None = None,
    tags: Tags = None,
    tls_keys: KeyLogFiles = None,
    checksums: bool = False,
    slow_ns: int = 1_000_000_000,
) -> Frames:
    """Return the tables of one capture or several as data frames, columns as in docs/tables.md.

    ``library`` is ``pandas``, ``polars`` or ``arrow`` (a `pyarrow.Table`). In pandas, columns have Arrow types, so integers
    with nulls stay integers. ``tables`` names the wanted tables, all by default; fewer are faster. The other arguments are
    those of `dissect.open`. Everything is kept in memory. Raises `MissingLibraryError` (an ImportError) with the command that
    installs a missing library, ValueError for a wrong name of a library or a table, `CaptureError` if a file cannot be read,
    and `SelectError` for a wrong expression.
    """
    if library not in LIBRARIES:
        near = close_names(library, LIBRARIES)
        raise ValueError(
            f"no library {library!r}; {'did you mean ' + near[0] if near else 'use ' + ', '.join(LIBRARIES)}"
        )
    for name in {"pyarrow", library} - {"arrow"}:
        needed(name, "dissect.frames")
    chosen = chosen_tables([tables] if isinstance(tables, str) else tables)
    sink = PackedTables(chosen)
    feed = TableFeed(chosen, sink)
    run = reading_of([path, *more], Options(slow_ns, checksums=checksums), where, tags, tls_keys).run(feed)
    feed.begin(run.files)
    run.read()
    feed.finish(run.pipeline, run.files)
    return Frames(sink, library)


def _frame(table: Any, library: str) -> Any:
    if library == "arrow":
        return table
    if library == "polars":
        return needed("polars", "dissect.frames").from_arrow(table)
    pandas = needed("pandas", "dissect.frames")
    return table.to_pandas(types_mapper=pandas.ArrowDtype)
