"""Values as text: for CSV, and lists for databases without a list type."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

from dissect.output.export.tables import BYTES, TIME, Column
from dissect.wire.text import Clock, cell


class Cells:
    """Makes CSV cells: no text that a spreadsheet would run as a formula, times in ISO 8601 (UTC), bytes in hexadecimal."""

    def __init__(self, columns: Sequence[Column]) -> None:
        self._columns = tuple(columns)
        stored = [column.name for column in columns if not column.of]
        self._at = [stored.index(column.of or column.name) for column in columns]
        self._clock = Clock()

    def row(self, values: Sequence[Any]) -> list[str]:
        """Return the cells of a row, derived columns included; an empty cell is null."""
        return [self._cell(column, values[at]) for column, at in zip(self._columns, self._at, strict=True)]

    def _cell(self, column: Column, value: Any) -> str:
        if value is None:
            return ""
        if column.type == TIME:
            return self._clock.iso(value)
        if column.type == BYTES:
            return str(value.hex())
        if isinstance(value, str):
            return cell(value)
        if isinstance(value, bool):
            return "true" if value else "false"
        if isinstance(value, list):
            return cell(listed(value))
        return repr(value)


def listed(values: Sequence[Any]) -> str:
    """Return a list as JSON."""
    return json.dumps(values, ensure_ascii=False)
