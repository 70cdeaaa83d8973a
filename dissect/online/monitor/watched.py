"""Watched variables: their latest values, who read or wrote them, and a trend of a minute, in bounded memory."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable
from typing import Final

from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.transaction import Transaction
from dissect.output.variables.collector import ValueCollector
from dissect.output.variables.model import ValueRow, Variable
from dissect.output.variables.wanted import WantedSet

#: Greatest number of watched variables; values of others are only counted.
MAX_WATCHED: Final = 500
#: Seconds of a trend by the clock of the capture, and greatest number of values in the details of a variable.
SECONDS: Final = 60
LATEST: Final = 50
_NS_PER_S: Final = 1_000_000_000


class WatchedFacts:
    """The state of one variable: its ``latest`` row, the numbers of values and changes, and the latest changes.

    The trend has (second, number) for those of the last `SECONDS` in which there was a number.
    """

    def __init__(self, variable: Variable, row: ValueRow) -> None:
        self.variable = variable
        self.latest = row
        self.changed_ns = int(row.time_ns)
        self.count = 0
        self.changes = 0
        self.rows: deque[ValueRow] = deque(maxlen=LATEST)
        self._trend: deque[tuple[int, float]] = deque(maxlen=SECONDS)

    def add(self, row: ValueRow) -> None:
        """Take a value."""
        self.latest = row
        self.count += 1
        if row.changed:
            self.changed_ns = int(row.time_ns)
            self.changes += not row.first
            self.rows.append(row)
        value = row.value
        if isinstance(value, (bool, int, float)) and math.isfinite(value):
            second = int(row.time_ns) // _NS_PER_S
            if self._trend and self._trend[-1][0] >= second:
                self._trend.pop()
            self._trend.append((second, float(value)))

    def trend(self, now_ns: int, seconds: int) -> list[float]:
        """Return the latest number in each of the last ``seconds``, the present one included; NaN before the first number."""
        last = max(now_ns // _NS_PER_S, self._trend[-1][0] if self._trend else 0)
        known = dict(self._trend)
        number = math.nan
        for second, value in self._trend:
            if second <= last - seconds:
                number = value
        points = []
        for second in range(last - seconds + 1, last + 1):
            number = known.get(second, number)
            points.append(number)
        return points


class Watched:
    """Makes `WatchedFacts` from transactions, for the ``wanted`` variables; None for all."""

    def __init__(self, wanted: WantedSet | None = None, most: int = MAX_WATCHED) -> None:
        self._collector = ValueCollector(wanted, most=most)
        self._facts: dict[Variable, WatchedFacts] = {}
        self._most = most

    def take(self, transactions: Iterable[Transaction]) -> None:
        """Take transactions, in their order."""
        for transaction in transactions:
            self._collector.transaction(transaction)
        for row in self._collector.take():
            facts = self._facts.get(row.variable)
            if facts is None:
                if len(self._facts) >= self._most:
                    continue
                facts = self._facts[row.variable] = WatchedFacts(row.variable, row)
            facts.add(row)

    def forget(self, connection: Connection) -> None:
        """Forget a connection that is over."""
        self._collector.connection_closed(connection)

    @property
    def not_listed(self) -> int:
        """The number of values of variables for which there was no room."""
        return int(self._collector.untracked)

    @property
    def refused(self) -> int:
        """The number of refused reads and writes of the variables."""
        return int(self._collector.refused)

    @property
    def likely(self) -> int:
        """The number of transactions whose values were left out because they are only likely."""
        return sum(self._collector.doubts.values())

    @property
    def facts(self) -> list[WatchedFacts]:
        """Return the variables: those with a name first, in the order in which they were first seen."""
        return sorted(self._facts.values(), key=lambda one: not one.variable.tag)
