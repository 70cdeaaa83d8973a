"""TPKT framing of one direction (RFC 1006 section 6, reference section 1): turns octets in order into whole TPKTs.

`dissect.engine.iso` itself takes TPKTs that are complete in one segment; `Framer` handles everything else: TPKTs in several
segments, gaps and garbage. Its state between segments:

* ``pending``: the first octets of a TPKT whose rest has not arrived yet;
* ``skip``: the number of octets of a TPKT damaged by a gap that are still to be skipped. After a gap of known size that ends
  inside a TPKT, the framer knows where the next one begins, and stays in step;
* ``synced`` false: out of step; the framer has to search for the next TPKT. A possible beginning is kept until it is certain.
  So even if no TPKT is complete in one segment, only the octets in the gap are lost.

A length field may be wrong, so that it covers other TPKTs. A TPKT is *sound* if it contains a class 0 DT with a PDU whose own
lengths fill it exactly. If a sound TPKT begins inside one whose length does not match its content, the outer one ends there.
Where both readings agree with all lengths, both TPKTs are reported.
"""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.protocols.iso.upper import MMS, RDP, S7COMM, S7COMM_PLUS, TLS, classify, is_sound, stated_size
from dissect.wire.octets import u16

VERSION: Final = 3
HEADER: Final = 4
#: Size of the smallest packet with a TPDU: an empty DT.
MIN_LENGTH: Final = 7
MAX_LENGTH: Final = 65535
#: The size of the largest TPKT that a search finds if it begins inside a segment and ends in a later one.
MAX_SOUGHT: Final = 4096
#: Maximum number of places that are kept where such a TPKT may begin; the latest are kept.
_MAX_CANDIDATES: Final = 32

#: A class 0 DT that ends its TSDU begins with this.
_DT_EOT: Final = b"\x02\xf0\x80"
#: Number of octets at the start of a TPKT, header included, that show whether its length matches the PDU in it.
_TELLING: Final = 19

_TPDU_CODES: Final = frozenset((0x1, 0x2, 0x5, 0x6, 0x7, 0x8, 0xC, 0xD, 0xE, 0xF))
_DT: Final = 0xF0

# The results of `judge_beginning`.
NO: Final = 0
YES: Final = 1
UNDECIDED: Final = 2

#: Faults of a TPKT header (`Framer.faults`).
BAD_VERSION: Final = "version"
BAD_LENGTH: Final = "length"
#: A TPKT that covers sound ones: its length is wrong, or its sender aborted it and began a new one.
HIDING: Final = "hiding"


def plausible(octets: bytes, at: i64, end: i64) -> bool:
    """Return whether a TPKT with a COTP TPDU may begin at ``at``, judged by its first six octets.

    The first four must be present: version, a zero reserved octet and a legal length. The other two are checked if present.
    """
    if end - at < HEADER or octets[at] != VERSION or octets[at + 1] != 0:
        return False
    length: i64 = u16(octets, at + 2)
    if length < MIN_LENGTH:
        return False
    if end - at < HEADER + 2:
        return True
    li: i64 = octets[at + 4]
    if li == 0 or li == 255 or li + 1 > length - HEADER:
        return False
    return (octets[at + 5] >> 4) in _TPDU_CODES


def judge_beginning(octets: bytes, at: i64, end: i64) -> i64:
    """Return whether a TPKT begins at ``at``: `YES`, `NO` or, if its end is not there yet, `UNDECIDED` (reference 1.3).

    This is stricter than `plausible`, for places inside a segment: a DT must be empty or carry a known protocol, and after the
    TPKT there must be another plausible one or the end of the octets. ``octets[at]`` must be present.
    """
    if end - at < HEADER:
        return UNDECIDED if _may_follow(octets, at, end) else NO
    if not plausible(octets, at, end):
        return NO
    length: i64 = u16(octets, at + 2)
    follower: i64 = at + length
    if follower > end:
        return UNDECIDED if length <= MAX_SOUGHT else NO
    if sound_length(octets, at, end):
        return YES  # whatever follows
    if octets[at + 5] & 0xF0 == _DT:
        data: i64 = at + 5 + octets[at + 4]
        if data < follower:
            upper: i64 = classify(octets, data, follower)
            if upper != S7COMM and upper != S7COMM_PLUS and upper != MMS and upper != TLS and upper != RDP:
                return NO
    return YES if follower == end or _may_follow(octets, follower, end) else NO


