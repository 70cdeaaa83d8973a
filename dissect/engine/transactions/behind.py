"""`Behind` takes PDUs behind the malformed header of a TPDU (docs/decisions/0004-pairing.md).

Such a header does not fit a class 0 DT, so a device that checks it drops the TPDU. A device that skips three octets and reads
on accepts the PDU. Only an answer shows that a request was accepted, and an answer counts only if no better one comes. So both
wait separately:

* a request is not opened. An answer with its reference makes it a transaction, if no ordinary request with that reference is
  open. Without an answer it ends as `BEHIND_MALFORMED`, and its answer is not reported as missing;
* an answer waits while a matching ordinary request is open. It completes that request once the client sends more requests than
  it may have open, or when no other answer came in time.

All of them are marked (`Transaction._flags` has `BEHIND`), and all that are finished go to `Dialogue.also`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from mypy_extensions import i64

from dissect.engine.transactions.aside import Aside, Held
from dissect.engine.transactions.contradictions import is_strange
from dissect.engine.transactions.open_requests import (
    NEVER_NS,
    ORPHAN_HOLD_FRAMES,
    ORPHAN_HOLD_NS,
    acknowledged,
    excludes,
    key_of,
)
from dissect.engine.transactions.pairing import Dialogue
from dissect.engine.transactions.results import BEHIND, check_written, wants_answer
from dissect.engine.transactions.transaction import BEHIND_MALFORMED, MALFORMED_HEADER, OPEN, Transaction
from dissect.packets.tcp.stream import MASK
from dissect.protocols.s7.parameters import Parameters
from dissect.protocols.s7.tables import JOB, USERDATA, WRITE_VAR

if TYPE_CHECKING:
    from dissect.engine.transactions.side import Side


class Behind:
    """Takes requests, answers and pushes behind malformed headers, for all connections."""

    def __init__(self, dialogue: Dialogue) -> None:
        self.used: bool = False  # whether anything ever waited on any connection
        self._dialogue: Dialogue = dialogue
        dialogue.behind = self

    def ask(
        self, side: Side, rosctr: i64, pdu_ref: i64, parameters: Parameters, octets: bytes, frame: i64, time_ns: i64
    ) -> None:
        """Take a request of ``side``, which then waits for an answer."""
        dialogue = self._dialogue
        dialogue.count += 1
        request = Transaction(dialogue.count, side.connection, side.index, rosctr, pdu_ref, parameters)
        request._flags = BEHIND
        request.reason = MALFORMED_HEADER
        request.request_frame = frame
        request.request_ns = time_ns
        request._request_ack = side.last_ack
        request._request_seq = (side.end_seq - side.size) & MASK
        request._request_buf = octets
        request.request_size = len(octets)
        if parameters.function == WRITE_VAR:
            request._flags |= check_written(parameters, octets, 0, len(octets))
        if not wants_answer(request):
            self._alone(request)
            return
        requests = side.connection.open_requests[side.index]
        if requests.orphans is not None and dialogue.find_answer(side, requests, key_of(rosctr, pdu_ref), request):
            dialogue.also.append(request)
            return
        self._hold(side, request, None)
        if side.peer is not None:
            dialogue.holding.append(side.peer)

    def answer(
        self, side: Side, rosctr: i64, pdu_ref: i64, parameters: Parameters, octets: bytes, frame: i64, time_ns: i64
    ) -> None:
        """Take an answer of ``side``: it waits for a better one, or completes a request that also waits here."""
        told = self._told(side, rosctr, pdu_ref, parameters, octets, frame, time_ns)
        requests = side.connection.open_requests[1 - side.index]
        for one in requests.under(key_of(rosctr, pdu_ref)):
            if not acknowledged(one, side.end_seq) and not is_strange(one, told):
                self._hold(side, told, one)
                self._dialogue.holding.append(side)
                return
        if not self.take(side, told):
            self._alone(told)

    def push(self, side: Side, pdu_ref: i64, parameters: Parameters, octets: bytes, frame: i64, time_ns: i64) -> None:
        """Take an unsolicited message that ``side`` sent."""
        self._alone(self._told(side, parameters.rosctr, pdu_ref, parameters, octets, frame, time_ns))

    def _told(
        self, side: Side, rosctr: i64, pdu_ref: i64, parameters: Parameters, octets: bytes, frame: i64, time_ns: i64
    ) -> Transaction:
        told = Transaction(0, side.connection, 1 - side.index, rosctr, pdu_ref, parameters)
        told._flags = BEHIND
        told.reason = MALFORMED_HEADER
        told._set_response(rosctr, parameters, octets, 0, len(octets), frame, time_ns)
        return told

    def _hold(self, side: Side, transaction: Transaction, request: Transaction | None) -> None:
        self.used = True
        traits = side.connection.traits
        if traits.aside is None:
            traits.aside = Aside()
        for gone in traits.aside.add(Held(transaction, request, side.tcp.packets)):
            self._end(gone, side if gone.transaction.asked_by != side.index else side.peer)

    def take(self, side: Side, told: Transaction) -> bool:
        """Return whether an answer of ``side`` that belongs to no ordinary request completes a waiting request."""
        aside = side.connection._aside
        if aside is None:
            return False
        key: i64 = key_of(told.response_rosctr, told.pdu_ref)
        for held in aside.held:
            request = held.transaction
            if (
                not request.response_size
                and request.asked_by == told.asked_by
                and key_of(request.rosctr, request.pdu_ref) == key
                and not excludes(request, side.end_seq, side.last_ack)
                and not is_strange(request, told)
            ):
                aside.held.remove(held)
                self._dialogue.join(request, told)
                self._dialogue.also.append(request)
                return True
        return False

    def take_orphan(self, side: Side, key: i64, told: Transaction) -> bool:
        """Return whether an ordinary answer completes a waiting request; no ordinary request with its key may be open."""
        if side.connection._aside is None or side.connection.open_requests[1 - side.index].find(key) is not None:
            return False
        return self.take(side, told)

    def _alone(self, transaction: Transaction) -> None:
        """Make a transaction of a request, an answer or a push that belongs to nothing else."""
        dialogue = self._dialogue
        if transaction.number == 0:
            dialogue.count += 1
            transaction.number = dialogue.count
            if transaction.rosctr < USERDATA:
                transaction.rosctr = JOB  # the ROSCTR of the request, which is not there
        transaction._outcome = BEHIND_MALFORMED
        dialogue.also.append(transaction)

    def _end(self, held: Held, answering: Side | None) -> None:
        """Stop waiting: an answer completes the request that it matches, if that is still open."""
        told = held.transaction
        request = held.request
        if request is None or answering is None or request._outcome != OPEN:
            self._alone(told)
            return
        requests = request.connection.open_requests[request.asked_by]
        requests.close(key_of(request.rosctr, request.pdu_ref), request)
        request._flags |= BEHIND
        request.reason = MALFORMED_HEADER
        self._dialogue.pair(answering, requests, request, told)
        self._dialogue.also.append(request)

    def asked(self, side: Side) -> None:
        """``side`` sent a request: if it now has more open than allowed, it accepted the answers behind malformed headers."""
        aside = side.connection._aside
        requests = side.connection.open_requests[side.index]
        if aside is None or requests.count <= max(1, side.connection.jobs_allowed(side.index)):
            return
        self._end_all(aside, [one for one in aside.held if one.request is not None], side, side.index)

    def expire(self, side: Side, time_ns: i64) -> None:
        """End what waited too long for an answer of ``side``, or for a better one."""
        aside = side.connection._aside
        if aside is None:
            return
        over: list[Held] = []
        for held in aside.held:
            one = held.transaction
            if held.request is None:
                if time_ns - one.request_ns > NEVER_NS:
                    over.append(held)
            elif time_ns - one.response_ns > ORPHAN_HOLD_NS or side.tcp.packets - held.packet > ORPHAN_HOLD_FRAMES:
                over.append(held)
        self._end_all(aside, over, side, 1 - side.index)

    def end(self, side: Side) -> None:
        """The connection of ``side`` is over: end everything that waits on it."""
        aside = side.connection._aside
        if aside is not None:
            for asked_by in (0, 1):
                self._end_all(aside, list(aside.held), side, asked_by)

    def _end_all(self, aside: Aside, over: list[Held], side: Side, asked_by: i64) -> None:
        """End those of ``over`` that belong to requests of ``asked_by``; ``side`` is either of the sides."""
        answering = side if side.index != asked_by else side.peer
        for held in over:
            if held.transaction.asked_by == asked_by:
                aside.held.remove(held)
                self._end(held, answering)
