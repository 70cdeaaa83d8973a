"""`SpanBook`: finds the octets of a stream that carried a PDU; the pipeline reports only the packet that completed it.

It remembers ranges of TCP sequence numbers, by which packets are found even if they are out of order, retransmitted or in IP
fragments. Next to octets that belong to no TPKT, a range may be too long, but never too short.
"""

from __future__ import annotations

from collections import OrderedDict
from typing import Final

from dissect.engine.transactions.side import Side
from dissect.packets.tcp.stream import MASK, HalfStream

#: Maximum number of PDUs whose ranges are remembered until their transactions come, and of directions.
MAX_SPANS: Final = 65_536
MAX_DIRECTIONS: Final = 16_384

#: A block of a `SpanIndex` has at least two to the power of this sequence numbers: about what a segment, and most PDUs, have.
_LEAST_BITS: Final = 10

#: COTP: the code of a DT, and the octet and bit (EOT) that mark the last DT of a message.
_DT: Final = 0xF0
_EOT_AT: Final = 6
_EOT: Final = 0x80


class Span:
    """A range of octets of one direction of a TCP connection: ``size`` octets from sequence number ``seq`` on.

    ``key`` is the key of the packets in this direction (`dissect.engine.transactions.table`). ``more`` counts PDUs of one size
    that one packet completed: they share a range.
    """

    __slots__ = ("key", "more", "seq", "size")

    def __init__(self, key: bytes, seq: int, size: int) -> None:
        self.key = key
        self.seq = seq
        self.size = size
        self.more = 0

    def overlaps(self, seq: int, size: int) -> bool:
        """Return whether a segment with ``size`` octets from ``seq`` on carries any of them."""
        return size > 0 and self.size > 0 and ((seq - self.seq) & MASK < self.size or (self.seq - seq) & MASK < size)


class TimedSpan:
    """The range of a PDU, and the times between which its octets are searched for."""

    __slots__ = ("from_ns", "span", "to_ns")

    def __init__(self, span: Span, from_ns: int, to_ns: int) -> None:
        self.span = span
        self.from_ns = from_ns
        self.to_ns = to_ns


class SpanIndex:
    """Spans of one direction by the blocks of sequence numbers that they touch, so that a search examines only a few.

    Blocks are at least as large as the span, so a span of any length touches at most two of them.
    """

    __slots__ = ("_levels",)

    def __init__(self) -> None:
        self._levels: dict[
            int, dict[int, list[TimedSpan]]
        ] = {}  # by the bits of a number within a block, then by block

    def add(self, timed: TimedSpan) -> None:
        """Make a span known."""
        span = timed.span
        bits = max(_LEAST_BITS, span.size.bit_length())
        blocks = self._levels.setdefault(bits, {})
        for block in _touched(span.seq, span.size, bits):
            blocks.setdefault(block, []).append(timed)

    def carries(self, time_ns: int, seq: int, size: int) -> bool:
        """Return whether a segment with ``size`` octets from ``seq`` on, at this time, carries octets of a span."""
        for bits, blocks in self._levels.items():
            for block in _touched(seq, size, bits):
                for one in blocks.get(block, ()):
                    if one.from_ns <= time_ns <= one.to_ns and one.span.overlaps(seq, size):
                        return True
        return False


def _touched(seq: int, size: int, bits: int) -> list[int]:
    """Return the blocks with any of ``size`` sequence numbers from ``seq`` on; the last number is followed by the first."""
    if size <= 0:
        return []
    return [block & MASK >> bits for block in range(seq >> bits, (seq + size - 1 >> bits) + 1)]


class _Direction:
    """The progress of one direction; positions count octets from the start of its stream."""

    __slots__ = ("area", "begun", "complete", "cursor", "first", "loose", "skipped", "stream", "total")

    def __init__(self, stream: HalfStream) -> None:
        self.stream = stream  # to notice when another connection uses the same addresses
        self.total = 0  # everything before this has been accounted for
        self.area = 0  # beginning of the octets that were accounted for last
        self.cursor = 0  # after the last TPKT that was reported
        self.skipped = 0
        self.loose = False  # whether some of them belong to no TPKT
        self.first = 0  # where the present message begins
        # beginning of the PDU that the current message is a part of: S7comm-plus divides PDUs into frames
        self.begun = 0
        self.complete = True

    def take(self, total: int, skipped: int, size: int) -> tuple[int, int]:
        """Return (begin, end) of a TPKT of ``size`` octets that is reported after ``total`` octets were accounted for."""
        if total > self.total:
            self.area = self.cursor = self.total
            self.total = total
            self.loose = skipped != self.skipped
            self.skipped = skipped
        begin = self.cursor
        self.cursor = min(begin + size, self.total)
        return (self.area, self.total) if self.loose else (begin, self.cursor)


