"""One direction of a TCP connection: turns segments in any order into octets in order, and reports gaps.

`HalfStream` does no I/O and knows no clock; time comes in with each segment. A segment that is exactly the next one is the
common case and costs one comparison, which the pipeline makes itself (`next_seq`, `held`). Everything else comes here:

* The first copy of an octet wins; a later copy that differs is counted as a conflict.
* A segment ahead of its turn is held, in order of position, until the octets before it arrive or are declared missing.
* Missing octets are declared a gap once the far end acknowledged them and a short grace period has passed, because captures
  also show a segment after its own acknowledgement; else after `MAX_HELD` held segments; else after `HOLE_TIMEOUT_NS` of
  capture time; else at the end of the stream. Nothing is ever filled in (docs/decisions/0003-holes.md).
* A segment beyond any possible window counts only if the far end acknowledges it; otherwise it is dropped (`outside`).

Positions are counted from the first octet seen, without wrap; sequence numbers wrap at 2**32. `Endpoint` is the sender.
"""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64, mypyc_attr

from dissect.packets.tcp.stretches import Chunk, Held
from dissect.wire.copies import leaves
from dissect.wire.octets import u16
from dissect.wire.text import POINT, SHORT, decimal

MASK: Final = 0xFFFFFFFF
HALF_SPACE: Final = 0x80000000

#: Segments and octets held for one direction before its first gap is declared: a little more than the full segments that fit a
#: window without scaling.
MAX_HELD: Final = 64
MAX_HELD_OCTETS: Final = 1024 * 1024
#: What a held segment takes in memory besides its octets, for the sum over all connections (`held_size`).
HELD_COST: Final = 128
#: An unexplained gap is declared after this much capture time.
HOLE_TIMEOUT_NS: Final = 1_000_000_000
#: For so many segments of the connection, or so much time, an octet that the far end acknowledged may still be captured late.
ACK_GRACE_SEGMENTS: Final = 8
ACK_GRACE_NS: Final = 50_000_000
#: If the far end was not captured, a segment further ahead than this is accepted only if a second one follows it closely.
FAR_AHEAD: Final = 1024 * 1024
#: If the far end was captured, a segment further ahead than this, the largest window without scaling, counts only if the far
#: end acknowledges it.
WINDOW: Final = 65535

#: Results for a segment's octets (`HalfStream.accept`).
NEW: Final = 0
OLD: Final = 1
KEEP_ALIVE: Final = 2
BEFORE_START: Final = 3


#: The ready data of a stream without any: most streams share this list, which is never appended to.
_NOTHING: Final[list[Chunk]] = []


