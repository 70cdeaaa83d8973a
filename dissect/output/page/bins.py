"""Counts over time and distributions of durations, in limited memory: the data for the plots of a report."""

from __future__ import annotations

from array import array
from collections.abc import Callable
from typing import Any, Final

_MS: Final = 1_000_000
#: Widths of bins in nanoseconds: round numbers, each a multiple of the one before it, so that bins can be joined.
WIDTHS: Final = tuple(
    _MS * width
    for width in (
        *(1, 2, 10, 20, 100, 200, 1_000, 2_000, 10_000, 20_000, 60_000, 120_000, 600_000, 1_200_000, 3_600_000),
        *(7_200_000, 43_200_000, 86_400_000, 864_000_000, 8_640_000_000, 86_400_000_000, 864_000_000_000),
    )
)
#: Maximum number of bins that are kept while packets are read.
_MOST: Final = 1500

#: Buckets of a distribution for each doubling, as a power of two: durations are distinguished to 1/32.
_STEP_BITS: Final = 5
_STEPS: Final = 1 << _STEP_BITS
#: Up to this many durations of a distribution are kept one by one.
_EXACT: Final = 1024


class Bins:
    """Counts by time and column. Empty bins are not kept; if there are too many bins, neighbours are joined.

    ``width`` is in nanoseconds; the number of a bin is its time divided by ``width``.
    """

    __slots__ = ("_most", "_step", "rows", "width")

    def __init__(self, most: int = _MOST) -> None:
        self.rows: dict[int, dict[int, int]] = {}
        self._most = most
        self._step = 0
        self.width = WIDTHS[0]

    def add(self, time_ns: int, column: int) -> None:
        """Count one in a column at a time (nanoseconds since 1970)."""
        row = self.rows.get(time_ns // self.width)
        if row is None:
            row = self.rows.setdefault(time_ns // self.width, {})
            while len(self.rows) > self._most:
                self._join()
                row = self.rows[time_ns // self.width]
        row[column] = row.get(column, 0) + 1

    def settle(self, begin_ns: int, end_ns: int, most: int) -> None:
        """Join bins until there are about ``most`` of them or fewer between two times (nanoseconds since 1970)."""
        while (end_ns - begin_ns) // self.width > most and self._step + 1 < len(WIDTHS):
            self._join()

    def widen(self, width: int) -> None:
        """Join bins until they are as wide as ``width``, one of `WIDTHS`: the width in another session."""
        while self.width < width:
            self._join()

    def _join(self) -> None:
        if self._step + 1 == len(WIDTHS):
            self._most *= 2  # these bins are the widest: 27 years
            return
        self._step += 1
        wider = WIDTHS[self._step]
        factor = wider // self.width
        joined: dict[int, dict[int, int]] = {}
        for number, row in self.rows.items():
            into = joined.setdefault(number // factor, {})
            for column, count in row.items():
                into[column] = into.get(column, 0) + count
        self.rows = joined
        self.width = wider


def bucket(ns: int) -> int:
    """Return the bucket of a duration in nanoseconds; negative ones count as 0."""
    if ns < _STEPS:
        return max(ns, 0)
    shift = ns.bit_length() - _STEP_BITS - 1
    return (shift << _STEP_BITS) + (ns >> shift)


def lower_end(number: int) -> int:
    """Return the shortest duration in nanoseconds of a bucket."""
    if number < 2 * _STEPS:
        return number
    shift = (number >> _STEP_BITS) - 1
    return (number - (shift << _STEP_BITS)) << shift


def cells_of(bins: Bins, step: int, seconds: Callable[[int], float]) -> dict[str, Any]:
    """Return the number of durations by time and length, for JSON: in ``cells`` (bin, band, count).

    A bin begins ``width`` seconds times its number after ``origin``; a band is ``step`` buckets of a distribution.
    """
    first = min(bins.rows, default=0)
    return {
        "width": bins.width / 1e9,
        "origin": seconds(first * bins.width),
        "step": step,
        "cells": [
            [number - first, band, count]
            for number, row in sorted(bins.rows.items())
            for band, count in sorted(row.items())
        ],
    }


class Spread:
    """Durations in nanoseconds: count, sums, extremes, and the number in each `bucket`."""

    __slots__ = ("_kept", "buckets", "count", "largest", "smallest", "squares", "sum")

    def __init__(self) -> None:
        self.count = 0
        self.sum = 0
        self.squares = 0
        self.smallest = 0
        self.largest = 0
        self.buckets: dict[int, int] = {}
        self._kept: array[int] = array("q")

    def add(self, ns: int, number: int = -1) -> None:
        """Take one duration; ``number`` is its bucket, if already known."""
        if self.count < _EXACT:
            self._kept.append(ns)
        if not self.count or ns < self.smallest:
            self.smallest = ns
        if not self.count or ns > self.largest:
            self.largest = ns
        self.count += 1
        self.sum += ns
        self.squares += ns * ns
        if number < 0:
            number = bucket(ns)
        self.buckets[number] = self.buckets.get(number, 0) + 1

    @property
    def mean(self) -> int:
        """The mean, 0 if there are none."""
        return self.sum // self.count if self.count else 0

    @property
    def deviation(self) -> int:
        """The standard deviation, 0 if there are none."""
        if not self.count:
            return 0
        return int(max(0.0, self.squares / self.count - (self.sum / self.count) ** 2) ** 0.5)

    def quantile(self, share: float) -> int:
        """Return the duration that this share of all durations does not exceed; 0 without durations.

        It is exact up to `_EXACT` durations (the median of an even number is the mean of the two in the middle), then to 1/32.
        """
        wanted = max(1, -int(-share * self.count // 1))
        if self.count <= _EXACT:
            if not self.count:
                return 0
            ordered = sorted(self._kept)
            if share == 0.5 and self.count % 2 == 0:
                return (ordered[wanted - 1] + ordered[wanted]) // 2
            return ordered[wanted - 1]
        seen = 0
        for number in sorted(self.buckets):
            here = self.buckets[number]
            if seen + here >= wanted:
                # This assumes that durations are spread evenly in a bucket; the lower end of a bucket would always be too
                # short.
                low, high = lower_end(number), lower_end(number + 1)
                return min(
                    max(low + (high - low) * (2 * (wanted - seen) - 1) // (2 * here), self.smallest), self.largest
                )
            seen += here
        return self.largest
