"""Answer times added up: exact for the first 16,384, then within one part in 128 (docs/decisions/0007)."""

from __future__ import annotations

from typing import Final

from librt.strings import BytesWriter, read_i64_le, write_i64_le
from librt.vecs import vec
from mypy_extensions import i64

from dissect.wire.build import COMPILED

#: Answer times kept as they are; from then on they are counted in buckets.
EXACT: Final = 16384
#: How many of these are counted there with each one that comes then: no packet waits for all of them.
_AT_ONCE: Final = 32
#: Buckets to each doubling.
_STEPS: Final = 128
#: Buckets for every answer time that 63 bits can hold.
_BUCKETS: Final = 57 * _STEPS
#: Of more than so many that are kept as they are, only those near a rank are put in order to find the one that has it.
_FEW: Final = 256
#: So many buckets beside each other are counted together for that.
_COARSE: Final = 16


class Latencies:
    """Answer times in nanoseconds: count, minimum, maximum and quantiles.

    Quantiles are exact up to `EXACT` answers (the value at rank ⌈q·n⌉; the median of an even count is the mean of the two in
    the middle), and after that the lower end of a bucket whose width is at most 1/128 of it. Negative times (reordered
    captures) count as they are for the minimum and as 0 in buckets.
    """

    __slots__ = ("_asked_at", "_buckets", "_counted", "_kept", "_spread", "_waiting", "count", "largest", "smallest")

    def __init__(self) -> None:
        self.count: i64 = 0
        self.smallest: i64 = 0
        self.largest: i64 = 0
        self._kept: BytesWriter = BytesWriter()  # those that are kept as they are, in eight octets each
        self._asked_at: i64 = 0  # of how many answers a quantile was asked last: a few are in order since then
        self._spread: list[int] = []  # of more, how many are in each `_COARSE` buckets
        self._buckets: vec[i64] = vec[
            i64
        ]()  # empty as long as they are kept; numbers, not objects, unlike a list (mypyc)
        self._waiting: bytes = b""  # those that were kept, while buckets do not count them all
        self._counted: i64 = 0  # octets of these that they do

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
        if len(self._waiting) > 0:  # told without a call, unlike the truth of an object (mypyc)
            self._fold(_AT_ONCE)

    def _begin_buckets(self) -> None:
        self._buckets = vec[i64]([0] * _BUCKETS)
        self._waiting = self._kept.getvalue()
        self._kept = BytesWriter()

    @property
    def exact(self) -> bool:
        """True while every answer time is kept as it is."""
        return len(self._buckets) == 0

    def quantile(self, q: float) -> int | None:
        """Return the answer time that a share ``q`` (0 to 1) of all does not exceed, None when there is none."""
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
        """Return the answer time at a rank from 1 on, while all are kept as they are."""
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
        before = 0
        coarse = 0
        while before + self._spread[coarse] < rank:
            before += self._spread[coarse]
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
        """Count up to ``most`` of those kept as they are in buckets instead."""
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
        """Take all answer times of ``other``, which keeps them."""
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
    """Return the numbers in memory in their order."""
    writer = BytesWriter()
    for number in sorted([read_i64_le(packed, at) for at in range(0, len(packed), 8)]):
        write_i64_le(writer, number)
    return writer.getvalue()


def _spread(packed: bytes) -> list[int]:
    """Return how many of the numbers in memory are in each `_COARSE` buckets."""
    spread = [0] * (_BUCKETS // _COARSE)
    for at in range(0, len(packed), 8):
        coarse: i64 = _bucket(read_i64_le(packed, at)) // _COARSE
        spread[coarse] = spread[coarse] + 1  # as in `add`
    return spread


def _bucket(latency_ns: i64) -> i64:
    """Return the bucket number: the doubling times `_STEPS`, plus the step within it."""
    if latency_ns < _STEPS:
        return max(0, latency_ns)
    if not COMPILED:
        shift = int(latency_ns).bit_length() - _STEPS.bit_length()
        return shift * _STEPS + (latency_ns >> shift)
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
