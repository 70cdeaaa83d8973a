"""Compares PDUs without the numbers that differ in each PDU, to recognise repeated ones.

These numbers are the digest, the sequence number, the session of a request, and the integrity id. Sound PDUs with the same
`Seen.kind` and `Seen.body` have the same length and the same contents at the same offsets, apart from the integrity id.
tests/protocols/s7plus/test_sameness.py checks that against `dissect.protocols.s7plus.bodies`.
"""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.protocols.s7plus.ending import FILL
from dissect.protocols.s7plus.grammar import ending_with_objects
from dissect.protocols.s7plus.message import SHORT_HEADS
from dissect.protocols.s7plus.plain import NOTIFICATION_SIZE, REQUEST_SIZE, RESPONSE_SIZE, SESSION_AT, one_frame
from dissect.protocols.s7plus.tables import (
    EXPLORE,
    NOTIFICATION,
    REQUEST,
    RESPONSE,
    V1,
    V3,
)
from dissect.wire.octets import u16, u32
from dissect.wire.varint import VLQ, VLQ64, read_varint

#: Size of the longest PDU that is compared.
_LONGEST: Final = 4096
_BIT_7: Final = 0x80
_FLAGS: Final = 9  # of a response; its return value follows
_CREDIT: Final = 11
_ID: Final = 4
#: Minimum number of zeros at the end of a PDU of version 3 (`FILL` is the maximum); size of the longest integrity id that is
#: recognised.
_LEAST_FILL: Final = 4
_LONGEST_ID: Final = 4
#: Requests and responses whose contents may end with objects: only the next octets decide whether another object follows.
_OPEN_REQUESTS: Final = ending_with_objects(True)
_OPEN_RESPONSES: Final = ending_with_objects(False)


class Seen:
    """The current PDU. The caller sets ``alike``: whether it was taken for one of the equal PDUs.

    ``kind`` and ``body`` are the parts that it has in common with others. ``has_id``: ``integrity_id`` was found where sound
    PDUs have it, and is not part of ``body``. ``session`` is session, transport flags and version of a request as one number.
    Numbers that the PDU does not have are -1.
    """

    __slots__ = (
        "alike",
        "at",
        "body",
        "credit_tick",
        "has_id",
        "integrity_id",
        "kind",
        "number",
        "octets",
        "opcode",
        "session",
        "subscription_id",
        "version",
    )

    def __init__(self) -> None:
        self.alike = False
        self.octets = b""
        self.body = b""
        self.at: i64 = 0  # offset of the data
        self.kind: i64 = 0
        self.version: i64 = 0
        self.opcode: i64 = 0
        self.session: i64 = -1
        self.subscription_id: i64 = -1
        self.number: i64 = -1
        self.credit_tick: i64 = -1
        self.has_id = False
        self.integrity_id: i64 = -1

    def read(self, octets: bytes) -> bool:
        """Take a PDU; return False if it is not compared with others. Never raises."""
        at, end = one_frame(octets)
        size: i64 = end - at
        self.alike = at >= 0 and NOTIFICATION_SIZE <= size <= _LONGEST and self._take(octets, at, end)
        return self.alike

    def _take(self, octets: bytes, at: i64, end: i64) -> bool:
        self.octets = octets
        self.at = at
        self.version = octets[1]
        self.opcode = octets[at]
        self.has_id = False
        self.integrity_id = -1
        if self.opcode == NOTIFICATION:
            return self._notification(octets, at, end)
        function = u16(octets, at + 3)
        if self.opcode == REQUEST:
            return end - at >= REQUEST_SIZE and self._request_of(octets, at, end, function)
        return self.opcode == RESPONSE and self._response(octets, at, end, function)

    def _notification(self, octets: bytes, at: i64, end: i64) -> bool:
        if self.version == V1:
            return False
        begin: i64 = at + NOTIFICATION_SIZE
        behind: i64 = begin
        self.subscription_id = u32(octets, at + 1)
        self.credit_tick = octets[at + _CREDIT]
        self.number = self.credit_tick
        if self.subscription_id >= SHORT_HEADS:
            number, after = read_varint(octets, begin, end, VLQ)
            if after < 0:
                return False
            self.number = number
            behind = after
        self._name(self.subscription_id, behind - begin)
        self.body = octets[behind:end]
        return True

    def _request_of(self, octets: bytes, at: i64, end: i64, function: i64) -> bool:
        self.session = (u32(octets, at + SESSION_AT) << 8 | octets[at + REQUEST_SIZE - 1]) << 8 | self.version
        stop: i64 = end
        if self.version == V3:
            if function in _OPEN_REQUESTS:
                return False
            stop = self._id(octets, at + REQUEST_SIZE, end)
            if stop < 0:
                return False
        self._name(function, end - stop)
        self.body = octets[at + REQUEST_SIZE : stop]
        return True

    def _response(self, octets: bytes, at: i64, end: i64, function: i64) -> bool:
        stop: i64 = end
        if self.version == V3:
            if function == EXPLORE:
                return self._explored(octets, at, end)
            if function in _OPEN_RESPONSES:
                return False
            stop = self._id(octets, at + RESPONSE_SIZE, end)
            if stop < 0:
                return False
        self._name(function, end - stop)
        self.body = octets[at + _FLAGS : stop]
        return True

    def _explored(self, octets: bytes, at: i64, end: i64) -> bool:
        """Take a response to Explore, which has its integrity id before the objects."""
        stop: i64 = read_varint(octets, at + RESPONSE_SIZE, end, VLQ64)[1]
        if stop < 0:
            return False
        stop += _ID
        if stop >= end:
            return False
        number, after = read_varint(octets, stop, end, VLQ)
        if after < 0:
            return False
        self.has_id = True
        self.integrity_id = number
        self._name(EXPLORE, after - stop)
        self.body = octets[at + _FLAGS : stop] + octets[after:end]
        return True

    def _id(self, octets: bytes, begin: i64, end: i64) -> i64:
        """Find the integrity id before the zeros that end a PDU; return its offset, -1 if that is not certain.

        It does not begin with an octet that adds nothing to its number, because an id read from another offset would be another
        number.
        """
        last: i64 = end - 1
        while last >= begin and octets[last] == 0 and end - last <= FILL + 1:
            last -= 1
        if last < begin:
            return -1
        if octets[last] >= _BIT_7:
            last += 1  # the last octet of the id may itself be a zero
        fill: i64 = end - last - 1
        if fill < _LEAST_FILL or fill > FILL:
            return -1
        at: i64 = last
        while at > begin and octets[at - 1] >= _BIT_7:
            at -= 1
        if last - at >= _LONGEST_ID or octets[at] == _BIT_7:
            return -1
        self.has_id = True
        number: i64 = 0
        first: i64 = at
        while at <= last:
            number = number << 7 | octets[at] & (_BIT_7 - 1)
            at += 1
        self.integrity_id = number
        return first

    def _name(self, what: i64, size: i64) -> None:
        """Set ``kind`` from a function or subscription, and the number of octets that are not in ``body``."""
        self.kind = ((what << 4 | size) << 8 | self.version) << 8 | self.opcode
