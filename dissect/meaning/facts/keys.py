"""Identifiers of connections for other tools: Community ID, and a uid in the form of Zeek's."""

from __future__ import annotations

import base64
import hashlib
import struct
from typing import Final

from dissect.engine.transactions.connection import Connection
from dissect.packets.tcp.stream import Endpoint

_TCP: Final = 6
_UDP: Final = 17
#: Digits of Zeek's uids, the least significant first.
_DIGITS: Final = "0123456789abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ"


def community_id(one: Endpoint, other: Endpoint, protocol: int = _TCP, seed: int = 0) -> str:
    """Return the Community ID v1 of two ends in any order (corelight/community-id-spec).

    ``protocol`` is the IP protocol number: 6 for TCP, 17 for UDP.
    """
    ends = sorted((end.address, end.port & 0xFFFF) for end in (one, other))
    (low, low_port), (high, high_port) = ends
    octets = struct.pack(">H", seed) + low + high + struct.pack(">BBHH", protocol, 0, low_port, high_port)
    digest = hashlib.sha1(octets, usedforsecurity=False).digest()
    return "1:" + base64.b64encode(digest).decode("ascii")


def connection_community_id(connection: Connection) -> str:
    """Return the Community ID v1 of a connection."""
    one, other = connection.tcp.ends
    return community_id(one, other, _UDP if connection.udp else _TCP)


def connection_uid(connection: Connection) -> str:
    """Return an identifier in the form of Zeek's: ``C`` and 96 bits in base 62.

    Zeek's uids are random. This one is a hash of the time of the first packet, the ends, the protocol and the VLANs, so it is
    the same in each run. It differs from the uid of a live Zeek: join by Community ID and time.
    """
    tcp = connection.tcp
    one, other = sorted(tcp.ends, key=lambda end: (end.address, end.port))
    octets = struct.pack(
        ">qQBiiBB",
        tcp.first_ns,
        tcp.vlan & 0xFFFFFFFFFFFFFFFF,
        _UDP if connection.udp else _TCP,
        one.port,
        other.port,
        len(one.address),
        len(other.address),
    )
    digest = hashlib.sha256(octets + one.address + other.address).digest()
    return "C" + _base62(int.from_bytes(digest[:4], "big")) + _base62(int.from_bytes(digest[4:12], "big"))


def _base62(number: int) -> str:
    if not number:
        return _DIGITS[0]
    digits = []
    while number:
        number, digit = divmod(number, 62)
        digits.append(_DIGITS[digit])
    return "".join(digits)
