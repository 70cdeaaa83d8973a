"""Packets of a capture file, read in the simplest way: times, lengths, and the payload of TCP over IPv4 on Ethernet.

Nothing of the package is imported: its statements about packets are compared with this.
"""

from __future__ import annotations

import struct
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Final, NamedTuple

ETHERNET: Final = 1
_PCAP: Final = {b"\xd4\xc3\xb2\xa1": ("<", 1000), b"\xa1\xb2\xc3\xd4": (">", 1000), b"\x4d\x3c\xb2\xa1": ("<", 1)}
_MASK: Final = 0xFFFFFFFF
_FIN: Final = 1
_SYN: Final = 2
_RST: Final = 4
_HALF: Final = 0x7FFFFFFF
#: Fewer bytes than these after the last captured ones are not a message.
_LEAST: Final = 4


class Packet(NamedTuple):
    """A packet: its time, its link, the captured bytes, and its size."""

    time_ns: int
    link: int
    octets: bytes
    length: int


class Segment(NamedTuple):
    """A TCP segment: sender and receiver, its numbers, its flags and its payload size."""

    flow: tuple[bytes, bytes]
    seq: int
    ack: int
    flags: int
    size: int


def packets_of(path: Path) -> list[Packet] | None:
    """Return the packets of a file; None for a format that this does not read, or if the file is cut off or compressed."""
    data = path.read_bytes()
    try:
        if data[:4] in _PCAP:
            order, factor = _PCAP[data[:4]]
            return list(_pcap(data, order, factor))
        return list(_pcapng(data)) if data[:4] == b"\x0a\x0d\x0d\x0a" else None
    except (struct.error, ValueError):
        return None


def _pcap(data: bytes, order: str, factor: int) -> Iterator[Packet]:
    link = struct.unpack_from(f"{order}I", data, 20)[0] & 0xFFFF
    at = 24
    while at < len(data):
        seconds, rest, captured, length = struct.unpack_from(f"{order}IIII", data, at)
        at += 16 + captured
        if at > len(data):
            raise ValueError("the file is cut off")
        yield Packet(seconds * 10**9 + rest * factor, link, data[at - captured : at], length)


def _pcapng(data: bytes) -> Iterator[Packet]:
    at, order = 0, "<"
    interfaces: list[tuple[int, int]] = []
    while at < len(data):
        if data[at : at + 4] == b"\x0a\x0d\x0d\x0a":
            order = "<" if data[at + 8 : at + 12] == b"\x4d\x3c\x2b\x1a" else ">"
            interfaces = []
        kind, size = struct.unpack_from(f"{order}II", data, at)
        if size < 12 or at + size > len(data):
            raise ValueError("the file is cut off")
        body = data[at + 8 : at + size - 4]
        if kind == 1:
            interfaces.append((struct.unpack_from(f"{order}H", body)[0], _resolution(body[8:], order)))
        elif kind == 6:
            number, high, low, captured, length = struct.unpack_from(f"{order}IIIII", body)
            link, units = interfaces[number]
            yield Packet(((high << 32) + low) * (10**9 // units), link, body[20 : 20 + captured], length)
        elif kind in {2, 3}:
            raise ValueError("an old form of packets")
        at += size


def _resolution(options: bytes, order: str) -> int:
    """Return the units of a second, from the options of an interface."""
    at = 0
    while at + 4 <= len(options):
        code, size = struct.unpack_from(f"{order}HH", options, at)
        if code == 9:
            value = options[at + 4]
            if value & 0x80 or value > 9:
                raise ValueError("a resolution in powers of two")
            return int(10**value)
        if code == 14:
            raise ValueError("an offset of times")
        at += 4 + size + (-size % 4)
    return 10**6


def segments_of(packets: list[Packet]) -> list[Segment] | None:
    """Return the TCP segments of a capture; None if some of it is not plain TCP over IPv4 over Ethernet."""
    found = []
    for packet in packets:
        octets = packet.octets
        if packet.link != ETHERNET or len(octets) != packet.length:
            return None
        if octets[12:14] != b"\x08\x00" or octets[23] != 6 or len(octets) < 54:
            return None
        head = 14 + (octets[14] & 15) * 4
        total = struct.unpack_from(">H", octets, 16)[0]
        if struct.unpack_from(">H", octets, 20)[0] & 0x3FFF or not total:
            return None
        seq, ack, offset, flags = struct.unpack_from(">IIBB", octets, head + 4)
        ends = octets[26:30] + octets[head : head + 2], octets[30:34] + octets[head + 2 : head + 4]
        found.append(Segment(ends, seq, ack if flags & 16 else -1, flags, 14 + total - head - (offset >> 4) * 4))
    return found


def missing_of(segments: list[Segment]) -> tuple[int, int] | None:
    """Return how many bytes of both directions of connections are missing, and how many were captured.

    Bytes that the other side acknowledged were sent, whether captured or not. Return None if one connection follows another
    with the same addresses.
    """
    starts: dict[tuple[bytes, bytes], int] = {}
    acked: dict[tuple[bytes, bytes], int] = {}
    ends: set[tuple[bytes, bytes]] = set()
    covered: dict[tuple[bytes, bytes], set[tuple[int, int]]] = defaultdict(set)
    for segment in segments:
        flow, other = segment.flow, segment.flow[::-1]
        begin = (segment.seq + (1 if segment.flags & _SYN else 0)) & _MASK
        if segment.flags & _SYN:
            if flow in starts and starts[flow] != begin:
                return None
            starts[flow] = begin
        if segment.flags & _FIN:
            ends.add(flow)
        if segment.size:
            starts.setdefault(flow, begin)
            covered[flow].add(((begin - starts[flow]) & _MASK, segment.size))
        if segment.ack >= 0 and not segment.flags & _RST:
            starts.setdefault(other, segment.ack)
            acked[other] = max(acked.get(other, 0), (segment.ack - starts[other]) & _MASK)
    missing = captured = 0
    for flow in {segment.flow for segment in segments}:  # a direction of which nothing was captured has no gaps
        at = 0
        for begin, size in sorted(covered[flow]):
            if begin > _HALF:
                return None
            missing += max(0, begin - at)
            captured += max(0, begin + size - max(at, begin))
            at = max(at, begin + size)
        behind = acked.get(flow, 0) - at - (flow in ends)
        if _LEAST <= behind <= _HALF:
            missing += behind
    return missing, captured