class HalfStream:
    """Reassembly of one direction. `accept` takes segments; `ready` holds the octets that can be read, in order."""

    __slots__ = (
        "_acked_latest",
        "_acked_ns",
        "_acked_segments",
        "_acked_to",
        "before",
        "before_at",
        "conflicts",
        "gap_ns",
        "heard",
        "held",
        "held_octets",
        "last",
        "last_at",
        "next_seq",
        "octets",
        "outside",
        "position",
        "ready",
        "repeats",
        "shown",
        "start_seq",
    )

    def __init__(self) -> None:
        self.next_seq: i64 = -1  # sequence number of the next octet, -1 before the first
        self.start_seq: i64 = -1
        self.position: i64 = 0  # octets and holes passed since the start
        self.octets: i64 = 0  # octets passed on, holes not counted
        self.held: list[Held] | None = None  # None while nothing is held, so that the fast path need not look inside
        self.held_octets: i64 = 0
        self.ready: list[Chunk] = _NOTHING
        self.conflicts: i64 = 0
        self.gap_ns: i64 = 0  # time of the packet that shows the latest gap
        self.shown: i64 = 0  # octets that are missing at the end, as far as packets before the first FIN or RST show
        # The two latest stretches passed on in place, to compare a retransmission with.
        self.last: bytes = b""
        self.last_at: i64 = 0
        self.before: bytes = b""
        self.before_at: i64 = 0
        self._acked_to: i64 = -1  # position the far end acknowledged while a hole was open, -1 for none
        self._acked_latest: i64 = -1
        self._acked_ns: i64 = 0
        self._acked_segments: i64 = 0
        self.heard: bool = False  # the far end was captured as well, so its acknowledgements can be seen
        self.repeats: bool = False  # the last segment that `accept` took has octets that were there before
        self.outside: i64 = 0  # octets that were not believed; the code that reports them sets this back to 0

    def start(self, seq: i64) -> None:
        """Begin at sequence number ``seq`` (the octet after a SYN, or the first one seen)."""
        self.next_seq = seq & MASK
        self.start_seq = self.next_seq

    def distance(self, seq: i64) -> i64:
        """Return how far a sequence number is ahead of the next octet; negative where it is behind."""
        ahead: i64 = (seq - self.next_seq) & MASK
        return ahead if ahead < HALF_SPACE else ahead - MASK - 1

    def passed(self, octets: bytes, size: i64) -> None:
        """Count ``size`` octets that the caller took directly from an in-order segment."""
        self.before = self.last
        self.before_at = self.last_at
        self.last = octets
        self.last_at = self.position
        self.position += size
        self.octets += size
        self.next_seq = (self.next_seq + size) & MASK

    def accept(self, seq: i64, octets: bytes, frame: i64, time_ns: i64, ack: i64 = -1) -> i64:
        """Take one segment's octets (at least one); return the result: NEW, OLD, KEEP_ALIVE or BEFORE_START.

        ``ack`` is the TCP acknowledgement it came with, -1 for none.
        """
        size: i64 = len(octets)
        if self.next_seq < 0:
            self.start(seq)
        ahead: i64 = (seq - self.next_seq) & MASK
        if ahead >= HALF_SPACE:
            ahead -= MASK + 1
        at: i64 = self.position + ahead
        self.repeats = False
        if at + size <= self.position:
            if size == 1 and ahead == -1:
                return KEEP_ALIVE  # its octet is arbitrary (RFC 1122 4.2.3.6), so it is not compared
            if at + size <= 0:
                return BEFORE_START
            self.repeats = True
            self._compare_passed(at, octets)
            return OLD
        if at < self.position:
            self.repeats = True
            self._compare_passed(at, octets)
            octets = octets[self.position - at :]
            at = self.position
        if at == self.position and self.held is None:
            self._pass(octets, ack, frame, time_ns)
            return NEW
        new: bool = self._hold(at, octets, ack, frame, time_ns)
        self._drain(frame, time_ns)
        while self.held is not None and (len(self.held) >= MAX_HELD or self.held_octets > MAX_HELD_OCTETS):
            self._give_up_or_drop()
        return NEW if new else OLD

    def acknowledged(self, ack: i64, time_ns: i64) -> None:
        """The far end acknowledged up to ``ack``; call it only while something is held."""
        held = self.held
        if held is None:
            return
        ahead: i64 = (ack - self.next_seq) & MASK
        if ahead >= HALF_SPACE or self.position + ahead < held[0].at:
            return
        self._acked_latest = max(self._acked_latest, self.position + ahead)
        if self._acked_to < 0:
            self._acked_to = self._acked_latest
            self._acked_ns = time_ns
            self._acked_segments = 0

    def passing(self, time_ns: i64) -> None:
        """A segment of the connection went by; gives gaps up when their time is over. Call it only while holding."""
        self._acked_segments += 1
        self.expire(time_ns)

    def expire(self, time_ns: i64) -> None:
        """Give up gaps whose time is over; a far jump that nothing confirmed is left waiting for confirmation."""
        if self._acked_to >= 0 and (
            self._acked_segments > ACK_GRACE_SEGMENTS or time_ns - self._acked_ns > ACK_GRACE_NS
        ):
            while self.held is not None and self.held[0].at <= self._acked_to:
                self.give_up()
            # Octets acknowledged since then get a separate grace period.
            self._acked_to = self._acked_latest if self._acked_latest > self._acked_to else -1
            self._acked_ns = time_ns
            self._acked_segments = 0
        while self.held is not None and time_ns - self.held[0].time_ns > HOLE_TIMEOUT_NS and self.time_bound:
            self.give_up()

    @property
    def held_size(self) -> i64:
        """Approximate memory, in octets, of the held segments and of the latest stretches passed on."""
        size: i64 = self.held_octets + len(self.last) + len(self.before)
        held = self.held
        return size if held is None else size + len(held) * HELD_COST

    @property
    def time_bound(self) -> bool:
        """True while something is held that the passing of time alone may release."""
        held = self.held
        if held is None:
            return False
        return self._believed(held)

    def _believed(self, held: list[Held]) -> bool:
        """Return whether the first held stretch may be at its position, without an acknowledgement of the far end."""
        ahead: i64 = held[0].at - self.position
        if self.heard:
            return ahead <= WINDOW
        return ahead <= FAR_AHEAD or (len(held) > 1 and held[1].at - held[0].at <= FAR_AHEAD)

    def _give_up_or_drop(self) -> None:
        """Declare the first gap, unless there is no evidence for the data after it: then drop that data."""
        held = self.held
        if held is None:
            return
        if self._acked_latest >= held[0].at or self._believed(held):
            self.give_up()
            return
        for stretch in held:
            self.outside += len(stretch.octets)
        self.held = None
        self.held_octets = 0

    def give_up(self) -> None:
        """Declare the first gap and pass on the data after it."""
        held = self.held
        if held is None:
            return
        hole: i64 = held[0].at - self.position
        if hole > 0:
            self.skip(hole, held[0].frame, held[0].time_ns)  # reported at the packet after the gap
        self._drain(-1, 0)

    def skip(self, hole: i64, frame: i64, time_ns: i64) -> None:
        """Declare the next ``hole`` octets missing (also used for octets the capture cut off)."""
        self.position += hole
        self.next_seq = (self.next_seq + hole) & MASK
        self.gap_ns = time_ns
        self._append(Chunk(b"", hole, self.next_seq, -1, frame, time_ns))

    def finish(self) -> None:
        """The stream ends: give up every gap and pass on what is held."""
        while self.held is not None:
            self._give_up_or_drop()
        self.last = b""  # a connection may be remembered long after its end
        self.before = b""

    def _pass(self, octets: bytes, ack: i64, frame: i64, time_ns: i64) -> None:
        self.passed(octets, len(octets))
        self._append(Chunk(octets, 0, self.next_seq, ack, frame, time_ns))

    def _append(self, chunk: Chunk) -> None:
        if self.ready:
            self.ready.append(chunk)
        else:
            self.ready = [chunk]

    def take_ready(self) -> list[Chunk]:
        """Return and remove what can be read."""
        ready = self.ready
        self.ready = _NOTHING
        return ready

    def _hold(self, at: i64, octets: bytes, ack: i64, frame: i64, time_ns: i64) -> bool:
        """Keep those octets of a stretch that no held stretch covers; return True if there are any."""
        held = self.held
        if held is None:
            held = []
            self.held = held
        start: i64 = at
        end: i64 = at + len(octets)
        # The first stretch that ends after this one; usually there is none.
        index: i64 = len(held)
        if index and held[index - 1].at + len(held[index - 1].octets) > start:
            low: i64 = 0
            while low < index:
                middle: i64 = (low + index) >> 1
                if held[middle].at + len(held[middle].octets) <= start:
                    low = middle + 1
                else:
                    index = middle
        new: bool = False
        while start < end:
            stop: i64 = end
            if index < len(held) and held[index].at < end:
                other = held[index]
                if other.at <= start:
                    stop = min(end, other.at + len(other.octets))
                    self.repeats = True
                    mine = octets[start - at : stop - at]
                    if other.octets[start - other.at : stop - other.at] != mine:
                        self.conflicts += 1
                    start = stop
                    index += 1
                    continue
                stop = other.at
            held.insert(index, Held(start, octets[start - at : stop - at], ack, frame, time_ns))
            self.held_octets += stop - start
            new = True
            index += 1
            start = stop
        return new

    def _drain(self, frame: i64, time_ns: i64) -> None:
        """Pass on held stretches that are next. ``frame`` is the packet that filled a gap, -1 if one was declared."""
        held = self.held
        if held is None:
            return
        count: i64 = 0
        for stretch in held:
            if stretch.at != self.position:
                break
            if frame < stretch.frame:
                frame = stretch.frame
                time_ns = stretch.time_ns
            self.held_octets -= len(stretch.octets)
            self._pass(stretch.octets, stretch.ack, frame, time_ns)
            self.ready[-1].own_frame = stretch.frame
            self.ready[-1].own_ns = stretch.time_ns
            count += 1
        if count == len(held):
            self.held = None
        elif count:
            del held[:count]

    def _compare_passed(self, at: i64, octets: bytes) -> None:
        """Count a conflict when ``octets`` differ from those passed on at the same positions, if they are kept."""
        if self._differs(self.last_at, self.last, at, octets) or self._differs(self.before_at, self.before, at, octets):
            self.conflicts += 1

    def _differs(self, kept_at: i64, kept: bytes, at: i64, octets: bytes) -> bool:
        start: i64 = max(kept_at, at)
        end: i64 = min(kept_at + len(kept), at + len(octets))
        return start < end and kept[start - kept_at : end - kept_at] != octets[start - at : end - at]


