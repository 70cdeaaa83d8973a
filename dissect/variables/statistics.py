"""What a summary says of one variable, added up value by value in bounded memory."""

from __future__ import annotations

import math
from typing import Final

from mypy_extensions import i64

from dissect.transactions.connection import Connection
from dissect.variables.model import ValueRow

#: Distinct values that are told apart; of more only that there are more.
MAX_DISTINCT: Final = 20
#: Clients of one variable that are told apart; the others count together.
MAX_CLIENTS: Final = 8
#: Points of a trend: when there are twice as many, neighbours become one.
POINTS: Final = 24
_BUCKET_NS: Final = 1_000_000


class Pace:
    """How often a client came: ``count`` times, on average every ``mean`` nanoseconds, of which ``jitter`` is the deviation."""

    __slots__ = ("count", "last_ns", "mean", "squares")

    def __init__(self) -> None:
        self.count: i64 = 0
        self.last_ns: i64 = 0
        self.mean: float = 0.0
        self.squares: float = 0.0

    def add(self, time_ns: i64) -> None:
        """Take the time of another value (Welford's way of adding up deviations)."""
        if self.count:
            gap = float(time_ns - self.last_ns)
            off = gap - self.mean
            self.mean += off / float(self.count)
            self.squares += off * (gap - self.mean)
        self.count += 1
        self.last_ns = time_ns

    @property
    def period_ns(self) -> int | None:
        """The mean time between two values, None for fewer than two."""
        return round(self.mean) if self.count > 1 else None

    @property
    def jitter_ns(self) -> int | None:
        """The standard deviation of that time, None for fewer than two of them."""
        return round(math.sqrt(self.squares / float(self.count - 1))) if self.count > 2 else None


class Statistics:
    """The values of one variable: how many, first, last, extremes, mean, distinct ones, and who gave and took them.

    ``first`` and ``last`` are values, or octets (bytes) where these have no value. ``least``, ``most``, ``total`` and the
    ``trend`` are of the ``numbers`` among them (a truth value is 0 or 1; NaN and the infinities are none).
    ``distinct`` are octets, or texts of values without octets, at most `MAX_DISTINCT`. ``others`` are values of clients beyond
    `MAX_CLIENTS`.
    """

    __slots__ = (
        "_bucket_ns",
        "_link",
        "_pace",
        "_side",
        "_writes",
        "changes",
        "count",
        "distinct",
        "first",
        "first_ns",
        "last",
        "last_ns",
        "least",
        "more_distinct",
        "most",
        "numbers",
        "others",
        "readers",
        "total",
        "trend",
        "writers",
    )

    def __init__(self) -> None:
        self.count: i64 = 0
        self.changes: i64 = 0
        self.first: object = None
        self.first_ns: i64 = 0
        self.last: object = None
        self.last_ns: i64 = 0
        self.numbers: i64 = 0
        self.least: int | float = 0
        self.most: int | float = 0
        self.total: float = 0.0
        self.distinct: set[bytes] = set()
        self.more_distinct: bool = False
        self.readers: dict[str, Pace] = {}
        self.writers: dict[str, Pace] = {}
        self.others: i64 = 0
        self.trend: list[float] = []
        self._bucket_ns: i64 = _BUCKET_NS
        self._pace: Pace | None = None
        self._link: Connection | None = None
        self._side: i64 = 0
        self._writes: bool = False

    def add(self, row: ValueRow) -> None:
        """Add a value."""
        time_ns: i64 = row.time_ns
        value = row.value
        if value is None:
            value = row.data
        if self.count == 0:
            self.first = value
            self.first_ns = time_ns
        self.count += 1
        self.last = value
        self.last_ns = time_ns
        if row.changed:
            if not row.first:
                self.changes += 1
            if not self.more_distinct:
                key = row.data if row.data is not None else repr(value).encode("utf-8", "backslashreplace")
                if key not in self.distinct:
                    if len(self.distinct) >= MAX_DISTINCT:
                        self.more_distinct = True
                    else:
                        self.distinct.add(key)
        if isinstance(value, float):
            if math.isfinite(value):
                self._number(value, value, time_ns)
        elif isinstance(value, int):
            number: int = int(value)
            self._number(number, float(number), time_ns)
        if self._pace is not None and row.link is self._link and row.side == self._side and row.writes == self._writes:
            self._pace.add(time_ns)  # the same client as before: its address need not be written again
            return
        clients = self.writers if row.writes else self.readers
        host = row.host
        pace = clients.get(host)
        if pace is None:
            if len(clients) >= MAX_CLIENTS:
                self.others += 1
                return
            pace = Pace()
            clients[host] = pace
        self._pace = pace
        self._link = row.link
        self._side = row.side
        self._writes = row.writes
        pace.add(time_ns)

    @property
    def distinct_count(self) -> int:
        """How many distinct values there were, at most `MAX_DISTINCT`."""
        return len(self.distinct)

    @property
    def mean(self) -> float | None:
        """The mean of all numbers, None where there are none."""
        return self.total / float(self.numbers) if self.numbers else None

    @property
    def pace(self) -> Pace | None:
        """The pace of the client that read most often, or else wrote; None where nobody did twice."""
        found = [pace for pace in [*self.readers.values()] if pace.count > 1]
        if not found:
            found = [pace for pace in [*self.writers.values()] if pace.count > 1]
        return max(found, key=_count) if found else None

    def _number(self, exact: int | float, number: float, time_ns: i64) -> None:  # noqa: PYI041 - compiled they differ
        if self.numbers == 0:
            self.least = exact
            self.most = exact
        elif exact < self.least:
            self.least = exact
        elif exact > self.most:
            self.most = exact
        self.numbers += 1
        self.total += number
        self._point(number, time_ns)

    def _point(self, number: float, time_ns: i64) -> None:
        """Put a number into the trend; what falls together with an earlier one replaces it."""
        trend = self.trend
        at: i64 = max(0, time_ns - self.first_ns) // self._bucket_ns
        while at >= 2 * POINTS:
            if trend:
                halves: list[float] = []
                size: i64 = len(trend)
                index: i64 = 0
                while index < size:
                    later = trend[index + 1] if index + 1 < size else math.nan
                    halves.append(trend[index] if math.isnan(later) else later)
                    index += 2
                trend = halves
            self._bucket_ns *= 2
            at = max(0, time_ns - self.first_ns) // self._bucket_ns
        while len(trend) <= at:
            trend.append(math.nan)
        trend[at] = number
        self.trend = trend


def _count(pace: Pace) -> int:
    return pace.count
