"""What missing octets mean for requests and answers (docs/decisions/0003-holes.md, 0004-pairing.md).

TCP acknowledgements are the witness: what a side acknowledged it has received, whether the capture has it or not. A request
carries the acknowledgement of its time, so it shows what its sender had received before it. An answer comes after that place.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from mypy_extensions import i64

from dissect.engine.transactions.open_requests import OpenRequests, excludes
from dissect.engine.transactions.transaction import Transaction
from dissect.packets.tcp.stream import HALF_SPACE, MASK

if TYPE_CHECKING:
    from dissect.engine.transactions.side import Side

#: The shortest answer, in octets: TPKT, DT and the header of an Ack. Fewer missing octets are an empty DT or a FIN.
LEAST_ANSWER: Final = 19
#: A connection on which a request is open is not silent for longer: TCP acknowledges it or sends it again.
_ACK_DUE_NS: Final = 1_000_000_000
#: After this many requests, each with another reference than the one before, a client is known to change it.
_FEW_REQUESTS: Final = 3
#: Maximum number of requests that are examined for one gap.
_MOST: Final = 16


def has_gaps(side: Side) -> bool:
    """Return whether octets of either side of a connection are missing from the capture, as far as `side` shows now."""
    peer = side.peer
    return peer is None or side.holes > 0 or peer.holes > 0 or peer.is_ahead(side.last_ack)


def begins_open(side: Side) -> bool:
    """Return whether ``side``, which turns out to repeat its reference, may have requests open that were not captured."""
    peer = side.peer
    return side.connection.mid_stream or side.holes > 0 or peer is None or peer.holes > 0


def latest_gap(side: Side) -> i64:
    """Return the packet at which the latest gap of either side was declared, 0 for none."""
    peer = side.peer
    return side.hole_frame if peer is None or side.hole_frame > peer.hole_frame else peer.hole_frame


def perhaps_answered(request: Transaction, answering: Side) -> bool:
    """Return whether octets of the answering side are missing that may be the answer to an open request."""
    ack: i64 = request._request_ack
    if answering.hole_frame >= request.request_frame and (
        ack < 0 or answering.hole_end < 0 or 0 < (answering.hole_end - ack) & MASK < HALF_SPACE
    ):
        return True
    asking = answering.peer
    return (
        answering.captured
        and answering.unseen > 0
        and asking is not None
        and 0 < (asking.acked - ack) & MASK < HALF_SPACE
    )


def unheard(request: Transaction, answering: Side, now_ns: i64, lossy: bool) -> bool:
    """Return whether the capture probably lacks all that came after a request: its connection is silent until the end.

    That is so only where the capture has gaps elsewhere (``lossy``): a device that is gone is silent as well.
    """
    if not answering.captured or request._request_ack < 0 or now_ns - answering.tcp.last_ns <= _ACK_DUE_NS:
        return False
    return lossy


def between(side: Side, request: Transaction) -> bool:
    """Return whether octets of both sides are missing between ``request`` and what ``side``, which answers, sends now.

    Then the answer to the request may be missing, and another request with its reference.
    """
    asking = side.peer
    asked: i64 = request.request_frame
    if asking is None or side.hole_frame < asked or side.hole_end < 0:
        return False
    if request._request_ack >= 0 and not 0 < (side.hole_end - request._request_ack) & MASK < HALF_SPACE:
        return False
    if asking.is_ahead(side.last_ack):
        return True
    return asking.hole_frame >= asked and asking.hole_end >= 0 and follows(asking.hole_end, request._request_seq)


def missing_since(side: Side, request: Transaction) -> bool:
    """Return whether octets of either side are missing since ``request``; ``side`` is the one that answers."""
    return perhaps_answered(request, side) or _asks_missing(side, request)


def perhaps_unasked(side: Side, request: Transaction) -> bool:
    """Return whether what ``side`` sends now may answer a request that was not captured, instead of ``request``.

    Octets that the asking side sent are missing after ``request``, or right before it.
    """
    asking = side.peer
    if asking is not None and asking.hole_end >= 0 and (request._request_seq - asking.hole_end) & MASK < LEAST_ANSWER:
        return True
    return _asks_missing(side, request) or excludes(request, side.end_seq, side.last_ack)


def unasked_before(side: Side, requests: OpenRequests, key: i64) -> bool:
    """Return whether a request of ``side`` with the reference of the one at hand may be open, and was not captured.

    That takes a gap since the request before, no answer without a request since then, and a client that uses its references
    more than once, as far as is known.
    """
    answering = side.peer
    if side.hole_end < 0 or not follows(side.hole_end, requests.asked_seq) or answering is None:
        return False
    if requests.was_passed(key, side.end_seq) or answering.hole_frame >= requests.asked_frame:
        return False
    return requests.repeats > 0 or key == requests.latest_key or side.requests <= _FEW_REQUESTS


def _asks_missing(side: Side, request: Transaction) -> bool:
    """Return whether octets that the asking side sent since ``request`` are missing; ``side`` is the one that answers."""
    asking = side.peer
    if asking is None or asking.is_ahead(side.last_ack):
        return True
    return asking.hole_frame >= request.request_frame and (
        asking.hole_end < 0 or follows(asking.hole_end, request._request_seq)
    )


def follows(seq: i64, before: i64) -> bool:
    """Return whether one sequence number is after the other."""
    return 0 < (seq - before) & MASK < HALF_SPACE


def passed_over(side: Side, requests: OpenRequests, waiting: Transaction) -> bool:
    """Return whether an answer of ``side`` probably belongs to a later request than ``waiting``, of the same reference.

    That is so where octets of both sides are missing after ``waiting``: they may include its answer, and another request that
    uses the reference again. Servers answer in order, so they do include them if a request sent later is answered already; and
    a client that always uses one reference has most probably used it again.
    """
    if requests.answered <= waiting.number and requests.repeats < 2:
        return False
    return between(side, waiting)


def answered_in(side: Side, size: i64, requests: OpenRequests) -> list[Transaction]:
    """Return the open requests that were certainly answered in the latest gap of ``side``, of ``size`` octets.

    Each request acknowledges what its sender had received before, so the gap has a part for each of them. A part that is too
    short for an answer leaves open which one the next part has. Where ``side`` sends requests or indications as well, the gap
    may contain those.
    """
    connection = side.connection
    if size < LEAST_ANSWER or side.requests or connection.unsolicited > connection.one_way or connection.subscribes:
        return []
    found = requests.recent(requests.answered, _MOST)
    if len(found) > _MOST:
        return []
    begin: i64 = (side.hole_end - size) & MASK
    certain: list[Transaction] = []
    for index in range(len(found)):
        at: i64 = found[index]._request_ack
        if at < 0 or not follows(side.hole_end, at):
            break  # sent after what is missing had been received
        if follows(begin, at):
            at = begin
        end: i64 = side.hole_end
        if index + 1 < len(found) and follows(end, found[index + 1]._request_ack):
            end = found[index + 1]._request_ack
        if (end - at) & MASK < LEAST_ANSWER or follows(at, end):
            break
        certain.append(found[index])
    return certain
