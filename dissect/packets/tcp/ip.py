"""IPv4 and IPv6: finds the TCP segment or UDP datagram in a packet, and reassembles fragments.

The length in the IP header counts, not the size of the frame, because Ethernet trailers look like data. A packet whose length
reaches beyond the frame ends where the frame does; `IpPacket.missing` counts the rest.
"""

from __future__ import annotations

from collections import OrderedDict
from typing import Final

from mypy_extensions import i64

from dissect.wire.octets import u16

TCP: Final = 6
UDP: Final = 17
#: Protocols that carry packets or frames (`dissect.packets.tcp.tunnel`), and the authentication header of IPv4.
IPV4: Final = 4
IPV6: Final = 41
GRE: Final = 47
AUTHENTICATION: Final = 51
ETHERIP: Final = 97
MPLS: Final = 137
CARRIERS: Final = frozenset((IPV4, IPV6, GRE, AUTHENTICATION, ETHERIP, MPLS))
_EXTENSION_HEADERS: Final = frozenset((0, 43, 51, 60, 135, 139, 140))
_MAX_EXTENSION_HEADERS: Final = 16
_FRAGMENT_HEADER: Final = 44
_CUT: Final = -1  # instead of a protocol
#: Sizes of the fragment keys (addresses, identification, protocol or next header); a VLAN may follow.
_V4_KEY: Final = 11
_V6_KEY: Final = 37

#: The fragments of a datagram that is not whole after this much capture time are dropped.
FRAGMENT_TIMEOUT_NS: Final = 30_000_000_000
#: Bounds of the fragment store.
MAX_DATAGRAMS: Final = 4096
MAX_FRAGMENT_OCTETS: Final = 32 * 1024 * 1024
MAX_DATAGRAM_OCTETS: Final = 65535
_MAX_FRAGMENTS: Final = 1024
#: Octets of memory that each piece of a datagram takes besides its content; they count towards `MAX_FRAGMENT_OCTETS`.
_PIECE_COST: Final = 128


class IpPacket:
    """What `parse_ip` found: addresses, the upper protocol and its octets.

    ``problem`` is empty, or says why the packet cannot be used: ``bad_header``, ``cut``. ``start`` and ``end`` bound the
    payload within the captured octets; ``missing`` counts payload octets that the IP length includes but the capture does not
    have. ``fragment_key`` is set for a fragment of what may be a TCP segment, a tunnel or, when wanted, a UDP datagram. The
    payload is then what `FragmentStore.add` takes, with the IPv6 extension headers that follow the fragment header.
    """

    __slots__ = (
        "addresses",
        "end",
        "fragment_key",
        "fragment_offset",
        "missing",
        "more",
        "problem",
        "protocol",
        "start",
    )

    def __init__(self) -> None:
        self.problem: str = ""
        self.addresses: bytes = b""
        self.protocol: i64 = 0
        self.start: i64 = 0
        self.end: i64 = 0
        self.missing: i64 = 0
        self.fragment_key: bytes = b""
        self.fragment_offset: i64 = 0
        self.more: bool = False

    def gather(self, protocol: i64, size: i64) -> None:
        """Replace the payload by that of the whole datagram: ``size`` octets, which are alone in a buffer of their own."""
        self.protocol = protocol
        self.start = 0
        self.end = size
        self.missing = 0
        self.fragment_key = b""
        self.fragment_offset = 0
        self.more = False


def parse_ip(buf: bytes, at: i64, end: i64, wants_udp: bool = False) -> IpPacket:
    """Read the IP header at ``at``; the frame's octets end at ``end``. Never raises.

    ``wants_udp``: fragments of UDP datagrams get a ``fragment_key`` as well.
    """
    packet = IpPacket()
    if at >= end:
        packet.problem = "cut"
        return packet
    version: i64 = buf[at] >> 4
    if version == 4:
        _parse_v4(packet, buf, at, end, wants_udp)
    elif version == 6:
        _parse_v6(packet, buf, at, end, wants_udp)
    else:
        packet.problem = "bad_header"
    return packet


def _parse_v4(packet: IpPacket, buf: bytes, at: i64, end: i64, wants_udp: bool) -> None:
    if end - at < 20:
        packet.problem = "cut"
        return
    low: i64 = buf[at] & 0x0F
    header: i64 = low * 4
    total: i64 = u16(buf, at + 2)
    if header < 20 or 0 < total < header:
        packet.problem = "bad_header"
        return
    if end - at < header:
        packet.problem = "cut"
        return
    if total == 0:  # segmentation offload: the network card sets the length after the capture
        total = end - at
    packet.protocol = buf[at + 9]
    packet.addresses = buf[at + 12 : at + 20]
    packet.start = at + header
    packet.end = at + total
    if packet.end > end:
        packet.missing = packet.end - end
        packet.end = end
    flags: i64 = u16(buf, at + 6)
    if flags & 0x3FFF:
        packet.fragment_offset = (flags & 0x1FFF) * 8
        packet.more = bool(flags & 0x2000)
        if packet.protocol == TCP or packet.protocol in CARRIERS or (wants_udp and packet.protocol == UDP):
            packet.fragment_key = b"%b%b%b" % (packet.addresses, buf[at + 4 : at + 6], buf[at + 9 : at + 10])


