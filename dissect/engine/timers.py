"""`Timers`: everything that waits for time to pass, and `OverdueWatch`, which reports requests that wait too long.

Segments wait for those before them, responses for their requests, and closed connections for late packets. The time is that of
the capture: packets advance it, and while none arrive `Pipeline.tick` does. The pipeline compares the time of each packet with
``deadline_ns``, and calls these classes when that is reached.

`OverdueWatch` reports a request that is overdue while it is still open. A capture may hold thousands of connections, and most
requests are answered at once, so nothing is stored for a request. Instead, a side that sends a request is checked when that
request is due, and again when its next open request is; a side without open requests is not checked until it sends a request.
So a polling side costs one check per `Options.overdue_ns`. A request is not reported if its answer may be missing from the
capture: the answering side has a gap, or was not captured.
"""

from __future__ import annotations

import heapq
from typing import Final

from mypy_extensions import i64

from dissect.engine import ends
from dissect.engine.counters import Counters
from dissect.engine.exchange import Exchange
from dissect.engine.findings.reporter import Reporter
from dissect.engine.transactions.gaps import perhaps_answered
from dissect.engine.transactions.naming import subject
from dissect.engine.transactions.pairing import Dialogue
from dissect.engine.transactions.results import wants_answer
from dissect.engine.transactions.side import Side
from dissect.engine.transactions.table import MAX_CONNECTIONS
from dissect.engine.transactions.transaction import Transaction
from dissect.packets.tcp.stretches import Chunk
from dissect.wire.text import duration_text

#: Maximum number of sides, and of open requests, that are checked at once; the others wait for the next check.
_SIDES_AT_ONCE: Final = 1024
_REQUESTS_AT_ONCE: Final = 8192
#: The shortest time between two checks of a side with open requests.
_PAUSE_NS: Final = 50_000_000
#: When the list has this many sides, more than can be open, those of finished connections are dropped.
_MANY: Final = 8 * MAX_CONNECTIONS


class _Entry:
    """A side, and the time of its next check."""

    __slots__ = ("due_ns", "side")

    def __init__(self, due_ns: i64, side: Side) -> None:
        self.due_ns: i64 = due_ns
        self.side: Side = side

    def __lt__(self, other: _Entry) -> bool:
        return self.due_ns < other.due_ns


class OverdueWatch:
    """Checks the sides that have sent requests, in the order in which these become overdue."""

    def __init__(self, reporter: Reporter, dialogue: Dialogue, limit_ns: i64) -> None:
        self._reporter: Reporter = reporter
        self._dialogue: Dialogue = dialogue
        self._limit_ns: i64 = limit_ns
        self._due: list[_Entry] = []
        dialogue.watching = True

    def look(self, now_ns: i64) -> None:
        """At time ``now_ns``, report the overdue requests that were not reported before."""
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
        """Add the sides that sent requests since the last check; each is due when the latest request of its connection is."""
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
        """Report the overdue requests of a side; return the time of its next check."""
        answering = side.peer
        if answering is None or answering.stream.held is not None:
            return now_ns + _PAUSE_NS  # an answer may be in the segments that are held, or missing before them
        again_ns: i64 = now_ns + self._limit_ns
        for transaction in side.connection.open_requests[side.index].asked_after(side.told_overdue):
            due_ns: i64 = transaction.request_ns + self._limit_ns
            if due_ns > now_ns:
                again_ns = min(again_ns, due_ns)
                break
            side.told_overdue = transaction.number
            if answering.captured and not perhaps_answered(transaction, answering) and wants_answer(transaction):
                self._tell(transaction, now_ns)
        return max(again_ns, now_ns + _PAUSE_NS)

    def _tell(self, transaction: Transaction, now_ns: i64) -> None:
        connection = transaction.connection
        frame: int = transaction.request_frame
        if self._reporter.wants("transaction.overdue", connection.number, frame, frame, now_ns):
            waits: int = now_ns - transaction.request_ns
            ago = duration_text(int(waits))
            detail = f"{subject(transaction)}: sent {ago} ago in packet {frame}, still unanswered"
            detail += self._reporter.doubt(transaction.request_ns)
            self._reporter.detail("transaction.overdue", connection.number, [frame], now_ns, detail)


#: Waiting sides are checked this often in capture time, always at multiples of it, so that the results for a connection do not
#: depend on other connections in the capture.
TICK_NS: Final = 50_000_000
#: When the list of waiting sides has grown to this size, those of finished connections are dropped.
_MANY_WAITING: Final = 4 * MAX_CONNECTIONS
#: Sizes of one or two DTs without data between two messages: nothing else is as short, so no request and no answer is missing.
_EMPTY_DTS: Final = (7, 14)
#: The beginning of a TPKT: version and reserved octet (RFC 1006, 6).
_BEGINS: Final = b"\x03\x00"
#: The deadline while nothing waits.
FAR_FUTURE: Final = 0x7FFFFFFFFFFFFFFF


