"""Makes the Ethernet frames of a TCP connection from the octets that both sides sent, as if it had been captured.

A proxy or a recorder knows the octets but has no packets. Sequence numbers, acknowledgements and checksums are consistent, so
that readers of captures find neither gaps nor retransmissions. Facts that no socket shows are invented: the MAC addresses, the
borders of segments, and that the next packet of the other side acknowledges every octet.
"""

from __future__ import annotations

import struct
from ipaddress import ip_address
from typing import Any, Final

from dissect.packets.tcp.stream import ACK, FIN, RST, SYN, Endpoint

#: Octets of payload that fit into an IPv4 packet: 65,535 less the IP and TCP headers of 20 octets each.
MAX_SEGMENT: Final = 65_495
#: Octets after which the other side acknowledges even when it has nothing to send.
ACKNOWLEDGE_AFTER: Final = 1 << 20

_PSH: Final = 0x08
_MASK: Final = 0xFFFFFFFF
#: Locally administered addresses: those of the client and of the server.
_MACS: Final = (b"\x02\0\0\0\0\x01", b"\x02\0\0\0\0\x02")
_TCP: Final = 6
#: The window, with the scale below 1 GiB, so that it never fills.
_WINDOW: Final = 65_535
#: Maximum segment size, no operation, window scale 14 (RFC 9293 3.1, RFC 7323 2.2).
_SYN_OPTIONS: Final = struct.pack(">BBHBBBB", 2, 4, MAX_SEGMENT, 1, 3, 3, 14)
_TCP_HEAD: Final = struct.Struct(">HHIIBBHHH")
_IPV4_HEAD: Final = struct.Struct(">BBHHHBBH4s4s")
_IPV6_HEAD: Final = struct.Struct(">IHBB16s16s")
_MAPPED: Final = bytes(10) + b"\xff\xff"
#: Multiplier that spreads conversation numbers over the sequence numbers (Knuth: 2**32 divided by the golden ratio).
_SPREAD: Final = 2_654_435_761


def endpoint_of(address: tuple[Any, ...]) -> Endpoint:
    """Return an address from ``getpeername`` or ``getsockname``, ``(host, port, …)``, as an endpoint without its scope."""
    number = ip_address(str(address[0]).partition("%")[0])
    mapped = getattr(number, "ipv4_mapped", None)
    return Endpoint((mapped or number).packed, int(address[1]))


