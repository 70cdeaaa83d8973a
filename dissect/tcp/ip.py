"""IPv4 and IPv6: where the TCP segment of a packet is, and the reassembly of fragments.

The IP length is trusted, not the frame's: Ethernet trailers look like data. A length that reaches beyond the frame is cut to
what was captured, and told.
"""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.wire.octets import u16

TCP: Final = 6
_EXTENSION_HEADERS: Final = frozenset((0, 43, 51, 60, 135, 139, 140))
_FRAGMENT_HEADER: Final = 44

#: Fragments of one datagram are dropped when it is not whole after this much capture time.
FRAGMENT_TIMEOUT_NS: Final = 30_000_000_000
#: Bounds of the fragment store.
MAX_DATAGRAMS: Final = 4096
MAX_FRAGMENT_OCTETS: Final = 32 * 1024 * 1024
MAX_DATAGRAM_OCTETS: Final = 65535
_MAX_FRAGMENTS: Final = 1024


class IpPacket:
    """What `parse_ip` found: addresses, the upper protocol and its octets.

    ``problem`` is empty, or why the packet cannot be used: ``bad_header``, ``cut``, ``not_ip``.
    ``start``/``end`` bound the payload within the captured octets; ``missing`` counts payload octets the IP length claims and
    the capture does not hold. For a fragment ``fragment_key`` is not empty.
    """

    __slots__ = ("addresses", "end", "fragment_key", "fragment_offset", "missing", "more", "problem", "protocol", "start")

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


def parse_ip(buf: bytes, at: i64, end: i64) -> IpPacket:
    """Read the IP header at ``at``; the frame's octets end at ``end``. Never raises."""
    packet = IpPacket()
    if at >= end:
        packet.problem = "cut"
        return packet
    version: i64 = buf[at] >> 4
    if version == 4:
        _parse_v4(packet, buf, at, end)
    elif version == 6:
        _parse_v6(packet, buf, at, end)
    else:
        packet.problem = "bad_header"
    return packet


def _parse_v4(packet: IpPacket, buf: bytes, at: i64, end: i64) -> None:
    if end - at < 20:
        packet.problem = "cut"
        return
    low: i64 = buf[at] & 0x0F
    header: i64 = low * 4
    total: i64 = u16(buf, at + 2)
    if total == 0:  # segmentation offload: the stack left the length to the card
        total = end - at
    if header < 20 or total < header:
        packet.problem = "bad_header"
        return
    if end - at < header:
        packet.problem = "cut"
        return
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
        packet.fragment_key = b"%b%b%b" % (packet.addresses, buf[at + 4 : at + 6], buf[at + 9 : at + 10])


def _parse_v6(packet: IpPacket, buf: bytes, at: i64, end: i64) -> None:
    if end - at < 40:
        packet.problem = "cut"
        return
    length: i64 = u16(buf, at + 4)
    packet.addresses = buf[at + 8 : at + 40]
    packet.end = at + 40 + length if length else end
    if packet.end > end:
        packet.missing = packet.end - end
        packet.end = end
    next_header: i64 = buf[at + 6]
    here: i64 = at + 40
    for _ in range(16):
        if next_header == _FRAGMENT_HEADER:
            if here + 8 > packet.end:
                packet.problem = "cut" if packet.missing else "bad_header"
                return
            word: i64 = u16(buf, here + 2)
            packet.fragment_offset = word & 0xFFF8
            packet.more = bool(word & 1)
            if packet.fragment_offset or packet.more:  # else an atomic fragment: whole by itself
                packet.fragment_key = packet.addresses + buf[here + 4 : here + 8] + buf[here : here + 1]
            next_header = buf[here]
            here += 8
            if packet.fragment_offset:
                break  # what follows is the middle of a datagram, no header
            continue
        if next_header not in _EXTENSION_HEADERS:
            break
        if here + 8 > packet.end:
            packet.problem = "cut" if packet.missing else "bad_header"
            return
        units: i64 = buf[here + 1]
        size: i64 = (units + 2) * 4 if next_header == 51 else (units + 1) * 8
        if here + size > packet.end:
            packet.problem = "cut" if packet.missing else "bad_header"
            return
        next_header = buf[here]
        here += size
    packet.protocol = next_header
    packet.start = here


class _Datagram:
    __slots__ = ("conflict", "fragments", "octets", "pieces", "since_ns", "total")

    def __init__(self, since_ns: i64) -> None:
        self.since_ns: i64 = since_ns
        self.pieces: list[tuple[int, bytes]] = []  # sorted by offset, not overlapping
        self.octets: i64 = 0
        self.total: i64 = -1
        self.fragments: i64 = 0
        self.conflict: bool = False


