"""Finds the request of an answer if several with its reference are open.

These criteria are used, in this order (docs/decisions/0004-pairing.md):

1. The place in the stream: an answer is sent after its request arrived, and before the client sends a request that acknowledges
   it.
2. The shape: function, number of items, sizes and types of items.
3. The order: servers answer one request after the other.

If only the order decides, it is reliable only if the number of answers equals the number of requests by the time the connection
is idle or ends. Until then the answers wait in their `Row`. If an answer is missing, the pairs are only likely.
"""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.engine.transactions.contradictions import contradicts
from dissect.engine.transactions.gaps import follows
from dissect.engine.transactions.open_requests import REPEAT_NS, HeldAnswer, Row, excludes, no_answer
from dissect.engine.transactions.transaction import Transaction

#: Maximum number of answers that wait in one row, and how long the first of them may wait.
MAX_HELD: Final = 64
HELD_NS: Final = 5_000_000_000
#: A connection is idle when nothing passed for this long, and for as long as the oldest request would have waited for its
#: answer.
REST_NS: Final = 500_000_000


def possible(row: Row, end_seq: i64, ack: i64, gap_end: i64, lost: list[Transaction]) -> list[Transaction]:
    """Return the requests of a row to which an answer may belong by its place: it ends at ``end_seq`` and came with ``ack``.

    ``gap_end`` is the end of the latest gap of its side, -1 for none, and ``lost`` are requests answered in that gap: these are
    left out. If any other request remains, one followed by a request that acknowledges the missing octets is left out as well.
    """
    found = [one for one in row.requests if not excludes(one, end_seq, ack)]
    if gap_end < 0 or len(found) < 2:
        return found
    latest: i64 = found[len(found) - 1]._request_ack
    if latest < 0:
        return found
    received: bool = not follows(gap_end, latest)
    left = [one for one in found if one not in lost and not (received and follows(gap_end, one._request_ack))]
    return left or found


def fitting(requests: list[Transaction], answer: Transaction, data_at: i64) -> list[Transaction]:
    """Return the ``requests`` that match the shape of an answer; ``data_at`` is where its data block begins."""
    rosctr, parameters = answer.response_rosctr, answer.parameters
    buf, at, size = answer._response_buf, answer._response_offset, answer.response_size
    return [one for one in requests if not contradicts(one, rosctr, parameters, buf, at, size, data_at)]


def is_repeat(request: Transaction, before: Transaction) -> bool:
    """Return whether a client repeated exactly the same request soon after the first."""
    return request.request_ns - before.request_ns <= REPEAT_NS and request.request_octets == before.request_octets


def is_complete(row: Row) -> bool:
    """Return whether a row has as many answers as there are requests for them."""
    return len(row.answers) >= len(row.wanted)


def is_over(row: Row, now_ns: i64, last_ns: i64) -> bool:
    """Return whether the connection is idle, so that no more answers come; ``last_ns`` is the time of its latest packet."""
    first = row.answers[0]
    rest: i64 = REST_NS
    waited: i64 = first.transaction.response_ns - first.fits[0].request_ns
    if rest < waited:
        rest = min(waited, HELD_NS)
    return now_ns - last_ns >= rest


def is_due(row: Row, now_ns: i64) -> bool:
    """Return whether a row has too many answers, or its first answer has waited too long."""
    return len(row.answers) >= MAX_HELD or now_ns - row.answers[0].transaction.response_ns >= HELD_NS


def assign(row: Row, over: bool) -> list[Transaction | None]:
    """Return the request of each answer in ``row``, None if unknown; ``over``: no more answers come.

    Servers answer in order, so the first answer belongs to the first request if each has one, or if a client repeats its
    request. If answers are missing, the client waited in vain for the oldest before it continued. As long as more answers may
    come, this counts only for requests after which the client got nothing for a while.
    """
    wanted = [one for one in row.requests if one.number in row.wanted]
    spare: i64 = len(wanted) - len(row.answers)
    if spare <= 0 or (len(wanted) == 2 and is_repeat(wanted[1], wanted[0])):
        return _in_order(row.answers, wanted)
    if over:
        found = _in_order(row.answers[::-1], wanted[::-1])
        found.reverse()
        return found
    for index in range(spare, 0, -1):
        if no_answer(wanted[index], wanted[index - 1]):
            return _in_order(row.answers, wanted[index:])
    return _in_order(row.answers, wanted)


def _in_order(answers: list[HeldAnswer], requests: list[Transaction]) -> list[Transaction | None]:
    """Give each of ``answers`` the next of ``requests`` that matches it, None if there is none."""
    found: list[Transaction | None] = []
    at: i64 = 0
    for answer in answers:
        chosen: Transaction | None = None
        for index in range(at, len(requests)):
            if requests[index] in answer.fits:
                chosen = requests[index]
                at = index + 1
                break
        found.append(chosen)
    return found
