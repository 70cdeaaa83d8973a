"""Answer times in bounded memory: exact for the first 16,384, then within one part in 128."""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

#: Answer times kept as they are; from then on they are counted in buckets.
EXACT: Final = 16384
#: How many of those are counted in buckets with each one that comes then: no packet waits for all of them.
_AT_ONCE: Final = 32
#: Buckets to each doubling.
_STEPS: Final = 128
#: Buckets for every answer time that 63 bits can hold.
_BUCKETS: Final = 57 * _STEPS


class Latencies:
    """Answer times in nanoseconds: count, minimum, maximum and quantiles.

    Quantiles are exact up to `EXACT` answers (the value at rank ⌈q·n⌉; the median of an even count is the mean of the two in
    the middle), and after that the lower end of a bucket whose width is at most 1/128 of it. Negative times (reordered
    captures) count as they are for the minimum and as 0 in buckets.
    """

    __slots__ = ("_buckets", "_recent", "count", "largest", "smallest")

    def __init__(self) -> None:
        self.count: i64 = 0
        self.smallest: i64 = 0
        self.largest: i64 = 0
        self._recent: list[int] = []
        self._buckets: list[int] | None = None

    def add(self, latency_ns: i64) -> None:
        """Take one answer time."""
        if self.count == 0:
            self.smallest = latency_ns
            self.largest = latency_ns
        elif latency_ns < self.smallest:
            self.smallest = latency_ns
        elif latency_ns > self.largest:
            self.largest = latency_ns
        self.count += 1
        buckets = self._buckets
        if buckets is None:
            self._recent.append(latency_ns)
            if len(self._recent) > EXACT:
                self._buckets = [0] * _BUCKETS
            return
        buckets[_bucket(latency_ns)] += 1
        if self._recent:
            self._fold(_AT_ONCE)

    @property
    def exact(self) -> bool:
        """True while every answer time is kept as it is."""
        return self._buckets is None

    def quantile(self, q: float) -> int | None:
        """Return the answer time that a share ``q`` (0 to 1) of all does not exceed, None when there is none."""
        if self.count == 0:
            return None
        rank: int = max(1, int(-(-(q * int(self.count)) // 1)))
        buckets = self._buckets
        if buckets is None:
            self._recent.sort()
            if q == 0.5 and self.count % 2 == 0:
                return (self._recent[rank - 1] + self._recent[rank]) // 2
            return self._recent[rank - 1]
        self._fold(len(self._recent))
        seen = 0
        for bucket, count in enumerate(buckets):
            seen += count
            if seen >= rank:
                return min(max(_lower_end(bucket), int(self.smallest)), int(self.largest))
        return self.largest

    def as_dict(self) -> dict[str, int | None]:
        """Return minimum, median, 95 %, 99 % and maximum in nanoseconds; all None when there is no answer."""
        if self.count == 0:
            return {"min": None, "median": None, "p95": None, "p99": None, "max": None}
        return {
            "min": self.smallest,
            "median": self.quantile(0.5),
            "p95": self.quantile(0.95),
            "p99": self.quantile(0.99),
            "max": self.largest,
        }

    def _fold(self, most: i64) -> None:
        """Count up to ``most`` of those kept as they are in buckets instead."""
        buckets = self._buckets
        if buckets is None:
            buckets = [0] * _BUCKETS
            self._buckets = buckets
        recent = self._recent
        for _ in range(min(most, len(recent))):
            buckets[_bucket(recent.pop())] += 1

    def merge(self, other: Latencies) -> None:
        """Take all answer times of ``other``, which keeps them."""
        if not other.count:
            return
        if not self.count or other.smallest < self.smallest:
            self.smallest = other.smallest
        if not self.count or other.largest > self.largest:
            self.largest = other.largest
        self.count += other.count
        self._recent.extend(other._recent)
        if other._buckets is not None or len(self._recent) > EXACT:
            self._fold(len(self._recent))
        if self._buckets is not None and other._buckets is not None:
            for bucket, count in enumerate(other._buckets):
                self._buckets[bucket] += count


def _bucket(latency_ns: i64) -> i64:
    """Return the bucket number: the doubling times `_STEPS`, plus the step within it."""
    if latency_ns < _STEPS:
        return max(0, latency_ns)
    doubling: i64 = 0
    value: i64 = latency_ns
    while value >= _STEPS << 16:  # answer times of milliseconds would be halved a dozen times
        value >>= 16
        doubling += 16
    while value >= _STEPS << 4:
        value >>= 4
        doubling += 4
    while value >= 2 * _STEPS:
        value >>= 1
        doubling += 1
    return (doubling + 1) * _STEPS + (value - _STEPS)


def _lower_end(bucket: int) -> int:
    doubling, step = divmod(bucket, _STEPS)
    if doubling == 0:
        return step
    return (_STEPS + step) << (doubling - 1)
