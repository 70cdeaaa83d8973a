"""TPKT framing of one direction: octets in order become whole TPKTs, across any segmentation, holes and garbage.

RFC 1006 section 6; reference section 1. The pipeline takes TPKTs that lie whole in one segment itself and comes here with
everything else, so the state here is what is left between segments:

* ``pending``: the first octets of a TPKT whose rest is still to come;
* ``skip``: octets of a TPKT that a hole damaged, still to be passed over (a hole of known size inside a TPKT does not cost
  the synchronisation);
* ``synced`` false: the next TPKT has to be searched for. What may be the beginning of one is kept until that is certain, so
  that small segments, in which no TPKT lies whole, do not cost more than the octets that were lost.
"""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.iso.upper import MMS, RDP, S7COMM, S7COMM_PLUS, TLS, classify
from dissect.wire.octets import u16

HEADER: Final = 4
#: Smallest packet with a TPDU in it: an empty DT.
MIN_LENGTH: Final = 7
MAX_LENGTH: Final = 65535
#: A TPKT that begins inside a segment and ends in a later one is found while searching when it is no longer than this.
MAX_SOUGHT: Final = 4096
#: Places looked at for that at once; of more, the latest count.
_MAX_CANDIDATES: Final = 32

_TPDU_CODES: Final = frozenset((0x1, 0x2, 0x5, 0x6, 0x7, 0x8, 0xC, 0xD, 0xE, 0xF))
_DT: Final = 0xF0

# Answers of `judge_beginning`.
NO: Final = 0
YES: Final = 1
UNDECIDED: Final = 2

#: Faults of a TPKT header (`Framer.faults`).
BAD_VERSION: Final = "version"
BAD_LENGTH: Final = "length"


def plausible(octets: bytes, at: i64, end: i64) -> bool:
    """Tell whether a TPKT with a COTP TPDU may begin at ``at``: what is there of the first six octets fits.

    Wants the version, a zero reserved octet and a legal length to be there (four octets).
    """
    if end - at < HEADER or octets[at] != 3 or octets[at + 1] != 0:
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
    """Tell whether a TPKT begins at ``at``, judged as strictly as a place inside a segment needs (reference 1.3).

    Beyond `plausible`: a DT must be empty or carry a known protocol, and the TPKT must be followed by another plausible one
    or by the end of the octets. `UNDECIDED` when its end is still to come; ``octets[at]`` must be there.
    """
    if end - at < HEADER:
        return UNDECIDED if _may_follow(octets, at, end) else NO
    if not plausible(octets, at, end):
        return NO
    length: i64 = u16(octets, at + 2)
    follower: i64 = at + length
    if follower > end:
        return UNDECIDED if length <= MAX_SOUGHT else NO
    if octets[at + 5] & 0xF0 == _DT:
        data: i64 = at + 5 + octets[at + 4]
        if data < follower:
            upper: i64 = classify(octets, data, follower)
            if upper != S7COMM and upper != S7COMM_PLUS and upper != MMS and upper != TLS and upper != RDP:
                return NO
    return YES if follower == end or _may_follow(octets, follower, end) else NO


def _may_follow(octets: bytes, at: i64, end: i64) -> bool:
    """Tell whether the octets at ``at``, be they fewer than a header, fit the beginning of a TPKT."""
    if end - at >= HEADER:
        return plausible(octets, at, end)
    return octets[at] == 3 and (at + 1 == end or octets[at + 1] == 0)


class Fault:
    """A TPKT header that cannot be right: ``kind`` is `BAD_VERSION` or `BAD_LENGTH`, ``value`` what the field held."""

    __slots__ = ("kind", "value")

    def __init__(self, kind: str, value: int) -> None:
        self.kind = kind
        self.value = value


