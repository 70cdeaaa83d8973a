"""Joins TSDUs to S7comm-plus PDUs.

A PDU that is too long for one frame continues in the next frames of its direction. Each frame is a separate TSDU with the
header ``72 version length``. Only the last frame has the trailer ``72 version 00 00`` after its data; the first frame looks
like the others. So a frame that has another version, or whose content can only be the beginning of a PDU (`is_beginning`), does
not continue the previous PDU, which is then over. The octets of a joined PDU are its frames one after another, as `parse_plus`
expects them.
"""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.protocols.s7plus.bodies import is_known, parse_contents
from dissect.protocols.s7plus.layouts import DIGEST, FILL
from dissect.protocols.s7plus.message import HEADER_SIZE, INTEGRITY_SIZE, is_beginning, parse_plus
from dissect.protocols.s7plus.plain import data_of
from dissect.protocols.s7plus.tables import FUNCTIONS, KEEP_ALIVE, NOTIFICATION, SYSTEM_EVENT, V1, V3
from dissect.protocols.s7plus.walk import MAX_WORK
from dissect.wire.octets import u16

#: Number of octets that are kept of a PDU in several frames; further octets are only counted. Downloads and answers to Explore
#: have several hundred thousand.
MAX_PDU: Final = 8 * 1024 * 1024
#: Maximum number of frames of a PDU that are kept: as many as 8 MiB need on a connection with the smallest TPDUs. A frame may
#: carry only one octet of data, but costs more than a hundred octets of memory when the PDU is read.
MAX_FRAMES: Final = 65_536
#: Maximum number of empty frames of a PDU before version 3 that may be skipped: each looks like the trailer, so the contents
#: decide. Larger PDUs, in octets, are not examined for this.
_MOST_EMPTY: Final = 64
_LARGEST_JUDGED: Final = 1 << 16
#: The parts at the end of contents, and the minimum number of zeros there.
_ENDS: Final = (FILL, DIGEST)
_ZEROS: Final = bytes(3)
#: The octets after the id of the subscription in each notification of V2 and V3 (reference S7comm-plus section 8).
_AFTER_SUBSCRIPTION: Final = b"\x04\x00\x00\x00\x00\x00"


def _begins(frame: bytes) -> bool:
    """Return whether a frame certainly begins a PDU: opcode, zeros and a known function are in the right places."""
    pdu = parse_plus(frame)
    if not is_beginning(pdu):
        return False
    if pdu.opcode == NOTIFICATION:
        # Compressed blobs contain arbitrary octets: a valid id alone would be found by chance once in some hundred frames.
        return pdu.subscription_id > 0x70000000 and pdu.data[5:11] == _AFTER_SUBSCRIPTION
    return pdu.function in FUNCTIONS and u16(pdu.data, 1) | u16(pdu.data, 5) == 0


def is_notification(octets: bytes) -> bool:
    """Return whether a PDU with the opcode of a notification is one; the rest of another PDU may begin with the same octet."""
    if len(octets) < HEADER_SIZE or octets[1] == V1:
        return True  # notifications of V1 have nothing that could be checked
    data, at, _ = data_of(octets)
    return data[at + 5 : at + 5 + len(_AFTER_SUBSCRIPTION)] == _AFTER_SUBSCRIPTION


def _without_data(version: i64) -> i64:
    """Return the size of a frame without data."""
    return HEADER_SIZE + (INTEGRITY_SIZE if version == V3 else 0)


def _is_complete(octets: bytes) -> bool:
    """Return whether frames may be a whole PDU, given a frame after them that is either the trailer or has no data.

    Contents end with zeros or a digest; any other end means that the PDU continues.
    """
    if octets[1] == V3 or len(octets) > _LARGEST_JUDGED:
        return True  # in that case a digest is in the frame without data
    pdu = parse_plus(octets)
    if not pdu.whole or pdu.malformed or not is_beginning(pdu):
        return False
    if not is_known(pdu):
        return pdu.data.endswith(_ZEROS)
    found = parse_contents(pdu, True, MAX_WORK)
    return found.exhausted or (found.whole and len(found.parts) > 0 and found.parts[-1].layout in _ENDS)


class PlusAssembler:
    """Joins the frames of one direction. ``parts`` is None between PDUs.

    ``passed``: the latest frame has no data and is not part of a PDU. ``left_out`` counts the octets of a PDU beyond ``most``,
    or after its first `MAX_FRAMES` frames. The caller sets these: ``begun_frame`` and ``begun_ns`` are packet and time of the
    first frame of a PDU in several frames, ``last_frame`` and ``last_ns`` those of the latest frame. ``holed``: octets before
    the next PDU are missing or were sent before the capture began, so it may be the rest of a PDU.
    """

    __slots__ = (
        "_carries",
        "_empty",
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
        "passed",
    )

    def __init__(self, most: i64 = MAX_PDU) -> None:
        self._most: i64 = most
        self._frames: i64 = 0  # kept frames of the unfinished PDU
        self._carries = False  # one of them has data
        self._empty: i64 = 0  # frames without data within it, before version 3; they are not kept
        self.asked: i64 = -1  # sequence number of the latest request, -1 for none
        self.notified: i64 = -1  # number of the latest notification, -1 for none
        self.parts: bytearray | None = None
        self.left_out: i64 = 0  # of the unfinished PDU
        self.passed = False
        self.begun_frame: i64 = 0
        self.begun_ns: i64 = 0
        self.last_frame: i64 = 0
        self.last_ns: i64 = 0
        self.holed: bool = False

    def push(self, tsdu: bytes) -> bytes | None:
        """Take a TSDU that begins with 0x72; return the PDU if it is now complete, else None."""
        size: i64 = len(tsdu)
        if size < HEADER_SIZE or tsdu[1] == SYSTEM_EVENT or tsdu[1] == KEEP_ALIVE:
            return tsdu  # a separate PDU, even between the frames of another one
        ends: bool = HEADER_SIZE + u16(tsdu, 2) != size  # a trailer follows, or it is damaged
        parts = self.parts
        self.passed = False
        if parts is not None and size == HEADER_SIZE and not ends:
            ends = self._empty >= _MOST_EMPTY or _is_complete(bytes(parts) + tsdu)
            self.passed = not ends
            if self.passed:
                self._empty += 1
                return None
        if parts is None:
            self.left_out = 0
            if ends:
                return tsdu
            self.parts = bytearray(tsdu)
            self._frames = 1
            self._empty = 0
            self._carries = size > _without_data(tsdu[1])
            return None
        if self.left_out or self._frames >= MAX_FRAMES or len(parts) + size > self._most:
            self.left_out += size
        else:
            parts += tsdu
            self._frames += 1
            self._carries = self._carries or size > _without_data(tsdu[1])
        return self.finish() if ends else None

    def interrupted(self, tsdu: bytes) -> bool:
        """Return whether ``tsdu`` begins another PDU while one is unfinished; then call `finish` first."""
        parts = self.parts
        if parts is None or len(tsdu) <= HEADER_SIZE or tsdu[1] == SYSTEM_EVENT or tsdu[1] == KEEP_ALIVE:
            return False
        if not self._carries:
            return False  # only empty frames came before it
        return tsdu[1] != parts[1] or _begins(tsdu)

    def finish(self) -> bytes:
        """Return the received part of an unfinished PDU, empty if there is none; the next frame begins another PDU."""
        parts = self.parts
        self.parts = None
        return bytes(parts) if parts is not None else b""
