"""Finds the causes that explain other findings, and decides which of them applies.

See `dissect.engine.findings.cause_tables`.

A fault of a request is known when the request comes; it is remembered by the number of its transaction, until that is answered
or abandoned. Other causes appear only when requests stay unanswered (`dissect.engine.findings.ways`). While there are signs of
such a cause, the findings that it would explain wait; the decision comes with the end of the connection, an answer that refutes
the cause, or after `WAIT_NS`.

No cause is given while octets of the answering side are missing from the capture.
"""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.engine.findings.cause_tables import EXPLAINS
from dissect.engine.findings.known_bugs_tables import KNOWN_BUGS
from dissect.engine.findings.reporter import Finding, Reporter
from dissect.engine.findings.transaction_rules import judge_written
from dissect.engine.findings.transport_rules import DT_HEAD, sent_large
from dissect.engine.findings.ways import Way, whole
from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.ending import Ending
from dissect.engine.transactions.results import ASKED_JUDGED
from dissect.engine.transactions.side import Side
from dissect.engine.transactions.transaction import (
    CONNECTION_CLOSED,
    CONNECTION_EVICTED,
    UNANSWERED,
    Transaction,
)
from dissect.wire.text import count

#: Findings wait at most this long for their cause: clients wait a few seconds for an answer, and alerts must not be late.
WAIT_NS: Final = 5_000_000_000
#: Maximum number of faulty requests that are remembered, of one connection and of all.
_MOST: Final = 256
_MOST_ALL: Final = 65536
#: Known bugs, by the findings about ways of sending.
_KNOWN: Final[dict[str, str]] = {
    "cotp.number_unanswered": "numbered_tpdu",
    "cotp.fragments_unanswered": "fragments",
}
#: At the end of a connection at most this many open requests are examined.
_LOOKED_AT: Final = 64


class _Suspects:
    """What is known of a connection: its faulty requests, by the number of their transaction, and how it sends requests.

    ``small`` is the finding about its TPDU size, ``cut`` the cause of its end.
    """

    __slots__ = ("cut", "requests", "small", "ways")

    def __init__(self) -> None:
        self.requests: dict[int, Finding] = {}
        self.ways: list[Way] = []
        self.small: Finding | None = None
        self.cut: Finding | None = None


