"""S7comm-plus PDUs as tests need them: frames, heads, and two PDUs of published captures."""

from __future__ import annotations

import struct
from typing import Final

CREATE_OBJECT: Final = 0x04CA
SET_VARIABLE: Final = 0x04F2
GET_MULTI: Final = 0x054C
INIT_SSL: Final = 0x05B3
ERROR: Final = 0x04B1

#: A response of version 3, and a notification; the digests are the original ones.
RESPONSE_V3: Final = bytes.fromhex(
    "72030043203dcac8ee113108f0defe64eff4faf6106fe1fa3d75064cde9b8314d9f1e276a3320000054c0000831d3400010004010200088372030008"
    "be04000083a1100000000072030000"
)
NOTIFICATION_V3: Final = bytes.fromhex(
    "7203004c20858c8cc6515200791f6d4a7e8f8e05e765695838645e875af747f0fd2c904e743370000e51040000000000d28ec151019200000019000e"
    "417e964c920000001b000e4193dfbe000000000072030000"
)


def framed(data: bytes, version: int = 2, trailer: bool = True) -> bytes:
    """A frame; in version 3 with a digest of 0x5a."""
    content = b"\x20" + b"\x5a" * 32 + data if version == 3 else data
    end = bytes((0x72, version, 0, 0)) if trailer else b""
    return bytes((0x72, version)) + len(content).to_bytes(2, "big") + content + end


def asked(
    sequence: int, function: int = GET_MULTI, session: int = 0x386, flags: int = 0x34, body: bytes = b""
) -> bytes:
    return struct.pack(">BHHHHIB", 0x31, 0, function, 0, sequence, session, flags) + body


def told(sequence: int, function: int = GET_MULTI, body: bytes = b"\x00", opcode: int = 0x32) -> bytes:
    return struct.pack(">BHHHHB", opcode, 0, function, 0, sequence, 0x34) + body


def notified(number: int = 5, subscription: int = 0x70000E51) -> bytes:
    return struct.pack(">BIHHHB", 0x33, subscription, 0x0400, 0, 0, 1) + bytes((number,)) + b"\x01\x00"


def event(confirmed: int, message: bytes = b"") -> bytes:
    content = struct.pack(">IIII", 0, confirmed, 0, 0) + message
    return b"\x72\xfe" + len(content).to_bytes(2, "big") + content


KEEP_ALIVE: Final = b"\x72\xff\x07\x00"
