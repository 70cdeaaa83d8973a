"""Framing of one direction of an IBH-NetLink connection, and how such a connection is recognised (docs/ibh.md).

A packet begins with two channel numbers and has its length in the third octet. That is weak evidence. So while the framer is
out of step, a packet counts only if its flags are known and its MPI header, if it has one, matches the first header. In step,
any length counts. But if a certain packet begins inside an uncertain one, the length of the outer one was wrong, and the outer
one ends there.
"""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.protocols.ibh.packet import BEFORE_DATA, HEADER, little, mpi_head
from dissect.protocols.ibh.tables import SERVICES
from dissect.protocols.iso.upper import stated_size

#: Size of the longest packet in octets; its length field is one octet.
MAX_PACKET: Final = HEADER + 255
_LENGTH_AT: Final = 2
_CHANNELS: Final = frozenset((0x00, 0x01, 0x07, 0x10))
_GATEWAY: Final = 0xFF
#: The version octet of a TPKT, the first octet on nearly every connection to a PLC; it is not a channel.
_TPKT: Final = 3
_DEVICE: Final = frozenset(((0x00, 0x10), (0x10, 0x00)))
#: The claim of a connection number, which a client sends first: this function, and these octets after the number.
_CLAIM: Final = 0x97
_CLAIM_REST: Final = b"\xff\xf0\xf0\xf0\xf0"
_CLAIM_SIZE: Final = 14

# Results of `judge_beginning`.
NO: Final = 0
YES: Final = 1
UNDECIDED: Final = 2


def channels_fit(octets: bytes, at: i64, end: i64) -> bool:
    """Return whether the octets are a known pair of channel numbers, judged by those that are present (at least one)."""
    first: i64 = octets[at]
    if end - at < 2:
        return first == _GATEWAY or first in _CHANNELS
    second: i64 = octets[at + 1]
    if first == _GATEWAY:
        return second in _CHANNELS
    return (second == _GATEWAY and first in _CHANNELS) or (first, second) in _DEVICE


def flags_fit(octets: bytes, at: i64) -> bool:
    """Return whether a header, which must be complete, requests a known service or answers one."""
    answered: i64 = little(octets, at + 4)
    asked: i64 = little(octets, at + 6)
    if asked:
        return answered == 0 and asked in SERVICES
    return answered != 0 and (answered & 0xFF) != 0 and (answered & 0xFF) in SERVICES


def opens(octets: bytes, on_port: bool, at_start: bool) -> bool:
    """Return whether the octets of a segment are IBH-NetLink; ``at_start``: they are the first octets that their side sent.

    On the gateway's own port (``on_port``) a known pair of channels with known flags is sufficient; at the start, the beginning
    of such a header is. On other ports it must be certain.
    """
    end: i64 = len(octets)
    if not octets or octets[0] == _TPKT:
        return False
    if not on_port:
        return judge_beginning(octets, 0, end) == YES
    if not channels_fit(octets, 0, end):
        return False
    return at_start if end < HEADER else flags_fit(octets, 0)


def judge_beginning(octets: bytes, at: i64, end: i64) -> i64:
    """Return whether a packet certainly begins at ``at``: `YES`, `NO`, or `UNDECIDED` if more octets are needed.

    A packet is certain if it has an MPI header whose length agrees with that of the packet, or if it is the claim of a
    connection number, which opens a connection.
    """
    if not channels_fit(octets, at, end):
        return NO
    if end - at < HEADER:
        return UNDECIDED
    if little(octets, at + 4) != 0:
        return NO
    asked: i64 = little(octets, at + 6)
    length: i64 = octets[at + _LENGTH_AT]
    if asked == _CLAIM:
        if HEADER + length != _CLAIM_SIZE:
            return NO
        if end - at == HEADER:
            return UNDECIDED
        rest = octets[at + HEADER + 1 : min(end, at + _CLAIM_SIZE)]
        if rest == _CLAIM_REST:
            return YES
        return UNDECIDED if end - at < _CLAIM_SIZE and _CLAIM_REST.startswith(rest) else NO
    head: i64 = mpi_head(asked)
    if head == 0:
        return NO
    if length <= head:
        return NO
    if end - at < HEADER + head:
        return UNDECIDED
    return YES if octets[at + HEADER + head - 1] == length - head else NO


def _size(octets: bytes, at: i64, end: i64) -> i64:
    """Return the size of the packet at ``at``; its length field must be present.

    An MPI header may state a smaller size. This size counts if the octets after it look like a packet, unless the S7 PDU in the
    packet ends, by its own lengths, where the packet ends.
    """
    size: i64 = HEADER + octets[at + _LENGTH_AT]
    head: i64 = mpi_head(little(octets, at + 6)) if end - at >= HEADER else 0
    if head and size >= HEADER + head and end - at >= HEADER + head:
        stated: i64 = HEADER + head + octets[at + HEADER + head - 1]
        pdu: i64 = at + HEADER + head + BEFORE_DATA
        if stated < size and at + stated < end and channels_fit(octets, at + stated, end):
            if at + size > end or stated_size(octets, pdu, at + size) != at + size - pdu:
                return stated
    return size


