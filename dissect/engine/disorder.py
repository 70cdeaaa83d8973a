"""Takes the segments of a known connection that are not the next ones in order, and notes requests that TCP sent again."""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.engine.counters import Counters
from dissect.engine.silent import untold
from dissect.engine.timers import Timers
from dissect.engine.transactions import accounts
from dissect.engine.transactions.accounts import PAYLOAD
from dissect.engine.transactions.connection import FOREIGN, LEFT_OUT, PROBING
from dissect.engine.transactions.results import SentAgain
from dissect.engine.transactions.side import Side
from dissect.packets.tcp import stream
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


def take(counters: Counters, timers: Timers, side: Side, seq: i64, octets: bytes, missing: i64) -> i64:
    """Insert a segment where it belongs, pass on all that is in order now, and return its account (`transactions.accounts`)."""
    connection = side.connection
    half = side.stream
    peer = side.peer
    assert peer is not None
    what: i64 = stream.NEW
    conflicts: i64 = half.conflicts
    if octets:
        if peer.stream.octets:
            half.heard = True
        if seq == half.next_seq and half.held is None and missing == 0 and not half.ready and not half.outside:
            half.passed(octets, len(octets))  # what `accept` and `chunks` would do, without a `Chunk`
            side.end_seq = half.next_seq
            side.size = len(octets)
            side.protocol.feed(side, octets, 0, len(octets), counters.frames, counters.now_ns)
        else:
            what = half.accept(seq, octets, counters.frames, counters.now_ns, side.last_ack)
    if half.conflicts > conflicts and connection.followed:
        counters.note("stream.conflict", f"{len(octets)} bytes at TCP sequence number {seq}", connection.number)
    if missing and half.held is None and half.next_seq == (seq + len(octets)) & stream.MASK:
        timers.chunks(side)
        half.skip(missing, counters.frames, counters.now_ns)
        timers.chunks(side, True)
    elif half.ready or half.outside:
        timers.chunks(side)
    if half.repeats:
        note_sent_again(side, seq, len(octets), counters.frames, counters.now_ns)
    if half.held is not None:
        timers.wait(side)
    if what == stream.KEEP_ALIVE and (side.probes or untold(side)):
        side.note_probe(counters.frames, counters.now_ns, True)
        return accounts.KEEP_ALIVE
    if connection._state == LEFT_OUT:
        return accounts.LEFT_OUT
    if connection._state == FOREIGN or (connection._state == PROBING and half.held is None):
        return accounts.OTHER_PROTOCOL  # unused even now, before it is reported as a different protocol
    if what == stream.NEW or what == stream.OLD:
        return PAYLOAD if what == stream.NEW else accounts.RETRANSMISSION
    return accounts.KEEP_ALIVE if what == stream.KEEP_ALIVE else accounts.BEFORE_START
