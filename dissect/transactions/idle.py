"""Which connections are idle longest, found a little with each one that opens: a live line must not wait for a search."""

from __future__ import annotations

import heapq
from typing import TYPE_CHECKING, Final

from mypy_extensions import i64

if TYPE_CHECKING:
    from dissect.transactions.table import Side

#: Connections looked at in one step.
LOOK_AT_ONCE: Final = 64
#: The longest idle ones that a round finds; the next round has to begin while this many of them are left.
MAX_FOUND: Final = 512
_FEW_LEFT: Final = 160
#: Of those found, looked at for one that is idle still.
_TRIED: Final = 16


class IdleSearch:
    """Looks through the open connections in rounds, `LOOK_AT_ONCE` with each `step`, and keeps the longest idle of a round.

    `take` gives one of them that is idle still. ``looks`` counts the connections looked at.
    """

    def __init__(self) -> None:
        self.looks: i64 = 0
        self._sides: list[Side] = []  # of the round under way, and of the one before it, from which `_found` is
        self._before: list[Side] = []
        self._at: i64 = 0
        self._longest: list[tuple[int, int, int]] = []  # a heap, the least idle first: (-last_ns, -first frame, place)
        self._found: list[tuple[int, int, int]] = []  # of the last whole round, the longest idle last

    @property
    def running_out(self) -> bool:
        """True when the next round has to begin."""
        return not self._sides and len(self._found) < _FEW_LEFT

    def begin(self, sides: list[Side]) -> None:
        """Begin a round through ``sides``, one side of each open connection."""
        self._sides = sides
        self._at = 0
        self._longest = []

    def step(self) -> None:
        """Look at the next connections of a round, if one is under way."""
        count: i64 = len(self._sides)
        if count == 0:
            return
        stop: i64 = min(self._at + LOOK_AT_ONCE, count)
        for at in range(self._at, stop):
            side = self._sides[at]
            self.looks += 1
            if side.peer is None:
                continue  # over
            entry = (-int(side.tcp.last_ns), -int(side.tcp.first_frame), int(at))
            if len(self._longest) < MAX_FOUND:
                heapq.heappush(self._longest, entry)
            else:
                heapq.heappushpop(self._longest, entry)
        self._at = stop
        if stop == count:
            self._before = self._sides
            self._sides = []
            self._found = sorted(self._longest)
            self._longest = []

    def finish(self) -> None:
        """Look through the rest of a round."""
        while self._sides:
            self.step()

    def take(self) -> Side | None:
        """Return the longest idle connection that was found, None when there is none.

        One that carried something since it was looked at stays, unless many in a row did: then the longest idle of them leaves.
        """
        best: Side | None = None
        tried: i64 = 0
        while self._found and tried < _TRIED:
            entry = self._found.pop()
            side = self._before[entry[2]]
            if side.peer is None:
                continue
            if int(side.tcp.last_ns) == -entry[0]:
                return side
            tried += 1
            if best is None or side.tcp.last_ns < best.tcp.last_ns:
                best = side
        return best
