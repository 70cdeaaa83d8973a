"""Requests that wait too long for their answers, told while they wait.

A line may carry thousands of connections, and most requests are answered at once, so nothing is kept for a request. A side
that asks is looked at when the request it asked then is due, and while some of its requests are open again when the next one
is; one that has none is left alone until it asks again. So a side that polls costs one look for each `Options.overdue_ns`.
What the capture does not show is not held against anybody: an answer in a hole, or a side of which nothing was captured.
"""

from __future__ import annotations

import heapq
from typing import Final

from mypy_extensions import i64

from dissect.findings.reporter import Reporter
from dissect.transactions.dialogue import Dialogue
from dissect.transactions.naming import subject
from dissect.transactions.table import MAX_CONNECTIONS, Side
from dissect.transactions.transaction import Transaction
from dissect.wire.durations import duration_text

#: Sides looked at in one go, and open requests; the others have to wait for the next one.
_SIDES_AT_ONCE: Final = 1024
_REQUESTS_AT_ONCE: Final = 8192
#: A side whose requests stay open is not looked at again before this.
_PAUSE_NS: Final = 50_000_000
#: Sides are sought out of those whose connection is over when there are this many; more than can be open.
_MANY: Final = 8 * MAX_CONNECTIONS


class _Entry:
    """A side, and when it is looked at."""

    __slots__ = ("due_ns", "side")

    def __init__(self, due_ns: i64, side: Side) -> None:
        self.due_ns: i64 = due_ns
        self.side: Side = side

    def __lt__(self, other: _Entry) -> bool:
        return self.due_ns < other.due_ns


class OverdueWatch:
    """Looks at the sides that have asked, in the order in which their requests become overdue."""

    def __init__(self, judge: Reporter, dialogue: Dialogue, limit_ns: i64) -> None:
        self._judge: Reporter = judge
        self._dialogue: Dialogue = dialogue
        self._limit_ns: i64 = limit_ns
        self._due: list[_Entry] = []
        dialogue.watching = True

    def look(self, now_ns: i64) -> None:
        """It is ``now_ns``: tell the requests that are overdue by now and were not told before."""
        self._take_new()
        due = self._due
        sides: i64 = 0
        requests: i64 = 0
        while due and due[0].due_ns <= now_ns and sides < _SIDES_AT_ONCE and requests < _REQUESTS_AT_ONCE:
            side = heapq.heappop(due).side
            sides += 1
            if side.peer is None:
                continue  # its connection is over
            asked = side.connection.open_requests[side.index]
            if asked.count == 0:
                side.watched = False
                continue
            requests += asked.count
            heapq.heappush(due, _Entry(self._look_at(side, now_ns), side))

    def _take_new(self) -> None:
        """Take over the sides that asked since the last look; each is due when the latest request of its connection is."""
        fresh = self._dialogue.asking
        if not fresh:
            return
        self._dialogue.asking = []
        for side in fresh:
            heapq.heappush(self._due, _Entry(side.connection.last_request_ns + self._limit_ns, side))
        if len(self._due) > _MANY:
            self._due = [entry for entry in self._due if entry.side.peer is not None]
            heapq.heapify(self._due)

    def _look_at(self, side: Side, now_ns: i64) -> i64:
        """Tell what is overdue of a side; return when to look at it again."""
        answering = side.peer
        if answering is None or answering.stream.held is not None:
            return now_ns + _PAUSE_NS  # packets are missing, or out of order: the answer may be among them
        again_ns: i64 = now_ns + self._limit_ns
        for transaction in side.connection.open_requests[side.index].asked_after(side.told_overdue):
            due_ns: i64 = transaction.request_ns + self._limit_ns
            if due_ns > now_ns:
                again_ns = min(again_ns, due_ns)
                break
            side.told_overdue = transaction.number
            if answering.captured and answering.hole_frame < transaction.request_frame:
                self._tell(transaction, now_ns)
        return max(again_ns, now_ns + _PAUSE_NS)

    def _tell(self, transaction: Transaction, now_ns: i64) -> None:
        connection = transaction.connection
        if self._judge.wants("transaction.overdue", connection.number):
            frame: int = transaction.request_frame
            waits: int = now_ns - transaction.request_ns
            ago = duration_text(int(waits))
            detail = f"{subject(transaction)}: sent {ago} ago in packet {frame}, still unanswered"
            self._judge.detail("transaction.overdue", connection.number, [frame], now_ns, detail)
