"""Measures in limited memory: the number of events in a moving window, and answer times."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

#: A window moves in steps of a tenth of its length.
STEPS: Final = 10
#: Leading bits of an answer time that are kept.
_BITS: Final = 8


class RateWindow:
    """The number of events in the last ``window_ns`` nanoseconds, in steps of a tenth of that.

    Events may come out of order; one that is older than the window is not counted. ``highest`` is the greatest number so far.
    """

    __slots__ = ("_counts", "_newest", "_step_ns", "_total", "highest", "window_ns")

    def __init__(self, window_ns: int) -> None:
        self.window_ns = window_ns
        self.highest = 0
        self._step_ns = max(1, window_ns // STEPS)
        self._counts = [0] * STEPS
        self._newest = -STEPS
        self._total = 0

    def add(self, time_ns: int, count: int = 1) -> int:
        """Count events at ``time_ns``; return the number in the window that ends there, or at a later event."""
        step = time_ns // self._step_ns
        self._advance(step)
        if step > self._newest - STEPS:
            self._counts[step % STEPS] += count
            self._total += count
            self.highest = max(self.highest, self._total)
        return self._total

    def total(self, now_ns: int) -> int:
        """Return the number of events in the window that ends at ``now_ns``."""
        self._advance(now_ns // self._step_ns)
        return self._total

    def _advance(self, step: int) -> None:
        passed = step - self._newest
        if passed <= 0:
            return
        if passed >= STEPS:
            self._counts = [0] * STEPS
            self._total = 0
        else:
            for gone in range(self._newest + 1, step + 1):
                self._total -= self._counts[gone % STEPS]
                self._counts[gone % STEPS] = 0
        self._newest = step


class AnswerTimes:
    """Answer times in nanoseconds, kept to eight leading bits (within 1/128); count and longest are exact."""

    __slots__ = ("_counts", "count", "longest")

    def __init__(self) -> None:
        self.count = 0
        self.longest = 0
        self._counts: dict[int, int] = {}

    def add(self, latency_ns: int) -> None:
        """Take one answer time; a negative one (reordered capture) counts as 0."""
        latency_ns = max(latency_ns, 0)
        cut = max(latency_ns.bit_length() - _BITS, 0)
        kept = latency_ns >> cut << cut
        self._counts[kept] = self._counts.get(kept, 0) + 1
        self.count += 1
        self.longest = max(self.longest, latency_ns)

    def merge(self, others: Iterable[AnswerTimes]) -> None:
        """Add all answer times of others, which are not changed."""
        for other in others:
            self.count += other.count
            self.longest = max(self.longest, other.longest)
            for kept, count in other._counts.items():  # noqa: SLF001 - of the same class
                self._counts[kept] = self._counts.get(kept, 0) + count

    def quantile(self, q: float) -> int | None:
        """Return the answer time at rank ⌈q·n⌉, None when there is none."""
        rank = max(1, int(-(-(q * self.count) // 1)))
        seen = 0
        for kept in sorted(self._counts):
            seen += self._counts[kept]
            if seen >= rank:
                return kept
        return None


class RecentAnswers:
    """The answer times of the last ``window_ns`` nanoseconds, in steps of a tenth of that."""

    __slots__ = ("_newest", "_step_ns", "_steps")

    def __init__(self, window_ns: int) -> None:
        self._step_ns = max(1, window_ns // STEPS)
        self._steps: dict[int, AnswerTimes] = {}
        self._newest = 0

    def add(self, time_ns: int, latency_ns: int) -> None:
        """Add an answer at ``time_ns``; one that is older than the window is not counted."""
        step = time_ns // self._step_ns
        self._advance(step)
        if step > self._newest - STEPS:
            self._steps.setdefault(step, AnswerTimes()).add(latency_ns)

    def all(self, now_ns: int) -> AnswerTimes:
        """Return all answer times in the window that ends at ``now_ns``."""
        self._advance(now_ns // self._step_ns)
        together = AnswerTimes()
        together.merge(self._steps.values())
        return together

    def _advance(self, step: int) -> None:
        if step > self._newest:
            self._newest = step
            for old in [one for one in self._steps if one <= step - STEPS]:
                del self._steps[old]
