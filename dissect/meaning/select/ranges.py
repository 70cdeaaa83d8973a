"""`Ranges`: numbers of packets, or times, from one to another; there may be many, and they may overlap."""

from __future__ import annotations

from bisect import bisect_right


class Ranges:
    """Ranges of integers, both ends included. With the first query, ranges that touch become one."""

    __slots__ = ("_added", "_firsts", "_lasts")

    def __init__(self) -> None:
        self._added: list[tuple[int, int]] = []
        self._firsts: list[int] = []
        self._lasts: list[int] = []

    def add(self, first: int, last: int) -> None:
        """Add a range; it is empty if it ends before it begins."""
        if first <= last:
            self._added.append((first, last))

    def __contains__(self, number: int) -> bool:
        if self._added:
            self._join()
        place = bisect_right(self._firsts, number) - 1
        return place >= 0 and number <= self._lasts[place]

    def _join(self) -> None:
        ranges = sorted([*zip(self._firsts, self._lasts, strict=True), *self._added])
        self._added = []
        self._firsts, self._lasts = [], []
        for first, last in ranges:
            if self._lasts and first <= self._lasts[-1] + 1:
                self._lasts[-1] = max(self._lasts[-1], last)
            else:
                self._firsts.append(first)
                self._lasts.append(last)
