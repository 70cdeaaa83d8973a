"""Whether the checksum of a TCP segment or UDP datagram is right (RFC 9293 section 3.1, RFC 768; IPv6: RFC 8200 section 8.1).

Ones' complement arithmetic is arithmetic modulo 65535, which lets whole numbers of any length do the adding.
"""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.tcp.ip import TCP
from dissect.wire.octets import u16

_MODULUS: Final = 0xFFFF
#: Where the checksum stands in the header.
_IN_TCP: Final = 16
_IN_UDP: Final = 6


def is_damaged(addresses: bytes, protocol: i64, buf: bytes, at: i64, end: i64) -> bool:
    """Tell whether the checksum of the whole segment or datagram ``buf[at:end]`` is wrong.

    ``addresses`` are those of the IP header, the sender's first. A packet captured on the computer that sends it may bear
    the sum of the pseudo header only, and its network card does the rest: that is no damage. Nor is a UDP datagram without.
    """
    where: i64 = at + (_IN_TCP if protocol == TCP else _IN_UDP)
    stated: i64 = u16(buf, where)
    if stated == 0 and protocol != TCP:
        return False
    size: i64 = end - at
    content: i64 = _sum(buf[at:end])
    head: i64 = _sum(addresses) + protocol
    if (head + size + content) % _MODULUS == 0:
        return False
    left = stated % _MODULUS
    # Where the card also cuts what is too long into segments, it adds their lengths itself.
    return left != (head + size) % _MODULUS and left != head % _MODULUS


def _sum(octets: bytes) -> i64:
    total = int.from_bytes(octets, "big")
    if len(octets) & 1:
        total <<= 8
    return total % _MODULUS