class Conversation:
    """A TCP connection from ``client`` (side 0) to ``server`` (side 1).

    Call the method for the next event; it returns the frames. ``number`` distinguishes conversations between the same
    endpoints: it decides their first sequence numbers. If only one end has an IPv6 address, the address of the other is written
    as an IPv4-mapped one. Raises ValueError for octets after a close or a reset, which TCP does not allow.
    """

    def __init__(self, client: Endpoint, server: Endpoint, number: int = 0) -> None:
        addresses = [client.address, server.address]
        if len(addresses[0]) != len(addresses[1]):
            addresses = [address if len(address) == 16 else _MAPPED + address for address in addresses]
        self._addresses = addresses
        self._ports = (client.port, server.port)
        first = number * _SPREAD + 1000
        self._next = [first & _MASK, (first + 0x40000000) & _MASK]  # next sequence number of each side
        self._known = [self._next[0], self._next[1]]  # up to where each side's octets were acknowledged by the other
        self._finished = [False, False]
        self._over = False
        self._packets = 0

    def opened(self) -> list[bytes]:
        """Return the frames of the handshake: the connection was made."""
        first = self._segment(0, SYN, b"", _SYN_OPTIONS)
        self._next[0] = (self._next[0] + 1) & _MASK
        second = self._segment(1, SYN | ACK, b"", _SYN_OPTIONS)
        self._next[1] = (self._next[1] + 1) & _MASK
        return [first, second, self._segment(0, ACK)]

    def refused(self) -> list[bytes]:
        """The server refused the connection."""
        return [*self.unanswered(), self._segment(1, RST | ACK)]

    def unanswered(self) -> list[bytes]:
        """Add packets for a connection attempt without an answer."""
        self._over = True
        first = self._segment(0, SYN, b"", _SYN_OPTIONS)
        self._next[0] = (self._next[0] + 1) & _MASK
        self._next[1] = 0  # a reset that answers a SYN has no number of its own (RFC 9293 3.10.7.1)
        return [first]

    def sent(self, side: int, octets: bytes) -> list[bytes]:
        """``side`` sent octets; return as many segments as they need."""
        self._expect_open(side)
        frames = []
        for start in range(0, len(octets), MAX_SEGMENT):
            piece = octets[start : start + MAX_SEGMENT]
            last = start + MAX_SEGMENT >= len(octets)
            frames.append(self._segment(side, ACK | _PSH if last else ACK, piece))
            self._next[side] = (self._next[side] + len(piece)) & _MASK
            if (self._next[side] - self._known[side]) & _MASK >= ACKNOWLEDGE_AFTER:
                frames.append(self._segment(1 - side, ACK))
        return frames

    def skipped(self, side: int, size: int) -> None:
        """``side`` sent ``size`` octets that were not kept: they become a gap, as if a capture had lost packets."""
        self._expect_open(side)
        self._next[side] = (self._next[side] + size) & _MASK

    def closed(self, side: int) -> list[bytes]:
        """``side`` closed its direction (FIN); the other side may still send."""
        self._expect_open(side)
        self._finished[side] = True
        first = self._segment(side, FIN | ACK)
        self._next[side] = (self._next[side] + 1) & _MASK
        return [first, self._segment(1 - side, ACK)]

    def reset(self, side: int) -> list[bytes]:
        """``side`` reset the connection."""
        if self._over:
            raise ValueError("the connection is over")
        self._over = True
        return [self._segment(side, RST | ACK)]

    def _expect_open(self, side: int) -> None:
        if self._over or self._finished[side]:
            raise ValueError(f"side {side} has closed, it can no longer send")

    def _segment(self, side: int, flags: int, payload: bytes = b"", options: bytes = b"") -> bytes:
        """Return a frame from ``side`` that acknowledges everything that the other side sent."""
        ack = 0
        if flags & ACK:
            ack = self._known[1 - side] = self._next[1 - side]
        source, target = self._addresses[side], self._addresses[1 - side]
        size = _TCP_HEAD.size + len(options) + len(payload)
        head = _TCP_HEAD.pack(
            self._ports[side],
            self._ports[1 - side],
            self._next[side],
            ack,
            (_TCP_HEAD.size + len(options)) << 2,
            flags,
            _WINDOW,
            0,
            0,
        )
        # The pseudo header of RFC 9293 3.1 in the form for IPv6; the form for IPv4 has the same sum.
        pseudo = source + target + struct.pack(">II", size, _TCP)
        check = struct.pack(">H", _checksum(b"".join((pseudo, head, options, payload))))
        tcp = b"".join((head[:16], check, head[18:], options, payload))
        return b"".join((_MACS[1 - side], _MACS[side], self._ip_head(source, target, size), tcp))

    def _ip_head(self, source: bytes, target: bytes, size: int) -> bytes:
        """Return EtherType and IP header of a packet that carries ``size`` octets of TCP."""
        if len(source) == 16:
            return b"\x86\xdd" + _IPV6_HEAD.pack(0x60000000, size, _TCP, 64, source, target)
        self._packets = (self._packets + 1) & 0xFFFF
        fields = (0x45, 0, 20 + size, self._packets, 0x4000, 64, _TCP)  # 0x4000: do not fragment
        check = _checksum(_IPV4_HEAD.pack(*fields, 0, source, target))
        return b"\x08\x00" + _IPV4_HEAD.pack(*fields, check, source, target)


def _checksum(octets: bytes) -> int:
    """Return the Internet checksum (RFC 1071): a sum of 16-bit words with carries is the number modulo 0xFFFF."""
    if len(octets) & 1:
        octets += b"\0"
    return 0xFFFF - (int.from_bytes(octets, "big") % 0xFFFF)