def _parse_v6(packet: IpPacket, buf: bytes, at: i64, end: i64, wants_udp: bool) -> None:
    if end - at < 40:
        packet.problem = "cut"
        return
    length: i64 = u16(buf, at + 4)
    packet.addresses = buf[at + 8 : at + 40]
    packet.end = at + 40 + length if length else end
    if packet.end > end:
        packet.missing = packet.end - end
        packet.end = end
    protocol, here = _skip_extensions(buf, at + 40, packet.end, buf[at + 6])
    packet.start = here
    if protocol == _FRAGMENT_HEADER:
        protocol = _CUT if here + 8 > packet.end else _parse_fragment_header(packet, buf, here, wants_udp)
    if protocol == _CUT:
        packet.problem = "cut" if packet.missing else "bad_header"
        return
    packet.protocol = protocol


def _parse_fragment_header(packet: IpPacket, buf: bytes, here: i64, wants_udp: bool) -> i64:
    """Read the fragment header at ``here``; return the protocol after it and further extension headers, `_CUT` when cut."""
    word: i64 = u16(buf, here + 2)
    packet.fragment_offset = word & 0xFFF8
    packet.more = bool(word & 1)
    packet.start = here + 8
    protocol: i64 = buf[here]
    after: i64 = packet.start
    if packet.fragment_offset == 0:  # other fragments have no headers of the datagram
        protocol, after = _skip_extensions(buf, packet.start, packet.end, protocol)
        if not packet.more:
            packet.start = after  # an atomic fragment is whole by itself (RFC 6946)
            return protocol
    wanted: bool = protocol == TCP or protocol in CARRIERS or (wants_udp and protocol == UDP)
    if wanted or (packet.fragment_offset and protocol in _EXTENSION_HEADERS):
        packet.fragment_key = packet.addresses + buf[here + 4 : here + 8] + buf[here : here + 1]
    return protocol


def _skip_extensions(buf: bytes, at: i64, end: i64, protocol: i64) -> tuple[i64, i64]:
    """Step over the IPv6 extension headers at ``at``, the first of type ``protocol``.

    Return the protocol of the payload after the extension headers and its offset. The protocol is `_CUT` when the headers reach
    beyond ``end``, and that of an extension header when there are more than `_MAX_EXTENSION_HEADERS`.
    """
    for _ in range(_MAX_EXTENSION_HEADERS):
        if protocol not in _EXTENSION_HEADERS:
            break
        if at + 8 > end:
            return _CUT, at
        units: i64 = buf[at + 1]
        size: i64 = (units + 2) * 4 if protocol == AUTHENTICATION else (units + 1) * 8
        if at + size > end:
            return _CUT, at
        protocol = buf[at]
        at += size
    return protocol, at


class _Datagram:
    __slots__ = ("conflict", "fragments", "octets", "pieces", "since_ns", "total")

    def __init__(self, since_ns: i64) -> None:
        self.since_ns: i64 = since_ns
        self.pieces: list[tuple[int, bytes]] = []  # sorted by offset, not overlapping
        self.octets: i64 = 0
        self.total: i64 = -1
        self.fragments: i64 = 0
        self.conflict: bool = False

    def may_end(self, end: i64, more: bool) -> bool:
        """Return whether a fragment that reaches to ``end`` agrees with what is known so far of where the datagram ends."""
        if self.total >= 0:
            return end <= self.total if more else end == self.total
        if more or not self.pieces:
            return True
        at, octets = self.pieces[-1]
        return end >= at + len(octets)


