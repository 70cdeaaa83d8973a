"""Counters by number."""

from __future__ import annotations

from mypy_extensions import i64


class Tally:
    """How often each number below ``size`` came.

    ``often`` and ``also`` come far more often than the others: counting them makes no int object, which compiled is most of
    what counting costs.
    """

    __slots__ = ("_also", "_also_count", "_counts", "_often", "_often_count")

    def __init__(self, size: int, often: i64, also: i64) -> None:
        self._often: i64 = often
        self._also: i64 = also
        self._often_count: i64 = 0
        self._also_count: i64 = 0
        self._counts: list[int] = [0] * size

    def add(self, number: i64) -> None:
        """Count ``number``; IndexError when it is too large."""
        if number == self._often:
            self._often_count += 1
        elif number == self._also:
            self._also_count += 1
        else:
            self._counts[number] = self._counts[number] + 1  # `+=` on an element of a list is slower (mypyc)

    def counts(self) -> list[int]:
        """Return the counts by number, as a list of its own."""
        counts = self._counts.copy()
        counts[self._often] += self._often_count
        counts[self._also] += self._also_count
        return counts

    def add_counts(self, more: list[int]) -> None:
        """Add what another one of the same size counted."""
        self._counts = [one + other for one, other in zip(self._counts, more, strict=True)]
