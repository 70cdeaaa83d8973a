"""The parts of a row of the table of facts: `Fact`, `Cell`, and readers that several cells need.

A cell is the place of the fact in a record of the face (``ending.by``), or a `Cell` if more is needed: ``read`` makes the value
from that place and the record, ``tells`` checks the value if the face shows less.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final, NamedTuple

from tests.faces.kinds import (
    UNTOLD,
    Agrees,
)
from tests.faces.records import Record, end

#: Makes the value from the content of a cell's place and the whole record.
Made = Callable[[Any, Record], Any]


class Cell(NamedTuple):
    """How a face shows a fact: its place in the record, the way to read it, and how much of the fact it shows."""

    path: str
    read: Made | None = None
    tells: Agrees | None = None


class Fact(NamedTuple):
    """A fact of a kind of record, the kind of its values, and its cells by name of face."""

    record: str
    name: str
    kind: str
    cells: dict[str, Cell]


#: Names of faces that cannot be names of arguments.
_FACES: Final = {"where": "-Y"}


def _fact(record: str, name: str, kind: str, cells: dict[str, str | Cell]) -> Fact:
    return Fact(record, name, kind, {
        _FACES.get(face, face): cell if isinstance(cell, Cell) else Cell(cell) for face, cell in cells.items()
    })  # fmt: skip


class Rows:
    """Collects the rows of a kind of record."""

    def __init__(self, record: str) -> None:
        self._record = record
        self.rows: list[Fact] = []

    def __call__(self, name: str, kind: str, **cells: str | Cell) -> None:
        self.rows.append(_fact(self._record, name, kind, cells))


# ---- readers --------------------------------------------------------------------------------------------------------


def zero(path: str) -> Cell:
    """Return a cell of a count that is omitted if it is 0."""
    return Cell(path, lambda value, _: int(value or 0))


def ends(host: str, port: str) -> Cell:
    return Cell(host, lambda value, record: end(value, record[port]))


def ecs_end(side: str) -> Cell:
    return Cell(f"{side}.ip", lambda value, record: end(value, record.get(side, {}).get("port")))


def zeek_end(side: str) -> Cell:
    return Cell(f"{side}_h", lambda value, record: end(value, record[f"{side}_p"]))


def sender(client: str, server: str) -> Made:
    """Return a reader that chooses between both ends of a table by ``from_client``."""

    def made(value: Any, record: Record) -> Any:
        side = client if value else server
        return end(record[f"{side}_host"], record[f"{side}_port"])

    return made


def mapped(path: str, names: dict[Any, Any]) -> Cell:
    return Cell(path, lambda value, _: names.get(value, value))


def none(path: str, *nothing: Any) -> Cell:
    """Return a cell in which some values mean nothing."""
    return Cell(path, lambda value, _: None if value in nothing else value)


def told(path: str) -> Cell:
    """Return a cell of a face that simply omits missing facts."""
    return Cell(path, lambda value, _: UNTOLD if value is None else value)


def first(value: Any, _: Record) -> Any:
    """Return the first of several values, None for none."""
    return value[0] if value else None