class Framer:
    """Finds TPKTs in the octets of one direction. ``packets`` collects whole ones (header included), in order.

    Every octet given is accounted for: ``framed`` (in whole TPKTs and in TPKTs told as cut) + ``skipped`` + ``buffered``.
    ``ends`` says of each packet how many octets were given up to its end; who takes the packets deletes one with each.
    """

    __slots__ = (
        "_candidates",
        "_need",
        "_sought",
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
        self.ends: list[int] = []
        self.pending: bytearray | None = None
        self._need: i64 = 0  # size of the pending TPKT, 0 while its header is not complete
        self._sought: bytes = b""  # while searching: octets from the first on with which a TPKT may begin
        self._candidates: list[int] = []  # the places in them where one may begin, if its end comes to fit
        self.skip: i64 = 0
        self.synced: bool = False
        self.packets: list[bytes] = []
        self.faults: list[Fault] = []
        self.framed: i64 = 0
        self.skipped: i64 = 0
        self.cut_packet: bytes = b""

    @property
    def buffered(self) -> int:
        """Octets held back: of an unfinished TPKT, or of what may become one."""
        return len(self.pending) if self.pending is not None else len(self._sought)

    @property
    def passed(self) -> int:
        """Octets given up to the end of the TPKT being told, those in holes left out."""
        if self.ends:
            return self.ends[0]
        return self.framed + self.skipped

    def push(self, octets: bytes, start: i64, at_segment_start: bool) -> None:
        """Take ``octets[start:]``; whole TPKTs are appended to ``packets``."""
        if self.ends and not self.packets:
            self.ends = []
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
                step: i64 = min(self.skip, end - at)
                self.skip -= step
                self.skipped += step
                at += step
            elif self.pending is not None:
                at = self._continue(octets, at, end)
            elif not self.synced:
                at = self._search(octets, at, max(at, fresh), end, at_segment_start and at <= fresh)
            else:
                at = self._begin(octets, at, end)

    def hole(self, size: i64, cut: bool) -> bool:
        """``size`` octets are missing here. True when the end of the TPKT they fall into is still known.

        When ``cut`` (the capture cut the frame), the TPKT begun is left in ``cut_packet`` as far as it was captured;
        otherwise its octets count as skipped.
        """
        self.cut_packet = b""
        if self.skip:
            self._pass_hole(self.skip, size)
            return self.synced
        pending = self.pending
        if pending is None:
            self.skipped += len(self._sought)
            self._sought = b""
            self._candidates = []
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
        """A hole of ``size`` where ``left`` octets of a TPKT were still to come."""
        if size <= left:
            self.skip = left - size
            self.synced = True
        else:
            self.skip = 0
            self.synced = False

    def _begin(self, octets: bytes, at: i64, end: i64) -> i64:
        """In step, at the first octet of a TPKT: take it whole, keep its beginning, or find it wrong."""
        if octets[at] != 3:
            self.faults.append(Fault(BAD_VERSION, octets[at]))
            self.synced = False
            return at
        if end - at < HEADER:
            self._keep(octets, at, 0)
            return end
        length: i64 = u16(octets, at + 2)
        if length < MIN_LENGTH:
            return self._short(octets, at, end, length)
        if at + length <= end:
            self.packets.append(octets[at : at + length])
            self.framed += length
            self.ends.append(self.framed + self.skipped)
            return at + length
        self._keep(octets, at, length)
        return end

    def _short(self, octets: bytes, at: i64, end: i64, length: i64) -> i64:
        """A length of 4 to 6 holds no whole TPDU and is stepped over; below 4 nothing can be stepped over."""
        self.faults.append(Fault(BAD_LENGTH, length))
        if length < HEADER:
            self.synced = False
            self.skipped += 1
            return at + 1
        step: i64 = min(length, end - at)
        self.skipped += step
        self.skip = length - step
        return at + step

    def _keep(self, octets: bytes, at: i64, need: i64) -> None:
        self.pending = bytearray(octets[at:])
        self._need = need

    def _continue(self, octets: bytes, at: i64, end: i64) -> i64:
        """Add to the TPKT begun. Linear: octets are appended once and looked at once."""
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
                    self.skipped += HEADER - 1  # the rest of the header went by with it
                return at
            self._need = length
            have = HEADER
        take = min(self._need - have, end - at)
        pending += octets[at : at + take]
        if have + take == self._need:
            self.packets.append(bytes(pending))
            self.framed += self._need
            self.ends.append(self.framed + self.skipped)
            self.pending = None
        return at + take

    def _search(self, octets: bytes, at: i64, fresh: i64, end: i64, segment_start: bool) -> i64:
        """Out of step: look for the next TPKT in ``octets[at:end]``, of which those before ``fresh`` were looked at before.

        When a segment starts at ``fresh``, as it usually does with a TPKT, that place comes first.
        """
        found: i64 = -1
        candidates: list[int] = []
        if segment_start and plausible(octets, fresh, end):
            found = fresh
        else:
            found = self._settle(octets, end, candidates)
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
            self._candidates = []
            self.synced = True
            self.skipped += found - at
            return found
        if fresh < end and octets[end - 1] == 3:
            candidates.append(end - 1)
        candidates = candidates[-_MAX_CANDIDATES:]
        keep: i64 = candidates[0] if candidates else end
        self._candidates = [place - keep for place in candidates]
        self._sought = octets[keep:]
        self.skipped += keep - at
        return end

    def _settle(self, octets: bytes, end: i64, undecided: list[int]) -> i64:
        """Return the first candidate that now is certain, -1 for none; those still open go to ``undecided``."""
        for place in self._candidates:
            judged: i64 = judge_beginning(octets, place, end)
            if judged == YES:
                return place
            if judged == UNDECIDED:
                undecided.append(place)
        return -1
