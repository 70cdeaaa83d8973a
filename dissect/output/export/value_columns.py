"""Collects values of variables in columns, as `dissect.output.export.item_columns` does with items. Compiled."""

from __future__ import annotations

import json
from typing import Final

from dissect.meaning.report.item_json import decoded_json
from dissect.output.export.item_columns import rounded
from dissect.output.export.transaction_rows import MOST_KNOWN, Packets, Shared, TransactionRows
from dissect.output.variables.model import HOWS, ValueRow, Variable
from dissect.wire.text import encodable

#: Groups of columns that repeat: those of the connection and the operation, and those of the variable.
ROUTE: Final = ("connection", "client_host", "server_host", "operation", "written")
VARIABLE: Final = ("address", "name", "type", "unit")


class ValueColumns:
    """The columns of values: each has an entry for each value; ``…_at`` has an index into a list of shared rows instead."""

    def __init__(self, rows: TransactionRows) -> None:
        self.packets: Packets = Packets(rows.files)
        self.routes: Shared = Shared([])
        self.variables: Shared = Shared([])
        self._route_of: dict[int, int] = {}
        self._variable_of: dict[tuple[Variable, str], int] = {}
        #: By index of the variable: its latest value, as number and as text.
        self._latest: dict[int, tuple[object, float | None, str | None]] = {}
        self._begin()

    def _begin(self) -> None:
        self.routes_at: list[int] = []
        self.variables_at: list[int] = []
        self.times: list[int] = []
        self.numbers: list[float | None] = []
        self.texts: list[str | None] = []
        self.data: list[bytes | None] = []
        self.changed: list[bool | None] = []
        self.previous: list[float | None] = []
        self.remarks: list[str | None] = []

    def clear(self) -> None:
        """Begin new columns; the old ones belong to the code that took them."""
        self._begin()
        self.packets.clear()
        if self.routes.bounded():
            self._route_of = {}
        if self.variables.bounded():
            self._variable_of = {}
            self._latest = {}

    def add(self, row: ValueRow) -> int:
        """Add a value; return the new number of values."""
        self.packets.add(row.frame)
        self.times.append(int(row.time_ns))
        self.routes_at.append(self._route(row))
        at = self._variable(row.variable)
        self.variables_at.append(at)
        self._value(at, row.value)
        self.data.append(row.data)
        self.changed.append(None if row.first else row.changed)
        before = row.previous
        self.previous.append(float(before) if isinstance(before, (int, float)) else None)
        self.remarks.append(encodable(row.remark) if row.remark else None)
        return len(self.data)

    def _value(self, at: int, value: object) -> None:
        """Add a value of the variable with this index.

        A polled value that does not change is the same object, and is written once.
        """
        known = self._latest.get(at)
        if known is None or known[0] is not value:
            known = self._latest[at] = (value, *shown(value))
        self.numbers.append(known[1])
        self.texts.append(known[2])

    def _route(self, row: ValueRow) -> int:
        """Return the index of the row with connection, hosts and operation."""
        key: int = ((int(row.link.number) * 2 + int(row.side)) * len(HOWS) + HOWS.index(row.how)) * 2 + int(row.writes)
        known = self._route_of
        found = known.get(key)
        if found is None:
            if len(known) >= MOST_KNOWN:
                known.clear()
            made = (int(row.connection), row.host, row.plc.host, row.how, bool(row.writes))
            found = known[key] = self.routes.at(made)
        return found

    def _variable(self, variable: Variable) -> int:
        """Return the index of the row of a variable, whose name may become known later."""
        key = (variable, variable.tag)
        known = self._variable_of
        found = known.get(key)
        if found is None:
            if len(known) >= MOST_KNOWN:
                known.clear()
            texts = (encodable(variable.tag) or None, variable.type or None, variable.unit or None)
            found = known[key] = self.variables.at((encodable(variable.address), *texts))
        return found


def shown(value: object) -> tuple[float | None, str | None]:
    """Return a value as number and text; a list or an object is JSON."""
    if value is None:
        return None, None
    if isinstance(value, (int, float)):
        return float(value), rounded(value) if isinstance(value, int) else None
    if isinstance(value, str):
        return None, encodable(value)
    if isinstance(value, list) and not any([isinstance(one, (dict, list)) for one in value]):
        return None, decoded_json(value)
    return None, json.dumps(value, default=str)
