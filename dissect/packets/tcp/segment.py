"""Finds the TCP segment or UDP datagram in a frame of any link type and IP version; the pipeline reads common frames itself.

A segment in a tunnel (`dissect.packets.tcp.tunnel`) is returned with the innermost addresses, as if there were no tunnel.

Checksums are verified on request (RFC 9293 section 3.1, RFC 768; IPv6: RFC 8200 section 8.1). Ones' complement arithmetic is
arithmetic modulo 65535, so the sum of all words is one large integer modulo 65535.
"""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.packets.tcp import ip, link
from dissect.packets.tcp.ip import TCP, IpPacket
from dissect.packets.tcp.tunnel import Inner, sealed_link
from dissect.wire.octets import u16, u32

_MODULUS: Final = 0xFFFF
#: Offset of the checksum in the header.
_IN_TCP: Final = 16
_IN_UDP: Final = 6


def is_damaged(addresses: bytes, protocol: i64, buf: bytes, at: i64, end: i64) -> bool:
    """Return whether the checksum of the whole segment or datagram ``buf[at:end]`` is wrong.

    ``addresses`` are those of the IP header, the sender's first. A packet captured on its sender may have the sum of only the
    pseudo header, because the network card adds the rest; that is not damage. A UDP datagram without a checksum is not damaged
    either.
    """
    where: i64 = at + (_IN_TCP if protocol == TCP else _IN_UDP)
    stated: i64 = u16(buf, where)
    if stated == 0 and protocol != TCP:
        return False
    size: i64 = end - at
    content: i64 = _sum(buf[at:end])
    head: i64 = _sum(addresses) + protocol
    if (head + size + content) % _MODULUS == 0:
        return False
    left = stated % _MODULUS
    # With segmentation offload the network card also adds the length of each segment.
    return left != (head + size) % _MODULUS and left != head % _MODULUS


def _sum(octets: bytes) -> i64:
    total = int.from_bytes(octets, "big")
    if len(octets) & 1:
        total <<= 8
    return total % _MODULUS


_UDP_HEADER: Final = 8


class Segment:
    """The TCP segment or UDP datagram of a packet, or why it has none.

    ``problem`` is empty, or the category (`transactions.accounts`) of a packet that has no segment to use. With a problem other
    than ``bad_checksum`` only ``sealed`` is set as well: it names the encapsulation that could not be opened, if any.

    ``protocol`` is `ip.TCP` or `ip.UDP`. ``key`` is the addresses and ports in the packet's order, then the VLAN key when there
    is one; ``octets`` is the payload. ``word`` is the data offset and the flags; a datagram has none of ``seq``, ``ack`` and
    ``word``. ``missing`` counts octets of payload that the IP length (for a datagram the UDP length) claims and the capture
    does not hold. ``macs`` are the Ethernet addresses of the innermost frame in a tunnel, None outside of one.
    """

    __slots__ = ("ack", "key", "macs", "missing", "octets", "problem", "protocol", "sealed", "seq", "vlan", "word")

    def __init__(self, problem: str) -> None:
        self.problem: str = problem
        self.protocol: i64 = 0
        self.key: bytes = b""
        self.vlan: i64 = 0
        self.seq: i64 = 0
        self.ack: i64 = 0
        self.word: i64 = 0
        self.octets: bytes = b""
        self.missing: i64 = 0
        self.macs: bytes | None = None
        self.sealed: str = ""


def find_segment(
    buf: bytes,
    start: i64,
    end: i64,
    link_type: i64,
    fragments: ip.FragmentStore,
    time_ns: i64,
    wants_udp: bool = False,
    checksums: bool = False,
) -> Segment:
    """Return the TCP segment of the frame ``buf[start:end]``, or why there is none. Never raises.

    With ``wants_udp`` a UDP datagram is returned as well; without, it is ``not_tcp``. A fragment goes into ``fragments``; for
    the one that completes its datagram, the whole is returned. Checksums are verified only with ``checksums``, because that
    costs time, and because all are wrong in captures whose addresses were changed.
    """
    at, vlan = link.find_ip(buf, start, end, link_type)
    if at < 0:
        if at != link.FRAME:
            return _without_ip(at, vlan, link_type)
        inner = Inner(IpPacket(), 0, wants_udp)
        inner.open_frame(buf, vlan, end)
        return _innermost(inner, buf, fragments, time_ns, checksums)
    packet = ip.parse_ip(buf, at, end, wants_udp)
    if packet.problem:
        return Segment(packet.problem)
    if packet.protocol == ip.TCP and not packet.fragment_key:
        tag = int(vlan).to_bytes(8, "big") if vlan else b""
        return _read(packet.addresses, tag, vlan, buf, packet.start, packet.end, packet.missing, checksums)
    return _innermost(Inner(packet, vlan, wants_udp), buf, fragments, time_ns, checksums)


