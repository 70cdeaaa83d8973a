"""Replaces addresses by key: IP addresses with a common prefix keep one of the same length; Ethernet addresses keep their kind.

The mapping of IP addresses is Crypto-PAn (Xu, Fan, Ammar, Moon 2002) with HMAC-SHA-256 instead of AES: the key and the
preceding bits decide whether a bit is flipped. Ranges with a special meaning stay: no bit of their prefixes is flipped, so no
other address is mapped into them and the mapping stays one to one.
"""

from __future__ import annotations

from typing import Final

from dissect.files.anonymize.account import IP_ADDRESSES, MAC_ADDRESSES
from dissect.files.anonymize.key import Key

#: Maximum number of cached addresses; others are computed again.
MAX_CACHED: Final = 65_536

#: (prefix, length) of IPv4 ranges that stay: this network, loopback, multicast with the reserved range and broadcast.
_SAME_V4: Final = ((0x00, 8), (0x7F, 8), (0b111, 3))
#: Ranges that are mapped to themselves: private and link-local addresses, and carrier-grade NAT.
_WITHIN_V4: Final = ((0x0A, 8), (0xAC1, 12), (0xC0A8, 16), (0xA9FE, 16), (0b0110010001, 10))
#: IPv6: unspecified and loopback, multicast; link-local, unique local, global unicast.
_SAME_V6: Final = ((0, 120), (0xFF, 8))
_WITHIN_V6: Final = ((0xFE80 << 48, 64), (0b1111110, 7), (0xFD, 8), (0b001, 3))
_MAPPED_V4: Final = bytes(10) + b"\xff\xff"
#: Multicast addresses that contain the end of a station's address: RFC 4291 solicited-node, and their Ethernet addresses.
_SOLICITED: Final = bytes.fromhex("ff0200000000000000000001ff")
_SOLICITED_MAC: Final = bytes.fromhex("3333ff")


class _Tree:
    """The mapping of addresses with ``width`` bits."""

    def __init__(
        self, key: Key, width: int, same: tuple[tuple[int, int], ...], within: tuple[tuple[int, int], ...]
    ) -> None:
        self._key = key
        self._width = width
        self._same = same
        self._fixed = frozenset(
            (size, prefix >> (length - size)) for prefix, length in (*same, *within) for size in range(length)
        )

    def map(self, address: bytes) -> bytes:
        """Return the replacement of ``address``."""
        width = self._width
        value = int.from_bytes(address, "big")
        if any(value >> (width - length) == prefix for prefix, length in self._same):
            return address
        mapped = 0
        for size in range(width):
            prefix = value >> (width - size)
            bit = value >> (width - 1 - size) & 1
            if (size, prefix) not in self._fixed:
                bit ^= self._key.stream(f"ip{width}", bytes((size,)) + prefix.to_bytes(16, "big"), 1)[0] & 1
            mapped = mapped << 1 | bit
        return mapped.to_bytes(width // 8, "big")


class AddressMap:
    """Maps addresses to replacements. ``changed`` counts distinct addresses by kind: `IP_ADDRESSES`, `MAC_ADDRESSES`."""

    def __init__(self, key: Key) -> None:
        self.changed = {IP_ADDRESSES: 0, MAC_ADDRESSES: 0}
        self._key = key
        self._v4 = _Tree(key, 32, _SAME_V4, _WITHIN_V4)
        self._v6 = _Tree(key, 128, _SAME_V6, _WITHIN_V6)
        self._cache: dict[bytes, bytes] = {}

    def ip(self, address: bytes) -> bytes:
        """Return the replacement of an IPv4 or IPv6 address (4 or 16 octets)."""
        return self._cache.get(address) or self._remember(address, self._map_ip(address), IP_ADDRESSES)

    def mac(self, address: bytes) -> bytes:
        """Return the replacement of an Ethernet address (6 octets); zero, group and broadcast addresses stay."""
        return self._cache.get(address) or self._remember(address, self._map_mac(address), MAC_ADDRESSES)

    def _remember(self, address: bytes, mapped: bytes, kind: str) -> bytes:
        if len(self._cache) >= MAX_CACHED:
            self._cache.clear()
        self._cache[address] = mapped
        if mapped != address:
            self.changed[kind] += 1
        return mapped

    def _map_ip(self, address: bytes) -> bytes:
        if len(address) == 4:
            return self._v4.map(address)
        if address.startswith(_MAPPED_V4):
            return _MAPPED_V4 + self._v4.map(address[12:])
        if address.startswith(_SOLICITED):
            return _SOLICITED + self._key.stream("station", address[13:], 3)
        return self._v6.map(address)

    def _map_mac(self, address: bytes) -> bytes:
        if address.startswith(_SOLICITED_MAC):
            return _SOLICITED_MAC + self._key.stream("station", address[3:], 3)
        if address[0] & 1 or not any(address):
            return address
        mapped = self._key.stream("mac", address, 6)
        return bytes((mapped[0] & 0xFC | address[0] & 3,)) + mapped[1:]
