"""From TSDUs to S7comm-plus PDUs.

A PDU that is too long for one frame goes on in the following frames of its direction, each in a TSDU of its own with the
header ``72 version length``; only the last has the trailer ``72 version 00 00`` behind its data, and nothing else tells the
first from the others. So what begins a PDU by all that its octets say (`is_beginning`), or has another version, goes on
nothing: what was begun before is all there will be of it. The octets of a joined PDU are those frames one behind the
other, which is what `parse_plus` reads.
"""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.s7plus.message import HEADER_SIZE, INTEGRITY_SIZE, is_beginning, parse_plus
from dissect.s7plus.tables import FUNCTIONS, KEEP_ALIVE, NOTIFICATION, SYSTEM_EVENT, V1, V3
from dissect.wire.octets import u16

#: Octets of a PDU in several frames that are kept; what comes after them is counted only. Downloads and answers to Explore take
#: several hundred thousand.
MAX_PDU: Final = 8 * 1024 * 1024
#: Frames of a PDU that are kept: as many as 8 MiB take on a connection with the smallest TPDUs. Each costs more than a hundred
#: octets when the PDU is read, and needs to carry only one.
MAX_FRAMES: Final = 65_536
#: What follows the subscription's id in every notification of V2 and V3 (reference S7comm-plus section 8).
_AFTER_SUBSCRIPTION: Final = b"\x04\x00\x00\x00\x00\x00"


def _begins(frame: bytes) -> bool:
    """Tell whether a frame begins a PDU, so surely that it cannot go on one: opcode, zeros and known function are there."""
    pdu = parse_plus(frame, cut=True)
    if not is_beginning(pdu):
        return False
    if pdu.opcode == NOTIFICATION:
        # Compressed blobs go through all octets: the id alone is met by chance once in some hundred frames.
        return pdu.subscription_id > 0x70000000 and pdu.data[5:11] == _AFTER_SUBSCRIPTION
    return pdu.function in FUNCTIONS and u16(pdu.data, 1) | u16(pdu.data, 5) == 0


def is_notification(octets: bytes) -> bool:
    """Tell whether a PDU with the opcode of a notification is one: the rest of a PDU may begin with that octet as well."""
    if len(octets) < HEADER_SIZE or octets[1] == V1:
        return True  # that form has nothing by which to tell
    at: i64 = HEADER_SIZE + 5 + (INTEGRITY_SIZE if octets[1] == V3 else 0)
    return octets[at : at + len(_AFTER_SUBSCRIPTION)] == _AFTER_SUBSCRIPTION


class PlusAssembler:
    """Joins the frames of one direction. ``parts`` is None between PDUs.

    ``left_out`` counts the octets of a PDU past ``most``, or past its first `MAX_FRAMES` frames.
    ``begun_frame`` and ``begun_ns`` are for who feeds it: packet and time of the first frame of a PDU in several, and
    ``last_frame`` and ``last_ns`` those of the latest. So is ``holed``: octets are missing before the next PDU, or were sent
    before the capture, so that it may be the rest of one.
    """

    __slots__ = (
        "_frames",
        "_most",
        "asked",
        "begun_frame",
        "begun_ns",
        "holed",
        "last_frame",
        "last_ns",
        "left_out",
        "notified",
        "parts",
    )

    def __init__(self, most: i64 = MAX_PDU) -> None:
        self._most: i64 = most
        self._frames: i64 = 0  # of the PDU at hand that are kept
        self.asked: i64 = -1  # sequence number of the latest request, -1 for none
        self.notified: i64 = -1  # number of the latest notification, -1 for none
        self.parts: bytearray | None = None
        self.left_out: i64 = 0  # of the PDU at hand
        self.begun_frame: i64 = 0
        self.begun_ns: i64 = 0
        self.last_frame: i64 = 0
        self.last_ns: i64 = 0
        self.holed: bool = False

    def push(self, tsdu: bytes) -> bytes | None:
        """Take a TSDU that begins with 0x72; return the PDU when it is whole, else None."""
        size: i64 = len(tsdu)
        if size < HEADER_SIZE or tsdu[1] == SYSTEM_EVENT or tsdu[1] == KEEP_ALIVE:
            return tsdu  # stands for itself, also between the frames of another PDU
        ends: bool = HEADER_SIZE + u16(tsdu, 2) != size  # a trailer follows, or it is damaged
        parts = self.parts
        if parts is None:
            self.left_out = 0
            if ends:
                return tsdu
            self.parts = bytearray(tsdu)
            self._frames = 1
            return None
        if self.left_out or self._frames >= MAX_FRAMES or len(parts) + size > self._most:
            self.left_out += size
        else:
            parts += tsdu
            self._frames += 1
        return self.finish() if ends else None

    def interrupted(self, tsdu: bytes) -> bool:
        """Tell whether ``tsdu`` begins another PDU while one is not finished; `finish` it first."""
        parts = self.parts
        if parts is None or len(tsdu) <= HEADER_SIZE or tsdu[1] == SYSTEM_EVENT or tsdu[1] == KEEP_ALIVE:
            return False
        return tsdu[1] != parts[1] or _begins(tsdu)

    def finish(self) -> bytes:
        """Return what there is of an unfinished PDU, empty for none; the next frame begins another."""
        parts = self.parts
        self.parts = None
        return bytes(parts) if parts is not None else b""