def next_tick(now_ns: i64) -> i64:
    """Return when to check waiting sides next."""
    return (now_ns // TICK_NS + 1) * TICK_NS


class Timers:
    """Keeps the sides on which something waits; passes it on, or drops it when it has waited too long."""

    def __init__(self, counters: Counters, exchange: Exchange, overdue_ns: i64) -> None:
        self._counters: Counters = counters
        self._exchange: Exchange = exchange
        self._waiting: list[Side] = []  # sides with held segments or held answers
        self._doubts: list[Side] = []  # sides whose end is in doubt, and that sent something since the last check
        self._overdue: OverdueWatch | None = None
        self._rest_ns: i64 = FAR_FUTURE  # the deadline while nothing waits
        if overdue_ns:
            self._overdue = OverdueWatch(exchange.reporter, exchange.dialogue, overdue_ns)
            self._rest_ns = 0
        self.deadline_ns: i64 = self._rest_ns

    # ---- octets in order, and gaps ----------------------------------------------------------------------------------

    def chunks(self, side: Side, cut: bool = False) -> None:
        """Pass on what is ready in the stream of ``side``, octets and gaps in order; ``cut``: the capture cut a frame there."""
        for chunk in self._take_ready(side):
            self._pass_on(side, chunk, cut)

    def both(self, side: Side) -> None:
        """Pass on what is ready in both directions of the connection of ``side``, in the order of the packets.

        So an answer follows its request if both waited because of gaps.
        """
        peer = side.peer
        if peer is None:
            return
        ready = self._take_ready(side)
        others = self._take_ready(peer)
        at: i64 = 0
        for chunk in ready:
            while at < len(others) and others[at].own_frame < chunk.own_frame:
                self._pass_on(peer, others[at], False)
                at += 1
            self._pass_on(side, chunk, False)
        while at < len(others):
            self._pass_on(peer, others[at], False)
            at += 1

    def _take_ready(self, side: Side) -> list[Chunk]:
        ready = side.stream.take_ready()
        if side.stream.outside:
            self._note_outside(side)
        return ready

    def _pass_on(self, side: Side, chunk: Chunk, cut: bool) -> None:
        """Hand octets of ``side`` to its protocol, or report a gap to it."""
        if not chunk.hole and side.at_rest:
            # No message is unfinished, so the messages in these octets were complete when their own packet came.
            chunk.frame = chunk.own_frame
            chunk.time_ns = chunk.own_ns
        side.end_seq = chunk.end_seq
        side.size = len(chunk.octets)
        side.last_ack = chunk.ack
        if chunk.hole:
            if side.connection.followed:
                self._counters.octets.holes += 1
                self._counters.octets.missing += chunk.hole
                if not side.at_rest:
                    self._counters.octets.inside += 1
            side.holes += 1
            side.missing += chunk.hole
            if side.at_rest and chunk.hole in _EMPTY_DTS and not cut:
                side.slight = chunk
            else:
                side.note_gap(chunk.frame, -1 if cut else chunk.end_seq)
            side.protocol.gap(side, chunk.hole, cut, chunk.frame, chunk.time_ns)
            if not cut:
                self._exchange.dialogue.lost(side, chunk.hole)
        else:
            slight = side.slight
            if slight is not None:
                side.slight = None
                if not chunk.octets.startswith(_BEGINS):
                    side.note_gap(slight.frame, slight.end_seq)  # it was the begin of a message after all
            side.protocol.feed(side, chunk.octets, 0, len(chunk.octets), chunk.frame, chunk.time_ns)

    def _note_outside(self, side: Side) -> None:
        if side.connection.followed:
            detail = f"{side.stream.outside} bytes from {side.tcp.ends[side.index]}"
            self._counters.note("stream.outside_window", detail, side.connection.number)
        side.stream.outside = 0

    # ---- waiting sides ----------------------------------------------------------------------------------------------

    def wait(self, side: Side) -> None:
        """Check ``side`` again when time passes, or with the next packet of its connection."""
        if not side.waiting:
            side.waiting = True
            side.longest = 0
            if side.peer is not None:
                side.peer.longest = 0
            self._waiting.append(side)
            if len(self._waiting) > _MANY_WAITING:
                self._waiting = [one for one in self._waiting if one.waiting]
        self.wake()

    def doubt(self, side: Side) -> None:
        """The end of a connection is in doubt, and ``side`` sent something: check it when time passes."""
        doubt = side.tcp.doubt
        if doubt is None or doubt.due:
            return
        doubt.due = True
        side.longest = 0
        if side.peer is not None:
            side.peer.longest = 0
        self._doubts.append(side)
        if len(self._doubts) > _MANY_WAITING:
            self.look_at_ends()
        self.wake()

    def wake(self) -> None:
        """Something waits from now on: set the deadline unless there is one."""
        if self.deadline_ns == FAR_FUTURE:
            self.deadline_ns = next_tick(self._counters.now_ns)

    def step_back(self, time_ns: i64) -> None:
        """The clock of the capture went back to ``time_ns``: move the deadline back as well, so that nothing waits too long."""
        self._counters.note_step_back(time_ns)
        if self.deadline_ns != FAR_FUTURE:
            self.deadline_ns = min(self.deadline_ns, next_tick(time_ns))

    def expire_answers(self, side: Side) -> None:
        """Drop answers of ``side`` that waited too long for their request."""
        exchange = self._exchange
        exchange.dialogue.expire(side, self._counters.now_ns)
        if side.connection._aside is not None:
            exchange.behind.expire(side, self._counters.now_ns)
        if exchange.dialogue.also:
            exchange.beside(self._counters.frames, self._counters.now_ns)

    def passing(self, side: Side, peer: Side, ack: i64, acknowledges: bool) -> None:
        """Take a packet of a connection on which something waits, because it may end the waiting."""
        now_ns: i64 = self._counters.now_ns
        if side.tcp.doubt is not None:
            ends.look(self._counters, side)
            self.doubt(side)
        if peer.stream.held is not None and acknowledges:
            peer.stream.acknowledged(ack, now_ns)
        for end in (peer, side):
            if end.stream.held is not None:
                end.stream.passing(now_ns)
        if side.stream.ready or peer.stream.ready:
            self.both(peer)
        # Answers come last, because their requests may just have been passed on.
        self.expire_answers(peer)
        self.expire_answers(side)

    def give_up_waiting(self) -> None:
        """Time has passed: drop everything that waited too long."""
        waiting = list(self._waiting)
        self.look_at_ends()
        for side in waiting:
            side.stream.expire(self._counters.now_ns)
        for side in waiting:
            if side.stream.ready:
                self.both(side)
        for side in waiting:  # a separate loop, because the request of an answer may just have been passed on
            self.expire_answers(side)
            asked = side.connection.open_requests[1 - side.index]
            side.waiting = (
                side.stream.time_bound
                or asked.orphans is not None
                or asked.undecided is not None
                or side.connection._aside is not None
            )

    def look_at_ends(self) -> None:
        """Check the connections whose end is in doubt and that had packets since the last check.

        The others have nothing new, and there may be thousands of them until the end of the capture.
        """
        held: list[Side] = []
        for side in self._doubts:
            doubt = side.tcp.doubt
            peer = side.peer
            if doubt is None or peer is None or not doubt.due:
                continue
            doubt.due = False
            ends.look(self._counters, side)
            if side.stream.time_bound or peer.stream.time_bound:
                held.append(side)  # check again once the held segments are passed on
        self._doubts = []
        for side in held:
            self.doubt(side)

    def look_overdue(self) -> None:
        """Report the requests that have been open for longer than the limit, if there is a limit."""
        if self._overdue is not None:
            self._overdue.look(self._counters.now_ns)

    def settle(self, lingering: bool) -> None:
        """Forget the sides on which nothing waits any longer; clear the deadline if none is left and nothing lingers."""
        self._waiting = [side for side in self._waiting if side.waiting]
        causes = self._exchange.causes
        if self._overdue is None and not self._waiting and not self._doubts and not lingering and not causes.waiting:
            self.deadline_ns = FAR_FUTURE

    def oldest_held(self) -> i64:
        """Return the first packet whose segment or answer is held back, 0 if there is none."""
        oldest: i64 = 0
        for side in self._waiting:
            held = side.stream.held
            if held is not None:
                for stretch in held:
                    if oldest == 0 or stretch.frame < oldest:
                        oldest = stretch.frame
            waiting = side.connection.open_requests[1 - side.index].waiting()
            aside = side.connection._aside
            if aside is not None:
                waiting = waiting + aside.answers()
            for answer in waiting:
                if oldest == 0 or answer.response_frame < oldest:
                    oldest = answer.response_frame
        return oldest

    def finish(self) -> None:
        """The capture ends: nothing waits any longer."""
        self._waiting = []
        self._doubts = []
        self.deadline_ns = self._rest_ns
