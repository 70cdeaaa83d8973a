"""Ways of sending requests that some devices do not accept: in numbered TPDUs, or in several TPDUs each.

The sign of it: no request sent in such a way is answered, but others are. A single answer refutes it.
"""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.engine.findings.reporter import Finding
from dissect.engine.transactions.side import Side

#: Maximum number of requests of one way that are remembered. A way with more is not reported: no client waits for this many
#: answers.
_MOST: Final = 4096


def whole(asking: Side) -> bool:
    """Return whether all octets of both directions are captured, so that nothing else was sent."""
    answering = asking.peer
    if answering is None or not answering.captured or answering.holes or asking.holes:
        return False
    if answering.unseen or asking.unseen:
        return False
    return not answering.unfinished and answering.stream.held is None


class Way:
    """The requests that ``side`` sent in one way; ``slug`` is the finding about this way, and ``said`` describes it.

    ``frame`` and ``since_ns`` are packet and time of the first of them. ``unanswered`` counts those that finally got no answer.
    With ``fine`` nothing is wrong with this way. ``told`` is the finding, once it exists.
    """

    __slots__ = ("_numbers", "fine", "frame", "said", "side", "since_ns", "slug", "told", "unanswered")

    def __init__(self, side: Side, slug: str, said: str, frame: i64, time_ns: i64) -> None:
        self.side: Side = side
        self.slug: str = slug
        self.said: str = said
        self.frame: i64 = frame
        self.since_ns: i64 = time_ns
        self.unanswered: i64 = 0
        self.fine: bool = False
        self.told: Finding | None = None
        self._numbers: set[int] = set()

    @property
    def sent(self) -> i64:
        """How many requests were sent in this way."""
        return len(self._numbers)

    def has(self, number: i64) -> bool:
        """Return whether the request of a transaction was sent in this way."""
        return int(number) in self._numbers

    def note(self, number: i64) -> None:
        """The next request, that of transaction ``number``, is sent in this way."""
        opened = self.side.connection.open_requests[self.side.index]
        if self.sent - self.unanswered > opened.count or self.sent >= _MOST:
            self.fine = True  # one of them was answered
            self._numbers = set()
            return
        self._numbers.add(int(number))

    def give_up(self, number: i64, seen: bool) -> None:
        """A request of the connection stays unanswered; unless ``seen``, it may have been answered all the same."""
        if self.has(number) and seen:
            self.unanswered += 1
        else:
            self.fine = True

    @property
    def suspicious(self) -> bool:
        """True while this way may be the reason for unanswered requests: others were answered."""
        return not self.fine and self.side.connection.answered > 0

    def stands(self, before_ns: i64) -> bool:
        """Return whether this way is the reason for unanswered requests: others were answered, but none of these.

        Of open requests, only those sent before ``before_ns`` have waited long enough.
        """
        if not self.suspicious or not whole(self.side):
            return False
        pending: i64 = 0
        overdue: i64 = self.unanswered
        for transaction in self.side.connection.open_requests[self.side.index].asked_after(-1):
            if not self.has(transaction.number):
                return False
            pending += 1
            if transaction.request_ns < before_ns:
                overdue += 1
        return overdue > 0 and pending + self.unanswered == self.sent