class Causes:
    """Remembers causes by connection, and sets `Reporter.because` to the right one during a judgement.

    `begin` and `close` surround the rules about a transaction, `at_end` and `close` those about the end of a connection.
    ``waiting`` are the connections on which findings may wait, each with the time since when.
    """

    def __init__(self, reporter: Reporter, slow_ns: i64) -> None:
        self.waiting: dict[int, int] = {}
        self._reporter: Reporter = reporter
        self._slow_ns: i64 = slow_ns
        self._of: dict[int, _Suspects] = {}  # by connection
        self._kept: i64 = 0

    def _suspects(self, connection: Connection) -> _Suspects:
        suspects = self._of.get(connection.number)
        if suspects is None:
            suspects = self._of[connection.number] = _Suspects()
        return suspects

    # ---- what is wrong with requests --------------------------------------------------------------------------------

    def blame(self, connection: Connection, number: i64, slug: str) -> None:
        """Remember that the finding ``slug``, which was just noted, is about the request of transaction ``number``."""
        finding = self._reporter.noted(slug)
        if finding is None:
            return
        requests = self._suspects(connection).requests
        before = requests.get(number)
        if before is not None:
            if EXPLAINS[before.slug] < EXPLAINS[slug]:
                requests[number] = finding
            return
        if len(requests) >= _MOST:
            del requests[next(iter(requests))]
            self._kept -= 1
        if self._kept < _MOST_ALL:
            requests[number] = finding
            self._kept += 1

    def waits(self, connection: Connection) -> bool:
        """Return whether findings on a connection wait for a cause."""
        return connection.number in self.waiting

    def sent(self, side: Side, slug: str, said: str, number: i64, frame: i64, time_ns: i64) -> Way:
        """Note that a request, future transaction ``number``, is sent in a way that some devices reject; return that way."""
        connection = side.connection
        suspects = self._suspects(connection)
        for way in suspects.ways:
            if way.slug == slug and way.side is side:
                break
        else:
            way = Way(side, slug, said, frame, time_ns)
            suspects.ways.append(way)
        if not way.fine:
            way.note(number)
            self._settle(connection.number, suspects, time_ns)
        return way

    # ---- what waits -------------------------------------------------------------------------------------------------

    def _settle(self, connection: i64, suspects: _Suspects, now_ns: i64) -> None:
        """Let findings wait while a way of sending may still be their cause; report them once none can be."""
        for way in suspects.ways:
            if way.suspicious:
                if connection not in self.waiting and way.told is None:
                    self.waiting[connection] = int(now_ns)
                    self._reporter.hold(connection)
                return
        self._release(connection, None)

    def _release(self, connection: i64, cause: Finding | None) -> None:
        if self.waiting:
            self.waiting.pop(connection, None)
        self._reporter.release(connection, cause)

    def tick(self, now_ns: i64) -> None:
        """Time has passed: decide about findings that have waited long enough."""
        for connection, since_ns in list(self.waiting.items()):
            if not 0 <= now_ns - since_ns < WAIT_NS:
                suspects = self._of.get(connection)
                before_ns: i64 = now_ns - self._slow_ns
                self._release(connection, self._standing(suspects, before_ns, now_ns) if suspects is not None else None)

    def _standing(self, suspects: _Suspects, before_ns: i64, now_ns: i64) -> Finding | None:
        """Return the finding about a way of sending that is never answered; report it if that was not done yet.

        Requests sent before ``before_ns`` have waited long enough.
        """
        for way in suspects.ways:
            if way.since_ns > self._reporter.lost_ns and way.stands(before_ns):
                told = way.told
                if told is None:
                    told = way.told = self._tell_way(way, now_ns)
                return told
        return None

    def _tell_way(self, way: Way, now_ns: i64) -> Finding | None:
        connection = way.side.connection
        who = way.side.tcp.ends[way.side.index]
        detail = (
            f"{count(int(way.sent), 'request')} of {who} {way.said}: no answer;"
            f" {count(int(connection.answered), 'other request')} answered{KNOWN_BUGS[_KNOWN[way.slug]].note}"
        )
        self._reporter.note(way.slug, connection.number, [int(way.frame)], now_ns, detail)
        return self._reporter.noted(way.slug)

    # ---- while something is judged ----------------------------------------------------------------------------------

    def begin(self, transaction: Transaction, now_ns: i64) -> None:
        """Before the rules about a transaction run, find out what caused its failure, if it failed."""
        connection = transaction.connection
        suspects = self._of.get(connection.number) if self._of else None
        cause: Finding | None = None
        if suspects is not None and suspects.requests:
            cause = suspects.requests.pop(transaction.number, None)
            if cause is not None:
                self._kept -= 1
        if transaction._outcome == UNANSWERED:
            if suspects is not None and suspects.ways:
                seen: bool = not transaction.unseen
                for way in suspects.ways:
                    way.give_up(transaction.number, seen)
                self._settle(connection.number, suspects, now_ns)
            if cause is None:
                cause = self._silence(transaction, suspects, now_ns)
        self._reporter.because = cause

    def _silence(self, transaction: Transaction, suspects: _Suspects | None, now_ns: i64) -> Finding | None:
        """Return why a request that has no fault itself stays unanswered."""
        if transaction.unseen:
            return None
        ending = transaction.connection.ending
        by_server: bool = ending is not None and ending.side == 1 - transaction.asked_by
        if transaction.request_ns < self._due(by_server, now_ns) and self._is_too_large(transaction):
            return self._tell_small(transaction, now_ns)
        if suspects is not None and by_server and transaction.reason == CONNECTION_CLOSED:
            return suspects.cut
        return None

    def close(self) -> None:
        """The rules are done: clear the cause for the next judgement."""
        self._reporter.because = None

    def _due(self, by_server: bool, now_ns: i64) -> i64:
        """Return the time before which requests should have been answered: any time, if the server ended the connection."""
        return now_ns + 1 if by_server else now_ns - self._slow_ns

    # ---- answers that do not fit the TPDU size ----------------------------------------------------------------------

    def _is_too_large(self, transaction: Transaction) -> bool:
        """Return whether the answer to a read fits the PDU length, but exceeds the TPDU size and all TPDUs of the server."""
        connection = transaction.connection
        size: i64 = transaction.parameters.answer_size
        return (
            0 < connection.tpdu_size < size + DT_HEAD
            and (connection.pdu_length == 0 or size <= connection.pdu_length)
            and not sent_large(connection, 1 - transaction.asked_by)
            and transaction.request_ns > self._reporter.lost_ns
        )

    def _tell_small(self, transaction: Transaction, now_ns: i64) -> Finding | None:
        """Return the finding that the TPDU size is too small for an answer; report it the first time."""
        connection = transaction.connection
        suspects = self._suspects(connection)
        if suspects.small is None:
            size: i64 = transaction.parameters.answer_size + DT_HEAD
            granted = f"; the PDU length of {connection.pdu_length} allows it" if connection.pdu_length else ""
            detail = (
                f"{transaction.parameters.subject}: the answer takes {size} bytes, TPDU size {connection.tpdu_size}"
                f"{_asked_for(connection)}{granted}{KNOWN_BUGS['small_tpdu'].note}"
            )
            frames = [int(transaction.request_frame)]
            self._reporter.note("session.tpdu_too_small", connection.number, frames, now_ns, detail)
            suspects.small = self._reporter.noted("session.tpdu_too_small")
        return suspects.small

    # ---- the end of a connection ------------------------------------------------------------------------------------

    def at_end(self, side: Side, reason: str, asked: list[Transaction], ending: Ending) -> None:
        """Find the cause of the end of a connection, before its open requests are finished.

        ``asked`` are the requests that certainly have no answer.
        """
        now_ns: i64 = ending.time_ns
        connection = side.connection
        if reason == CONNECTION_EVICTED:
            self._release(connection.number, None)
            return
        for asking in (side, side.peer):
            if asking is not None and asked and whole(asking):
                cause = self._of_pending(asking, asked, self._due(ending.side == 1 - asking.index, now_ns), now_ns)
                if cause is not None:
                    self._suspects(connection).cut = cause
                    self._reporter.because = cause
        suspects = self._of.get(connection.number) if self._of else None
        if suspects is not None and suspects.ways:
            self._release(connection.number, self._standing(suspects, self._due(False, now_ns), now_ns))

    def _of_pending(self, asking: Side, asked: list[Transaction], before_ns: i64, now_ns: i64) -> Finding | None:
        """Return what is wrong with the open requests of a side that were sent before ``before_ns``, None if nothing is."""
        suspects = self._of.get(asking.connection.number) if self._of else None
        pending = [
            transaction
            for transaction in asked[:_LOOKED_AT]
            if transaction.asked_by == asking.index and transaction.request_ns < before_ns
        ]
        if not pending:
            return None
        for transaction in pending:
            cause = self._at_fault(transaction, suspects)
            if cause is not None:
                return cause
        for transaction in pending:
            if self._is_too_large(transaction):
                return self._tell_small(transaction, now_ns)
        return self._standing(suspects, before_ns, now_ns) if suspects is not None else None

    def _at_fault(self, transaction: Transaction, suspects: _Suspects | None) -> Finding | None:
        """Return what is wrong with an open request itself, None if nothing is."""
        found = suspects.requests.get(transaction.number) if suspects is not None else None
        if found is None and transaction._flags:
            judge_written(self._reporter, transaction)
            transaction._flags |= ASKED_JUDGED
            found = self._reporter.because
            self._reporter.because = None
            if found is not None:
                self._suspects(transaction.connection).requests[transaction.number] = found
                self._kept += 1
        return found

    def forget(self, connection: Connection) -> None:
        """A connection is over and fully reported: forget it."""
        suspects = self._of.get(connection.number) if self._of else None
        if suspects is not None:
            self._release(connection.number, None)
            del self._of[connection.number]
            self._kept -= len(suspects.requests)


def _asked_for(connection: Connection) -> str:
    """Return who chose the TPDU size, empty if that was not captured."""
    if not connection.cr_seen:
        return ""
    asked: i64 = connection.tpdu_size_asked
    return " as the client asked" if asked == connection.tpdu_size else f", the client asked for {asked or 'none'}"
