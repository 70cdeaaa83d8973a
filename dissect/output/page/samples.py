"""A limited number of rows of many, spread over the time, and the number of all rows.

The choice does not depend on chance: the same capture gives the same rows.
"""

from __future__ import annotations

import heapq
from typing import Any, Final

from dissect.output.page.bins import WIDTHS, Bins

#: The rows are spread over this many bins of time or fewer, and on average a bin has room for this many rows or more.
_BINS: Final = 64
_ROOM: Final = 4
#: Mixes a number (golden ratio of 2**64), so that consecutive numbers are kept or not without a pattern.
_MIX: Final = 0x9E3779B97F4A7C15
_MASK: Final = 2**64 - 1
#: Above every rank.
_ALL: Final = 2**65


def mixed(number: int) -> int:
    """Return a rank for a number that is independent of its order: `Samples` then keeps each row with the same chance."""
    return ((number * _MIX & _MASK) ^ (number * _MIX & _MASK) >> 29) * _MIX & _MASK


class _Bin:
    """The rows of a bin of time, those with the greatest rank on top; ranks from ``floor`` on are no longer accepted."""

    __slots__ = ("floor", "rows")

    def __init__(self) -> None:
        self.floor = _ALL
        self.rows: list[tuple[int, int, int, Any]] = []


class Samples:
    """At most ``most`` rows. If there are more, the row with the greatest rank is dropped from the fullest bin of time.

    So a busy time does not displace the rows of other times, and in each bin the lowest ranks stay. Ask `wants` before a row is
    made: most are not wanted, and making one takes longer than asking. ``counts`` counts all requests, by time; with
    ``counted`` False the caller counts them.
    """

    def __init__(self, most: int, counted: bool = True) -> None:
        self.total = 0
        self.counts = Bins() if counted else None
        self._most = most
        self._most_bins = max(1, min(_BINS, most // _ROOM))
        self._kept = 0
        self._step = 0
        self._bins: dict[int, _Bin] = {}

    def __len__(self) -> int:
        return self._kept

    def wants(self, time_ns: int, rank: int) -> bool:
        """Count something at a time (nanoseconds since 1970); return whether its row must be made and given to `add`."""
        self.total += 1
        if self.counts is not None:
            self.counts.add(time_ns, 0)
        found = self._bins.get(time_ns // WIDTHS[self._step])
        return found is None or rank < found.floor

    def add(self, time_ns: int, rank: int, row: Any) -> None:
        """Take the row that `wants` wanted."""
        number = time_ns // WIDTHS[self._step]
        found = self._bins.get(number)
        if found is None:
            found = self._bins.setdefault(number, _Bin())
        heapq.heappush(found.rows, (-rank, time_ns, self.total, row))
        self._kept += 1
        while len(self._bins) > self._most_bins and self._step + 1 < len(WIDTHS):
            self._join()
        if self._kept > self._most:
            self._give_up()

    def rows(self) -> list[Any]:
        """Return the rows that were kept, in order of time."""
        found = [entry for one in self._bins.values() for entry in one.rows]
        return [row for _, _, _, row in sorted(found, key=lambda entry: (entry[1], entry[2]))]

    def _give_up(self) -> None:
        fullest = max(self._bins.items(), key=lambda entry: (len(entry[1].rows), -entry[0]))[1]
        rank = -heapq.heappop(fullest.rows)[0]
        fullest.floor = min(fullest.floor, rank)
        self._kept -= 1

    def _join(self) -> None:
        self._step += 1
        factor = WIDTHS[self._step] // WIDTHS[self._step - 1]
        joined: dict[int, _Bin] = {}
        for number, one in sorted(self._bins.items()):
            into = joined.setdefault(number // factor, _Bin())
            into.rows += one.rows
            into.floor = min(into.floor, one.floor)
        for one in joined.values():
            heapq.heapify(one.rows)
        self._bins = joined


class Ranked:
    """At most ``most`` rows: those with the lowest ranks, however many come."""

    def __init__(self, most: int) -> None:
        self.total = 0
        self._most = most
        self._rows: list[tuple[tuple[int, ...], Any]] = []

    def __len__(self) -> int:
        return len(self._rows)

    def wants(self, rank: tuple[int, ...]) -> bool:
        """Count something, whose rank is unique; return whether its row must be made and given to `add`."""
        self.total += 1
        return len(self._rows) < self._most or tuple([-one for one in rank]) > self._rows[0][0]

    def add(self, rank: tuple[int, ...], row: Any) -> None:
        """Take the row that `wants` wanted."""
        entry = (tuple([-one for one in rank]), row)
        if len(self._rows) < self._most:
            heapq.heappush(self._rows, entry)
        else:
            heapq.heapreplace(self._rows, entry)

    def rows(self) -> list[Any]:
        """Return the kept rows, those with the lowest rank first."""
        return [row for _, row in sorted(self._rows, key=lambda entry: entry[0], reverse=True)]