class FragmentStore:
    """Holds the fragments of datagrams until the datagrams are whole; the first copy of an octet wins.

    ``waiting``, ``used`` and ``dropped`` count packets; ``invalid`` counts the dropped ones that can be part of no datagram.
    ``conflicts`` counts datagrams whose fragments contradict each other in their octets or about where the datagram ends.
    ``evicted`` counts datagrams dropped because the store was full, ``expired`` those dropped because they were not whole in
    time. ``protocol`` is that of the datagram that `add` returned last.
    """

    def __init__(self) -> None:
        # In order of arrival. (Not a plain dict: finding its first key takes longer the more were deleted before it.)
        self._datagrams: OrderedDict[bytes, _Datagram] = OrderedDict()
        self._octets: i64 = 0
        self.protocol: i64 = 0
        self.waiting: i64 = 0
        self.used: i64 = 0
        self.dropped: i64 = 0
        self.invalid: i64 = 0
        self.conflicts: i64 = 0
        self.evicted: i64 = 0
        self.expired: i64 = 0

    def add(
        self, key: bytes, offset: i64, more: bool, octets: bytes, time_ns: i64, wants_udp: bool = False
    ) -> bytes | None:
        """Take one fragment; return the payload of its datagram if that is whole now, else None.

        The payload is a TCP segment, the content of a tunnel or, when wanted, a UDP datagram. It is empty when the extension
        headers of the whole datagram lead to another protocol. An impossible fragment, or one that contradicts the end of its
        datagram, is dropped. The packet that completes a datagram is not counted here: the caller counts it like any whole
        packet.
        """
        self._expire(time_ns)
        end: i64 = offset + len(octets)
        if end > MAX_DATAGRAM_OCTETS or (more and len(octets) % 8 != 0):
            self.dropped += 1
            self.invalid += 1
            return None
        datagram = self._datagrams.get(key)
        if datagram is None:
            datagram = _Datagram(time_ns)
            self._datagrams[key] = datagram
        elif datagram.fragments >= _MAX_FRAGMENTS:
            self.dropped += 1
            return None
        elif not datagram.may_end(end, more):
            self._note_conflict(datagram)
            self.dropped += 1
            return None
        datagram.fragments += 1
        self.waiting += 1
        if not more:
            datagram.total = end
        self._insert(datagram, offset, octets)
        if datagram.octets == datagram.total:
            return self._complete(key, datagram, wants_udp)
        while len(self._datagrams) > MAX_DATAGRAMS or self._octets > MAX_FRAGMENT_OCTETS:
            self._drop(next(iter(self._datagrams)))
            self.evicted += 1
        return None

    def _note_conflict(self, datagram: _Datagram) -> None:
        if not datagram.conflict:
            datagram.conflict = True
            self.conflicts += 1

    def _insert(self, datagram: _Datagram, offset: i64, octets: bytes) -> None:
        """Insert the new part of ``octets`` between the existing pieces."""
        pieces = datagram.pieces
        start: i64 = offset
        end: i64 = offset + len(octets)
        index: i64 = 0
        above: i64 = len(pieces)
        while index < above:  # find the first piece that ends after ``start``
            middle: i64 = (index + above) >> 1
            piece_at, piece = pieces[middle]
            if piece_at + len(piece) <= start:
                index = middle + 1
            else:
                above = middle
        while start < end:
            stop: i64 = end
            if index < len(pieces):
                piece_at, piece = pieces[index]
                if piece_at <= start:
                    stop = min(end, piece_at + len(piece))
                    if piece[start - piece_at : stop - piece_at] != octets[start - offset : stop - offset]:
                        self._note_conflict(datagram)
                    start = stop
                    index += 1
                    continue
                stop = min(end, piece_at)
            pieces.insert(index, (start, octets[start - offset : stop - offset]))
            datagram.octets += stop - start
            self._octets += stop - start + _PIECE_COST
            start = stop
            index += 1

    def _complete(self, key: bytes, datagram: _Datagram, wants_udp: bool) -> bytes:
        self._forget(key, datagram)
        self.used += datagram.fragments - 1
        whole = b"".join([piece for _, piece in datagram.pieces])
        if len(key) < _V6_KEY:
            self.protocol = key[_V4_KEY - 1]
            return whole
        protocol, at = _skip_extensions(whole, 0, len(whole), key[_V6_KEY - 1])
        self.protocol = protocol
        wanted: bool = protocol == TCP or protocol in CARRIERS or (wants_udp and protocol == UDP)
        return whole[at:] if wanted else b""

    def _forget(self, key: bytes, datagram: _Datagram) -> None:
        del self._datagrams[key]
        self._octets -= datagram.octets + _PIECE_COST * len(datagram.pieces)
        self.waiting -= datagram.fragments

    def _expire(self, time_ns: i64) -> None:
        """Drop datagrams that waited too long; they are in order of arrival, so the first younger one ends the search."""
        while self._datagrams:
            key = next(iter(self._datagrams))
            if time_ns - self._datagrams[key].since_ns <= FRAGMENT_TIMEOUT_NS:
                return
            self._drop(key)
            self.expired += 1

    def _drop(self, key: bytes) -> None:
        datagram = self._datagrams[key]
        self._forget(key, datagram)
        self.dropped += datagram.fragments
