"""One direction of a TCP connection: the octets of its stream that are kept or replaced.

Positions count octets from the first one of the stream. Octets of unknown meaning become zero.
"""

from __future__ import annotations

from array import array
from bisect import bisect_left, bisect_right
from collections import OrderedDict, deque
from typing import Final

from dissect.files.anonymize.rewrite_plan import RewritePlan
from dissect.packets.tcp.connection import TcpConnection
from dissect.packets.tcp.stream import HALF_SPACE, MASK, HalfStream

#: Maximum number of ranges over all connections, and maximum size of replacements; beyond them everything becomes zero.
MAX_RANGES: Final = 4_000_000
MAX_REPLACED: Final = 64 * 1024 * 1024
#: Memory of a replacement besides its octets.
COST: Final = 64
#: Maximum number of segments of a direction that are kept for comparison with retransmissions, and of their octets in total.
MAX_RECENT: Final = 64
MAX_RECENT_OCTETS: Final = 32 * 1024 * 1024
#: Beginning of a TPKT, size of its header, with and without that of a DT; beginning of an ordinary one.
_TPKT: Final = b"\x03\x00"
_HEADER: Final = 4
_DT_HEAD: Final = 7
_DT: Final = b"\x02\xf0"
#: Up to this many ranges are skipped one by one before a binary search.
_STEPS: Final = 8
#: A segment further ahead than this does not change the expected position of the next one.
_JUMP: Final = 1 << 24


class Room:
    """The memory that is left for ranges; in the second pass for segments, with at most ``recent_octets``."""

    def __init__(self, recent_octets: int = MAX_RECENT_OCTETS) -> None:
        self.ranges = MAX_RANGES
        self.octets = MAX_REPLACED
        self.recent = 0  # size of the segments
        self._most = recent_octets
        self._tracks: OrderedDict[int, Track] = OrderedDict()

    def touch(self, track: Track) -> None:
        """Note that a track stored a segment; if memory is short, tracks without a segment for the longest time drop theirs."""
        self._tracks[id(track)] = track
        self._tracks.move_to_end(id(track))
        while self.recent > self._most:
            self._tracks.popitem(last=False)[1].forget(0)

    def take(self, octets: int) -> bool:
        """Take memory for a range and its replacement; return False if there is none left."""
        if self.ranges <= 0 or self.octets < octets:
            return False
        self.ranges -= 1
        self.octets -= octets
        return True