def _without_ip(answer: i64, detail: i64, link_type: i64) -> Segment:
    """Return the segment of a frame without IP (`link.find_ip`): the problem and the encapsulation that could not be opened."""
    if answer == link.CUT:
        return Segment("cut")
    segment = Segment("link_type" if answer == link.UNSUPPORTED else "not_ip")
    if answer == link.UNSUPPORTED:
        segment.sealed = sealed_link(link_type)
    elif answer == link.SEALED:
        segment.sealed = link.SEALED_NAMES[detail]
    return segment


def _innermost(inner: Inner, buf: bytes, fragments: ip.FragmentStore, time_ns: i64, checksums: bool) -> Segment:
    """Return what `find_segment` does, for a packet that may be a tunnel or a fragment: descend to the innermost packet."""
    while True:
        inner.descend(buf)
        packet = inner.packet
        vlan: i64 = inner.vlan
        if inner.problem:
            found = Segment(inner.problem)
            found.sealed = inner.sealed
            return found
        tag = int(vlan).to_bytes(8, "big") if vlan else b""
        if not packet.fragment_key:
            break
        if packet.missing:
            return Segment("cut")  # a datagram with a cut piece can never be whole
        piece = buf[packet.start : packet.end]
        key = packet.fragment_key + tag
        whole = fragments.add(key, packet.fragment_offset, packet.more, piece, time_ns, inner.wants_udp)
        if whole is None:
            return Segment("fragment_waiting")
        if not whole and fragments.protocol != ip.UDP:
            return Segment("not_tcp")  # only the whole datagram shows which protocol its extension headers lead to
        packet.gather(fragments.protocol, len(whole))
        buf = whole
    if packet.protocol == ip.TCP:
        found = _read(packet.addresses, tag, vlan, buf, packet.start, packet.end, packet.missing, checksums)
    elif inner.wants_udp and packet.protocol == ip.UDP:
        found = _read_datagram(packet.addresses, tag, vlan, buf, packet.start, packet.end, packet.missing, checksums)
    else:
        return Segment("not_tcp")
    found.macs = inner.macs
    return found


def _read(
    addresses: bytes, tag: bytes, vlan: i64, buf: bytes, at: i64, end: i64, missing: i64, checksums: bool
) -> Segment:
    """Read the TCP header at ``at``."""
    if end - at < 20:
        return Segment("cut" if missing else "bad_header")
    word: i64 = u16(buf, at + 12)
    header: i64 = (word >> 12) << 2
    if header < 20:
        return Segment("bad_header")
    if at + header > end:
        return Segment("cut" if missing else "bad_header")
    damaged = checksums and missing == 0 and is_damaged(addresses, ip.TCP, buf, at, end)
    segment = Segment("bad_checksum" if damaged else "")
    segment.protocol = ip.TCP
    segment.key = b"%b%b%b" % (addresses, buf[at : at + 4], tag)
    segment.vlan = vlan
    segment.seq = u32(buf, at + 4)
    segment.ack = u32(buf, at + 8)
    segment.word = word
    segment.octets = buf[at + header : end]
    segment.missing = missing
    return segment


def _read_datagram(
    addresses: bytes, tag: bytes, vlan: i64, buf: bytes, at: i64, end: i64, missing: i64, checksums: bool
) -> Segment:
    """Read the UDP header at ``at``; the IP payload has ``missing`` more octets after ``end``.

    The UDP length includes the header (RFC 768); octets of the IP packet after it are padding. Length 0, the jumbogram of RFC
    2675, needs an IPv6 option that is never sent; it is a bad header, like any length shorter than the header.
    """
    if end - at < _UDP_HEADER:
        return Segment("cut" if missing else "bad_header")
    length: i64 = u16(buf, at + 4)
    if length < _UDP_HEADER or length > end - at + missing:
        return Segment("bad_header")
    stop: i64 = min(at + length, end)
    damaged = checksums and at + length == stop and is_damaged(addresses, ip.UDP, buf, at, stop)
    datagram = Segment("bad_checksum" if damaged else "")
    datagram.protocol = ip.UDP
    datagram.key = b"%b%b%b" % (addresses, buf[at : at + 4], tag)
    datagram.vlan = vlan
    datagram.octets = buf[at + _UDP_HEADER : stop]
    datagram.missing = at + length - stop
    return datagram
