"""The TCP streams of a capture, put together from tshark's sequence numbers and payloads and from nothing else.

They judge what Wireshark's own reassembly did with a packet, and are no part of what is compared: which octets a packet brought
for the first time, whether octets before it were still missing, whether certain octets stand in a stream and in which order.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from typing import Final

from dissect.oracle.tshark import Segment, read_segments

_MASK: Final = 0xFFFFFFFF
_HALF: Final = 0x80000000
#: Octets of a TPKT at most: how far from a segment a message it belongs to can begin.
_REACH: Final = 65535


class Arrival:
    """A segment in its place: ``at`` counts from the first octet of its direction.

    ``new``: how many octets no earlier segment brought; ``ahead``: octets before it were still missing.
    """

    __slots__ = ("ahead", "at", "new", "segment")

    def __init__(self, segment: Segment, at: int, new: int, ahead: bool) -> None:
        self.segment = segment
        self.at = at
        self.new = new
        self.ahead = ahead


class _Flow:
    """One direction: stretches of octets without a hole, in order; the first copy of an octet counts."""

    def __init__(self, sequence: int) -> None:
        self._origin = sequence
        self._latest = 0
        self._starts: list[int] = []
        self._stretches: list[bytearray] = []

    def add(self, segment: Segment) -> Arrival:
        ahead = (segment.sequence - self._origin - self._latest) & _MASK
        start = self._latest + (ahead - _MASK - 1 if ahead >= _HALF else ahead)
        missing = bool(self._starts) and start > self._starts[0] + len(self._stretches[0])
        self._latest = max(self._latest, start + len(segment.payload))
        return Arrival(segment, start, self._insert(start, segment.payload), missing)

    def _insert(self, start: int, payload: bytes) -> int:
        """Take the octets that are new; return how many."""
        index = max(bisect_right(self._starts, start) - 1, 0)
        if index == len(self._starts) - 1 and self._starts[index] + len(self._stretches[index]) == start:
            self._stretches[index] += payload
            return len(payload)
        while index < len(self._starts) and self._starts[index] + len(self._stretches[index]) < start:
            index += 1
        joined = bytearray(payload)
        begin, new = start, len(payload)
        while index < len(self._starts) and self._starts[index] <= start + len(payload):
            at, old = self._starts.pop(index), self._stretches.pop(index)
            end = max(begin + len(joined), at + len(old))
            new -= max(0, min(start + len(payload), at + len(old)) - max(start, at))
            merged = bytearray(end - min(begin, at))
            low = min(begin, at)
            merged[begin - low : begin - low + len(joined)] = joined
            merged[at - low : at - low + len(old)] = old
            joined, begin = merged, low
        self._starts.insert(index, begin)
        self._stretches.insert(index, joined)
        return new

    def follow(self, pieces: Sequence[tuple[int, bytes]]) -> list[bool]:
        """Tell of each piece (position of its segment, octets) whether it stands around there, behind the piece before it."""
        passed = list(self._starts)  # of each stretch, the end of the last piece found in it
        found = []
        for at, octets in pieces:
            index = bisect_right(self._starts, at) - 1
            start = max(passed[index], at - _REACH) - self._starts[index]
            place = self._stretches[index].find(octets, start, at + 2 * _REACH - self._starts[index])
            found.append(place >= 0)
            if place >= 0:
                passed[index] = self._starts[index] + place + len(octets)
        return found


class Streams:
    """Every segment of a capture by its frame; the capture is read once, when first asked."""

    def __init__(self, path: str) -> None:
        self._path = path
        self._flows: dict[str, _Flow] = {}
        self._arrivals: dict[int, Arrival] | None = None

    def arrival(self, frame: int) -> Arrival | None:
        """Return the segment of a frame, None when it has no TCP octets."""
        if self._arrivals is None:
            self._arrivals = {}
            for segment in read_segments(self._path):
                flow = self._flows.setdefault(segment.flow, _Flow(segment.sequence))
                self._arrivals[segment.frame] = flow.add(segment)
        return self._arrivals.get(frame)

    def follow(self, pieces: Sequence[tuple[int, bytes]]) -> list[bool]:
        """Tell of pieces (frame, octets), in the order they were found, whether each stands in its stream behind the last.

        Whoever counts a message twice, or finds one inside another, gives a piece that does not.
        """
        by_flow: dict[str, list[int]] = {}
        arrivals: dict[int, Arrival] = {}
        for index, (frame, _) in enumerate(pieces):
            arrival = self.arrival(frame)
            if arrival is not None:
                arrivals[index] = arrival
                by_flow.setdefault(arrival.segment.flow, []).append(index)
        found = [False] * len(pieces)
        for name, indexes in by_flow.items():
            placed = [(arrivals[index].at, pieces[index][1]) for index in indexes]
            for index, stands in zip(indexes, self._flows[name].follow(placed), strict=True):
                found[index] = stands
        return found
