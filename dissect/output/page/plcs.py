"""The parts of a PLC's card that nothing else counts: its answer times over time, and its slowest requests."""

from __future__ import annotations

import heapq
from typing import Any, Final

from dissect.output.page.bins import Bins
from dissect.output.page.rows import Station

#: Maximum number of PLCs whose answer times are kept over time.
MAX_PLCS: Final = 200
#: Number of slowest requests that are kept for each.
_SLOWEST: Final = 5
#: Maximum number of bins of time for each while packets are read.
_BINS: Final = 240
#: Buckets of a distribution that make a band: two for each doubling.
BAND: Final = 16


class Plc:
    """The answers of a PLC: their numbers by time and by duration (`BAND`), and the rows of the slowest."""

    __slots__ = ("_slowest", "times")

    def __init__(self) -> None:
        self.times = Bins(_BINS)
        self._slowest: list[tuple[int, int, dict[str, Any]]] = []

    def answered(self, now: int, latency: int, number: int) -> bool:
        """Count an answer in bucket ``number``; return whether it is one of the slowest: then give its row to `slow`."""
        self.times.add(now, number // BAND)
        return len(self._slowest) < _SLOWEST or latency > self._slowest[0][0]

    def slow(self, latency: int, order: int, row: dict[str, Any]) -> None:
        """Take the row of a slow transaction; of equally slow ones the one with the greatest ``order`` stays."""
        if len(self._slowest) < _SLOWEST:
            heapq.heappush(self._slowest, (latency, order, row))
        else:
            heapq.heapreplace(self._slowest, (latency, order, row))

    def slowest(self) -> list[dict[str, Any]]:
        """Return the rows of the slowest transactions, slowest first."""
        return [row for _, _, row in sorted(self._slowest, key=lambda entry: (-entry[0], -entry[1]))]


class Plcs:
    """The PLCs of a run by their address and VLAN, the first `MAX_PLCS` that answer."""

    def __init__(self) -> None:
        self.found: dict[Station, Plc] = {}

    def of(self, station: Station) -> Plc | None:
        """Return the record of a PLC, None if there is no room for it."""
        found = self.found.get(station)
        if found is None and len(self.found) < MAX_PLCS:
            found = self.found.setdefault(station, Plc())
        return found