def _find_certain(octets: bytes, at: i64, stop: i64, end: i64) -> i64:
    """Return where a certain packet begins inside the one at ``at``, before ``stop``; -1 for none or if ``at`` is certain."""
    if judge_beginning(octets, at, end) != NO:
        return -1
    for place in range(at + 1, stop):
        if judge_beginning(octets, place, end) == YES:
            return place
    return -1


class PacketFramer:
    """Finds packets in the octets of one direction. ``packets`` collects complete ones, with their headers, in order.

    Each octet is counted once: in ``framed`` (in complete packets, and in packets reported as cut), ``skipped`` or
    ``buffered``. ``faults`` are the first octets found where a packet should begin. ``hiding`` counts packets whose length
    covered other packets. ``ends`` has, for each packet, the number of octets pushed up to its end; the caller deletes one
    entry with each packet that it takes.
    """

    __slots__ = ("_held", "cut_packet", "ends", "faults", "framed", "hiding", "packets", "skip", "skipped", "synced")

    def __init__(self) -> None:
        self._held: bytes = b""  # octets of an unfinished packet or, out of step, of a possible one
        self.skip: i64 = 0  # number of octets still to come of a packet that contains a gap
        self.synced: bool = False
        self.packets: list[bytes] = []
        self.ends: list[int] = []
        self.faults: list[int] = []
        self.hiding: i64 = 0
        self.framed: i64 = 0
        self.skipped: i64 = 0
        self.cut_packet: bytes = b""

    @property
    def buffered(self) -> int:
        """Number of octets held back: of an unfinished packet, or of a possible one."""
        return len(self._held)

    @property
    def passed(self) -> int:
        """Number of octets pushed up to the end of the current packet, without those in gaps."""
        if self.ends:
            return self.ends[0]
        return self.framed + self.skipped

    def push(self, octets: bytes) -> None:
        """Take the octets of a segment; append complete packets to ``packets``."""
        if self.ends and not self.packets:
            self.ends = []
        at: i64 = min(self.skip, len(octets))
        if at:
            self.skip -= at
            self.skipped += at
        if at == len(octets):
            return
        if self._held:
            if self.synced and at == 0 and self._begun_anew(octets):
                self.hiding += 1
                self.skipped += len(self._held)
            else:
                octets = self._held + octets
            self._held = b""
        elif not self.synced and at == 0:
            # A segment usually begins with a packet, so less evidence is sufficient here.
            self.synced = len(octets) >= HEADER and channels_fit(octets, 0, HEADER) and flags_fit(octets, 0)
        end: i64 = len(octets)
        while at < end:
            if not self.synced:
                at = self._search(octets, at, end)
                if not self.synced:
                    break
            if not channels_fit(octets, at, end):
                self.faults.append(octets[at])
                self.synced = False
                continue
            if end - at <= _LENGTH_AT:
                break
            size: i64 = _size(octets, at, end)
            inside: i64 = _find_certain(octets, at, min(end, at + size), end)
            if inside >= 0:
                self.hiding += 1
                size = inside - at
            if at + size > end:
                break
            if size < HEADER:
                self.skipped += size
                at += size
                continue
            self.packets.append(octets[at : at + size])
            self.framed += size
            self.ends.append(self.framed + self.skipped)
            at += size
        self._held = octets[at:end]

    def hole(self, size: i64, cut: bool) -> bool:
        """``size`` octets are missing here. Return True if the end of the packet that contains the gap is still known.

        If ``cut`` (the capture cut the frame), the captured part of the packet is put into ``cut_packet``; else its octets
        count as skipped.
        """
        held = self._held
        self._held = b""
        self.cut_packet = b""
        left: i64 = self.skip
        if held and self.synced:
            have: i64 = len(held)
            if cut:
                self.cut_packet = held
                self.framed += have
            else:
                self.skipped += have
            left = HEADER + held[_LENGTH_AT] - have if have > _LENGTH_AT else 0
        else:
            self.skipped += len(held)
        self.synced = 0 < size <= left
        self.skip = left - size if self.synced else 0
        return self.synced

    def _begun_anew(self, octets: bytes) -> bool:
        """Return whether a segment begins with a certain packet, so that the unfinished packet will never be complete."""
        end: i64 = len(octets)
        have: i64 = len(self._held)
        if judge_beginning(octets, 0, end) != YES:
            return False
        if have <= _LENGTH_AT:
            return True
        return HEADER + octets[_LENGTH_AT] <= end

    def _search(self, octets: bytes, at: i64, end: i64) -> i64:
        """Return where the next packet certainly begins, and be in step again; else the first place where one may begin."""
        here: i64 = at
        while here < end:
            judged: i64 = judge_beginning(octets, here, end)
            if judged != NO:
                self.synced = judged == YES
                break
            here += 1
        self.skipped += here - at
        return here
