"""`Statistics`: the summary of one variable, added up value by value in limited memory."""

from __future__ import annotations

import math
from typing import Final

from mypy_extensions import i64

from dissect.engine.transactions.connection import Connection
from dissect.output.variables.model import ValueRow

#: Maximum number of distinct values that are counted; if there are more, only that fact is known.
MAX_DISTINCT: Final = 20
#: Maximum number of clients of a variable that are counted separately; others are counted together.
MAX_CLIENTS: Final = 8
#: Number of points of a trend: when there are twice as many, neighbours are joined.
POINTS: Final = 24
_BUCKET_NS: Final = 1_000_000


class Pace:
    """How often a client read or wrote: ``count`` times, on average every ``mean`` nanoseconds.

    ``gaps`` is the number of intervals between two values. Intervals below zero, where the clock of the capture ran backwards,
    are left out.
    """

    __slots__ = ("count", "gaps", "last_ns", "mean", "squares")

    def __init__(self) -> None:
        self.count: i64 = 0
        self.gaps: i64 = 0
        self.last_ns: i64 = 0
        self.mean: float = 0.0
        self.squares: float = 0.0

    def add(self, time_ns: i64) -> None:
        """Add the time of another value (Welford's algorithm for the deviation)."""
        if self.count and time_ns >= self.last_ns:
            gap = float(time_ns - self.last_ns)
            off = gap - self.mean
            self.gaps += 1
            self.mean += off / float(self.gaps)
            self.squares += off * (gap - self.mean)
        self.count += 1
        self.last_ns = time_ns

    @property
    def period_ns(self) -> int | None:
        """The mean interval between two values in nanoseconds, None for fewer than two values."""
        return round(self.mean) if self.gaps else None

    @property
    def jitter_ns(self) -> int | None:
        """The standard deviation of the intervals in nanoseconds, None for fewer than two intervals."""
        return round(math.sqrt(self.squares / float(self.gaps))) if self.gaps > 1 else None


