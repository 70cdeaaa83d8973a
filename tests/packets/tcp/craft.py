"""IP packets and fragments made for the tests, without the package under test."""

from __future__ import annotations

import struct
from typing import Final

TCP: Final = 6
UDP: Final = 17
SRC: Final = bytes((10, 0, 0, 1))
DST: Final = bytes((10, 0, 0, 2))
SRC6: Final = bytes.fromhex("20010db8000000000000000000000001")
DST6: Final = bytes.fromhex("20010db8000000000000000000000002")


def v4(
    payload: bytes,
    *,
    protocol: int = TCP,
    options: bytes = b"",
    flags: int = 0,
    identification: int = 0x1234,
    total: int | None = None,
    ihl: int | None = None,
) -> bytes:
    """An IPv4 packet; ``flags`` is the word of flags and fragment offset."""
    size = 20 + len(options)
    words = size // 4 if ihl is None else ihl
    length = size + len(payload) if total is None else total
    head = struct.pack(">BBHHHBBH", 0x40 | words, 0, length, identification, flags, 64, protocol, 0)
    return head + SRC + DST + options + payload


def v6(payload: bytes, *, next_header: int = TCP, length: int | None = None) -> bytes:
    """An IPv6 packet; extension headers are part of the payload."""
    size = len(payload) if length is None else length
    return struct.pack(">IHBB", 6 << 28, size, next_header, 64) + SRC6 + DST6 + payload


def extension(next_header: int, units: int = 0, fill: int = 0) -> bytes:
    """A hop-by-hop, routing, destination, mobility … header of 8 + 8 * ``units`` octets."""
    return bytes((next_header, units)) + bytes((fill,)) * (6 + units * 8)


def authentication(next_header: int, words: int = 4) -> bytes:
    """An authentication header (RFC 4302: its length counts 4 octets and begins at minus 2)."""
    return bytes((next_header, words)) + bytes(words * 4 + 6)


def fragment_header(next_header: int, offset: int, more: bool, identification: int = 0x12345678) -> bytes:
    """An IPv6 fragment header; ``offset`` in octets."""
    return struct.pack(">BBHI", next_header, 0, offset | more, identification)
