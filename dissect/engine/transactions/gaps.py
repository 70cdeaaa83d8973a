"""The meaning of missing octets for requests and answers (docs/decisions/0003-holes.md, 0004-pairing.md).

TCP acknowledgements are the evidence: a side has received what it acknowledged, even if the capture lacks it. A request carries
an acknowledgement, which shows what its sender had received before. The answer to the request comes after that place.
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
#: A connection with an open request is not silent for longer: TCP acknowledges the request or sends it again.
_ACK_DUE_NS: Final = 1_000_000_000
#: After this many requests, each with a different reference from the one before, it is clear that a client changes its
#: reference.
_FEW_REQUESTS: Final = 3
#: Maximum number of requests that are examined for one gap.
_MOST: Final = 16


def has_gaps(side: Side) -> bool:
    """Return whether octets of either side of a connection are missing from the capture, as far as known now."""
    peer = side.peer
    return peer is None or side.holes > 0 or peer.holes > 0 or peer.is_ahead(side.last_ack)


def begins_open(side: Side) -> bool:
    """Return whether ``side``, which was found to repeat its reference, may have open requests that were not captured."""
    peer = side.peer
    return side.connection.mid_stream or side.holes > 0 or peer is None or peer.holes > 0


def latest_gap(side: Side) -> i64:
    """Return the packet at which the latest gap of either side was found, 0 for none."""
    peer = side.peer
    return side.hole_frame if peer is None or side.hole_frame > peer.hole_frame else peer.hole_frame


def perhaps_answered(request: Transaction, answering: Side) -> bool:
    """Return whether octets of the answering side are missing that may contain the answer to an open request."""
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
    """Return whether the capture probably lacks everything after a request, because its connection is silent until the end.

    That is so only if the capture has gaps elsewhere (``lossy``): a device that has gone is silent as well.
    """
    if not answering.captured or request._request_ack < 0 or now_ns - answering.tcp.last_ns <= _ACK_DUE_NS:
        return False
    return lossy


def between(side: Side, request: Transaction) -> bool:
    """Return whether octets of both sides are missing between ``request`` and the current message of ``side``, which answers.

    Then the answer to the request may be missing, and also another request with the same reference.
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
    """Return whether octets of either side are missing since ``request``; ``side`` is the answering side."""
    return perhaps_answered(request, side) or _asks_missing(side, request)


def perhaps_unasked(side: Side, request: Transaction) -> bool:
    """Return whether the current message of ``side`` may answer a request that was not captured, instead of ``request``.

    Octets of the asking side are missing after ``request``, or right before it.
    """
    asking = side.peer
    if asking is not None and asking.hole_end >= 0 and (request._request_seq - asking.hole_end) & MASK < LEAST_ANSWER:
        return True
    return _asks_missing(side, request) or excludes(request, side.end_seq, side.last_ack)


def unasked_before(side: Side, requests: OpenRequests, key: i64) -> bool:
    """Return whether a request of ``side`` that was not captured, with the current reference, may be open.

    The conditions are a gap since the request before, no answer without a request since then, and a client that, as far as
    known, uses its references more than once.
    """
    answering = side.peer
    if side.hole_end < 0 or not follows(side.hole_end, requests.asked_seq) or answering is None:
        return False
    if requests.was_passed(key, side.end_seq) or answering.hole_frame >= requests.asked_frame:
        return False
    return requests.repeats > 0 or key == requests.latest_key or side.requests <= _FEW_REQUESTS


def _asks_missing(side: Side, request: Transaction) -> bool:
    """Return whether octets of the asking side since ``request`` are missing; ``side`` is the answering side."""
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
    """Return whether an answer of ``side`` probably belongs to a later request than ``waiting``, with the same reference.

    That is so if octets of both sides are missing after ``waiting``: they may include its answer, and another request that uses
    the reference again. Servers answer in order, so the gap must include them if a later request is already answered; and a
    client that always uses one reference has most probably used it again.
    """
    if requests.answered <= waiting.number and requests.repeats < 2:
        return False
    return between(side, waiting)


def answered_in(side: Side, size: i64, requests: OpenRequests) -> list[Transaction]:
    """Return the open requests that were certainly answered in the latest gap of ``side``, which has ``size`` octets.

    Each request acknowledges what its sender had received, so the gap can be divided into a part for each request. If a part is
    too short for an answer, it is unknown which answer is in the next part. If ``side`` also sends requests or indications, the
    gap may contain those.
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
            break  # sent after the missing octets had been received
        if follows(begin, at):
            at = begin
        end: i64 = side.hole_end
        if index + 1 < len(found) and follows(end, found[index + 1]._request_ack):
            end = found[index + 1]._request_ack
        if (end - at) & MASK < LEAST_ANSWER or follows(at, end):
            break
        certain.append(found[index])
    return certain
