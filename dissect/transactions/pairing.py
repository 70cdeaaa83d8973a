"""Pairing: finds the request that each answer belongs to; opens, completes and closes transactions (reference section 5).

`Dialogue` takes every PDU in order and returns the transaction that the PDU completes. Others may end with the same PDU, such
as a request whose reference is used again, or an answer that was held for its request for too long; these go into ``also``.
`Dialogue` only states facts, as `Transaction.flags`; the rules in `dissect.findings` judge them.

The asking side of a transaction sends the request, the answering side the response.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from mypy_extensions import i64

from dissect.s7.message import parse_pdu
from dissect.s7.parameters import Parameters
from dissect.s7.tables import ACK, ACK_DATA, JOB, USERDATA, WRITE_VAR
from dissect.s7plus.parameters import PLUS
from dissect.tcp.stream import HALF_SPACE, MASK
from dissect.transactions.contradictions import contradicts, is_strange
from dissect.transactions.open_requests import (
    FEW_JOBS,
    GIVEN_UP_NS,
    REPEAT_NS,
    OpenRequests,
    acknowledged,
    excludes,
    no_answer,
)
from dissect.transactions.results import (
    EXPECTED,
    FUNCTION_MISMATCH,
    REORDERED,
    SentAgain,
    check_notification,
    check_other_answer,
    check_written,
    error_code,
    mismatch,
    wants_answer,
)
from dissect.transactions.transaction import (
    ANSWERED,
    CAPTURE_ENDED,
    HOLE,
    ORPHAN,
    PUSH,
    REFERENCE_REUSED,
    TABLE_FULL,
    UNANSWERED,
    Transaction,
    check_answer,
    check_data_codes,
)
from dissect.wire.build import COMPILED

if TYPE_CHECKING:
    from dissect.transactions.side import Side

#: Requests open at once per connection and side; the granted AmQ (parallel jobs) is 8 or less in practice.
MAX_OPEN: Final = 4096
#: Requests open at once on all connections. Beyond that, each new request of a side with more than `FEW_OPEN` drops its oldest.
MAX_OPEN_ALL: Final = 65536
FEW_OPEN: Final = 16
#: When `Dialogue.asking` has so many sides, those of closed connections are removed. It is more than can be open at once.
_MANY_ASKING: Final = MAX_OPEN_ALL

#: TCP waits longer than this before it retransmits (RFC 6298, 2.4: a second; in practice 100 ms). A copy that comes earlier is
#: a packet that was captured twice.
_TWICE_NS: Final = 10_000_000

#: Added to the reference of a userdata request: ROSCTR is part of the key.
USERDATA_KEY: Final = 0x10000
#: Added to the sequence number of an S7comm-plus request.
PLUS_KEY: Final = 0x20000
#: Added to what identifies an SCD request: its transaction number, or its index and sub-index, together 25 bits.
SCD_KEY: Final = 0x40000000


def key_of(rosctr: i64, pdu_ref: i64) -> i64:
    """Return the key of a request, or of the request that an answer belongs to."""
    if rosctr < USERDATA:
        return pdu_ref
    if rosctr == USERDATA:
        return pdu_ref | USERDATA_KEY
    return pdu_ref | (PLUS_KEY if rosctr == PLUS else SCD_KEY)


class Dialogue:
    """Pairs the PDUs of all connections. ``count`` is how many transactions were numbered so far."""

    def __init__(self) -> None:
        self.count: i64 = 0
        self.open: i64 = 0  # requests without answer on all connections
        self.also: list[Transaction] = []  # ended beside the PDU at hand; `Exchange.beside` reports and clears them
        self.holding: list[Side] = []  # sides whose answer is held for its request, since the pipeline last looked
        self.several: bool = False  # other requests were open when the side of the latest request sent it
        self.watching: bool = False  # an `OverdueWatch` takes the sides from `asking`
        self.asking: list[Side] = []  # sides that sent requests since it last looked, except those it watches already

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
        """Take a request: open a transaction. Return it only when its answer was captured before it."""
        connection = side.connection
        side.requests += 1
        connection.last_request = parameters
        connection.last_request_ns = time_ns
        self.count += 1
        asked_by: i64 = side.index
        transaction = Transaction(self.count, connection, asked_by, rosctr, pdu_ref, parameters)
        transaction.request_frame = frame
        transaction.request_ns = time_ns
        transaction.request_ack = side.last_ack
        transaction.request_buf = buf
        transaction.request_offset = at
        transaction.request_size = size
        if not connection.client_known:
            connection.note_request(side.index, parameters)
        if parameters.function == WRITE_VAR:
            transaction.flags |= check_written(parameters, buf, at, size)
        key: i64 = pdu_ref if rosctr < USERDATA else key_of(rosctr, pdu_ref)
        requests = connection.open_requests[asked_by]
        self.several = requests.count > 0
        if requests.orphans is not None:
            orphan = requests.find_orphan(key, side.end_seq)
            if orphan is not None and not (_holes(side) and is_strange(transaction, orphan.transaction)):
                requests.release_orphan(orphan)
                if orphan.transaction.response_frame < frame:
                    transaction.flags |= REORDERED
                self._join(transaction, orphan.transaction)
                requests.answered = transaction.number
                return transaction
            if side.peer is not None:
                for passed in requests.passed_orphans(side.end_seq):
                    self._give_up_orphan(passed, side.peer)
        self.open += 1
        if self.watching and not side.watched:
            self._watch(side)
        if requests.count == 0:  # nearly always
            requests.count = 1
            requests.latest = transaction
            requests.latest_key = key
            return None
        answering = side.peer
        waiting = requests.add(key, transaction)
        if waiting is not None:
            transaction.request_seq = (side.end_seq - len(side.stream.last)) & MASK
            expected: bool = answering is not None and _unseen(transaction, waiting, answering)
            beside: bool = expected or _is_beside(side, transaction, waiting)
            kept: bool = beside and requests.supersede(key, transaction, waiting)
            replaced = None if kept else requests.add_again(key, transaction, waiting)
            if replaced is not None:
                self._replace(replaced, answering)
        if requests.count > MAX_OPEN or (self.open > MAX_OPEN_ALL and requests.count > FEW_OPEN):
            oldest = requests.oldest()
            if oldest is not None:
                self._give_up(oldest, answering, TABLE_FULL)
        return None

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

        Complete the oldest open request that the answer fits and return its transaction. Without one hold the answer for a
        moment and return None.
        """
        requests = side.connection.open_requests[1 - side.index]
        key: i64 = pdu_ref if rosctr < USERDATA else key_of(rosctr, pdu_ref)
        waiting = requests.latest
        if waiting is None or key != requests.latest_key:
            waiting = requests.find(key)
            if waiting is not None and waiting.request_seq >= 0:
                waiting = self._take_one(side, key, waiting, rosctr, parameters, buf, at, size, data_at, frame)
                if waiting is None:
                    self._orphan(side, key, rosctr, pdu_ref, parameters, buf, at, size, frame, time_ns)
                    return None
                self.open -= 1
                requests.answered = waiting.number
                if mismatch(waiting.parameters, parameters):
                    waiting.flags |= FUNCTION_MISMATCH
                waiting.set_response(rosctr, parameters, buf, at, size, frame, time_ns)
                self._answered(waiting, parameters, data_at)
                return waiting
        if (
            waiting is not None
            and (waiting.request_ack - side.end_seq) & MASK < HALF_SPACE  # part of `acknowledged`: enough for most
            and acknowledged(waiting, side.end_seq)
        ):
            waiting = None  # the asking side had received this answer before it sent that request
        asking = side.peer
        holes: bool = side.holes > 0 or (asking is not None and asking.holes > 0)  # `_holes`, inlined
        if waiting is None or (
            holes
            and (
                _passed_over(side, requests, waiting)
                or contradicts(waiting, rosctr, parameters, buf, at, size, data_at)
            )
        ):
            # A gap may contain the answer to the open request, or the request of this answer.
            self._orphan(side, key, rosctr, pdu_ref, parameters, buf, at, size, frame, time_ns)
            return None
        if waiting is requests.latest:  # nearly always
            requests.latest = None
            requests.count -= 1
        else:
            requests.take(key, waiting)
        self.open -= 1
        requests.answered = waiting.number
        if parameters.function != waiting.parameters.function or parameters.userdata is not None or rosctr > USERDATA:
            if mismatch(waiting.parameters, parameters):
                waiting.flags |= FUNCTION_MISMATCH
        waiting.set_response(rosctr, parameters, buf, at, size, frame, time_ns)
        self._answered(waiting, parameters, data_at)
        return waiting

    def _take_one(
        self,
        side: Side,
        key: i64,
        waiting: Transaction,
        rosctr: i64,
        parameters: Parameters,
        buf: bytes,
        at: i64,
        size: i64,
        data_at: i64,
        frame: i64,
    ) -> Transaction | None:
        """Close and return the request that an answer belongs to, None for none, if its reference was used again while open.

        ``waiting`` is the latest open request of that reference.
        """
        requests = side.connection.open_requests[1 - side.index]
        holes: bool = _holes(side)
        if holes and _passed_over(side, requests, waiting):
            return None
        if side.connection.jobs_allowed(1 - side.index) > 1 and side.hole_frame < requests.first(waiting).request_frame:
            return self._take_oldest(side, key, waiting, rosctr, parameters, buf, at, size, data_at)
        if waiting.earlier is None and excludes(waiting, side.end_seq, side.last_ack):
            # The answer cannot be that of `waiting`: it belongs to a request before that one, or to none.
            older = requests.take_superseded(waiting, side.end_seq, side.last_ack)
            if older is not None and holes and contradicts(older, rosctr, parameters, buf, at, size, data_at):
                self._give_up(older, side, REFERENCE_REUSED)
                return None
            return older
        if holes and contradicts(waiting, rosctr, parameters, buf, at, size, data_at):
            return None
        if waiting.earlier is not None and side.hole_frame:
            lost = requests.lose(waiting, frame, side.hole_frame)
            if lost is not None:
                self._replace(lost, side)
        for late in requests.drop_superseded(waiting):  # requests sent before it would have been answered before it
            self._give_up(late, side, REFERENCE_REUSED)
        return requests.take(key, waiting)

    def _take_oldest(
        self,
        side: Side,
        key: i64,
        waiting: Transaction,
        rosctr: i64,
        parameters: Parameters,
        buf: bytes,
        at: i64,
        size: i64,
        data_at: i64,
    ) -> Transaction | None:
        """Close and return the oldest open request of a reference that an answer fits: answers come in the requests' order.

        ``waiting`` is the latest of these requests.
        """
        requests = side.connection.open_requests[1 - side.index]
        row = [one for one in requests.row(waiting) if not excludes(one, side.end_seq, side.last_ack)]
        if not row:
            return None
        chosen: Transaction | None = None
        latest_ns: i64 = row[len(row) - 1].request_ns
        for one in row:
            if latest_ns - one.request_ns > REPEAT_NS:  # the client gave it up before it sent the latest one
                requests.close(key, one)
                self._give_up(one, side, REFERENCE_REUSED)
            elif not contradicts(one, rosctr, parameters, buf, at, size, data_at):
                chosen = one
                break
            elif chosen is None and not _holes(side):
                chosen = one  # taken if the answer fits none of them: without gaps, the device is wrong
        if chosen is not None:
            requests.close(key, chosen)
        return chosen

    def _answered(self, transaction: Transaction, parameters: Parameters, data_at: i64) -> None:
        """The transaction has its answer, with ``parameters``: check the answer and count it."""
        transaction.outcome = ANSWERED
        asked = transaction.parameters
        if (
            COMPILED
            or transaction.response_rosctr != ACK_DATA
            or not asked.like_good(
                transaction.response_buf, transaction.response_offset, transaction.response_size, data_at
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
        """Return whether a request is open that an answer of ``side`` with this reference would complete."""
        key: i64 = key_of(rosctr, pdu_ref)
        return side.connection.open_requests[1 - side.index].find(key) is not None

    def sent_again(self, side: Side, seq: i64, size: i64, frame: i64, time_ns: i64) -> None:
        """``side`` retransmitted ``size`` octets from ``seq`` on: note that at its latest open request, if they end with it."""
        connection = side.connection
        half = side.stream
        half.repeats = False
        if (seq + size - half.next_seq) & MASK >= HALF_SPACE:
            return  # the latest octets of the side are not among them
        request = connection.open_requests[side.index].asked_last()
        if request is None or request.request_ns != connection.last_request_ns or not side.at_rest:
            return
        again = request.again
        if time_ns - (request.request_ns if again is None else again.time_ns) < _TWICE_NS:
            return
        if again is None:
            again = SentAgain()
            request.again = again
        again.times += 1
        again.frame = frame
        again.time_ns = time_ns

    def tell(
        self, side: Side, pdu_ref: i64, parameters: Parameters, octets: bytes, frame: i64, time_ns: i64
    ) -> Transaction:
        """Take an S7comm-plus request that wants no answer: it is a whole transaction by itself."""
        self.count += 1
        transaction = Transaction(self.count, side.connection, side.index, PLUS, pdu_ref, parameters)
        transaction.request_frame = frame
        transaction.request_ns = time_ns
        transaction.request_buf = octets
        transaction.request_size = len(octets)
        transaction.outcome = PUSH
        side.connection.note_one_way()
        return transaction

    def push(
        self, side: Side, pdu_ref: i64, parameters: Parameters, buf: bytes, at: i64, size: i64, frame: i64, time_ns: i64
    ) -> Transaction:
        """Take an unsolicited indication: it is a whole transaction by itself, with a response and no request."""
        self.count += 1
        rosctr: i64 = parameters.rosctr
        transaction = Transaction(self.count, side.connection, 1 - side.index, rosctr, pdu_ref, parameters)
        transaction.set_response(rosctr, parameters, buf, at, size, frame, time_ns)
        transaction.outcome = PUSH
        head = parameters.userdata
        if head is not None and head.error_code:
            transaction.error_code = head.error_code
            transaction.has_errors = True
        elif rosctr > USERDATA:
            check_notification(transaction)
        side.connection.unsolicited += 1
        return transaction

    def expire(self, side: Side, time_ns: i64) -> None:
        """Give up answers of ``side`` that were held for their request too long; they go to ``also``."""
        asking = side.peer
        requests = side.connection.open_requests[1 - side.index]
        if requests.orphans is None:
            return
        begun: bool = asking is not None and asking.unfinished
        for transaction in requests.expired_orphans(time_ns, side.tcp.packets, begun):
            self._give_up_orphan(transaction, side)

    def end(self, side: Side, reason: str) -> None:
        """The connection of ``side`` ends: close all open requests of ``side``, and the answers held for its requests."""
        connection = side.connection
        requests = connection.open_requests[side.index]
        answering = side.peer
        for transaction in requests.drain() if requests.count else []:
            self._give_up(transaction, answering, reason)
            if reason != CAPTURE_ENDED and transaction.outcome == UNANSWERED:
                connection.open_at_end += 1
        if requests.orphans is not None and answering is not None:
            for orphan in requests.orphans:
                self._give_up_orphan(orphan.transaction, answering)
            requests.orphans = None

    def _replace(self, replaced: Transaction, answering: Side | None) -> None:
        """The reference of an open request is used again: that request, and those that wait before it, stay unanswered."""
        requests = replaced.connection.open_requests[replaced.asked_by]
        for transaction in requests.drop_superseded(replaced):
            self._give_up(transaction, answering, REFERENCE_REUSED)
        chain: list[Transaction] = []
        link: Transaction | None = replaced
        while link is not None:
            chain.append(link)
            link = link.earlier
        for transaction in reversed(chain):
            transaction.earlier = None
            self._give_up(transaction, answering, REFERENCE_REUSED)

    def _give_up(self, transaction: Transaction, answering: Side | None, reason: str) -> None:
        """Close a request without an answer; where the answering side has a gap since the request, that is the reason."""
        self.open -= 1
        if not wants_answer(transaction):
            transaction.outcome = PUSH
            transaction.connection.note_one_way()
            self.also.append(transaction)
            return
        transaction.outcome = UNANSWERED
        transaction.reason = reason
        if answering is not None:
            if answering.hole_frame >= transaction.request_frame:
                transaction.reason = HOLE
            elif not answering.captured:
                transaction.flags |= EXPECTED
        transaction.connection.unanswered += 1
        self.also.append(transaction)

    def _orphan(
        self,
        side: Side,
        key: i64,
        rosctr: i64,
        pdu_ref: i64,
        parameters: Parameters,
        buf: bytes,
        at: i64,
        size: i64,
        frame: i64,
        time_ns: i64,
    ) -> None:
        transaction = Transaction(0, side.connection, 1 - side.index, rosctr, pdu_ref, parameters)
        transaction.set_response(rosctr, parameters, buf, at, size, frame, time_ns)
        transaction.outcome = ORPHAN
        asking = side.peer
        if asking is not None and asking.requests == 0 and (side.connection.mid_stream or not asking.captured):
            transaction.flags |= EXPECTED
        requests = side.connection.open_requests[1 - side.index]
        if not side.waiting:
            self.holding.append(side)
        pushed_out = requests.hold_orphan(key, transaction, side.last_ack, side.tcp.packets)
        if pushed_out is not None:
            self._give_up_orphan(pushed_out, side)

    def _give_up_orphan(self, transaction: Transaction, side: Side) -> None:
        """No request of a held answer came: the answer becomes a transaction by itself."""
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
        if asking is not None and asking.holes:
            transaction.flags |= EXPECTED
            transaction.reason = HOLE
        side.connection.orphans += 1
        self.also.append(transaction)

    def _join(self, transaction: Transaction, answer: Transaction) -> None:
        """Give a request the answer that was captured before it."""
        parameters = answer.parameters
        if mismatch(transaction.parameters, parameters):
            transaction.flags |= FUNCTION_MISMATCH
        rosctr: i64 = answer.response_rosctr
        at: i64 = answer.response_offset
        transaction.set_response(
            rosctr, parameters, answer.response_buf, at, answer.response_size, answer.response_frame, answer.response_ns
        )
        head: i64 = 12 if rosctr == ACK or rosctr == ACK_DATA else 10
        self._answered(transaction, parameters, at + head + len(parameters.octets))


def _passed_over(side: Side, requests: OpenRequests, waiting: Transaction) -> bool:
    """Return whether an answer of ``side`` probably belongs to a later request than ``waiting``, of the same reference.

    That is so where octets of both sides are missing after ``waiting``: they may include its answer, and another request that
    uses the reference again. Servers answer in order, so they do include them if a request sent later is answered already.
    """
    asking = side.peer
    asked: i64 = waiting.request_frame
    if asking is None or side.hole_frame <= asked or requests.answered <= waiting.number:
        return False
    # The asking side has a gap, or one that is not given up yet: the answer acknowledges octets that were not captured.
    return asking.hole_frame > asked or 0 < (side.last_ack - asking.stream.next_seq) & MASK < HALF_SPACE


def _unseen(request: Transaction, before: Transaction, answering: Side) -> bool:
    """Return whether a request acknowledges octets of the answering side that were not passed on yet as whole messages.

    Where the capture has shown no octet of that side: octets that ``before``, the request before, did not acknowledge.
    """
    if answering.unfinished:
        return True
    shown: i64 = answering.stream.next_seq
    if shown < 0:
        shown = before.request_ack
    ahead: i64 = (request.request_ack - shown) & MASK
    return request.request_ack >= 0 and shown >= 0 and 0 < ahead < HALF_SPACE


def _is_beside(side: Side, request: Transaction, before: Transaction) -> bool:
    """Return whether the client sent ``request`` while it still waits for the answer to ``before``, of the same reference.

    That needs room for another parallel job, and no gap that may hold the answer to ``before``. A request that is identical
    to ``before``, or comes after the client gave ``before`` up, does not count. If both stayed open then, each later answer
    would be paired with the request before its own.
    """
    connection = side.connection
    allowed: i64 = connection.jobs_allowed(side.index)
    if allowed < 2 or request.request_ns - before.request_ns > REPEAT_NS or no_answer(request, before):
        return False
    peer = side.peer
    if peer is None or peer.hole_frame >= before.request_frame or side.hole_frame >= before.request_frame:
        return False
    requests = connection.open_requests[side.index]
    if before.number == requests.anew:
        return False
    if requests.count >= allowed:
        # A request that has had no answer for long was given up by its client.
        since_ns: i64 = request.request_ns - GIVEN_UP_NS
        if allowed >= FEW_JOBS or requests.open_since(since_ns, peer.hole_frame, allowed) >= allowed:
            return False
    return before.request_octets != request.request_octets


def _holes(side: Side) -> bool:
    """Return whether octets of either side of a connection are missing from the capture."""
    peer = side.peer
    return side.holes > 0 or (peer is not None and peer.holes > 0)