def sound_length(octets: bytes, at: i64, end: i64) -> i64:
    """Return the length of the sound TPKT that begins at ``at`` and ends before ``end``, 0 if there is none."""
    if end - at < MIN_LENGTH + HEADER or octets[at] != VERSION or octets[at + 1] != 0:
        return 0
    length: i64 = u16(octets, at + 2)
    if length <= MIN_LENGTH or at + length > end or octets[at + 4] != 2 or octets[at + 5] != _DT:
        return 0
    if octets[at + 6] != 0x80 or not is_sound(octets, at + MIN_LENGTH, at + length):
        return 0
    return length


def find_sound(octets: bytes, at: i64, stop: i64, end: i64) -> i64:
    """Return the place of the first sound TPKT in ``octets[at:end]`` that begins before ``stop``; -1 for none."""
    here: i64 = octets.find(_DT_EOT, at + HEADER)
    while 0 <= here < stop + HEADER:
        if sound_length(octets, here - HEADER, end):
            return here - HEADER
        here = octets.find(_DT_EOT, here + 1)
    return -1


def agrees(head: bytes, length: i64) -> bool:
    """Return whether the length of a TPKT matches the content size stated in its first octets (``head``).

    ``head`` includes the header. Also True while ``head`` is too short for a decision.
    """
    size: i64 = len(head)
    if size < HEADER + 2:
        return True
    if head[4] != 2 or head[5] != _DT:
        return head[5] & 0xF0 != _DT and plausible(head, 0, size)
    content: i64 = length - MIN_LENGTH
    stated: i64 = stated_size(head, MIN_LENGTH, size)
    if stated == 0:
        return content == 0 or size < min(length, _TELLING)
    if head[6] < 0x80:
        return stated >= content  # the rest comes in the next DTs
    return stated == content or (head[7] == 0x72 and stated + 4 == content)


def _may_follow(octets: bytes, at: i64, end: i64) -> bool:
    """Return whether the octets at ``at``, which may be fewer than a header, fit the beginning of a TPKT."""
    if end - at >= HEADER:
        return plausible(octets, at, end)
    return octets[at] == VERSION and (at + 1 == end or octets[at + 1] == 0)


def _first_open(octets: bytes) -> i64:
    """Return the first place in ``octets`` where a sound, still unfinished TPKT may begin; the end of the octets for none."""
    end: i64 = len(octets)
    here: i64 = octets.find(_DT_EOT, HEADER)
    while here >= 0:
        at: i64 = here - HEADER
        length: i64 = u16(octets, at + 2)
        if octets[at] == VERSION and octets[at + 1] == 0 and at + length > end and length <= MAX_SOUGHT:
            if agrees(octets[at : at + _TELLING], length):
                return at
        here = octets.find(_DT_EOT, here + 1)
    here = octets.find(b"\x03", max(0, end - MIN_LENGTH + 1))
    while here >= 0 and not _may_follow(octets, here, end):
        here = octets.find(b"\x03", here + 1)
    return here if here >= 0 else end


class Fault:
    """A wrong TPKT header: ``kind`` is `BAD_VERSION`, `BAD_LENGTH` or `HIDING`, ``value`` the value of the wrong field.

    ``framed`` and ``skipped`` are the framer's counts before it.
    """

    __slots__ = ("framed", "kind", "skipped", "value")

    def __init__(self, kind: str, value: int, framed: i64, skipped: i64) -> None:
        self.kind = kind
        self.value = value
        self.framed: i64 = framed
        self.skipped: i64 = skipped


#: Empty lists that all framers share while they need none of their own; never append to them.
_NO_PLACES: Final[list[int]] = []
_NO_PACKETS: Final[list[bytes]] = []
_NO_FAULTS: Final[list[Fault]] = []

#: `Framer.alone` takes only TPKTs up to this size; connect requests and confirms are no larger.
_FEW: Final = 64


