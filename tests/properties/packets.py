"""Packets built octet by octet for the property tests: links, IPv4, IPv6, fragments, TCP. Independent of the package."""

from __future__ import annotations

import ipaddress
import struct
from collections.abc import Iterable, Sequence
from typing import Final, NamedTuple

FIN: Final = 0x01
SYN: Final = 0x02
RST: Final = 0x04
PSH: Final = 0x08
ACK: Final = 0x10

NULL: Final = 0
ETHERNET: Final = 1
RAW: Final = 101
LINUX_SLL: Final = 113
LINUX_SLL2: Final = 276

MASK: Final = 0xFFFFFFFF
MS: Final = 1_000_000
#: 2024-03-04 05:06:07 UTC in nanoseconds: where made captures begin.
EPOCH_NS: Final = 1_709_528_767 * 1_000_000_000


class Packet(NamedTuple):
    """One packet as a source delivers it."""

    time_ns: int
    octets: bytes
    wire_length: int
    link_type: int = ETHERNET


class Segment(NamedTuple):
    """One TCP segment of a flow; ``seq`` and ``ack`` are absolute."""

    flow: Flow
    side: int
    seq: int
    ack: int
    flags: int
    payload: bytes = b""

    def tcp(self) -> bytes:
        """Return the TCP header and payload (checksum 0, as with checksum offload)."""
        ports = self.flow.ports if self.side == 0 else self.flow.ports[::-1]
        head = struct.pack(">HHIIBBHHH", *ports, self.seq & MASK, self.ack & MASK, 0x50, self.flags, 8192, 0, 0)
        return head + self.payload

    def frame(self) -> bytes:
        """Return the whole packet in the form of its flow."""
        return self.flow.wrap(self.side, 6, self.tcp())


class Flow:
    """The addresses of one TCP connection, side 0 first, and the layers around its packets."""

    def __init__(
        self,
        client: str = "10.0.0.1",
        server: str = "10.0.0.2",
        ports: tuple[int, int] = (49152, 102),
        vlans: Sequence[int] = (),
        link: int = ETHERNET,
        options: bytes = b"",
    ) -> None:
        self.addresses = (ipaddress.ip_address(client), ipaddress.ip_address(server))
        self.ports = ports
        self.vlans = tuple(vlans)
        self.link = link
        self.options = options
        self.name = f"{client}:{ports[0]}>{server}:{ports[1]}/{self.vlans}"

    def wrap(self, side: int, protocol: int, content: bytes) -> bytes:
        """Return a packet that ``side`` sends."""
        return self.link_frame(self.ip_packet(side, protocol, content))

    def link_frame(self, packet: bytes) -> bytes:
        """Return an IP packet with the header of the flow's link."""
        ethertype = 0x86DD if packet[0] >> 4 == 6 else 0x0800
        if self.link == ETHERNET:
            tags = b"".join([struct.pack(">HH", 0x8100, vlan) for vlan in self.vlans])
            return b"\x02\x00\x00\x00\x00\x02\x02\x00\x00\x00\x00\x01" + tags + struct.pack(">H", ethertype) + packet
        if self.link == LINUX_SLL:
            return struct.pack(">HHH8sH", 0, 1, 6, b"\x02\x00\x00\x00\x00\x01", ethertype) + packet
        if self.link == LINUX_SLL2:
            return struct.pack(">HHIHBB8s", ethertype, 0, 2, 1, 0, 6, b"\x02\x00\x00\x00\x00\x01") + packet
        if self.link == NULL:
            return struct.pack("<I", 24 if ethertype == 0x86DD else 2) + packet
        return packet

    def ip_packet(self, side: int, protocol: int, content: bytes, ident: int = 1) -> bytes:
        """Return the whole IP packet."""
        source, target = self.addresses if side == 0 else self.addresses[::-1]
        if source.version == 6:
            extra = self.options  # a destination options header, when there is one
            first = 60 if extra else protocol
            head = struct.pack(">IHBB", 6 << 28, len(extra) + len(content), first, 64)
            return head + source.packed + target.packed + extra + content
        return _ipv4(source.packed, target.packed, protocol, content, ident, 0x4000, self.options)

    def fragments(self, segment: Segment, size: int, ident: int) -> list[bytes]:
        """Return the packets of ``segment`` cut into IP fragments of at most ``size`` octets (a multiple of 8)."""
        source, target = self.addresses if segment.side == 0 else self.addresses[::-1]
        whole = segment.tcp()
        packets = []
        for at in range(0, len(whole), size):
            piece = whole[at : at + size]
            more = at + size < len(whole)
            if source.version == 6:
                extra = struct.pack(">BBHI", 6, 0, at | more, ident) + piece
                head = struct.pack(">IHBB", 6 << 28, len(extra), 44, 64)
                packets.append(head + source.packed + target.packed + extra)
            else:
                word = at >> 3 | (0x2000 if more else 0)
                packets.append(_ipv4(source.packed, target.packed, 6, piece, ident, word, self.options))
        return [self.link_frame(packet) for packet in packets]


