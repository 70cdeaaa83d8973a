"""Rows as Arrow record batches, and the Arrow type of each type of column (`dissect.output.export.tables`).

pyarrow is imported when the first schema is made. Timestamps have the time zone UTC (`TIMESTAMPTZ_NS` in DuckDB, which has that
type since 2.0).
"""

from __future__ import annotations

from array import array
from collections.abc import Sequence
from typing import Any, Final

from dissect.output.export.batch import Batch, Part
from dissect.output.export.extras import needed
from dissect.output.export.tables import BOOL, BYTES, INT, INTS, REAL, TEXT, TIME, WORD, WORDS, Table
from dissect.output.export.transaction_rows import Row
from dissect.wire.text import encodable

#: Version of the tables, in the metadata of each file; it changes when a column is renamed, removed, has another type or means
#: something else.
TABLES_VERSION: Final = 2


def types() -> dict[str, Any]:
    """Return the Arrow type of each type of column."""
    pa = needed("pyarrow")
    return {
        INT: pa.int64(),
        REAL: pa.float64(),
        BOOL: pa.bool_(),
        TEXT: pa.string(),
        WORD: pa.dictionary(pa.int32(), pa.string()),
        BYTES: pa.binary(),
        TIME: pa.timestamp("ns", "UTC"),
        INTS: pa.list_(pa.int64()),
        WORDS: pa.list_(pa.string()),
    }


class Batches:
    """Makes record batches of one table. ``dictionaries`` False: a repeated text is plain text."""

    def __init__(self, table: Table, dictionaries: bool = True, metadata: dict[str, str] | None = None) -> None:
        pa = needed("pyarrow")
        self._pa = pa
        kinds = types()
        if not dictionaries:
            kinds[WORD] = kinds[TEXT]
        self.table = table
        self.dictionaries = dictionaries
        self._kinds = {column.name: kinds[column.type] for column in table.columns}
        self._stored = tuple([column.name for column in table.stored])
        self._shared: dict[tuple[str, ...], tuple[Sequence[Row], int, list[Any]]] = {}
        self.schema = pa.schema(
            [
                pa.field(column.name, self._kinds[column.name], metadata={"about": column.about, "unit": column.unit})
                for column in table.columns
            ],
            metadata={"s7dissect.table": table.name, "s7dissect.tables": str(TABLES_VERSION), **(metadata or {})},
        )

    def batch(self, rows: Sequence[Row]) -> Any:
        """Return rows as a `pyarrow.RecordBatch`."""
        pa = self._pa
        some = rows if isinstance(rows, Batch) else Batch(self.table, [Part(self._stored, rows)], {})
        runs: dict[int, Any] = {}
        arrays: dict[str, Any] = {name: _array(pa, values, self._kinds[name]) for name, values in some.columns.items()}
        for part in some.parts:
            arrays.update(zip(part.names, self._part(part, runs), strict=True))
        return self._whole(arrays)

    def with_derived(self, batch: Any) -> Any:
        """Return a record batch of the stored columns with the columns that are derived from them."""
        return self._whole(dict(zip(batch.schema.names, batch.columns, strict=True)))

    def _whole(self, arrays: dict[str, Any]) -> Any:
        for column in self.table.columns:
            if column.of:
                arrays[column.name] = arrays[column.of].view(self._kinds[column.name])
        columns = [arrays[column.name] for column in self.table.columns]
        return self._pa.RecordBatch.from_arrays(columns, schema=self.schema)

    def _part(self, part: Part, runs: dict[int, Any]) -> list[Any]:
        """Return the columns of a part as arrays. Arrays of shared rows are made anew only when rows were added.

        ``runs`` stores the results of `_runs` for ``part.ends``, by the identity of that list.
        """
        pa = self._pa
        known = self._shared.get(part.names)
        if known is not None and known[0] is part.rows and known[1] == len(part.rows):
            made = known[2]
        else:
            columns: list[Any] = list(zip(*part.rows, strict=True)) if part.rows else [()] * len(part.names)
            made = [_array(pa, values, self._kinds[name]) for name, values in zip(part.names, columns, strict=True)]
        at = None
        if part.at is not None:
            self._shared[part.names] = (part.rows, len(part.rows), made)
            at = _array(pa, part.at if isinstance(part.at, array) else array("i", part.at), pa.int32())
        if part.ends is not None:
            run = runs.get(id(part.ends))
            if run is None:
                run = runs[id(part.ends)] = _runs(pa, part.ends)
            at = run if at is None else at.take(run)
        return made if at is None else [one.take(at) for one in made]


def _array(pa: Any, values: Sequence[Any], kind: Any) -> Any:
    if isinstance(values, array):
        return pa.Array.from_buffers(kind, len(values), [None, pa.py_buffer(values)])
    encoded = pa.types.is_dictionary(kind)  # made in two steps, which is thirty times faster than in one
    plain = kind.value_type if encoded else kind
    try:
        made = pa.array(values, plain)
    except UnicodeEncodeError:  # a name from the file system, or from a tag file, that UTF-8 cannot represent
        made = pa.array([_encodable(value) for value in values], plain)
    return made.dictionary_encode() if encoded else made


def _runs(pa: Any, ends: Sequence[int]) -> Any:
    """Return the number of its run for each row; ``ends`` has the row after the last one of each run."""
    numbers = _array(pa, array("i", range(len(ends))), pa.int32())
    runs = pa.RunEndEncodedArray.from_arrays(_array(pa, array("i", ends), pa.int32()), numbers)
    return needed("pyarrow.compute").run_end_decode(runs)


def _encodable(value: Any) -> Any:
    if isinstance(value, str):
        return encodable(value)
    return [encodable(one) for one in value] if isinstance(value, list) else value
