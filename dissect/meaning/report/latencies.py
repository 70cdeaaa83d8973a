"""Statistics of answer times: exact for up to 16,384 of them, then with an error of one part in 128 (docs/decisions/0007)."""

from __future__ import annotations

from typing import Final

from librt.strings import BytesWriter, read_i64_le, write_i64_le
from librt.vecs import vec
from mypy_extensions import i64

from dissect.wire.build import COMPILED
from dissect.wire.copies import leaves

#: This many answer times are kept one by one; if there are more, all of them are counted in buckets.
EXACT: Final = 16384
#: With each further answer time, this many of the kept ones are moved to buckets; moving all at once would delay one packet.
_AT_ONCE: Final = 32
#: Buckets for each doubling of the answer time.
_STEPS: Final = 128
#: Buckets for every answer time that 63 bits can hold.
_BUCKETS: Final = 57 * _STEPS
#: Up to this many kept answer times are sorted to find a quantile. If there are more, only those near the wanted rank are
#: sorted.
_FEW: Final = 1024
#: To find those, kept answer times are counted in groups of this many neighbouring buckets.
_COARSE: Final = 16


class Latencies:
    """Answer times in nanoseconds: count, minimum, maximum and quantiles.

    Quantiles are exact up to `EXACT` answers (the value at rank ⌈q·n⌉; the median of an even count is the mean of the two in
    the middle). Of more answers, a quantile is the lower end of a bucket whose width is at most 1/128 of that value. Negative
    times (reordered captures) count unchanged for the minimum, and as 0 in buckets.
    """

    __slots__ = ("_asked_at", "_buckets", "_counted", "_kept", "_spread", "_waiting", "count", "largest", "smallest")

    def __init__(self) -> None:
        self.count: i64 = 0
        self.smallest: i64 = 0
        self.largest: i64 = 0
        self._kept: BytesWriter = BytesWriter()  # answer times kept one by one, eight octets each
        self._asked_at: i64 = 0  # `count` when `_kept` was last sorted, or `_spread` last made
        # Numbers in each group of `_COARSE` buckets, if more than `_FEW` are kept; in each bucket, empty while all are kept one
        # by one. Both contain numbers, not objects, unlike a list (mypyc).
        self._spread: vec[i64] = vec[i64]()
        self._buckets: vec[i64] = vec[i64]()
        self._waiting: bytes = b""  # answer times that were kept, until all of them are counted in buckets
        self._counted: i64 = 0  # number of octets of `_waiting` that are already counted

    def __repr__(self) -> str:
        return f"Latencies({self.count}, {self.smallest} to {self.largest} ns)" if self.count else "Latencies(0)"

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
        if len(buckets) == 0:
            write_i64_le(self._kept, latency_ns)
            if self.count > EXACT:
                self._begin_buckets()
            return
        bucket: i64 = _bucket(latency_ns)
        buckets[bucket] += 1
        if len(self._waiting) > 0:  # no call, unlike the truth of an object (mypyc)
            self._fold(_AT_ONCE)

    def _begin_buckets(self) -> None:
        self._buckets = vec[i64]([0] * _BUCKETS)
        self._waiting = self._kept.getvalue()
        self._kept = BytesWriter()

    @property
    def exact(self) -> bool:
        """Whether every answer time is kept, so that quantiles are exact."""
        return len(self._buckets) == 0

    def quantile(self, q: float) -> int | None:
        """Return the answer time, in nanoseconds, that a share ``q`` (0 to 1) of all does not exceed; None without answers."""
        if not 0 <= q <= 1:
            raise ValueError(f"expected a share from 0 to 1, got {q}")
        if self.count == 0:
            return None
        rank: int = max(1, int(-(-(q * int(self.count)) // 1)))
        buckets = self._buckets
        if len(buckets) == 0:
            if q == 0.5 and self.count % 2 == 0:
                return (self._at(rank) + self._at(rank + 1)) // 2
            return self._at(rank)
        self._fold(len(self._waiting))
        seen = 0
        for bucket, count in enumerate(buckets):
            seen += count
            if seen >= rank:
                return min(max(_lower_end(bucket), int(self.smallest)), int(self.largest))
        return self.largest

    def _at(self, rank: int) -> int:
        """Return the answer time at ``rank``, 1 for the smallest, while all are kept one by one."""
        few: bool = self.count <= _FEW
        packed = self._kept.getvalue()
        if self._asked_at != self.count:
            self._asked_at = self.count
            if few:
                packed = _in_order(packed)
                self._kept = BytesWriter()
                self._kept.write(packed)
            else:
                self._spread = _spread(packed)
        if few:
            return read_i64_le(packed, 8 * (rank - 1))
        spread = self._spread
        before: i64 = 0
        coarse: i64 = 0
        while before + spread[coarse] < rank:
            before += spread[coarse]
            coarse += 1
        first: i64 = _lower_end(coarse * _COARSE) if coarse else self.smallest
        last: i64 = _lower_end((coarse + 1) * _COARSE) - 1
        near: list[int] = []
        for at in range(0, len(packed), 8):
            latency: i64 = read_i64_le(packed, at)
            if first <= latency <= last:
                near.append(latency)
        return sorted(near)[rank - before - 1]

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
        """Move up to ``most`` of the kept answer times into buckets."""
        if len(self._buckets) == 0:
            self._begin_buckets()
        buckets = self._buckets
        waiting = self._waiting
        at: i64 = self._counted
        end: i64 = min(at + 8 * most, len(waiting))
        while at < end:
            bucket: i64 = _bucket(read_i64_le(waiting, at))
            buckets[bucket] += 1
            at += 8
        if at == len(waiting):
            self._waiting = b""
            at = 0
        self._counted = at

    def merge(self, other: Latencies) -> None:
        """Add all answer times of ``other``, which is not changed."""
        if not other.count:
            return
        if not self.count or other.smallest < self.smallest:
            self.smallest = other.smallest
        if not self.count or other.largest > self.largest:
            self.largest = other.largest
        self.count += other.count
        if self.exact and other.exact and self.count <= EXACT:
            self._kept.write(other._kept.getvalue())
            return
        self._fold(self.count)
        self._waiting = other._waiting[other._counted :] + other._kept.getvalue()
        self._fold(self.count)
        if not other.exact:
            for bucket, count in enumerate(other._buckets):
                self._buckets[bucket] += count


def _in_order(packed: bytes) -> bytes:
    """Return packed numbers in sorted order, packed again."""
    writer = BytesWriter()
    for number in sorted([read_i64_le(packed, at) for at in range(0, len(packed), 8)]):
        write_i64_le(writer, number)
    return writer.getvalue()


def _spread(packed: bytes) -> vec[i64]:
    """Return the number of packed numbers in each group of `_COARSE` buckets."""
    spread = vec[i64]([0] * (_BUCKETS // _COARSE))
    for at in range(0, len(packed), 8):
        coarse: i64 = _bucket(read_i64_le(packed, at)) // _COARSE
        spread[coarse] += 1
    return spread


def _bucket(latency_ns: i64) -> i64:
    """Return the bucket number: the number of doublings times `_STEPS`, plus the step within it."""
    if latency_ns < _STEPS:
        return max(0, latency_ns)
    if not COMPILED:
        shift = int(latency_ns).bit_length() - _STEPS.bit_length()
        return shift * _STEPS + (latency_ns >> shift)
    doubling: i64 = 0
    value: i64 = latency_ns
    while value >= _STEPS << 16:  # in large steps: halving milliseconds would take a dozen rounds
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


leaves(Latencies)
