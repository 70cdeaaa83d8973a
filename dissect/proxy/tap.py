"""What passed the relay, on its way to those who look at it: a queue that never makes the relay wait.

When it is full because nobody takes what is in it fast enough, octets are left out and counted: they become a hole, as when a
capture loses packets. The relay goes on as if nothing had happened.
"""

from __future__ import annotations

import queue
from typing import Final, NamedTuple, Protocol

from dissect.tcp.stream import Endpoint

#: What can happen to a connection.
OPENED: Final = "opened"
REFUSED: Final = "refused"
UNANSWERED: Final = "unanswered"
SENT: Final = "sent"
CLOSED: Final = "closed"
RESET: Final = "reset"
GONE: Final = "gone"

#: Octets that wait at most, each thing that happened counted as so many more; how much further beginnings may go. The ends of
#: what began always get through, three for each beginning at most.
MAX_OCTETS: Final = 64 * 1024 * 1024
OVERHEAD: Final = 400
_RESERVE: Final = 8 * 1024 * 1024


class Passed(NamedTuple):
    """Something happened on connection ``link``, numbered from 1.

    ``side`` did it (0 the client, 1 the server), at ``time_ns`` since 1970. ``octets`` are those of ``SENT``; ``skipped``
    octets of that side before it were left out. ``ends`` are client and server, where the connection begins; ``GONE`` is the
    last that is told of one.
    """

    kind: str
    link: int
    time_ns: int
    side: int = 0
    octets: bytes = b""
    skipped: int = 0
    ends: tuple[Endpoint, Endpoint] | None = None


def take_from(waiting: queue.SimpleQueue[Passed], wait_s: float) -> tuple[Passed | None, int]:
    """Return what happened next and what it counts for, waiting for it up to ``wait_s``; (None, 0) when nothing did."""
    try:
        passed = waiting.get(timeout=wait_s) if wait_s > 0 else waiting.get_nowait()
    except queue.Empty:
        return None, 0
    return passed, len(passed.octets) + OVERHEAD


class Tapped(Protocol):
    """Where what passed is taken from: a `Tap`, or the end of one in another process. ``lost`` counts what was left out."""

    @property
    def lost(self) -> int:
        """What was left out."""

    def take(self, wait_s: float) -> Passed | None:
        """Return what happened next, waiting for it up to ``wait_s``; None when nothing did."""

    def shut(self) -> None:
        """Nobody takes any more."""


class Tap:
    """The queue: one thread gives, another one takes.

    ``lost`` counts what was left out, ``lost_octets`` its octets.
    """

    def __init__(self, max_octets: int = MAX_OCTETS) -> None:
        self.lost = 0
        self.lost_octets = 0
        self._max_octets = max_octets
        self._queue: queue.SimpleQueue[Passed] = queue.SimpleQueue()
        # Each is changed by one thread only, so neither takes a lock.
        self._given = 0
        self._taken = 0
        self._shut = False
        self._followed: set[int] = set()  # connections whose beginning got through, and all their events since
        self._skipped: dict[tuple[int, int], int] = {}

    @property
    def held(self) -> int:
        """Octets that wait."""
        return self._given - self._taken

    def shut(self) -> None:
        """Nobody takes any more: what is given from now on is dropped at once. May be called by any thread."""
        self._shut = True

    # ---- the relay's side -------------------------------------------------------------------------------------------

    def opened(self, link: int, ends: tuple[Endpoint, Endpoint], time_ns: int) -> None:
        """A connection was made from the client to the server of ``ends``."""
        if self._put(Passed(OPENED, link, time_ns, ends=ends), _RESERVE):
            self._followed.add(link)

    def failed(self, kind: str, link: int, ends: tuple[Endpoint, Endpoint], time_ns: int) -> None:
        """A connection could not be made: ``REFUSED`` or ``UNANSWERED``."""
        self._put(Passed(kind, link, time_ns, ends=ends), _RESERVE)

    def sent(self, link: int, side: int, octets: bytes, time_ns: int) -> None:
        """Octets passed."""
        skipped = self._skipped.get((link, side), 0)
        if link not in self._followed:
            self._count_lost(len(octets))
        elif self._put(Passed(SENT, link, time_ns, side, octets, skipped), 0):
            if skipped:
                del self._skipped[link, side]
        else:
            self._skipped[link, side] = skipped + len(octets)

    def closed(self, link: int, side: int, time_ns: int) -> None:
        """A side sends no more."""
        self._end(Passed(CLOSED, link, time_ns, side, skipped=self._skipped.pop((link, side), 0)))

    def reset(self, link: int, side: int, time_ns: int) -> None:
        """A side broke the connection off."""
        self._end(Passed(RESET, link, time_ns, side, skipped=self._skipped.pop((link, side), 0)))

    def forget(self, link: int, time_ns: int) -> None:
        """Nothing more will come of a connection."""
        self._end(Passed(GONE, link, time_ns))
        self._followed.discard(link)
        self._skipped.pop((link, 0), None)
        self._skipped.pop((link, 1), None)

    def _end(self, passed: Passed) -> None:
        if passed.link in self._followed:
            self._put(passed, None)

    def _put(self, passed: Passed, reserve: int | None) -> bool:
        size = len(passed.octets) + OVERHEAD
        full = reserve is not None and self.held + size > self._max_octets + reserve
        if self._shut or full:
            self._count_lost(len(passed.octets))
            return False
        self._given += size
        self._queue.put(passed)
        return True

    def _count_lost(self, octets: int) -> None:
        if not self._shut:
            self.lost += 1
            self.lost_octets += octets

    # ---- the other side ---------------------------------------------------------------------------------------------

    def take(self, wait_s: float) -> Passed | None:
        """Return what happened next, waiting for it up to ``wait_s``; None when nothing did."""
        passed, size = take_from(self._queue, wait_s)
        self._taken += size
        return passed