class Track:
    """The octets of a stream: ranges that stay, replacements; zero for all others. `keep`, `put`, `apply` must go forward."""

    __slots__ = (
        "_begins",
        "_ends",
        "_expected",
        "_forgotten",
        "_index",
        "_last_end",
        "_latest",
        "_new",
        "_new_at",
        "_recent",
        "_room",
        "_top",
        "first_frame",
        "full",
        "start_seq",
        "stream",
        "tcp",
    )

    def __init__(self, tcp: TcpConnection, stream: HalfStream, room: Room) -> None:
        self.tcp: TcpConnection | None = tcp
        self.stream: HalfStream | None = stream
        self.first_frame = int(tcp.first_frame)
        self.start_seq = -1
        self.full = False  # memory ran out before the end
        self._room = room
        self._begins = array("Q")
        self._ends = array("Q")
        self._last_end = -1  # the last of them
        self._new_at = array("Q")
        self._new: list[bytes] = []
        self._expected = array("Q", (0,))
        self._latest = 0
        self._index = 0  # of the last range that a segment overlapped
        self._recent: deque[tuple[int, bytes]] | None = None
        self._top = 0  # end of the stored segments
        self._forgotten = 0  # the first copies of segments before this position are no longer stored

    # ---- first reading ----------------------------------------------------------------------------------------------

    def keep(self, begin: int, end: int) -> None:
        """Keep the octets from ``begin`` to ``end``."""
        last: int = self._last_end
        if begin < last or begin < 0:
            return  # contradicts an earlier range: neither can be trusted
        if begin == last:
            self._ends[-1] = self._last_end = end
        elif self._room.take(0):
            self._begins.append(begin)
            self._ends.append(end)
            self._last_end = end
        else:
            self.full = True

    def keep_one(self, at: int, octet: bytes) -> None:
        """Keep one ``octet``, even within a replacement."""
        before = bisect_right(self._new_at, at) - 1
        if before >= 0:
            new, place = self._new[before], at - self._new_at[before]
            if place < len(new):
                self._new[before] = new[:place] + octet + new[place + 1 :]
                return
        place = bisect_right(self._begins, at)
        if place and self._ends[place - 1] > at:
            return
        if self._room.take(0):
            self._begins.insert(place, at)
            self._ends.insert(place, at + 1)
            self._last_end = self._ends[-1]
        else:
            self.full = True

    def put(self, begin: int, new: bytes) -> None:
        """Replace the octets from ``begin`` on."""
        if begin < 0 or (self._new and begin < self._new_at[-1] + len(self._new[-1])):
            return
        if self._room.take(len(new) + COST):
            self._new_at.append(begin)
            self._new.append(new)
        else:
            self.full = True

    def expect(self, place: int, actual: int) -> None:
        """Note that a TPKT was expected at ``place`` and the next whole one began at ``actual``, -1 for none.

        If ``actual`` is later, the header of an incomplete TPKT may be at ``place`` (`_headers`).
        """
        if actual != place and self._expected[-1] < place and self._room.take(0):
            self._expected.append(place)

    def apply(self, plan: RewritePlan, offset: int, begin: int = 0, end: int = -1) -> None:
        """Apply the plan ``plan`` from ``begin`` to ``end``; positions in the stream are greater by ``offset``."""
        if end < 0:
            end = len(plan.octets)
        for first, last, new in plan.pieces:
            start, stop = max(first, begin), min(last, end)
            if start < stop:
                if new is None:
                    self.keep(offset + start, offset + stop)
                else:
                    self.put(offset + start, new[start - first : stop - first])

    def settle(self) -> None:
        """End the first pass."""
        if self.stream is not None:
            self.start_seq = int(self.stream.start_seq)
        self.tcp = None
        self.stream = None

    # ---- second reading ---------------------------------------------------------------------------------------------

    def render(self, seq: int, octets: bytes) -> tuple[bytes, int]:
        """Return the rewritten payload of a segment, and how many of its octets were set to zero."""
        size = len(octets)
        if self.start_seq < 0 or not size:
            return bytes(size), size
        at = self._position(seq)
        end = at + size
        here = at
        rest = size
        pieces: list[bytes] = []
        for begin, stop in self._ranges(at, end):
            if begin > here:
                pieces.append(bytes(begin - here))
            pieces.append(octets[begin - at : stop - at])
            rest -= stop - begin
            here = stop
        if rest:
            if here < end:
                pieces.append(bytes(end - here))
            rewritten = b"".join(pieces)
        else:
            rewritten = octets
        listens = self._expected[-1] >= at
        if listens or self._new or at < self._top or at < self._forgotten:
            new = bytearray(rewritten)
            if listens:
                rest -= self._headers(at, octets, new)
            self._compare(at, octets, new)
            for begin, piece in self._replacements(at, end):
                new[begin - at : begin - at + len(piece)] = piece
                rest -= len(piece)
            rewritten = bytes(new)
        self._remember(at, octets)
        return rewritten, rest

    def _position(self, seq: int) -> int:
        """Return the position of a sequence number: the one nearest to the last segment."""
        ahead = (seq - self.start_seq - self._latest) & MASK
        if ahead >= HALF_SPACE:
            ahead -= MASK + 1
        at = self._latest + ahead
        if 0 < ahead < _JUMP:
            self._latest = at
        return at

    def _ranges(self, at: int, end: int) -> list[tuple[int, int]]:
        """Return the parts of ``at`` to ``end`` that stay."""
        ranges: list[tuple[int, int]] = []
        begins, ends = self._begins, self._ends
        count = len(begins)
        index = self._index
        most = index + _STEPS
        if index < count and begins[index] <= at:  # usually slightly before the previous segment
            while index + 1 < count and begins[index + 1] <= at and index < most:
                index += 1
        if index >= count or begins[index] > at or index == most:
            index = max(bisect_right(begins, at) - 1, 0) if at >= 0 else 0
        while index < count:
            begin = begins[index]
            if begin >= end:
                break
            stop = ends[index]
            if begin < stop and stop > at:
                ranges.append((max(begin, at), min(stop, end)))
            self._index = index
            index += 1
        return ranges

    def _replacements(self, at: int, end: int) -> list[tuple[int, bytes]]:
        """Return (position, octets) of the replacements between ``at`` and ``end``."""
        ranges: list[tuple[int, bytes]] = []
        index = max(bisect_right(self._new_at, at) - 1, 0) if at >= 0 else 0
        while index < len(self._new_at) and self._new_at[index] < end:
            here, new = self._new_at[index], self._new[index]
            begin, stop = max(here, at), min(here + len(new), end)
            if begin < stop:
                ranges.append((begin, new[begin - here : stop - here]))
            index += 1
        return ranges

    def _headers(self, at: int, octets: bytes, new: bytearray) -> int:
        """Keep the header of a TPKT, and of a DT in it, at expected positions; return the number of octets."""
        kept = 0
        index = bisect_left(self._expected, max(at, 0))
        while index < len(self._expected) and self._expected[index] < at + len(octets):
            here = self._expected[index] - at
            while here + _HEADER <= len(octets) and octets[here : here + 2] == _TPKT:
                size = octets[here + 2] << 8 | octets[here + 3]
                end = here + _HEADER
                if size > _DT_HEAD and octets[end : end + 2] == _DT and end + 3 <= len(octets):
                    end += 3
                kept += end - here - sum([stop - begin for begin, stop in self._ranges(at + here, at + end)])
                new[here:end] = octets[here:end]
                if not _HEADER <= size < _DT_HEAD:
                    break
                here += size  # too short for a TPDU, but the next one is expected after it
            index += 1
        return kept

    def _compare(self, at: int, octets: bytes, new: bytearray) -> None:
        """Clear octets in ``new`` that differ from the first copy: the first pass did not examine them.

        A retransmission so late that the first copy is no longer stored is cleared as well.
        """
        end = at + len(octets)
        if at < self._forgotten:
            new[: self._forgotten - at] = bytes(min(self._forgotten, end) - at)
        if at < self._top:
            for there, before in self._recent or ():
                begin, stop = max(there, at), min(there + len(before), end)
                if begin < stop and before[begin - there : stop - there] != octets[begin - at : stop - at]:
                    for place in range(begin, stop):
                        if before[place - there] != octets[place - at]:
                            new[place - at] = 0

    def _remember(self, at: int, octets: bytes) -> None:
        """Store a segment for comparison with later ones."""
        recent = self._recent
        if recent is None:
            recent = self._recent = deque()
        recent.append((at, octets))
        self._top = max(self._top, at + len(octets))
        self._room.recent += len(octets)
        if len(recent) > MAX_RECENT:
            self.forget(MAX_RECENT)
        self._room.touch(self)

    def forget(self, left: int) -> None:
        """Drop segments until at most ``left`` are stored."""
        while self._recent is not None and len(self._recent) > left:
            at, octets = self._recent.popleft()
            self._room.recent -= len(octets)
            self._forgotten = max(self._forgotten, at + len(octets))


def track_at(tracks: list[Track] | None, frame: int) -> Track | None:
    """Return the track of packet ``frame`` among the ``tracks`` of a direction, which are in the order of their beginnings."""
    if not tracks:
        return None
    latest = tracks[0]
    for track in tracks:
        if track.first_frame > frame:
            break
        latest = track
    return latest