class Framer:
    """Finds TPKTs in the octets of one direction. ``packets`` collects whole ones (header included), in order.

    Every pushed octet is counted: in ``framed`` (in whole TPKTs and in TPKTs reported as cut), ``skipped`` or ``buffered``.
    ``ends`` has, for each of ``packets``, the number of octets pushed up to its end; the caller deletes one entry with each
    packet that it takes.
    """

    __slots__ = (
        "_brief",
        "_candidates",
        "_need",
        "_searched",
        "_sought",
        "_tail",
        "cut_packet",
        "ends",
        "faults",
        "framed",
        "packets",
        "pending",
        "skip",
        "skipped",
        "synced",
    )

    def __init__(self) -> None:
        self.ends: list[int] = _NO_PLACES
        self.pending: bytearray | None = None
        self._need: i64 = 0  # size of the pending TPKT, 0 while its header is incomplete
        self._searched: i64 = 0  # number of octets of the pending TPKT in which no sound one begins
        self._sought: bytes = b""  # during a search: the octets from the first possible beginning of a TPKT on
        self._candidates: list[int] = _NO_PLACES  # the places in `_sought` where a TPKT may begin
        # The last octets of a TPKT whose length did not match its content; another TPKT may begin in them.
        self._tail: bytes = b""
        self.skip: i64 = 0
        self._brief: bool = False  # `skip` counts octets of a TPKT too short for a TPDU; another may begin in them
        self.synced: bool = False
        self.packets: list[bytes] = _NO_PACKETS
        self.faults: list[Fault] = _NO_FAULTS
        self.framed: i64 = 0
        self.skipped: i64 = 0
        self.cut_packet: bytes = b""

    @property
    def buffered(self) -> int:
        """Number of octets held back: of an unfinished TPKT, or of a possible one."""
        return len(self.pending) if self.pending is not None else len(self._sought)

    @property
    def passed(self) -> int:
        """Number of octets pushed up to the end of the current TPKT; gaps do not count."""
        if self.ends:
            return self.ends[0]
        return self.framed + self.skipped

    def push(self, octets: bytes, start: i64, at_segment_start: bool) -> None:
        """Take ``octets[start:]``; whole TPKTs are appended to ``packets``."""
        if self.ends and not self.packets:
            self.ends = _NO_PLACES
        at: i64 = start
        fresh: i64 = start
        if self._sought:
            at = 0
            fresh = len(self._sought)
            octets = self._sought + octets[start:]
            self._sought = b""
        end: i64 = len(octets)
        while at < end:
            if self.skip:
                at = self._pass(octets, at, end)
            elif self.pending is not None:
                found: i64 = self._seek(octets, at, end, at_segment_start and at == start)
                if found >= 0:
                    again = self._part(found)
                else:
                    at = self._continue(octets, at, end)
                    again = self._sought
                    self._sought = b""
                if again:
                    octets = again + octets[at:]
                    at = 0
                    fresh = 0
                    end = len(octets)
            elif self.synced and self._tail and octets[at] != VERSION:
                # No TPKT begins here, and the length of the previous one did not match its content: it was too large.
                self.framed -= len(self._tail)
                self._tell(BAD_VERSION, octets[at])
                self.synced = False
                octets = self._tail + octets[at:]
                self._tail = b""
                at = 0
                fresh = 0
                end = len(octets)
            elif not self.synced:
                at = self._search(octets, at, max(at, fresh), end, at_segment_start and at <= fresh)
            else:
                at = self._begin(octets, at, end)

    def hole(self, size: i64, cut: bool) -> bool:
        """``size`` octets are missing here. Return True if the gap is inside a TPKT whose end is still known.

        With ``cut`` (the capture cut the frame), the captured octets of that TPKT are left in ``cut_packet``; otherwise they
        count as skipped.
        """
        self.cut_packet = b""
        self._tail = b""
        if self.skip:
            self._pass_hole(self.skip, size)
            return self.synced
        pending = self.pending
        if pending is None:
            self.skipped += len(self._sought)
            self._sought = b""
            self._candidates = _NO_PLACES
            self.synced = False
            return False
        have: i64 = len(pending)
        self.pending = None
        if cut:
            self.cut_packet = bytes(pending)
            self.framed += have
        else:
            self.skipped += have
        if self._need == 0:
            self.synced = False
            return False
        self._pass_hole(self._need - have, size)
        return self.synced

    def _pass_hole(self, left: i64, size: i64) -> None:
        """Take a gap of ``size`` octets when ``left`` octets of a TPKT were still to come."""
        self._brief = False
        self._tail = b""
        if size <= left:
            self.skip = left - size
            self.synced = True
        else:
            self.skip = 0
            self.synced = False

    def _begin(self, octets: bytes, at: i64, end: i64) -> i64:
        """In step, at the beginning of a TPKT: take it whole, keep its beginning, or note a fault; return the next place."""
        if octets[at] != VERSION:
            self._tell(BAD_VERSION, octets[at])
            self.synced = False
            return at
        if end - at < HEADER:
            self._keep(octets, at, 0)
            return end
        length: i64 = u16(octets, at + 2)
        if length < MIN_LENGTH:
            return self._short(octets, at, end, length)
        if at + length <= end:
            if not sound_length(octets, at, end):
                hidden: i64 = find_sound(octets, at + 1, at + length, end)
                if hidden >= 0:
                    self._end_early(octets[at:hidden], length)
                    return hidden
            self._add(octets[at : at + length])
            return at + length
        if not agrees(octets[at : min(end, at + _TELLING)], length):
            hidden = find_sound(octets, at + 1, end, end)
            if hidden >= 0:
                self._end_early(octets[at:hidden], length)
                return hidden
        self._keep(octets, at, length)
        return end

    def _tell(self, kind: str, value: int) -> None:
        if not self.faults:
            self.faults = []
        self.faults.append(Fault(kind, value, self.framed, self.skipped))

    def _whole(self, packet: bytes, given: int) -> None:
        """Take a complete TPKT; ``given`` octets had been pushed up to its end."""
        if not self.packets:
            self.packets = []
        self.packets.append(packet)
        if not self.ends:
            self.ends = []
        self.ends.append(given)

    def alone(self, octets: bytes, at: i64, end: i64) -> i64:
        """Take ``octets[at:end]`` if they are clearly one TPKT with a TPDU other than DT; return its length, else 0.

        Most connections begin with such TPKTs. Call this only in step, with nothing held back. `push` would find the same TPKT,
        but with more work.
        """
        length: i64 = end - at
        if length < MIN_LENGTH or length > _FEW or u16(octets, at + 2) != length or not plausible(octets, at, end):
            return 0
        for here in range(at + HEADER + 1, end):
            if octets[here] & 0xF0 == _DT:
                return 0  # it is a DT, or covers what may be one
        self._tail = b""
        self.framed += length
        return length

    def joined(self, octets: bytes, at: i64, end: i64) -> bytes:
        """Return the pending TPKT, completed by ``octets[at:end]``, which follow it; empty if they do not complete it.

        The result is also empty if another TPKT may begin in place of it. The caller checks its type and its length.
        """
        pending = self.pending
        if pending is None or at == end or octets[at] == VERSION:
            return b""
        have: i64 = len(pending)
        need: i64 = self._need
        if need == 0:  # its header is cut
            if have + end - at < HEADER:
                return b""
            need = u16(bytes(pending) + octets[at : at + HEADER - have], 2)
        if need <= have or need - have > end - at:
            return b""  # before copying octets that may have come in many segments
        return bytes(pending) + octets[at : at + need - have]

    def end_pending(self) -> None:
        """The pending TPKT was taken as `joined` returned it: it matches its length."""
        self.pending = None
        self._tail = b""

    def _add(self, packet: bytes) -> None:
        self.framed += len(packet)
        self._whole(packet, self.framed + self.skipped)
        self._tail = b""
        if not agrees(packet[:_TELLING], len(packet)):
            self._tail = packet[max(1, _first_open(packet)) :]

    def _end_early(self, octets: bytes, length: i64) -> None:
        """A TPKT with length field ``length`` covers a sound one: its content is only ``octets``, up to the sound one."""
        self._tell(HIDING, length)
        if len(octets) < MIN_LENGTH:
            self.skipped += len(octets)
        else:
            self._add(octets)

    def _pass(self, octets: bytes, at: i64, end: i64) -> i64:
        """Skip the rest of a damaged TPKT, but stop at a sound one: then the length of the damaged one was wrong."""
        if self._brief and octets[at] == VERSION:
            self.skip = 0
            return at
        step: i64 = min(self.skip, end - at)
        found: i64 = find_sound(octets, at, at + step, end)
        if found >= 0:
            self.skip = 0
            self.skipped += found - at
            return found
        self.skip -= step
        self.skipped += step
        return at + step

    def _seek(self, octets: bytes, at: i64, end: i64, segment_start: bool) -> i64:
        """Return how many octets of the pending TPKT and ``octets[at:]`` come before a sound TPKT that ends it, -1 for none.

        If the pending TPKT matches its length, only a sound one at the beginning of a segment can end it: there the sender has
        aborted the pending one and begins again. That is so if no TPKT can follow at the end of the pending one. Otherwise both
        interpretations are possible, and the inner TPKTs are reported as well.
        """
        pending = self.pending
        assert pending is not None
        have: i64 = len(pending)
        begun: i64 = sound_length(octets, at, end) if segment_start else 0
        head = bytes(pending[:_TELLING]) + octets[at : at + _TELLING]
        if self._need == 0:
            return have if begun and not plausible(head, 0, len(head)) else -1
        if agrees(head[: min(_TELLING, have + end - at)], self._need):
            left: i64 = self._need - have
            if 0 < begun <= left:
                self._tell_inside(octets, at, min(end, at + left))
            elif begun and not _may_follow(octets, at + left, end):
                return have
            return -1
        before: i64 = self._searched
        tail = bytes(pending[before:]) + octets[at:end]
        size: i64 = len(tail)
        found: i64 = find_sound(tail, 0, min(size, self._need - before), size)
        if found >= 0:
            return before + found
        self._searched = before + _first_open(tail)
        return -1

    def _tell_inside(self, octets: bytes, at: i64, end: i64) -> None:
        """Report the sound TPKTs at ``at``, in addition to the pending one, whose content they may be."""
        pending = self.pending
        assert pending is not None
        self._tell(HIDING, self._need)
        given: i64 = self.framed + self.skipped + len(pending) - at
        length: i64 = sound_length(octets, at, end)
        while length:
            self._whole(octets[at : at + length], given + at + length)
            at += length
            length = sound_length(octets, at, end)

    def _part(self, size: i64) -> bytes:
        """End the pending TPKT after ``size`` octets; return its other octets."""
        pending = self.pending
        assert pending is not None
        octets = bytes(pending)
        self.pending = None
        self.synced = True
        self._end_early(octets[:size], self._need or len(octets))
        return octets[size:]

    def _short(self, octets: bytes, at: i64, end: i64, length: i64) -> i64:
        """Skip a TPKT too short for a TPDU, unless another begins in it; a length below 4 is impossible: search from here."""
        self._tell(BAD_LENGTH, length)
        if length < HEADER:
            self.synced = False
            self.skipped += 1
            return at + 1
        self.skipped += HEADER
        self.skip = length - HEADER
        self._brief = True
        return at + HEADER

    def _keep(self, octets: bytes, at: i64, need: i64) -> None:
        self.pending = bytearray(octets[at:])
        self._need = need
        self._searched = 1

    def _continue(self, octets: bytes, at: i64, end: i64) -> i64:
        """Add octets to the pending TPKT; return the next place. Each octet is appended and examined only once."""
        pending = self.pending
        assert pending is not None
        have: i64 = len(pending)
        if self._need == 0:
            take: i64 = min(HEADER - have, end - at)
            pending += octets[at : at + take]
            at += take
            if len(pending) < HEADER:
                return at
            header = bytes(pending)
            length: i64 = u16(header, 2)
            if length < MIN_LENGTH:
                self.pending = None
                self._short(header, 0, HEADER, length)
                if length < HEADER:
                    self._sought = header[1:]
                return at
            self._need = length
            return at  # `push` then calls `_seek` for the rest, as if it came in another segment
        take = min(self._need - have, end - at)
        pending += octets[at : at + take]
        if have + take == self._need:
            self.pending = None
            self._add(bytes(pending))
        return at + take

    def _search(self, octets: bytes, at: i64, fresh: i64, end: i64, segment_start: bool) -> i64:
        """Out of step: search for the next TPKT in ``octets[at:end]``; return the next place.

        Octets before ``fresh`` were examined before. If a segment begins at ``fresh``, this place is tried first, because most
        segments begin with a TPKT.
        """
        found: i64 = -1
        candidates: list[int] = []
        found = fresh if segment_start and plausible(octets, fresh, end) else self._settle(octets, end, candidates)
        here: i64 = octets.find(b"\x03\x00", fresh) if found < 0 else -1
        while here >= 0:
            judged: i64 = judge_beginning(octets, here, end)
            if judged == YES:
                found = here
                break
            if judged == UNDECIDED:
                candidates.append(here)
            here = octets.find(b"\x03\x00", here + 1)
        if found >= 0:
            self._candidates = _NO_PLACES
            self.synced = True
            self.skipped += found - at
            return found
        if fresh < end and octets[end - 1] == VERSION:
            candidates.append(end - 1)
        candidates = candidates[-_MAX_CANDIDATES:]
        keep: i64 = candidates[0] if candidates else end
        self._candidates = [place - keep for place in candidates]
        self._sought = octets[keep:]
        self.skipped += keep - at
        return end

    def _settle(self, octets: bytes, end: i64, undecided: list[int]) -> i64:
        """Return the first candidate that is certain now, -1 for none; append the undecided ones to ``undecided``."""
        for place in self._candidates:
            judged: i64 = judge_beginning(octets, place, end)
            if judged == YES:
                return place
            if judged == UNDECIDED:
                undecided.append(place)
        return -1