class FragmentStore:
    """Holds the fragments of datagrams until they are whole; first copy wins.

    ``waiting``, ``used`` and ``dropped`` count packets; ``conflicts`` counts datagrams in which overlapping fragments held
    different octets; ``evicted`` counts datagrams dropped because the store was full.
    """

    def __init__(self) -> None:
        self._datagrams: dict[bytes, _Datagram] = {}
        self._octets: i64 = 0
        self.waiting: i64 = 0
        self.used: i64 = 0
        self.dropped: i64 = 0
        self.conflicts: i64 = 0
        self.evicted: i64 = 0
        self.expired: i64 = 0

    def add(self, key: bytes, offset: i64, more: bool, octets: bytes, time_ns: i64) -> bytes | None:
        """Take one fragment; return the whole payload when it is the last one missing, else None.

        The packet that completes a datagram is not counted here: its caller accounts for it like any whole packet.
        """
        self._expire(time_ns)
        end: i64 = offset + len(octets)
        datagram = self._datagrams.get(key)
        bad: bool = end > MAX_DATAGRAM_OCTETS or (more and len(octets) % 8 != 0)
        if bad or (datagram is not None and datagram.fragments >= _MAX_FRAGMENTS):
            self.dropped += 1
            return None
        if datagram is None:
            datagram = _Datagram(time_ns)
            self._datagrams[key] = datagram
        datagram.fragments += 1
        self.waiting += 1
        if not more:
            if datagram.total >= 0 and datagram.total != end:
                datagram.conflict = True
            else:
                datagram.total = end
        self._insert(datagram, offset, octets)
        if datagram.total >= 0 and datagram.octets >= datagram.total:
            return self._complete(key, datagram)
        while len(self._datagrams) > MAX_DATAGRAMS or self._octets > MAX_FRAGMENT_OCTETS:
            self._drop(next(iter(self._datagrams)))
            self.evicted += 1
        return None

    def _insert(self, datagram: _Datagram, offset: i64, octets: bytes) -> None:
        """Put the part of ``octets`` that is new between the pieces already there."""
        pieces = datagram.pieces
        start: i64 = offset
        end: i64 = offset + len(octets)
        index: i64 = 0
        count: i64 = len(pieces)
        # Fragments mostly arrive in order: look at the end first, so that a flood of them stays linear.
        if count:
            last_at, last_octets = pieces[count - 1]
            if start >= last_at + len(last_octets):
                index = count
        while start < end:
            if index == len(pieces):
                self._place(datagram, index, start, octets[start - offset :])
                return
            piece_at, piece = pieces[index]
            piece_end: i64 = piece_at + len(piece)
            if piece_end <= start:
                index += 1
                continue
            if piece_at > start:
                stop: i64 = min(end, piece_at)
                self._place(datagram, index, start, octets[start - offset : stop - offset])
                start = stop
                index += 1
                continue
            stop = min(end, piece_end)
            if piece[start - piece_at : stop - piece_at] != octets[start - offset : stop - offset]:
                datagram.conflict = True
            start = stop
            index += 1

    def _place(self, datagram: _Datagram, index: i64, at: i64, octets: bytes) -> None:
        datagram.pieces.insert(index, (at, octets))
        datagram.octets += len(octets)
        self._octets += len(octets)

    def _complete(self, key: bytes, datagram: _Datagram) -> bytes | None:
        del self._datagrams[key]
        self._octets -= datagram.octets
        self.waiting -= datagram.fragments
        if datagram.conflict:
            self.conflicts += 1
        whole = b"".join([piece for _, piece in datagram.pieces])
        self.used += datagram.fragments - 1
        return whole[: datagram.total]

    def _expire(self, time_ns: i64) -> None:
        """Drop datagrams that waited too long; they stand in order of arrival, so only the oldest need a look."""
        while self._datagrams:
            key = next(iter(self._datagrams))
            if time_ns - self._datagrams[key].since_ns <= FRAGMENT_TIMEOUT_NS:
                return
            self._drop(key)
            self.expired += 1

    def _drop(self, key: bytes) -> None:
        datagram = self._datagrams.pop(key)
        self._octets -= datagram.octets
        self.waiting -= datagram.fragments
        self.dropped += datagram.fragments


def address_text(address: bytes) -> str:
    """Return an IPv4 or IPv6 address (4 or 16 octets) as text; IPv6 in the RFC 5952 form."""
    if len(address) == 4:
        return ".".join([str(octet) for octet in address])
    groups = [u16(address, i * 2) for i in range(8)]
    best_at: i64 = -1
    best_size: i64 = 1
    at: i64 = 0
    while at < 8:
        size: i64 = 0
        while at + size < 8 and groups[at + size] == 0:
            size += 1
        if size > best_size:
            best_at, best_size = at, size
        at += size + 1
    texts = [f"{group:x}" for group in groups]
    if best_at < 0:
        return ":".join(texts)
    return ":".join(texts[:best_at]) + "::" + ":".join(texts[best_at + best_size :])


