"""`Tap`: a queue of events from the relay to the dissection, which never makes the relay wait.

When it is full because events are taken too slowly, octets are left out and counted. They become a gap, as if a capture had
lost packets. The relay is not affected.
"""

from __future__ import annotations

import queue
from typing import Final, NamedTuple, Protocol

from dissect.packets.tcp.stream import Endpoint

#: Kinds of events of a connection.
OPENED: Final = "opened"
REFUSED: Final = "refused"
UNANSWERED: Final = "unanswered"
SENT: Final = "sent"
CLOSED: Final = "closed"
RESET: Final = "reset"
GONE: Final = "gone"

#: At most this many octets wait, where each event counts as `OVERHEAD` more; beginnings of connections may exceed that by
#: `_RESERVE`. The end of a connection whose beginning was passed on is never left out; there are at most three such events for
#: each.
MAX_OCTETS: Final = 64 * 1024 * 1024
OVERHEAD: Final = 400
_RESERVE: Final = 8 * 1024 * 1024


class Passed(NamedTuple):
    """An event on connection ``link``, numbered from 1.

    ``side`` caused it (0 the client, 1 the server), at ``time_ns`` since 1970. ``octets`` are those of ``SENT``; ``skipped`` is
    how many octets of that side were left out before. ``ends`` are client and server, for the beginning of a connection;
    ``GONE`` is the last event of a connection.
    """

    kind: str
    link: int
    time_ns: int
    side: int = 0
    octets: bytes = b""
    skipped: int = 0
    ends: tuple[Endpoint, Endpoint] | None = None


def take_from(waiting: queue.SimpleQueue[Passed], wait_s: float) -> tuple[Passed | None, int]:
    """Return the next event and its size; wait up to ``wait_s`` seconds for it. (None, 0) if there is none."""
    try:
        passed = waiting.get(timeout=wait_s) if wait_s > 0 else waiting.get_nowait()
    except queue.Empty:
        return None, 0
    return passed, len(passed.octets) + OVERHEAD


class Tapped(Protocol):
    """A source of relay events: a `Tap`, or the reading end of one in another process."""

    @property
    def lost(self) -> int:
        """How many events were left out."""

    def take(self, wait_s: float) -> Passed | None:
        """Return the next event, waiting for it up to ``wait_s``; None if there is none."""

    def shut(self) -> None:
        """It will not be read from any more."""


class Tap:
    """The queue: one thread puts events in, a second one takes them.

    ``lost`` counts events that were left out, ``lost_octets`` their octets.
    """

    def __init__(self, max_octets: int = MAX_OCTETS) -> None:
        self.lost = 0
        self.lost_octets = 0
        self._max_octets = max_octets
        self._queue: queue.SimpleQueue[Passed] = queue.SimpleQueue()
        # Each of these is changed by only one thread, so no lock is needed.
        self._given = 0
        self._taken = 0
        self._shut = False
        self._followed: set[int] = set()  # connections whose beginning was not left out
        self._skipped: dict[tuple[int, int], int] = {}

    @property
    def held(self) -> int:
        """The number of octets that wait."""
        return self._given - self._taken

    def shut(self) -> None:
        """Drop all further events at once, because they are no longer read. May be called by any thread."""
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
        """``side`` sent octets."""
        skipped = self._skipped.get((link, side), 0)
        if link not in self._followed:
            self._count_lost(len(octets))
        elif self._put(Passed(SENT, link, time_ns, side, octets, skipped), 0):
            if skipped:
                del self._skipped[link, side]
        else:
            self._skipped[link, side] = skipped + len(octets)

    def closed(self, link: int, side: int, time_ns: int) -> None:
        """A side closed its direction (FIN)."""
        self._end(Passed(CLOSED, link, time_ns, side, skipped=self._skipped.pop((link, side), 0)))

    def reset(self, link: int, side: int, time_ns: int) -> None:
        """A side reset the connection."""
        self._end(Passed(RESET, link, time_ns, side, skipped=self._skipped.pop((link, side), 0)))

    def forget(self, link: int, time_ns: int) -> None:
        """A connection is over: no further events come."""
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
        """Return the next event, waiting for it up to ``wait_s``; None if there is none."""
        passed, size = take_from(self._queue, wait_s)
        self._taken += size
        return passed
