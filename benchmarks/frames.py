"""Ethernet, IPv4 and TCP frames with right checksums, built fast enough for millions.

A ones' complement sum over 16-bit words is the number modulo 65535, so `int.from_bytes` and one division do in C what the
standard (RFC 1071) describes as a loop.
"""

from __future__ import annotations

import struct
from typing import Final

FIN: Final = 0x01
SYN: Final = 0x02
RST: Final = 0x04
PSH: Final = 0x08
ACK: Final = 0x10

#: Ethernet II, IPv4 without options, TCP up to the urgent pointer.
_HEAD: Final = struct.Struct(">14sHHHHHHLLHHIIHHHH")
_IP: Final = struct.Struct(">14sHHHHHHLL")
_DO_NOT_FRAGMENT: Final = 0x4000
_PROTOCOL_TCP: Final = 6
#: Smallest frame on the wire without its check sequence; the sender's adapter pads shorter ones.
_ETHERNET_LEAST: Final = 60


def ones_complement(value: int) -> int:
    """Return the checksum field for words that add up to ``value`` (any size, not zero)."""
    rest = value % 0xFFFF
    return 0xFFFF - rest if rest else 0


def word_sum(octets: bytes) -> int:
    """Return a number congruent to the sum of the 16-bit words of ``octets`` (padded with a zero octet)."""
    value = int.from_bytes(octets, "big")
    return value << 8 if len(octets) & 1 else value


class Host:
    """An address on the network: MAC (6 octets) and IPv4 address as a number."""

    __slots__ = ("address", "ident", "mac", "ttl")

    def __init__(self, address: int, mac_prefix: bytes = b"\x02\x53\x37", ttl: int = 64) -> None:
        self.address = address
        self.mac = mac_prefix + (address & 0xFFFFFF).to_bytes(3, "big")
        self.ident = address * 40503 & 0xFFFF
        self.ttl = ttl

    def next_ident(self) -> int:
        """Return the IP identification for the next packet of this host."""
        self.ident = (self.ident + 1) & 0xFFFF
        return self.ident


class Sender:
    """One direction of a TCP connection.

    ``seq`` is the number of the next octet to send. ``stamps`` adds the time stamp option to each segment; ``pad`` fills
    short frames up to 60 octets, as they look when captured away from the sender.
    """

    __slots__ = (
        "_constant",
        "_ethernet",
        "_fixed_ip",
        "dest",
        "dport",
        "pad",
        "seq",
        "source",
        "sport",
        "stamps",
        "window",
    )

    def __init__(self, source: Host, sport: int, dest: Host, dport: int, seq: int) -> None:
        self.source = source
        self.dest = dest
        self.sport = sport
        self.dport = dport
        self.seq = seq
        self.window = 8192
        self.stamps = False
        self.pad = False
        self._ethernet = dest.mac + source.mac + b"\x08\x00"
        addresses = source.address + dest.address
        self._fixed_ip = 0x4500 + _DO_NOT_FRAGMENT + (source.ttl << 8 | _PROTOCOL_TCP) + addresses
        self._constant = addresses + _PROTOCOL_TCP + sport + dport

    def segment(self, flags: int, seq: int, ack: int, payload: bytes, time_ns: int = 0, options: bytes = b"") -> bytes:
        """Return one frame.

        ``options`` (a multiple of 4 octets) are for the SYN; other segments get the time stamp if wanted.
        """
        if self.stamps and not options:
            clock = time_ns // 1_000_000
            options = struct.pack(">HHII", 0x0101, 0x080A, clock + self.sport & 0xFFFFFFFF, clock & 0xFFFFFFFF)
        head = 20 + len(options)
        size = head + len(payload)
        total = 20 + size
        ident = self.source.next_ident()
        offset_flags = (head // 4) << 12 | flags
        rest = options + payload
        tcp_sum = self._constant + size + seq + ack + offset_flags + self.window + word_sum(rest)
        frame = (
            _HEAD.pack(
                self._ethernet,
                0x4500,
                total,
                ident,
                _DO_NOT_FRAGMENT,
                self.source.ttl << 8 | _PROTOCOL_TCP,
                ones_complement(self._fixed_ip + total + ident),
                self.source.address,
                self.dest.address,
                self.sport,
                self.dport,
                seq,
                ack,
                offset_flags,
                self.window,
                ones_complement(tcp_sum),
                0,
            )
            + rest
        )
        if self.pad and len(frame) < _ETHERNET_LEAST:
            return frame.ljust(_ETHERNET_LEAST, b"\x00")
        return frame


def ipv4(source: Host, dest: Host, protocol: int, payload: bytes, ident: int, fragment: int = 0) -> bytes:
    """Return an Ethernet frame with one IPv4 packet; ``fragment`` is the field of flags and offset (in units of 8)."""
    total = 20 + len(payload)
    addresses = source.address + dest.address
    check = ones_complement(0x4500 + total + ident + fragment + (source.ttl << 8 | protocol) + addresses)
    head = _IP.pack(
        dest.mac + source.mac + b"\x08\x00",
        0x4500,
        total,
        ident,
        fragment,
        source.ttl << 8 | protocol,
        check,
        source.address,
        dest.address,
    )
    return head + payload


def udp(source: Host, sport: int, dest: Host, dport: int, payload: bytes) -> bytes:
    """Return an Ethernet frame with a UDP datagram (checksum zero: not computed, which RFC 768 allows)."""
    datagram = struct.pack(">HHHH", sport, dport, 8 + len(payload), 0) + payload
    return ipv4(source, dest, 17, datagram, source.next_ident())


def arp(source: Host, wanted: int) -> bytes:
    """Return a broadcast ARP request of ``source`` for the address ``wanted``."""
    head = b"\xff" * 6 + source.mac + b"\x08\x06" + struct.pack(">HHBBH", 1, 0x0800, 6, 4, 1)
    body = source.mac + source.address.to_bytes(4, "big") + bytes(6) + wanted.to_bytes(4, "big")
    return (head + body).ljust(_ETHERNET_LEAST, b"\x00")