def _ipv4(source: bytes, target: bytes, protocol: int, content: bytes, ident: int, word: int, options: bytes) -> bytes:
    size = 20 + len(options)
    head = struct.pack(">BBHHHBBH", 0x40 | size >> 2, 0, size + len(content), ident & 0xFFFF, word, 64, protocol, 0)
    return head + source + target + options + content


def capture(frames: Iterable[bytes], link: int = ETHERNET, start_ns: int = EPOCH_NS, step_ns: int = MS) -> list[Packet]:
    """Return frames as packets, ``step_ns`` apart."""
    return [Packet(start_ns + at * step_ns, frame, len(frame), link) for at, frame in enumerate(frames)]


def captured(segments: Iterable[Segment], start_ns: int = EPOCH_NS, step_ns: int = MS) -> list[Packet]:
    """Return segments as packets, each of its flow's link, ``step_ns`` apart."""
    packets = []
    for at, segment in enumerate(segments):
        frame = segment.frame()
        packets.append(Packet(start_ns + at * step_ns, frame, len(frame), segment.flow.link))
    return packets


def cut_to(packet: Packet, size: int) -> Packet:
    """Return a packet of which the capture kept the first ``size`` octets."""
    return packet._replace(octets=packet.octets[:size])


class Talk:
    """A TCP connection, recorded segment by segment; each side acknowledges everything that it got."""

    def __init__(self, flow: Flow | None = None, isns: tuple[int, int] = (1000, 500_000)) -> None:
        self.flow = flow if flow is not None else Flow()
        self.next = [isns[0] & MASK, isns[1] & MASK]
        self.segments: list[Segment] = []

    def put(self, side: int, flags: int, payload: bytes = b"") -> Segment:
        """Send one segment."""
        segment = Segment(self.flow, side, self.next[side], self.next[1 - side] if flags & ACK else 0, flags, payload)
        self.next[side] = (self.next[side] + len(payload) + bool(flags & SYN) + bool(flags & FIN)) & MASK
        self.segments.append(segment)
        return segment

    def handshake(self) -> Talk:
        """Open the connection: side 0 begins."""
        self.put(0, SYN)
        self.put(1, SYN | ACK)
        self.put(0, ACK)
        return self

    def send(self, side: int, *payloads: bytes) -> Talk:
        """Send payloads, a segment each."""
        for payload in payloads:
            self.put(side, PSH | ACK, payload)
        return self

    def skip(self, side: int, size: int) -> Talk:
        """Omit ``size`` octets of ``side`` from the capture."""
        self.next[side] = (self.next[side] + size) & MASK
        return self

    def ack(self, side: int) -> Talk:
        """Send an empty segment."""
        self.put(side, ACK)
        return self

    def close(self, side: int = 0) -> Talk:
        """Close in good order, ``side`` first."""
        self.put(side, FIN | ACK)
        self.put(1 - side, FIN | ACK)
        self.put(side, ACK)
        return self

    def reset(self, side: int) -> Talk:
        """Break the connection off."""
        self.put(side, RST | ACK)
        return self

    def packets(self, start_ns: int = EPOCH_NS, step_ns: int = MS) -> list[Packet]:
        """Return the segments as packets."""
        return captured(self.segments, start_ns, step_ns)
