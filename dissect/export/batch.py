"""Rows that are handed on together: by whole columns to those who can, one by one to all."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple, overload

from dissect.export.tables import Table
from dissect.export.transaction_rows import Row


class Part(NamedTuple):
    """Columns that belong together: each row of the batch has, in these, the one of ``rows`` that ``at`` says, or its own."""

    names: tuple[str, ...]
    rows: Sequence[Row]
    at: Sequence[int] | None = None


class Batch(Sequence[Row]):
    """Rows of a table: ``parts`` and plain ``columns``, which together are all of its stored columns."""

    def __init__(self, table: Table, parts: Sequence[Part], columns: Mapping[str, Sequence[Any]]) -> None:
        self.table = table
        self.parts = parts
        self.columns = columns
        self._rows: list[Row] | None = None

    @overload
    def __getitem__(self, index: int) -> Row: ...
    @overload
    def __getitem__(self, index: slice) -> Sequence[Row]: ...
    def __getitem__(self, index: int | slice) -> Row | Sequence[Row]:
        """Return rows as tuples of the stored columns."""
        return self._made()[index]

    def __iter__(self) -> Iterator[Row]:
        """Yield rows as tuples of the stored columns."""
        return iter(self._made())

    def __len__(self) -> int:
        part = self.parts[0]
        return len(part.rows if part.at is None else part.at)

    def _made(self) -> list[Row]:
        if self._rows is None:
            columns = dict(self.columns)
            for part in self.parts:
                rows = part.rows if part.at is None else [part.rows[at] for at in part.at]
                columns.update(zip(part.names, zip(*rows, strict=True), strict=True))
            self._rows = list(zip(*[columns[column.name] for column in self.table.stored], strict=True))
        return self._rows
