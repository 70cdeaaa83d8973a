"""Rows as Arrow: the one place that says what a type of `dissect.export.tables` is in Arrow and Parquet.

pyarrow is imported when the first schema is made. Timestamps have no time zone and are in UTC: DuckDB has next to no functions
for a timestamp with a zone in nanoseconds.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

from dissect.export.extras import needed
from dissect.export.tables import BOOL, BYTES, INT, INTS, REAL, TEXT, TIME, WORD, WORDS, Table
from dissect.export.transaction_rows import Row
from dissect.wire.text import encodable

#: Version of the tables, in the metadata of each file; it changes when a column is renamed, removed or means something else.
TABLES_VERSION: Final = 1


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
        TIME: pa.timestamp("ns"),
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
        self._types = [kinds[column.type] for column in table.columns]
        self.schema = pa.schema(
            [
                pa.field(column.name, kind, metadata={"about": column.about, "unit": column.unit})
                for column, kind in zip(table.columns, self._types, strict=True)
            ],
            metadata={"s7dissect.table": table.name, "s7dissect.tables": str(TABLES_VERSION), **(metadata or {})},
        )

    def batch(self, rows: Sequence[Row]) -> Any:
        """Return rows as a batch."""
        pa = self._pa
        columns: list[Any] = list(zip(*rows, strict=True)) if rows else [() for _ in self.table.stored]
        stored = iter(columns)
        arrays: dict[str, Any] = {}
        for column, kind in zip(self.table.columns, self._types, strict=True):
            if not column.of:
                arrays[column.name] = _array(pa, next(stored), kind)
        for column, kind in zip(self.table.columns, self._types, strict=True):
            if column.of:
                arrays[column.name] = arrays[column.of].view(kind)
        return pa.RecordBatch.from_arrays([arrays[column.name] for column in self.table.columns], schema=self.schema)


def _array(pa: Any, values: Sequence[Any], kind: Any) -> Any:
    encoded = pa.types.is_dictionary(kind)  # made in two steps, which is thirty times faster than in one
    plain = kind.value_type if encoded else kind
    try:
        made = pa.array(values, plain)
    except UnicodeEncodeError:  # a name from the file system, or from a tag file, that UTF-8 cannot hold
        made = pa.array([_encodable(value) for value in values], plain)
    return made.dictionary_encode() if encoded else made


def _encodable(value: Any) -> Any:
    if isinstance(value, str):
        return encodable(value)
    return [encodable(one) for one in value] if isinstance(value, list) else value
