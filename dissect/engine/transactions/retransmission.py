"""Notes on a request that TCP sent it again, so that users know that its answer time includes that."""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.engine.transactions.results import SentAgain
from dissect.engine.transactions.side import Side
from dissect.packets.tcp.stream import HALF_SPACE, MASK

#: TCP waits longer than this before it retransmits (RFC 6298, 2.4: a second; in practice 100 ms). A copy that comes earlier was
#: captured twice.
_TWICE_NS: Final = 10_000_000


def note_sent_again(side: Side, seq: i64, size: i64, frame: i64, time_ns: i64) -> None:
    """``side`` retransmitted ``size`` octets from ``seq`` on: note that on its latest open request, if they end with it."""
    connection = side.connection
    half = side.stream
    half.repeats = False
    if (seq + size - half.next_seq) & MASK >= HALF_SPACE:
        return  # the latest octets of the side are not part of it
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
