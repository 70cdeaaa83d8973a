"""Reads in place, without making an object, the head of a PDU that is one sound frame, as most are.

Other PDUs are left to `dissect.protocols.s7plus.message`, which finds their faults and the places of these. A property test
ensures that both agree (tests/protocols/s7plus/test_plain.py).
"""

from __future__ import annotations

from typing import Final

from librt.strings import read_i64_be
from mypy_extensions import i64

from dissect.protocols.s7plus.message import DIGEST_SIZE, HEADER_SIZE, SHORT_HEADS, PlusPdu, is_beginning, parse_plus
from dissect.protocols.s7plus.tables import (
    FUNCTIONS,
    NO_RESPONSE,
    NOTIFICATION,
    PROTOCOL_ID,
    REQUEST,
    RESPONSE,
    RESPONSE2,
    V1,
    V2,
    V3,
)
from dissect.wire.octets import u32
from dissect.wire.varint import VLQ, VLQ64, read_varint

_TRAILER: Final = 4
#: Octets of the fixed part of a request, a response and a notification.
REQUEST_SIZE: Final = 14
RESPONSE_SIZE: Final = 10
NOTIFICATION_SIZE: Final = 12
#: Offsets in the data of a request: sequence number and session id.
SEQUENCE_AT: Final = 7
SESSION_AT: Final = 9
#: The reserved fields in the eight octets after the opcode of a request or response.
_RESERVED: Final = -1 << 48 | 0xFFFF0000
_BIT_7: Final = 0x80
_FUNCTIONS: Final = frozenset([row.number for row in FUNCTIONS])


def one_frame(octets: bytes) -> tuple[i64, i64]:
    """Return where the data of a PDU begin and end if it is one sound frame with a trailer; (-1, -1) for any other PDU."""
    end: i64 = len(octets) - _TRAILER
    if end < HEADER_SIZE:
        return -1, -1
    head: i64 = u32(octets, 0)
    version: i64 = head >> 16 & 0xFF
    if head >> 24 != PROTOCOL_ID or u32(octets, end) != PROTOCOL_ID << 24 | version << 16:
        return -1, -1
    at: i64 = HEADER_SIZE
    if version == V3:
        if end <= at or octets[at] != DIGEST_SIZE:
            return -1, -1
        at += 1 + DIGEST_SIZE
    elif version != V2 and version != V1:
        return -1, -1
    if at > end or head & 0xFFFF != end - HEADER_SIZE:
        return -1, -1
    return at, end


def data_of(octets: bytes) -> tuple[bytes, i64, i64]:
    """Return the data of a PDU, from the opcode on: octets that hold it, and where it begins and ends within them.

    Only this module knows the frames: code that reads numbers at fixed offsets of a PDU calls this first. Never raises.
    """
    at, end = one_frame(octets)
    if at >= 0:
        return octets, at, end
    data = parse_plus(octets).data
    return data, 0, len(data)


class Head:
    """The head of a PDU as the engine needs it; missing numbers are -1, as in `PlusPdu`. One object is used for many PDUs.

    ``begins`` is the result of `is_beginning`. ``at`` and ``end``, where its data begin and end, are set only by `read_plain`.
    """

    __slots__ = (
        "at",
        "begins",
        "end",
        "frames",
        "function",
        "opcode",
        "sequence",
        "subscription_id",
        "version",
        "wants_response",
    )

    def __init__(self) -> None:
        self.at: i64 = 0
        self.end: i64 = 0
        self.version: i64 = -1
        self.frames: i64 = 0
        self.opcode: i64 = -1
        self.function: i64 = -1
        self.sequence: i64 = -1
        self.subscription_id: i64 = -1
        self.begins = False
        self.wants_response = False

    def read_plain(self, octets: bytes) -> bool:
        """Read the head of a PDU that is one sound frame; return False for any other, for which `take` is used.

        Never raises.
        """
        at, end = one_frame(octets)
        if at < 0 or at >= end:
            return False
        opcode: i64 = octets[at]
        version: i64 = octets[1]
        if opcode == NOTIFICATION:
            if version == V1 or end - at < NOTIFICATION_SIZE:
                return False
            self.function = -1
            self.subscription_id = u32(octets, at + 1)
            if self.subscription_id < SHORT_HEADS:
                self.sequence = octets[at + NOTIFICATION_SIZE - 1]
            else:
                self.sequence = _number(octets, at + NOTIFICATION_SIZE, end)
            self.wants_response = False
        else:
            request: bool = opcode == REQUEST
            size: i64 = RESPONSE_SIZE
            if request:
                size = REQUEST_SIZE
            if (not request and opcode != RESPONSE and opcode != RESPONSE2) or end - at < size:
                return False
            word: i64 = i64(read_i64_be(octets, at + 1))  # reserved, function, reserved, sequence number
            function: i64 = word >> 32 & 0xFFFF
            if word & _RESERVED != 0 and function not in _FUNCTIONS:
                return False
            self.function = function
            self.subscription_id = -1
            self.sequence = word & 0xFFFF
            flags: i64 = NO_RESPONSE
            if request:
                flags = octets[at + REQUEST_SIZE - 1]
            self.wants_response = flags & NO_RESPONSE == 0
        self.at = at
        self.end = end
        self.version = version
        self.frames = 1
        self.opcode = opcode
        self.begins = True
        return True

    def take(self, pdu: PlusPdu) -> None:
        """Copy the head of a PDU of any kind."""
        self.version = pdu.version
        self.frames = pdu.frames
        self.opcode = pdu.opcode
        self.function = pdu.function
        self.sequence = pdu.sequence
        self.subscription_id = pdu.subscription_id
        self.begins = is_beginning(pdu)
        self.wants_response = pdu.wants_response

    def return_code(self, octets: bytes) -> i64:
        """Return the lower 16 bits of the return value of the response that was read last, -1 if there is none."""
        at: i64 = self.at + RESPONSE_SIZE
        if self.opcode == REQUEST or self.function not in _FUNCTIONS:
            return -1
        if at < self.end and octets[at] < _BIT_7:
            return octets[at]
        value, behind = read_varint(octets, at, self.end, VLQ64)
        return value & 0xFFFF if behind > 0 else -1


def _number(octets: bytes, at: i64, end: i64) -> i64:
    """Read an unsigned number of at most 32 bits, -1 if there is none."""
    if at < end and octets[at] < _BIT_7:
        return octets[at]
    if at + 1 < end and octets[at + 1] < _BIT_7:
        first: i64 = octets[at]
        second: i64 = octets[at + 1]
        return (first & (_BIT_7 - 1)) << 7 | second
    return read_varint(octets, at, end, VLQ)[0]
