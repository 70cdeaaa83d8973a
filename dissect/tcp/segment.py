"""From a frame of any link and any IP to its TCP segment; the common frame the pipeline reads itself."""

from __future__ import annotations

from mypy_extensions import i64

from dissect.tcp import ip, link
from dissect.wire.octets import u16, u32


class Segment:
    """A TCP segment as a packet brought it.

    ``problem`` is empty, or names the category of packets (`transactions.accounts`) that have no segment to give.
    ``key`` is addresses and ports as they stand in the packet, then the VLAN key when there is one; ``word`` is the data
    offset and the flags; ``missing`` counts octets that the IP length claims and the capture does not hold.
    """

    __slots__ = ("ack", "key", "missing", "octets", "problem", "seq", "vlan", "word")

    def __init__(self, problem: str) -> None:
        self.problem: str = problem
        self.key: bytes = b""
        self.vlan: i64 = 0
        self.seq: i64 = 0
        self.ack: i64 = 0
        self.word: i64 = 0
        self.octets: bytes = b""
        self.missing: i64 = 0


def find_segment(
    buf: bytes, start: i64, end: i64, link_type: i64, fragments: ip.FragmentStore, time_ns: i64
) -> Segment:
    """Return the TCP segment of the frame ``buf[start:end]``, or why there is none. Never raises.

    A fragment goes to ``fragments`` and comes out with the one that makes its datagram whole.
    """
    at, vlan = link.find_ip(buf, start, end, link_type)
    if at < 0:
        if at == link.CUT:
            return Segment("cut")
        return Segment("link_type" if at == link.UNSUPPORTED else "not_ip")
    packet = ip.parse_ip(buf, at, end)
    if packet.problem:
        return Segment(packet.problem)
    tag = int(vlan).to_bytes(8, "big") if vlan else b""
    if not packet.fragment_key:
        if packet.protocol != ip.TCP:
            return Segment("not_tcp")
        return _read(packet.addresses, tag, vlan, buf, packet.start, packet.end, packet.missing)
    if packet.missing:
        return Segment("cut")  # a datagram with a cut piece can never be whole
    whole = fragments.add(
        packet.fragment_key + tag, packet.fragment_offset, packet.more, buf[packet.start : packet.end], time_ns
    )
    if whole is None:
        return Segment("fragment_waiting")
    if not whole:
        return Segment("not_tcp")  # what stands behind the extension headers is known only now
    return _read(packet.addresses, tag, vlan, whole, 0, len(whole), 0)


def _read(addresses: bytes, tag: bytes, vlan: i64, buf: bytes, at: i64, end: i64, missing: i64) -> Segment:
    """Read the TCP header at ``at``."""
    if end - at < 20:
        return Segment("cut" if missing else "bad_header")
    word: i64 = u16(buf, at + 12)
    header: i64 = (word >> 12) << 2
    if header < 20:
        return Segment("bad_header")
    if at + header > end:
        return Segment("cut" if missing else "bad_header")
    segment = Segment("")
    segment.key = b"%b%b%b" % (addresses, buf[at : at + 4], tag)
    segment.vlan = vlan
    segment.seq = u32(buf, at + 4)
    segment.ack = u32(buf, at + 8)
    segment.word = word
    segment.octets = buf[at + header : end]
    segment.missing = missing
    return segment
