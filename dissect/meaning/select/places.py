"""`Places`: recognises packets by their number, by their connection, and by the octets of a stream that they carry."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Mapping, Sequence
from typing import Final

from dissect.engine.transactions.table import reverse_key
from dissect.meaning.select.spans import SpanIndex, TimedSpan
from dissect.packets.tcp import ip, link
from dissect.packets.tcp.stream import FIN, RST, SYN
from dissect.packets.tcp.tunnel import Inner
from dissect.wire.octets import u16, u32


class Ranges:
    """Ranges of integers, both ends included. With the first query, ranges that touch become one."""

    __slots__ = ("_added", "_firsts", "_lasts")

    def __init__(self) -> None:
        self._added: list[tuple[int, int]] = []
        self._firsts: list[int] = []
        self._lasts: list[int] = []

    def add(self, first: int, last: int) -> None:
        """Add a range; it is empty if it ends before it begins."""
        if first <= last:
            self._added.append((first, last))

    def __contains__(self, number: int) -> bool:
        if self._added:
            self._join()
        place = bisect_right(self._firsts, number) - 1
        return place >= 0 and number <= self._lasts[place]

    def _join(self) -> None:
        ranges = sorted([*zip(self._firsts, self._lasts, strict=True), *self._added])
        self._added = []
        self._firsts, self._lasts = [], []
        for first, last in ranges:
            if self._lasts and first <= self._lasts[-1] + 1:
                self._lasts[-1] = max(self._lasts[-1], last)
            else:
                self._firsts.append(first)
                self._lasts.append(last)


#: The octet of the TCP header with the flags, and the flags that open and close a connection.
_FLAGS_AT: Final = 13
_MARKS: Final = SYN | FIN | RST
_TCP_HEADER: Final = 20
_NONE: Final = Ranges()


class Stretch:
    """A connection in the capture: ``key`` of one direction, TCP or UDP, from packet ``first`` to packet ``last``."""

    __slots__ = ("first", "key", "last", "protocol")

    def __init__(self, key: bytes, protocol: int, first: int, last: int) -> None:
        self.key = key
        self.protocol = protocol
        self.first = first
        self.last = last


class Places:
    """The places of wanted packets. ``same`` has the first key of a connection for each other key (`SameKeys`).

    ``frames`` are numbers of packets; ``looks`` says whether anything else is known, so that packets must be examined.
    """

    def __init__(self, frames: frozenset[int], same: Mapping[bytes, bytes]) -> None:
        self.frames = frames
        self.looks = False
        self._same = same
        self._marked: dict[bytes, Ranges] = {}  # connections of which only SYN, FIN and RST are wanted
        self._connections: dict[tuple[bytes, int], Ranges] = {}
        self._spans: dict[bytes, SpanIndex] = {}
        # By the hosts only, for IP fragments, which have no ports; all together, for those that do not even show the hosts.
        self._connections_of_hosts: dict[bytes, Ranges] = {}
        self._connections_of_all = Ranges()
        self._times_of_hosts: dict[bytes, Ranges] = {}
        self._times_of_all = Ranges()

    def add_connections(self, stretches: Sequence[Stretch]) -> None:
        """Want all packets of these connections."""
        for stretch in stretches:
            self.looks = True
            for key in self._keys(stretch):
                self._connections.setdefault((key, stretch.protocol), Ranges()).add(stretch.first, stretch.last)
                self._connections_of_hosts.setdefault(_addresses(key), Ranges()).add(stretch.first, stretch.last)
            self._connections_of_all.add(stretch.first, stretch.last)

    def add_spans(self, spans: Sequence[TimedSpan]) -> None:
        """Want the packets that carry octets of these ranges of streams."""
        for timed in spans:
            self.looks = True
            key = timed.span.key
            self._spans.setdefault(self._same.get(key, key), SpanIndex()).add(timed)
            self._times_of_hosts.setdefault(_addresses(key), Ranges()).add(timed.from_ns, timed.to_ns)
            self._times_of_all.add(timed.from_ns, timed.to_ns)

    def mark(self, stretches: Sequence[Stretch]) -> None:
        """Want the packets that open and close these TCP connections."""
        for stretch in stretches:
            self.looks = True
            for key in self._keys(stretch):
                self._marked.setdefault(key, Ranges()).add(stretch.first, stretch.last)

    def _keys(self, stretch: Stretch) -> tuple[bytes, bytes]:
        """Return the keys of both directions under which a stretch is found."""
        there, back = stretch.key, reverse_key(stretch.key)
        return self._same.get(there, there), self._same.get(back, back)

    def wants(self, frame: int, time_ns: int, buf: bytes, packet: ip.IpPacket, key: bytes) -> bool:
        """Return whether an IP packet with this key, as `parsed` returns them, is wanted."""
        if packet.fragment_key:
            return self._wants_fragment(frame, time_ns, packet)
        if not key:
            return False
        key = self._same.get(key, key)
        protocol = int(packet.protocol)
        if frame in self._connections.get((key, protocol), _NONE):
            return True
        size = packet.end - packet.start
        if protocol != ip.TCP or size <= _FLAGS_AT:
            return False
        if buf[packet.start + _FLAGS_AT] & _MARKS and frame in self._marked.get(key, _NONE):
            return True
        spans = self._spans.get(key) if size >= _TCP_HEADER else None
        return spans is not None and spans.carries(time_ns, *_segment(buf, packet))

    def _wants_fragment(self, frame: int, time_ns: int, packet: ip.IpPacket) -> bool:
        """Return whether an IP fragment is wanted: its hosts are those of something wanted, at that time.

        A fragment of a tunnel does not show the hosts of the packet in it, so any fragment at that time is wanted.
        """
        if packet.protocol in ip.CARRIERS and (frame in self._connections_of_all or time_ns in self._times_of_all):
            return True
        hosts = packet.addresses
        return frame in self._connections_of_hosts.get(hosts, _NONE) or time_ns in self._times_of_hosts.get(
            hosts, _NONE
        )


def parsed(buf: bytes, start: int, end: int, link_type: int) -> tuple[ip.IpPacket, bytes] | None:
    """Return the IP packet in a frame, and its key (empty for a fragment or without ports); None if there is no IP packet."""
    at, vlan = link.find_ip(buf, start, end, link_type)
    if at >= 0:
        packet = ip.parse_ip(buf, at, end, True)
        if packet.problem:
            return None
        if packet.protocol != ip.TCP:
            inner = Inner(packet, vlan, True)
            inner.descend(buf)
            if not inner.problem:
                packet, vlan = inner.packet, inner.vlan
    elif at == link.FRAME:
        inner = Inner(ip.IpPacket(), 0, True)
        inner.open_frame(buf, vlan, end)
        inner.descend(buf)
        if inner.problem:
            return None
        packet, vlan = inner.packet, inner.vlan
    else:
        return None
    if packet.fragment_key or packet.end - packet.start < 4:
        return packet, b""
    tag = int(vlan).to_bytes(8, "big") if vlan else b""
    return packet, b"%b%b%b" % (packet.addresses, buf[packet.start : packet.start + 4], tag)


def packet_key(buf: bytes, start: int, end: int, link_type: int) -> tuple[bytes, bytes]:
    """Return the key of a TCP or UDP packet, and its two addresses; both are empty for other packets. Never raises."""
    found = parsed(buf, start, end, link_type)
    if found is None:
        return b"", b""
    packet, key = found
    return (key if packet.protocol in {ip.TCP, ip.UDP} else b""), packet.addresses


def _addresses(key: bytes) -> bytes:
    """Return the addresses of a key, without ports and VLAN."""
    return key[:8] if len(key) in (12, 20) else key[:32]


def _segment(buf: bytes, packet: ip.IpPacket) -> tuple[int, int]:
    """Return sequence number and size of the octets of a TCP segment."""
    at = int(packet.start)
    return u32(buf, at + 4), int(packet.end) + int(packet.missing) - at - (u16(buf, at + 12) >> 12 << 2)
