"""IPv4 and IPv6: where the TCP segment or UDP datagram of a packet is, and the reassembly of fragments.

The IP length is trusted, not the frame's: Ethernet trailers look like data. A length that reaches beyond the frame is cut to
what was captured, and reported.
"""

from __future__ import annotations

from collections import OrderedDict
from typing import Final

from mypy_extensions import i64

from dissect.wire.octets import u16

TCP: Final = 6
UDP: Final = 17
#: Protocols that carry packets or frames (`dissect.tcp.tunnel`), with the authentication header in IPv4.
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

#: Fragments of one datagram are dropped when it is not whole after this much capture time.
FRAGMENT_TIMEOUT_NS: Final = 30_000_000_000
#: Bounds of the fragment store.
MAX_DATAGRAMS: Final = 4096
MAX_FRAGMENT_OCTETS: Final = 32 * 1024 * 1024
MAX_DATAGRAM_OCTETS: Final = 65535
_MAX_FRAGMENTS: Final = 1024
#: Octets of memory that a stretch of a datagram takes besides its content, counted with it.
_PIECE_COST: Final = 128


class IpPacket:
    """What `parse_ip` found: addresses, the upper protocol and its octets.

    ``problem`` is empty, or why the packet cannot be used: ``bad_header``, ``cut``.
    ``start``/``end`` bound the payload within the captured octets; ``missing`` counts payload octets the IP length claims and
    the capture does not hold. For a fragment that may be of a TCP segment or a tunnel, or of a UDP datagram when these are
    wanted, ``fragment_key`` is not empty, and the payload is what `FragmentStore.add` takes, IPv6 extension headers behind the
    fragment header included.
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
        """The fragment is one of a whole of ``size`` octets, which stand alone in a buffer of their own."""
        self.protocol = protocol
        self.start = 0
        self.end = size
        self.missing = 0
        self.fragment_key = b""
        self.fragment_offset = 0
        self.more = False


def parse_ip(buf: bytes, at: i64, end: i64, wants_udp: bool = False) -> IpPacket:
    """Read the IP header at ``at``; the frame's octets end at ``end``. Never raises.

    ``wants_udp``: fragments of UDP are worth keeping too.
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
    if total == 0:  # segmentation offload: the stack left the length to the card
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
    """Read the fragment header at ``here``; return the protocol behind it and its extension headers, `_CUT` when cut."""
    word: i64 = u16(buf, here + 2)
    packet.fragment_offset = word & 0xFFF8
    packet.more = bool(word & 1)
    packet.start = here + 8
    protocol: i64 = buf[here]
    after: i64 = packet.start
    if packet.fragment_offset == 0:  # elsewhere the middle of a datagram follows, no header
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

    Return (protocol of what follows, where it begins); the protocol is `_CUT` when the headers do not end before ``end``, and
    that of an extension header when there are more than anybody sends.
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
        """Return whether a fragment that reaches to ``end`` agrees with what is known of the datagram's end."""
        if self.total >= 0:
            return end <= self.total if more else end == self.total
        if more or not self.pieces:
            return True
        at, octets = self.pieces[-1]
        return end >= at + len(octets)


class FragmentStore:
    """Holds the fragments of datagrams until they are whole; first copy wins.

    ``waiting``, ``used`` and ``dropped`` count packets, ``invalid`` those of the latter that can be part of no datagram;
    ``conflicts`` counts datagrams whose fragments contradict each other, in their octets or in where the datagram ends;
    ``evicted`` counts datagrams dropped because the store was full, ``expired`` those that were not whole in time.
    ``protocol`` is that of the datagram `add` returned last.
    """

    def __init__(self) -> None:
        # In order of arrival. (The first key of a plain dict takes longer to find the more were deleted before it.)
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
        """Take one fragment; return what it is of when it is the last one missing, else None.

        That is a TCP segment, what a tunnel carries or, when wanted, a UDP datagram.
        No octets are returned when the extension headers of the whole lead to another protocol. A fragment that cannot be,
        or that contradicts where its datagram ends, is dropped. The packet that completes a datagram is not counted here:
        its caller accounts for it like any whole packet.
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
        """Put the part of ``octets`` that is new between the pieces already there."""
        pieces = datagram.pieces
        start: i64 = offset
        end: i64 = offset + len(octets)
        index: i64 = 0
        above: i64 = len(pieces)
        while index < above:  # the first piece that ends behind the start
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
        """Drop datagrams that waited too long; they stand in order of arrival, so only the oldest need a look."""
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
