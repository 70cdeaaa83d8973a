"""Problems of a live run itself, reported where an operator sees them: as lines, as metrics, and to alert rules.

`Recovery` says when to retry after a failure. Nothing that writes is switched off because a disk is full.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from typing import Final, NamedTuple

from dissect.online.alerts.problems import KINDS

#: Seconds until something that failed is tried again: at first, and at most.
FIRST_S: Final = 1.0
LONGEST_S: Final = 60.0
#: At most this many problems wait to be shown; each is counted in any case.
_MAX_WAITING: Final = 1000


class Problem(NamedTuple):
    """A problem, or its end: ``text`` is a sentence, ``over`` says that it is over."""

    kind: str
    text: str
    over: bool = False


class WriterState(NamedTuple):
    """The state of a file writer.

    ``well``: its data are being written. ``files`` were finished, with ``octets``; ``lost`` packets or rows and ``lost_octets``
    of packets are in no file, and for ``lost_seconds`` nothing could be written. ``free`` is the free space of the disk, None
    if that is unknown.
    """

    label: str
    well: bool
    files: int
    octets: int
    lost: int
    lost_octets: int
    lost_seconds: float
    free: int | None


class Problems:
    """Collects problems. ``counts`` counts them by kind, without their ends; `take` returns those that were not shown yet.

    ``down_seconds`` is how long the interface was down; each of ``writers`` returns the state of a file writer. ``heads`` are
    the hashes of the latest entry of each manifest, by its name.
    """

    def __init__(self) -> None:
        self.down_seconds = 0.0
        self.writers: list[Callable[[], WriterState]] = []
        self.heads: dict[str, str] = {}
        self.counts: dict[str, int] = dict.fromkeys(KINDS, 0)
        self._fresh: deque[Problem] = deque(maxlen=_MAX_WAITING)
        self._listeners: list[Callable[[Problem], None]] = []

    def listen(self, listener: Callable[[Problem], None]) -> None:
        """Call ``listener`` with each problem from now on, in the thread in which it is found."""
        self._listeners.append(listener)

    def tell(self, kind: str, text: str, over: bool = False, shown: bool = True) -> None:
        """Report a problem, or the end of one; one that is not ``shown`` gets no line, because it is shown elsewhere."""
        problem = Problem(kind, text, over)
        if not over:
            self.counts[kind] = self.counts.get(kind, 0) + 1
        if shown:
            self._fresh.append(problem)
        for listener in self._listeners:
            listener(problem)

    def take(self) -> list[Problem]:
        """Return the problems since the last call."""
        taken: list[Problem] = []
        while self._fresh:
            taken.append(self._fresh.popleft())
        return taken


class Recovery:
    """When to retry after a failure: after 1, 2, 4 … 60 s.

    ``failing``: it failed and has not worked since. ``count`` counts failures that began, ``clock`` is a monotonic clock in
    seconds. After a failure within a minute of success, the wait grows as well, so that a disk with occasional room for a few
    packets does not cause two lines a second.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self.failing = False
        self.count = 0
        self._clock = clock
        self._pause = 0.0
        self._next = 0.0
        self._since = 0.0
        self._over = 0.0  # seconds of the failures that are over
        self._worked = -LONGEST_S

    @property
    def due(self) -> bool:
        """Whether it is time to try."""
        return not self.failing or self._clock() >= self._next

    @property
    def seconds(self) -> float:
        """Total time of the failures."""
        return self._over + (self._clock() - self._since if self.failing else 0.0)

    def failed(self) -> bool:
        """Note a failure; return whether it is a new one."""
        now = self._clock()
        begins = not self.failing
        if begins and now - self._worked >= LONGEST_S:
            self._pause = 0.0
        self._pause = min(max(self._pause * 2, FIRST_S), LONGEST_S)
        self._next = now + self._pause
        if begins:
            self.failing = True
            self._since = now
            self.count += 1
        return begins

    def worked(self) -> float:
        """Note that it works again; return how many seconds the failure lasted."""
        now = self._clock()
        lasted = now - self._since if self.failing else 0.0
        self._over += lasted
        self.failing = False
        self._worked = now
        return lasted
