"""The tables as data frames of pandas or polars, made from Arrow tables."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final

from dissect.engine.pipeline import Options
from dissect.files.session import KeyLogFiles, Tags, reading_of
from dissect.output.export.extras import needed
from dissect.output.export.feed import TableFeed
from dissect.output.export.packed import PackedTables
from dissect.output.export.tables import chosen_tables
from dissect.packets.source.given import Source
from dissect.wire.config.hints import close_names
from dissect.wire.text import encodable

if TYPE_CHECKING:
    from dissect.meaning.select import Where

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