class SpanBook:
    """Remembers the ranges of PDUs until `pop`. ``forgotten`` counts those that were dropped because there were too many."""

    def __init__(self) -> None:
        self.forgotten = 0
        # Ordered, because finding the oldest entry of a plain dict is slow after many deletions before it.
        self._directions: OrderedDict[bytes, _Direction] = OrderedDict()
        self._spans: OrderedDict[tuple[int, int, int, int], Span] = OrderedDict()

    def tpkt(self, side: Side, octets: bytes) -> Span | None:
        """Take a whole TPKT that is reported; return its range, None if it is unknown."""
        last = len(octets) <= _EOT_AT or octets[_EOT_AT] & _EOT != 0
        return self._take(side, len(octets), len(octets) > 5 and octets[5] & 0xF0 == _DT, last)

    def ibh_packet(self, side: Side, octets: bytes) -> Span | None:
        """Take a whole IBH-NetLink packet that is reported, as `tpkt`; parts of a message are not distinguished."""
        return self._take(side, len(octets), True, False)

    def _take(self, side: Side, size: int, carries: bool, last: bool) -> Span | None:
        direction = self._direction(side)
        framer, ibh = side.framer, side.ibh
        skipped = int(framer.skipped) + int(side.missing) + (int(ibh.skipped) if ibh is not None else 0)
        framed = int(framer.framed) + (int(ibh.framed) if ibh is not None else 0)
        begin, end = direction.take(framed + skipped, skipped, size)
        if carries:
            if direction.complete:
                direction.first = begin
                if not _unfinished(side):
                    direction.begun = begin
            direction.complete = last
        start = int(side.stream.start_seq)
        return Span(side.key, (start + begin) & MASK, end - begin) if start >= 0 and end > begin else None

    def pdu(self, side: Side, frame: int, size: int) -> None:
        """Remember the range of a PDU of ``size`` octets that packet ``frame`` completed."""
        direction = self._directions.get(side.key)
        start = int(side.stream.start_seq)
        if direction is None or start < 0:
            return
        end = direction.total if direction.loose else direction.cursor
        direction.complete = True
        begin = direction.first
        if not _unfinished(side):  # otherwise it came between the frames of another one
            begin = min(begin, direction.begun)
            direction.begun = direction.first
        if end <= begin:
            return
        spans = self._spans
        if len(spans) >= MAX_SPANS:
            spans.popitem(last=False)
            self.forgotten += 1
        key = (int(side.connection.number), int(side.index), frame, size)
        span = Span(side.key, (start + begin) & MASK, end - begin)
        same = spans.pop(key, None)
        if same is not None:
            span.more = same.more + 1
            span.size += (span.seq - same.seq) & MASK
            span.seq = same.seq
        spans[key] = span

    def pop(self, connection: int, side: int, frame: int, size: int) -> Span | None:
        """Return and forget the range of a PDU; None if it is unknown."""
        key = (connection, side, frame, size)
        span = self._spans.get(key)
        if span is None:
            return None
        if span.more:
            span.more -= 1
        else:
            del self._spans[key]
        return span

    def _direction(self, side: Side) -> _Direction:
        direction = self._directions.get(side.key)
        if direction is None or direction.stream is not side.stream:
            if len(self._directions) >= MAX_DIRECTIONS:
                self._directions.popitem(last=False)
            direction = _Direction(side.stream)
            self._directions[side.key] = direction
        return direction


def _unfinished(side: Side) -> bool:
    """Return whether an S7comm-plus PDU of a direction waits for its next frame."""
    return side.plus is not None and side.plus.parts is not None
