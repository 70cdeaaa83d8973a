"""`RateHistory`: transactions of a connection in each of the last seconds, and the longest answer time of each second."""

from __future__ import annotations

from typing import Final

_NS_PER_S: Final = 1_000_000_000
#: This many seconds are remembered.
SECONDS: Final = 60

#: Upper bounds of the levels of answer times, each √10 times the one before; the last level has no upper bound.
_LEVELS_NS: Final = (316_228, 1_000_000, 3_162_278, 10_000_000, 31_622_777, 100_000_000, 316_227_766)
LEVELS: Final = len(_LEVELS_NS) + 1


class RateHistory:
    """Counts by seconds of the capture's clock. Transactions from reordered packets count for the newest second."""

    __slots__ = ("_counts", "_second", "_worst")

    def __init__(self) -> None:
        self._second = 0
        self._counts = [0] * SECONDS
        self._worst = [-1] * SECONDS  # -1: no answer in that second

    def add(self, time_ns: int, latency_ns: int | None) -> None:
        """Take one transaction."""
        self._turn(time_ns // _NS_PER_S)
        at = self._second % SECONDS
        self._counts[at] += 1
        if latency_ns is not None and latency_ns > self._worst[at]:
            self._worst[at] = latency_ns

    def rate(self, now_ns: int, seconds: int) -> float:
        """Return the transactions per second over the last ``seconds`` whole seconds, without the present one."""
        last = now_ns // _NS_PER_S - 1
        return sum([self._of(self._counts, second, 0) for second in range(last - seconds + 1, last + 1)]) / seconds

    def worst(self, now_ns: int, seconds: int) -> list[int]:
        """Return the longest answer time of each of the last ``seconds``, the present one included; -1 for none."""
        last = max(now_ns // _NS_PER_S, self._second)
        return [self._of(self._worst, second, -1) for second in range(last - seconds + 1, last + 1)]

    def _of(self, kept: list[int], second: int, nothing: int) -> int:
        return kept[second % SECONDS] if self._second - SECONDS < second <= self._second else nothing

    def _turn(self, second: int) -> None:
        """Advance to a second, and clear the seconds in between."""
        if second <= self._second:
            return
        for passed in range(max(self._second + 1, second - SECONDS + 1), second + 1):
            self._counts[passed % SECONDS] = 0
            self._worst[passed % SECONDS] = -1
        self._second = second


def level(latency_ns: int) -> int:
    """Return how slow an answer was, from 0 to `LEVELS` - 1; -1 for none."""
    if latency_ns < 0:
        return -1
    return sum([latency_ns > bound for bound in _LEVELS_NS])
