"""Input and output of `HalfStream`: `Held` is a segment that waits for its turn, `Chunk` is a stretch delivered in order."""

from __future__ import annotations

from mypy_extensions import i64


class Held:
    """Octets from position ``at`` on that wait for those before them; ``ack`` is the TCP acknowledgement they came with."""

    __slots__ = ("ack", "at", "frame", "octets", "time_ns")

    def __init__(self, at: i64, octets: bytes, ack: i64, frame: i64, time_ns: i64) -> None:
        self.at: i64 = at
        self.ack: i64 = ack
        self.octets: bytes = octets
        self.frame: i64 = frame
        self.time_ns: i64 = time_ns


class Chunk:
    """The next octets of a stream (``hole`` is 0), or a gap of ``hole`` octets.

    ``end_seq`` is the sequence number after it. ``frame`` and ``time_ns`` are of the packet at which the octets were in order;
    ``own_frame`` and ``own_ns`` are of the packet that brought them. ``ack`` is the TCP acknowledgement that the last of them
    came with, -1 for none.
    """

    __slots__ = ("ack", "end_seq", "frame", "hole", "octets", "own_frame", "own_ns", "time_ns")

    def __init__(self, octets: bytes, hole: i64, end_seq: i64, ack: i64, frame: i64, time_ns: i64) -> None:
        self.own_frame: i64 = frame
        self.own_ns: i64 = time_ns
        self.ack: i64 = ack
        self.octets: bytes = octets
        self.hole: i64 = hole
        self.end_seq: i64 = end_seq
        self.frame: i64 = frame
        self.time_ns: i64 = time_ns
