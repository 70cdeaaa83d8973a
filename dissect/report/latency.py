"""Answer times in bounded memory: exact for the first 16,384, then within one part in 128."""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

#: Answer times kept as they are; from then on they are counted in buckets.
EXACT: Final = 16384
#: Buckets to each doubling.
_STEPS: Final = 128


class Latencies:
    """Answer times in nanoseconds: count, minimum, maximum and quantiles.

    Quantiles are exact up to `EXACT` answers (the value at rank ⌈q·n⌉), and after that the lower end of a bucket whose width
    is at most 1/128 of it. Negative times (reordered captures) count as they are for the minimum and as 0 in buckets.
    """

    __slots__ = ("_buckets", "_recent", "count", "largest", "smallest")

    def __init__(self) -> None:
        self.count: i64 = 0
        self.smallest: i64 = 0
        self.largest: i64 = 0
        self._recent: list[int] = []
        self._buckets: dict[int, int] | None = None

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
        self._recent.append(latency_ns)
        if len(self._recent) > EXACT:
            self._fold()

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
            return self._recent[rank - 1]
        self._fold()
        seen = 0
        for bucket in sorted(buckets):
            seen += buckets[bucket]
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

    def _fold(self) -> None:
        buckets = self._buckets
        if buckets is None:
            buckets = {}
            self._buckets = buckets
        for latency in self._recent:
            bucket = _bucket(latency)
            buckets[bucket] = buckets.get(bucket, 0) + 1
        self._recent = []


def _bucket(latency_ns: i64) -> int:
    """Return the bucket number: the doubling times `_STEPS`, plus the step within it."""
    if latency_ns < _STEPS:
        return max(0, latency_ns)
    doubling: i64 = 0
    value: i64 = latency_ns
    while value >= 2 * _STEPS:
        value >>= 1
        doubling += 1
    return (doubling + 1) * _STEPS + (value - _STEPS)


def _lower_end(bucket: int) -> int:
    doubling, step = divmod(bucket, _STEPS)
    if doubling == 0:
        return step
    return (_STEPS + step) << (doubling - 1)
