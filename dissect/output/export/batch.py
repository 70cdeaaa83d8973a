"""`Batch`: rows that are passed on together. A sink may take whole columns, or the rows one by one."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import chain, pairwise, repeat
from typing import Any, NamedTuple, overload

from dissect.output.export.tables import Table
from dissect.output.export.transaction_rows import Row


class Part(NamedTuple):
    """Some columns of a batch, with shared values: row n of the batch has ``rows[at[n]]``; ``rows[n]`` if ``at`` is None.

    With ``ends``, neighbouring rows share their values: ``at`` has an entry for each run of rows, ``ends`` the row after its
    last one.
    """

    names: tuple[str, ...]
    rows: Sequence[Row]
    at: Sequence[int] | None = None
    ends: Sequence[int] | None = None

    @property
    def size(self) -> int:
        """The number of rows of the batch."""
        if self.ends is not None:
            return self.ends[-1] if self.ends else 0
        return len(self.rows if self.at is None else self.at)

    def spread(self) -> Sequence[Row]:
        """Return the values of each row of the batch."""
        rows = self.rows if self.at is None else [self.rows[at] for at in self.at]
        if self.ends is None:
            return rows
        counts = [end - begin for begin, end in pairwise([0, *self.ends])]
        return list(chain.from_iterable(map(repeat, rows, counts)))


class Batch(Sequence[Row]):
    """Rows of a table: ``parts`` and plain ``columns`` together hold all its stored columns."""

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
        return self.parts[0].size

    def _made(self) -> list[Row]:
        if self._rows is None:
            columns = dict(self.columns)
            for part in self.parts:
                columns.update(zip(part.names, zip(*part.spread(), strict=True), strict=True))
            self._rows = list(zip(*[columns[column.name] for column in self.table.stored], strict=True))
        return self._rows