FIN: Final = 0x01
SYN: Final = 0x02
RST: Final = 0x04
ACK: Final = 0x10


def address_text(address: bytes) -> str:
    """Return an IPv4 or IPv6 address (4 or 16 octets) as text; IPv6 in the RFC 5952 form."""
    if len(address) == 4:
        return f"{POINT[address[0]]}{POINT[address[1]]}{POINT[address[2]]}{SHORT[address[3]]}"
    groups = [u16(address, i * 2) for i in range(8)]
    best_at: i64 = -1
    best_size: i64 = 1
    at: i64 = 0
    while at < 8:
        size: i64 = 0
        while at + size < 8 and groups[at + size] == 0:
            size += 1
        if size > best_size:
            best_at, best_size = at, size
        at += size + 1
    texts = [f"{group:x}" for group in groups]
    if best_at < 0:
        return ":".join(texts)
    return ":".join(texts[:best_at]) + "::" + ":".join(texts[best_at + best_size :])


@mypyc_attr(acyclic=True)  # many are kept, and each is smaller without the head of the collector
class Endpoint:
    """An address and a TCP port; ``port`` is -1 where only the host is known."""

    __slots__ = ("_host", "_text", "address", "port")

    def __init__(self, address: bytes, port: int) -> None:
        self.address = address
        self.port = port
        self._host: str = ""  # made on first access, like the next one
        self._text: str = ""

    @property
    def host(self) -> str:
        """The address without the port, as text."""
        if not self._host:
            self._host = address_text(self.address)
        return self._host

    def share(self, other: Endpoint) -> None:
        """Use the same address object as ``other``, which is equal: many connections belong to few stations."""
        self.address = other.address
        self._host = other.host

    def __repr__(self) -> str:
        return f"Endpoint({str(self)!r})"

    def __str__(self) -> str:
        if not self._text:
            if self.port < 0:
                self._text = self.host
            elif len(self.address) == 16:
                self._text = f"[{self.host}]:{self.port}"
            else:
                self._text = f"{self.host}:{decimal(self.port)}"
        return self._text


leaves(Endpoint)
leaves(HalfStream, without=("held", "outside", "ready"))
