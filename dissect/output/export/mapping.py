"""Names in another format for the columns of a table (`dissect.output.export.tables`), and so for facts."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

from dissect.output.export.tables import Table


class Mapped(NamedTuple):
    """A ``name`` of the format for a ``column`` of the table, empty if only the format has it; ``kind`` is its type."""

    name: str
    column: str
    kind: Any


def mapped(table: Table, kinds: Mapping[str, Any], text: str) -> tuple[Mapped, ...]:
    """Parse words: ``name``, or ``name=column`` if the format has another name; ``:kind`` if ``kinds`` does not have it.

    ``kinds`` are the types of the format by those of columns. Raises KeyError for a column that the table does not have.
    """
    types = {column.name: column.type for column in table.stored}
    found = []
    for word in text.split():
        name, renamed, rest = word.partition("=")
        column, _, kind = (rest if renamed else name).partition(":")
        known = kinds[types[column]] if column else None
        found.append(Mapped(name.partition(":")[0], column, kind or known))
    return tuple(found)


def told(names: tuple[Mapped, ...], row: Mapping[str, Any], given: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """Yield names and values of a row; ``given`` has the values that only the format has, or has in another form."""
    for one in names:
        yield one.name, given[one.name] if one.name in given else row[one.column]
