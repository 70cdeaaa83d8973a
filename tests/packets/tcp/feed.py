"""A stream fed by positions, and the simple model of its expected output."""

from __future__ import annotations

from dissect.packets.tcp import stream
from dissect.packets.tcp.stream import BEFORE_START, NEW, OLD, HalfStream
from dissect.packets.tcp.stretches import Chunk

#: An octet of the output, or None for one in a gap; and the packet that made it available.
Octet = tuple[int | None, int]


class Model:
    """The expected output if nothing is dropped before the end: the first copy of each octet, and gaps elsewhere."""

    def __init__(self) -> None:
        self.octets: dict[int, int] = {}
        self.frames: dict[int, int] = {}

    def add(self, at: int, octets: bytes, frame: int) -> int:
        """Take a segment (positions from the start on; earlier ones are unknown) and return its treatment."""
        fresh = [place for place in range(max(at, 0), at + len(octets)) if place not in self.octets]
        for place in fresh:
            self.octets[place] = octets[place - at]
            self.frames[place] = frame
        if at + len(octets) <= 0:
            return BEFORE_START
        return NEW if fresh else OLD

    def output(self) -> list[Octet]:
        """An octet is available when all before it are, back to the previous gap; gaps have no packet here."""
        out: list[Octet] = []
        latest = 0
        for place in range(max(self.octets, default=-1) + 1):
            if place in self.octets:
                latest = max(latest, self.frames[place])
                out.append((self.octets[place], latest))
            else:
                latest = 0
                out.append((None, 0))
        return out


class Feed:
    """A `HalfStream` fed by positions instead of sequence numbers, checked after every step."""

    def __init__(self, isn: int = 1000, known_start: bool = True) -> None:
        self.half = HalfStream()
        self.isn = isn
        self.base = 0
        self.frame = 0
        self.chunks: list[Chunk] = []
        if known_start:
            self.half.start(isn)

    def segment(self, at: int, octets: bytes, time_ns: int = -1) -> int:
        self.frame += 1
        if self.half.next_seq < 0:
            self.base = at
        time_ns = self.frame * 1000 if time_ns < 0 else time_ns
        what = self.half.accept((self.isn + at) & stream.MASK, octets, self.frame, time_ns)
        self.check()
        return what

    def ack(self, at: int, time_ns: int) -> None:
        self.half.acknowledged((self.isn + at) & stream.MASK, time_ns)

    def passing(self, time_ns: int) -> None:
        self.frame += 1
        self.half.passing(time_ns)
        self.check()

    def expire(self, time_ns: int) -> None:
        self.half.expire(time_ns)
        self.check()

    def finish(self) -> None:
        self.half.finish()
        self.check()
        assert self.half.held is None

    def check(self) -> None:
        """Nothing is lost or counted twice, and no held octets touch those passed on or held already."""
        half = self.half
        self.chunks += half.ready
        half.ready = []
        assert half.octets == sum(len(chunk.octets) for chunk in self.chunks)
        assert half.position == half.octets + sum(chunk.hole for chunk in self.chunks)
        seq = half.start_seq
        for chunk in self.chunks:
            assert (chunk.hole > 0) is (chunk.octets == b"")
            seq = (seq + chunk.hole + len(chunk.octets)) & stream.MASK
            assert chunk.end_seq == seq
        assert half.next_seq == seq
        assert half.held is None or half.held
        edge = half.position + 1
        for held in half.held or []:
            assert held.at >= edge
            assert held.octets
            edge = held.at + len(held.octets)
        assert half.held_octets == sum(len(held.octets) for held in half.held or [])
        assert half.held_octets <= stream.MAX_HELD_OCTETS
        assert len(half.held or []) < stream.MAX_HELD

    def output(self) -> list[Octet]:
        out: list[Octet] = []
        for chunk in self.chunks:
            out += [(octet, chunk.frame) for octet in chunk.octets] if chunk.octets else [(None, 0)] * chunk.hole
        return out

    @property
    def octets(self) -> bytes:
        return b"".join(chunk.octets for chunk in self.chunks)

    @property
    def holes(self) -> list[int]:
        return [chunk.hole for chunk in self.chunks if chunk.hole]
