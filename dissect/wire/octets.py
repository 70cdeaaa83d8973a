"""Big-endian reads (1 to 3 ns each), and counters that make no int objects when compiled."""

from __future__ import annotations

from typing import Final

from librt.strings import read_i16_be, read_i32_be, read_i32_le, read_i64_le
from librt.vecs import vec
from mypy_extensions import i64

from dissect.wire.build import COMPILED

#: Up to this many octets, comparing eight at a time is faster than a copy.
_SHORT: Final = 64


def u16(octets: bytes, at: i64) -> i64:
    """Return the two octets at ``at`` as a number; IndexError when they are not there."""
    if COMPILED:
        return i64(read_i16_be(octets, at)) & 0xFFFF
    return octets[at] << 8 | octets[at + 1]  # saves two calls when interpreted


def u24(octets: bytes, at: i64) -> i64:
    """Return the three octets at ``at`` as a number; IndexError when they are not there."""
    return (u16(octets, at) << 8) | octets[at + 2]


def u32(octets: bytes, at: i64) -> i64:
    """Return the four octets at ``at`` as a number; IndexError when they are not there."""
    return i64(read_i32_be(octets, at)) & 0xFFFFFFFF


def u32_le(octets: bytes, at: i64) -> i64:
    """Return the four octets at ``at``, of which the last counts most, as a number; IndexError when they are not there."""
    return i64(read_i32_le(octets, at)) & 0xFFFFFFFF


def same(octets: bytes, buf: bytes, at: i64, end: i64) -> bool:
    """Return whether ``buf[at:end]``, which must be there, equals ``octets``; short ones are compared without a copy."""
    size: i64 = len(octets)
    if size != end - at:
        return False
    if not COMPILED or size < 8 or size > _SHORT:
        return buf[at:end] == octets
    index: i64 = 0
    while index + 8 < size:
        if read_i64_le(octets, index) != read_i64_le(buf, at + index):
            return False
        index += 8
    return read_i64_le(octets, size - 8) == read_i64_le(buf, end - 8)


class Tally:
    """Counts the occurrences of each number below ``size``.

    ``often`` and ``also`` come far more often than the others: a caller that knows that a number is one of these adds to
    ``often_count`` or ``also_count`` itself.
    """

    __slots__ = ("_also", "_counts", "_often", "also_count", "often_count")

    def __init__(self, size: int, often: i64, also: i64) -> None:
        self._often: i64 = often
        self._also: i64 = also
        self.often_count: i64 = 0
        self.also_count: i64 = 0
        self._counts: vec[i64] = vec[i64]([0] * size)  # holds numbers, not objects, unlike a list (mypyc)

    def add(self, number: i64) -> None:
        """Count ``number``; IndexError when it is too large."""
        if number == self._often:
            self.often_count += 1
        elif number == self._also:
            self.also_count += 1
        else:
            counts = self._counts
            counts[number] += 1

    def counts(self) -> list[int]:
        """Return the counts by number, as a new list."""
        counts = [int(one) for one in self._counts]
        counts[self._often] += self.often_count
        counts[self._also] += self.also_count
        return counts

    def add_counts(self, more: list[int]) -> None:
        """Add the counts of another tally of the same size."""
        self._counts = vec[i64]([one + other for one, other in zip(self._counts, more, strict=True)])
