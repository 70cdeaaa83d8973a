"""Tables kept in memory compressed: most of their columns repeat, so they need about a fifth of the memory."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, Final

from dissect.output.export.arrow import Batches
from dissect.output.export.extras import needed
from dissect.output.export.feed import Sink
from dissect.output.export.tables import Table, chosen_tables
from dissect.output.export.transaction_rows import Row

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