class Statistics:
    """The values of one variable: count, first, last, extremes, mean, distinct values, and the clients that read or wrote.

    ``first`` and ``last`` are values, or octets (bytes) that have no value. ``least``, ``most``, ``total`` and ``trend`` are
    computed from numbers only, of which there are ``numbers`` (a truth value is 0 or 1; NaN and infinities are left out).
    ``distinct`` has octets, or texts of values without octets, at most `MAX_DISTINCT`. ``others`` counts values of clients
    beyond `MAX_CLIENTS`.
    """

    __slots__ = (
        "_at",
        "_bucket_ns",
        "_from_ns",
        "_high",
        "_link",
        "_low",
        "_number",
        "_numeric",
        "_pace",
        "_points",
        "_side",
        "_until_ns",
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
        self._numeric: bool = False  # whether the latest value is a number
        self._number: float = 0.0  # the latest number
        self._low: float = 0.0  # `least` and `most` as doubles, rounded if necessary
        self._high: float = 0.0
        self._points: list[float] = []
        self._bucket_ns: i64 = _BUCKET_NS
        self._at: i64 = 0  # the point of the latest number, which is stored when the next point begins
        self._from_ns: i64 = 0
        self._until_ns: i64 = 0
        self._pace: Pace | None = None
        self._link: Connection | None = None
        self._side: i64 = 0
        self._writes: bool = False

    def add(self, row: ValueRow) -> None:
        """Add the value of a row."""
        value = row.value if row.value is not None else row.data
        if row.changed:
            self.different(value, row.data, row.first, row.time_ns, row.link, row.side, row.writes)
        else:
            self._take(value, row.time_ns, row.link, row.side, row.writes)

    def different(
        self,
        value: object,
        data: bytes | None,
        first: bool,
        time_ns: i64,
        link: Connection,
        side: i64,
        writes: bool,
    ) -> None:
        """Add a value that is different from the one before, or the ``first``; ``data`` are its octets, None for none."""
        if not first:
            self.changes += 1
        if not self.more_distinct:
            key = data if data is not None else repr(value).encode("utf-8", "backslashreplace")
            if key not in self.distinct:
                if len(self.distinct) >= MAX_DISTINCT:
                    self.more_distinct = True
                else:
                    self.distinct.add(key)
        self._take(value, time_ns, link, side, writes)

    def again(self, time_ns: i64, link: Connection, side: i64, writes: bool) -> None:
        """Add the same value as before: only counts and times change."""
        self.count += 1
        self.last_ns = time_ns
        if self._numeric:
            self.numbers += 1
            self.total += self._number
            if not self._from_ns <= time_ns < self._until_ns:
                self._point(time_ns)
        self._come(time_ns, link, side, writes)

    def _take(self, value: object, time_ns: i64, link: Connection, side: i64, writes: bool) -> None:
        if self.count == 0:
            self.first = value
            self.first_ns = time_ns
        self.count += 1
        self.last = value
        self.last_ns = time_ns
        if isinstance(value, float):
            self._numeric = math.isfinite(value)
            if self._numeric:
                self._add(value, value, time_ns)
        elif isinstance(value, int):
            number: int = int(value)
            self._numeric = True
            self._add(number, float(number), time_ns)
        else:
            self._numeric = False
        self._come(time_ns, link, side, writes)

    def _come(self, time_ns: i64, link: Connection, side: i64, writes: bool) -> None:
        """Note that a client read or wrote."""
        latest = self._pace
        if latest is not None and link is self._link and side == self._side and writes == self._writes:
            latest.add(time_ns)  # the same client as before: no look-up by its address
            return
        clients = self.writers if writes else self.readers
        host = link.tcp.ends[side].host
        pace = clients.get(host)
        if pace is None:
            if len(clients) >= MAX_CLIENTS:
                self.others += 1
                return
            pace = Pace()
            clients[host] = pace
        self._pace = pace
        self._link = link
        self._side = side
        self._writes = writes
        pace.add(time_ns)

    @property
    def trend(self) -> list[float]:
        """The numbers over time, at most twice `POINTS`: the last number of each interval, NaN for an interval without one."""
        if self._points:
            self._points[self._at] = self._number
        return self._points

    @property
    def distinct_count(self) -> int:
        """The number of distinct values, at most `MAX_DISTINCT`."""
        return len(self.distinct)

    @property
    def mean(self) -> float | None:
        """The mean of all numbers, None if there are none."""
        return self.total / float(self.numbers) if self.numbers else None

    @property
    def pace(self) -> Pace | None:
        """The pace of the client that read most often, else of the one that wrote most often; None if none did so twice."""
        found = [pace for pace in [*self.readers.values()] if pace.count > 1]
        if not found:
            found = [pace for pace in [*self.writers.values()] if pace.count > 1]
        return max(found, key=_count) if found else None

    def _add(self, exact: int | float, number: float, time_ns: i64) -> None:  # noqa: PYI041 - compiled they differ
        if self.numbers == 0:
            self.least = exact
            self.most = exact
            self._low = number
            self._high = number
        elif number <= self._low or number >= self._high:
            if exact < self.least:
                self.least = exact
                self._low = number
            elif exact > self.most:
                self.most = exact
                self._high = number
        self.numbers += 1
        self.total += number
        if not self._from_ns <= time_ns < self._until_ns:
            self._point(time_ns)
        self._number = number

    def _point(self, time_ns: i64) -> None:
        """Find or begin the point for the time of a number; the number replaces an earlier one in the same point."""
        points = self._points
        if points:
            points[self._at] = self._number
        since: i64 = max(0, time_ns - self.first_ns)
        at: i64 = since // self._bucket_ns
        while at >= 2 * POINTS:
            if points:
                halves: list[float] = []
                size: i64 = len(points)
                index: i64 = 0
                while index < size:
                    later = points[index + 1] if index + 1 < size else math.nan
                    halves.append(points[index] if math.isnan(later) else later)
                    index += 2
                points = halves
            self._bucket_ns *= 2
            at = since // self._bucket_ns
        while len(points) <= at:
            points.append(math.nan)
        self._points = points
        self._at = at
        self._from_ns = self.first_ns + at * self._bucket_ns
        self._until_ns = self._from_ns + self._bucket_ns


def _count(pace: Pace) -> int:
    return pace.count
