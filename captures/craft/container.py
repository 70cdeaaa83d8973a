"""The files packets are written to: pcap and pcapng, in either byte order, octet by octet."""

from __future__ import annotations

import struct
from collections.abc import Iterable
from typing import NamedTuple

ETHERNET, NULL, RAW_BSD, RAW, LOOP, SLL, IPV4, IPV6, SLL2 = 1, 0, 12, 101, 108, 113, 228, 229, 276
"""LINKTYPE numbers."""
NS = 1_000_000_000
MICROSECONDS, NANOSECONDS = 6, 9
"""Values of if_tsresol."""


class Packet(NamedTuple):
    """One captured packet; ``wire`` is its size before it was cut."""

    time_ns: int
    octets: bytes
    wire: int
    interface: int = 0
    comment: str = ""


def write_pcap(
    packets: Iterable[Packet], big: bool = False, nanoseconds: bool = False, link_type: int = ETHERNET
) -> bytes:
    """A classic pcap file (draft-ietf-opsawg-pcap)."""
    order = ">" if big else "<"
    magic, unit = (0xA1B23C4D, 1) if nanoseconds else (0xA1B2C3D4, 1000)
    octets = struct.pack(f"{order}IHHiIII", magic, 2, 4, 0, 0, 262_144, link_type)
    for packet in packets:
        seconds, rest = divmod(packet.time_ns, NS)
        octets += struct.pack(f"{order}IIII", seconds, rest // unit, len(packet.octets), packet.wire) + packet.octets
    return octets


class Pcapng:
    """A pcapng file that grows block by block (draft-ietf-opsawg-pcapng)."""

    def __init__(self) -> None:
        self.octets = b""
        self._order = "<"
        self._clocks: list[tuple[int, int]] = []

    def section(self, big: bool = False, comment: str = "") -> None:
        """A section header; earlier interfaces are no longer valid."""
        self._order = ">" if big else "<"
        self._clocks = []
        options = self._options([(1, comment.encode())] if comment else [])
        self.block(0x0A0D0D0A, struct.pack(f"{self._order}IHHq", 0x1A2B3C4D, 1, 0, -1) + options)

    def interface(self, link_type: int, name: str, ticks: int = 10**6, offset: int = 0, snaplen: int = 262_144) -> None:
        """An interface whose clock has ``ticks`` a second (a power of 10 or 2) and starts ``offset`` seconds after 1970."""
        self._clocks.append((ticks, offset))
        resolution = len(str(ticks)) - 1 if ticks % 10 == 0 else 0x80 | (ticks.bit_length() - 1)
        options = [(2, name.encode()), (9, bytes([resolution]))]
        if offset:
            options.append((14, struct.pack(f"{self._order}q", offset)))
        head = struct.pack(f"{self._order}HxxI", link_type, snaplen)
        self.block(1, head + self._options(options))

    def packet(self, packet: Packet, old: bool = False) -> None:
        """An Enhanced Packet Block, or the obsolete Packet Block."""
        ticks_a_second, offset = self._clocks[packet.interface]
        ticks = (packet.time_ns - offset * NS) * ticks_a_second // NS
        first = struct.pack(
            f"{self._order}HH" if old else f"{self._order}I", packet.interface, *([0xFFFF] if old else [])
        )
        sizes = len(packet.octets), packet.wire
        body = first + struct.pack(f"{self._order}IIII", ticks >> 32, ticks & 0xFFFFFFFF, *sizes)
        options = self._options([(1, packet.comment.encode())] if packet.comment else [])
        self.block(2 if old else 6, body + padded(packet.octets) + options)

    def simple(self, packet: Packet) -> None:
        """A Simple Packet Block, which has no time."""
        self.block(3, struct.pack(f"{self._order}I", packet.wire) + packet.octets)

    def block(self, kind: int, body: bytes) -> None:
        """Any block."""
        body = padded(body)
        size = struct.pack(f"{self._order}I", 12 + len(body))
        self.octets += struct.pack(f"{self._order}I", kind) + size + body + size

    def _options(self, options: list[tuple[int, bytes]]) -> bytes:
        if not options:
            return b""
        told = [struct.pack(f"{self._order}HH", code, len(value)) + padded(value) for code, value in options]
        return b"".join(told) + bytes(4)


def padded(octets: bytes) -> bytes:
    """The octets up to the next multiple of four."""
    return octets + bytes(-len(octets) % 4)


def write_pcapng(packets: Iterable[Packet], link_types: Iterable[int] = (ETHERNET,), big: bool = False) -> bytes:
    """A pcapng file of one section, an interface for each link type, times in nanoseconds."""
    file = Pcapng()
    file.section(big)
    for number, link_type in enumerate(link_types):
        file.interface(link_type, f"crafted{number}", NS)
    for packet in packets:
        file.packet(packet)
    return file.octets
