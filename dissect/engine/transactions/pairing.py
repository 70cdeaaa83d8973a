"""Pairing: finds the request that each answer belongs to; opens, completes and closes transactions (reference section 5).

`Dialogue` takes every PDU in order and returns the transaction that the PDU completes. Others may end with the same PDU, such
as a request whose reference is reused, or an answer that was kept too long for its request; these go into ``also``. `Dialogue`
only states facts, as `Transaction._flags`; the rules in `dissect.engine.findings` judge them.

The asking side of a transaction sends the request, the answering side the response.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from mypy_extensions import i64

from dissect.engine.transactions.alike import (
    assign,
    fitting,
    is_complete,
    is_due,
    is_over,
    is_repeat,
    possible,
)
from dissect.engine.transactions.checks import check_answer, check_data_codes
from dissect.engine.transactions.contradictions import contradicts, is_strange
from dissect.engine.transactions.gaps import (
    answered_in,
    begins_open,
    between,
    has_gaps,
    latest_gap,
    missing_since,
    passed_over,
    perhaps_answered,
    perhaps_unasked,
    unasked_before,
    unheard,
)
from dissect.engine.transactions.open_requests import (
    GIVEN_UP_NS,
    NEVER_NS,
    SHORT_REST_NS,
    HeldAnswer,
    OpenRequests,
    Row,
    acknowledged,
    excludes,
    key_of,
)
from dissect.engine.transactions.results import (
    ALIKE,
    EXPECTED,
    FUNCTION_MISMATCH,
    GAPS,
    REORDERED,
    check_notification,
    check_other_answer,
    check_written,
    error_code,
    mismatch,
    wants_answer,
)
from dissect.engine.transactions.transaction import (
    ANSWERED,
    CAPTURE_ENDED,
    CONNECTION_EVICTED,
    HOLE,
    ONE_SIDED,
    PUSH,
    REFERENCE_REUSED,
    TABLE_FULL,
    UNANSWERED,
    Transaction,
    unasked,
)
from dissect.packets.tcp.stream import HALF_SPACE, MASK
from dissect.protocols.s7.message import parse_pdu
from dissect.protocols.s7.parameters import Parameters
from dissect.protocols.s7.tables import ACK, ACK_DATA, JOB, USERDATA, WRITE_VAR
from dissect.protocols.s7plus.parameters import PLUS
from dissect.wire.build import COMPILED

if TYPE_CHECKING:
    from dissect.engine.transactions.behind import Behind
    from dissect.engine.transactions.side import Side

#: Maximum number of open requests per connection and side; the granted AmQ (parallel jobs) is 8 or less in practice.
MAX_OPEN: Final = 4096
#: Maximum number of open requests on all connections; beyond it a new one drops its side's oldest, if that has over `FEW_OPEN`.
MAX_OPEN_ALL: Final = 65536
FEW_OPEN: Final = 16
#: A client with one reference is idle when no request is open for `SHORT_REST_NS` and for this many times its last wait.
_MANY_TIMES: Final = 4
#: When `Dialogue.asking` has this many sides (more than can be open), those of closed connections are removed.
_MANY_ASKING: Final = MAX_OPEN_ALL


class Dialogue:
    """Pairs the PDUs of all connections. ``count`` is the number of transactions so far."""

    def __init__(self) -> None:
        self.count: i64 = 0
        self.open: i64 = 0  # requests without answer on all connections
        self.also: list[Transaction] = []  # also ended by the current PDU; `Exchange.beside` reports and clears them
        self.holding: list[Side] = []  # sides with a kept answer, since the pipeline last checked
        self.several: bool = False  # other requests of its side were open when the latest request was sent
        self.shared: bool = False  # ... and one of them has its reference; cleared by the code that reports it
        self.cut: bool = False  # the current message ends in a gap, so its time is not that of its last packet
        self.lossy: bool = False  # the capture has a gap
        self.watching: bool = False  # an `OverdueWatch` takes the sides from `asking`
        self.asking: list[Side] = []  # sides that sent requests since the last check, if not yet watched
        self.behind: Behind | None = None  # messages behind malformed headers, to which an answer may belong

    def ask(
        self,
        side: Side,
        rosctr: i64,
        pdu_ref: i64,
        parameters: Parameters,
        buf: bytes,
        at: i64,
        size: i64,
        frame: i64,
        time_ns: i64,
    ) -> Transaction | None:
        """Take a request: open a transaction. Return its transaction only if its answer was captured before it."""
        connection = side.connection
        side.requests += 1
        connection.last_request = parameters
        connection.last_request_ns = time_ns
        self.count += 1
        asked_by: i64 = side.index
        transaction = Transaction(self.count, connection, asked_by, rosctr, pdu_ref, parameters)
        transaction.request_frame = frame
        transaction.request_ns = time_ns
        transaction._request_ack = side.last_ack
        transaction._request_seq = (side.end_seq - side.size) & MASK
        transaction._request_buf = buf
        transaction._request_offset = at
        transaction.request_size = size
        if not connection.client_known:
            connection._note_request(side.index, parameters)
        if parameters.function == WRITE_VAR:
            transaction._flags |= check_written(parameters, buf, at, size)
        key: i64 = pdu_ref if rosctr < USERDATA else key_of(rosctr, pdu_ref)
        requests = connection.open_requests[asked_by]
        self.several = requests.count > 0
        if side.holes:
            self._ask_after_gap(side, requests, key, transaction)
        if key == requests.latest_key:
            since_ns: i64 = time_ns - connection.last_answer_ns
            requests.repeat(begins_open(side), connection.answered > 0, since_ns, latest_gap(side))
        elif requests.latest is None:
            requests.latest_key = key
        requests.asked_frame = frame
        requests.asked_seq = transaction._request_seq
        if requests.orphans is not None and self.find_answer(side, requests, key, transaction):
            return transaction
        self.open += 1
        if self.watching and not side.watched:
            self._watch(side)
        if requests.count == 0:  # nearly always
            requests.count = 1
            requests.latest = transaction
            requests.latest_key = key
            return None
        waiting = requests.add(key, transaction)
        if waiting is not None:
            self._ask_again(side, requests, key, transaction, waiting)
        if requests.count > MAX_OPEN or (self.open > MAX_OPEN_ALL and requests.count > FEW_OPEN):
            oldest = requests.oldest()
            if oldest is not None:
                self._close(side.peer, requests, oldest[0], oldest[1], TABLE_FULL)
        return None

    def _ask_after_gap(self, side: Side, requests: OpenRequests, key: i64, transaction: Transaction) -> None:
        """Note if the answer may belong to an uncaptured request instead of this one, or if this request is incomplete."""
        if self.cut:
            transaction._flags |= GAPS
        elif unasked_before(side, requests, key):
            transaction._flags |= ALIKE

    def find_answer(self, side: Side, requests: OpenRequests, key: i64, transaction: Transaction) -> bool:
        """Return whether the answer to a new request is already kept, and join the two; drop answers to earlier requests."""
        orphan = requests.find_orphan(key, side.end_seq)
        if orphan is not None and (
            (orphan.ack == side.end_seq and not transaction._flags & ALIKE)
            or not (has_gaps(side) and is_strange(transaction, orphan.transaction))
        ):
            requests.release_orphan(orphan)
            if orphan.transaction.response_frame < transaction.request_frame:
                transaction._flags |= REORDERED
            if requests.doubtful:
                transaction._flags |= ALIKE
            self.join(transaction, orphan.transaction)
            requests.answered = transaction.number
            return True
        if side.peer is not None:
            for passed in requests.passed_orphans(side.end_seq):
                self._give_up_orphan(passed, side.peer)
        return False

    def _ask_again(
        self, side: Side, requests: OpenRequests, key: i64, transaction: Transaction, before: Transaction
    ) -> None:
        """Open a request with the reference of ``before``, which is still open; drop those that cannot be answered."""
        row = requests.join(key, transaction, before)
        if row.answers and requests.full:
            self._settle(side, requests, row, False)
        if not row.answers:
            for one in list(row.requests):
                if requests.full or transaction.request_ns - one.request_ns > NEVER_NS:
                    self._close(side.peer, requests, key, one, REFERENCE_REUSED)
        answering = side.peer
        if answering is None or answering.unfinished or answering.unseen or perhaps_answered(before, answering):
            return
        requests.beside = True
        if transaction.request_ns - before.request_ns <= GIVEN_UP_NS and not is_repeat(transaction, before):
            self.shared = True

    def _watch(self, side: Side) -> None:
        side.watched = True
        if len(self.asking) >= _MANY_ASKING:
            self.asking = [one for one in self.asking if one.peer is not None]
        self.asking.append(side)

    def answer(
        self,
        side: Side,
        rosctr: i64,
        pdu_ref: i64,
        parameters: Parameters,
        buf: bytes,
        at: i64,
        size: i64,
        data_at: i64,
        frame: i64,
        time_ns: i64,
    ) -> Transaction | None:
        """Take an answer; ``data_at`` is where its data block begins in ``buf``.

        Complete the oldest open request that the answer matches, and return its transaction. If there is none, keep the answer
        for a moment and return None.
        """
        connection = side.connection
        if not connection.client_known:
            connection._note_answer(side.index, parameters)
        requests = connection.open_requests[1 - side.index]
        key: i64 = pdu_ref if rosctr < USERDATA else key_of(rosctr, pdu_ref)
        waiting = requests.latest
        if waiting is None or key != requests.latest_key:
            row = requests.row(key)
            if row is not None:
                answer = unasked(
                    side.connection, 1 - side.index, rosctr, pdu_ref, parameters, buf, at, size, frame, time_ns
                )
                return self._answer_one(
                    side, requests, row, HeldAnswer(key, answer, side.last_ack, side.tcp.packets), data_at
                )
            waiting = requests.find(key)
        if waiting is not None and requests.repeats and excludes(waiting, side.end_seq, side.last_ack):
            waiting = None
        if (
            waiting is not None
            and (waiting._request_ack - side.end_seq) & MASK < HALF_SPACE  # the usual part of `acknowledged`
            and acknowledged(waiting, side.end_seq)
        ):
            waiting = None  # the asking side had received this answer before it sent the request
        asking = side.peer
        gaps: bool = side.holes > 0 or asking is None or asking.holes > 0 or asking.is_ahead(side.last_ack)
        if waiting is None or (
            gaps
            and (
                passed_over(side, requests, waiting)
                or (
                    (waiting._flags & ALIKE or perhaps_unasked(side, waiting))
                    and contradicts(waiting, rosctr, parameters, buf, at, size, data_at)
                )
            )
        ):
            # A gap may contain the answer to the open request, or the request of this answer.
            answer = unasked(
                side.connection, 1 - side.index, rosctr, pdu_ref, parameters, buf, at, size, frame, time_ns
            )
            self._orphan(side, key, answer)
            return None
        if waiting is requests.latest:  # nearly always
            requests.latest = None
            requests.count -= 1
        else:
            requests.close(key, waiting)
        self.open -= 1
        if gaps:
            self._note_gaps(side, requests, waiting)
        if requests.doubtful or (requests.answered == 0 and excludes(waiting, side.end_seq, side.last_ack)):
            waiting._flags |= ALIKE
        requests.answered = waiting.number
        if requests.repeats:
            requests.rest_ns = max(SHORT_REST_NS, _MANY_TIMES * (time_ns - waiting.request_ns))
        if parameters.function != waiting.parameters.function or parameters.userdata is not None or rosctr > USERDATA:
            if mismatch(waiting.parameters, parameters):
                waiting._flags |= FUNCTION_MISMATCH
        waiting._set_response(rosctr, parameters, buf, at, size, frame, time_ns)
        self._answered(waiting, parameters, data_at)
        return waiting

    def _note_gaps(self, side: Side, requests: OpenRequests, request: Transaction) -> None:
        """Note the consequences of gaps for the answered ``request`` and for the requests before it."""
        if self.cut or between(side, request):
            request._flags |= GAPS
        lost = requests.lost
        if lost:
            requests.lost = []
            if request in lost:
                request._flags |= GAPS  # its answer is either this one or one that is missing
            for one in lost:
                if one.number < request.number:  # servers answer in order
                    self._close(side, requests, key_of(one.rosctr, one.pdu_ref), one, HOLE, True)

    def _answer_one(
        self, side: Side, requests: OpenRequests, row: Row, answer: HeldAnswer, data_at: i64
    ) -> Transaction | None:
        """Take an answer whose reference several open requests share: complete one of them, or keep it until that is sure."""
        told = answer.transaction
        gaps: bool = has_gaps(side)
        placed = possible(row, side.end_seq, answer.ack, side.hole_end if gaps else -1, requests.lost)
        if gaps:
            placed = [one for one in placed if not passed_over(side, requests, one)]
        fits = fitting(placed, told, data_at)
        if not fits and placed and not gaps:
            fits = placed[:1]  # without gaps, the device is wrong
        if not fits:
            self._orphan(side, row.key, told)
            return None
        if row.answers or len(fits) > 1:
            answer.fits = fits
            requests.hold(row, answer)
            if not side.waiting:
                self.holding.append(side)
            if is_complete(row) or is_due(row, told.response_ns):
                self._settle(side, requests, row, False)
            return None
        request = fits[0]
        requests.close(row.key, request)
        self.pair(side, requests, request, told)
        if gaps:
            for one in requests.under(row.key):
                if one.number < request.number and perhaps_answered(one, side):
                    self._close(side, requests, row.key, one, HOLE)
        return request

    def pair(self, side: Side, requests: OpenRequests, request: Transaction, answer: Transaction) -> None:
        """Complete ``request``, which is closed already, by an answer of ``side``."""
        self.open -= 1
        if has_gaps(side):
            self._note_gaps(side, requests, request)
        if requests.doubtful:
            request._flags |= ALIKE
        requests.answered = max(requests.answered, request.number)
        self.join(request, answer)

    def _settle(self, answering: Side | None, requests: OpenRequests, row: Row, over: bool) -> None:
        """Decide to which request of a row each of its answers belongs; the pairs go to ``also``."""
        if answering is None:
            return
        complete: bool = is_complete(row)
        asked = row.requests[0]
        chosen = assign(row, over)
        sure: bool = complete and None not in chosen and not (has_gaps(answering) and missing_since(answering, asked))
        last: i64 = 0
        for request in chosen:
            if request is not None:
                last = request.number
        passed = [one for one in row.requests if one.number in row.wanted and one.number < last and one not in chosen]
        answers = requests.release(row)
        for one in passed:  # servers answer in order
            self._close(answering, requests, row.key, one, REFERENCE_REUSED)
        for index in range(len(answers)):
            request = chosen[index]
            if request is None:
                self._orphan(answering, row.key, answers[index].transaction)
                continue
            if not sure:
                request._flags |= ALIKE
            requests.close(row.key, request)
            self.pair(answering, requests, request, answers[index].transaction)
            self.also.append(request)
        requests.doubtful = requests.doubtful or not complete

    def lost(self, side: Side, size: i64) -> None:
        """Remember the requests that were answered in ``size`` octets of ``side`` that were not captured.

        If it is unclear which, or if requests may be among the octets, later pairs of a client with one reference may be wrong.
        """
        self.lossy = True
        first, second = side.connection.open_requests
        asked = first if side.index == 1 else second
        asked.lost = answered_in(side, size, asked) if asked.count else []
        asked.doubtful = asked.doubtful or (asked.beside and not asked.lost)
        asks = second if side.index == 1 else first
        asks.doubtful = asks.doubtful or asks.beside

    def _answered(self, transaction: Transaction, parameters: Parameters, data_at: i64) -> None:
        """Check and count the answer of a transaction; ``parameters`` are those of the answer."""
        transaction._outcome = ANSWERED
        asked = transaction.parameters
        if (
            COMPILED
            or transaction.response_rosctr != ACK_DATA
            or not asked.like_good(
                transaction._response_buf, transaction._response_offset, transaction.response_size, data_at
            )
        ):
            check_answer(transaction, parameters, data_at)
        if asked.answer_unjudged:
            check_data_codes(transaction)
        connection = transaction.connection
        connection.answered += 1
        connection.last_answer = asked
        connection.last_answer_ns = transaction.response_ns

    def waits(self, side: Side, rosctr: i64, pdu_ref: i64) -> bool:
        """Return whether an answer of ``side`` with this reference would complete an open request."""
        key: i64 = key_of(rosctr, pdu_ref)
        return side.connection.open_requests[1 - side.index].find(key) is not None

    def tell(
        self, side: Side, pdu_ref: i64, parameters: Parameters, octets: bytes, frame: i64, time_ns: i64
    ) -> Transaction:
        """Take an S7comm-plus request that needs no answer: it is a whole transaction."""
        self.count += 1
        transaction = Transaction(self.count, side.connection, side.index, PLUS, pdu_ref, parameters)
        transaction.request_frame = frame
        transaction.request_ns = time_ns
        transaction._request_buf = octets
        transaction.request_size = len(octets)
        transaction._outcome = PUSH
        side.connection._note_one_way()
        return transaction

    def push(
        self, side: Side, pdu_ref: i64, parameters: Parameters, buf: bytes, at: i64, size: i64, frame: i64, time_ns: i64
    ) -> Transaction:
        """Take an unsolicited indication: it is a whole transaction, with a response and no request."""
        self.count += 1
        rosctr: i64 = parameters.rosctr
        transaction = Transaction(self.count, side.connection, 1 - side.index, rosctr, pdu_ref, parameters)
        transaction._set_response(rosctr, parameters, buf, at, size, frame, time_ns)
        transaction._outcome = PUSH
        head = parameters.userdata
        if head is not None and head.error_code:
            transaction.error_code = head.error_code
            transaction.has_errors = True
        elif rosctr > USERDATA:
            check_notification(transaction)
        side.connection.unsolicited += 1
        return transaction

    def expire(self, side: Side, time_ns: i64) -> None:
        """Drop answers of ``side`` kept too long for their request, or decide to which one they belong; see ``also``."""
        asking = side.peer
        requests = side.connection.open_requests[1 - side.index]
        if requests.undecided is not None:
            for row in requests.undecided:
                over: bool = is_over(row, time_ns, side.tcp.last_ns)
                if over or is_due(row, time_ns):
                    self._settle(side, requests, row, over)
        if requests.orphans is None:
            return
        begun: bool = asking is not None and asking.unfinished
        for orphan in requests.expired_orphans(time_ns, side.tcp.packets, begun):
            self._give_up_orphan(orphan, side)

    def certainly_open(self, side: Side) -> list[Transaction]:
        """The connection of ``side`` ends: return its open requests, without those whose answer may be in a gap.

        Kept answers first go to the requests that they belong to, as `also`.
        """
        requests = side.connection.open_requests[side.index]
        answering = side.peer
        if requests.undecided is not None:
            for row in requests.undecided:
                self._settle(answering, requests, row, True)
        if answering is None or not answering.captured or requests.count == 0:
            return []
        return [
            one for one in requests.asked_after(-1) if one not in requests.lost and not perhaps_answered(one, answering)
        ]

    def end(self, side: Side, reason: str, now_ns: i64) -> None:
        """The connection of ``side`` ends: close all open requests of ``side``, and the answers kept for its requests."""
        connection = side.connection
        requests = connection.open_requests[side.index]
        answering = side.peer
        lost = requests.lost
        if reason != CAPTURE_ENDED:
            now_ns = 0
        for transaction in requests.drain() if requests.count else []:
            self._give_up(transaction, answering, reason, transaction in lost, now_ns)
            if reason != CAPTURE_ENDED and transaction._outcome == UNANSWERED:
                connection.open_at_end += 1
        if requests.orphans is not None and answering is not None:
            for orphan in requests.orphans:
                self._give_up_orphan(orphan, answering)
            requests.orphans = None

    def _close(
        self,
        answering: Side | None,
        requests: OpenRequests,
        key: i64,
        transaction: Transaction,
        reason: str,
        answered: bool = False,
    ) -> None:
        """Close one of the open requests of ``key`` without an answer; the rest is as in `_give_up`."""
        requests.close(key, transaction)
        self._give_up(transaction, answering, reason, answered)

    def _give_up(
        self, transaction: Transaction, answering: Side | None, reason: str, answered: bool, now_ns: i64 = 0
    ) -> None:
        """End a request without an answer; if an answer was sent but not captured (``answered``), or may have been, note that.

        ``now_ns`` is the time at which the capture ended, 0 if the end has another reason.
        """
        self.open -= 1
        if not wants_answer(transaction):
            transaction._outcome = PUSH
            transaction.connection._note_one_way()
            self.also.append(transaction)
            return
        transaction._outcome = UNANSWERED
        transaction.reason = reason
        if answered:
            transaction.reason = HOLE
        elif answering is not None:
            incomplete: bool = transaction._flags & GAPS != 0
            if (
                incomplete
                or perhaps_answered(transaction, answering)
                or unheard(transaction, answering, now_ns, self.lossy)
            ):
                transaction.reason = HOLE
                transaction._flags |= GAPS
            elif not answering.captured:
                transaction._flags |= EXPECTED
                transaction.reason = ONE_SIDED if reason != CONNECTION_EVICTED else reason
        transaction.connection.unanswered += 1
        self.also.append(transaction)

    def _orphan(self, side: Side, key: i64, transaction: Transaction) -> None:
        """Keep an answer of ``side`` for its request."""
        behind = self.behind
        if behind is not None and behind.take_orphan(side, key, transaction):
            return
        asking = side.peer
        if asking is not None and asking.requests == 0 and (side.connection.mid_stream or not asking.captured):
            transaction._flags |= EXPECTED
        requests = side.connection.open_requests[1 - side.index]
        if not side.waiting:
            self.holding.append(side)
        pushed_out = requests.hold_orphan(key, transaction, side.last_ack, side.tcp.packets)
        if pushed_out is not None:
            self._give_up_orphan(pushed_out, side)

    def _give_up_orphan(self, orphan: HeldAnswer, side: Side) -> None:
        """No request came for a kept answer: the answer becomes a transaction by itself."""
        transaction = orphan.transaction
        requests = transaction.connection.open_requests[transaction.asked_by]
        requests.orphan_frame = max(requests.orphan_frame, transaction.response_frame)
        self.count += 1
        transaction.number = self.count
        if transaction.rosctr > USERDATA:
            check_other_answer(transaction)
        else:
            if transaction.rosctr != USERDATA:
                transaction.rosctr = JOB  # the ROSCTR of the request, which was not captured
            octets = transaction.response_octets
            transaction.error_code = error_code(transaction.response_rosctr, octets, transaction.parameters)
            transaction.has_errors = parse_pdu(octets).refused
        asking = side.peer
        if asking is not None and (asking.holes or (asking.captured and asking.is_ahead(orphan.ack))):
            transaction._flags |= EXPECTED
            transaction.reason = HOLE
        side.connection.orphans += 1
        self.also.append(transaction)

    def join(self, transaction: Transaction, answer: Transaction) -> None:
        """Give a request the answer that was captured before it."""
        parameters = answer.parameters
        if mismatch(transaction.parameters, parameters):
            transaction._flags |= FUNCTION_MISMATCH
        rosctr: i64 = answer.response_rosctr
        at: i64 = answer._response_offset
        buf, size, frame = answer._response_buf, answer.response_size, answer.response_frame
        transaction._set_response(rosctr, parameters, buf, at, size, frame, answer.response_ns)
        head: i64 = 12 if rosctr == ACK or rosctr == ACK_DATA else 10
        self._answered(transaction, parameters, at + head + len(parameters.octets))
