"""Tunnels: descends from the outer IP packet to the innermost one, whose addresses are those of a connection.

Sensors and switches send mirrored frames in tunnels. Opens GRE (RFC 2784, 2890) with IP, Ethernet, MPLS or ERSPAN I to III
(draft-foschiano-erspan) in it; VXLAN (RFC 7348), Geneve (RFC 8926) and TZSP in UDP; IP in IP (RFC 2003, 4213), EtherIP (RFC
3378), MPLS in IP (RFC 4023); and the authentication header of IPv4 (RFC 4302), which is not a tunnel but comes where one would.

The VLAN of a packet is that of the innermost frame; the outer VLAN belongs to the network that carries the tunnel.
"""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.packets.tcp import ip, link
from dissect.packets.tcp.ip import IpPacket
from dissect.wire.octets import u16

#: How many tunnels may be nested.
MAX_LEVELS: Final = 4
_VXLAN: Final = 4789
_VXLAN_LINUX: Final = 8472
_GENEVE: Final = 6081
_TZSP: Final = 37008
_UDP_HEADER: Final = 8
_UDP_NAMES: Final[dict[int, str]] = {_VXLAN: "VXLAN", _VXLAN_LINUX: "VXLAN", _GENEVE: "Geneve", _TZSP: "TZSP"}

# Types in GRE and Geneve other than the EtherTypes that `link` reads.
_ETHERNET: Final = 0x6558
_ERSPAN: Final = 0x88BE
_ERSPAN_3: Final = 0x22EB

#: IP protocols that are not opened.
_SEALED: Final[dict[int, str]] = {50: "ESP (IPsec)", 115: "L2TP"}
#: Link types of TZSP, and of captures, that are IEEE 802.11, with or without a header that the receiver added.
_TZSP_WIRELESS: Final = frozenset((18, 119, 127))
_WIRELESS: Final = frozenset((105, 119, 127, 163, 192))


class Inner:
    """The innermost ``packet`` reached so far, and ``vlan``, the VLAN key of the frame that it is in.

    ``problem`` is empty, or the category (`transactions.accounts`) of a packet that cannot be used; ``sealed`` names the
    encapsulation that could not be opened. ``macs`` are the two Ethernet addresses of the innermost frame: empty where the
    tunnel holds no frame, None outside of tunnels, where the captured frame has them. ``at`` is where a packet in a tunnel
    begins, in the octets opened last. ``levels`` is how many tunnels may still be opened.
    """

    __slots__ = ("at", "levels", "macs", "packet", "problem", "sealed", "vlan", "wants_udp")

    def __init__(self, packet: IpPacket, vlan: i64, wants_udp: bool) -> None:
        self.packet: IpPacket = packet
        self.vlan: i64 = vlan
        self.wants_udp: bool = wants_udp
        self.problem: str = ""
        self.sealed: str = ""
        self.macs: bytes | None = None
        self.at: i64 = 0
        self.levels: i64 = MAX_LEVELS

    def descend(self, buf: bytes) -> None:
        """Open tunnels until ``packet`` is TCP, UDP or a fragment to be collected, or there is a ``problem``."""
        going = True
        while going and not self.problem:
            packet = self.packet
            if packet.fragment_key or packet.protocol == ip.TCP:
                return
            if packet.fragment_offset or packet.more:
                self._leave_fragment(buf)
                return
            going = self._open(buf, packet.protocol, packet.start, packet.end)

    def _leave_fragment(self, buf: bytes) -> None:
        """Give up a fragment that is not collected; if it is the first of a datagram, its UDP port names the tunnel."""
        packet = self.packet
        self.problem = "not_tcp"
        if packet.protocol == ip.UDP and packet.fragment_offset == 0 and packet.start + 4 <= packet.end:
            name = _UDP_NAMES.get(u16(buf, packet.start + 2))
            if name is not None:
                self.sealed = f"{name} in IP fragments"

    def _open(self, buf: bytes, protocol: i64, at: i64, end: i64) -> bool:
        """Open the payload ``buf[at:end]`` of this IP protocol; return False when there is nothing further to open."""
        if protocol == ip.UDP:
            return self._open_udp(buf, at, end)
        if protocol == ip.GRE:
            return self._open_gre(buf, at, end)
        if protocol == ip.IPV4 or protocol == ip.IPV6:
            return self._enter(buf, at, end, 0)
        if protocol == ip.AUTHENTICATION:
            return self._pass_authentication(buf, at, end)
        if protocol == ip.ETHERIP:
            return self.open_frame(buf, at + 2, end)
        if protocol == ip.MPLS:
            return self._open_type(buf, link.MPLS, at, end)
        self.problem = "not_tcp"
        if protocol in _SEALED:
            self.sealed = _SEALED[protocol]
        return False

    def _take_level(self) -> bool:
        """Count a level; return False, and set ``problem``, when there are too many."""
        if self.levels == 0:
            return self._stop("not_ip", f"more than {MAX_LEVELS} tunnels in each other")
        self.levels -= 1
        return True

    def _stop(self, problem: str, sealed: str = "") -> bool:
        self.problem = problem
        self.sealed = sealed
        return False

    def _enter(self, buf: bytes, at: i64, end: i64, vlan: i64) -> bool:
        """Go on with the IP packet at ``at``."""
        if not self._take_level():
            return False
        if self.macs is None:
            self.macs = b""
        packet = ip.parse_ip(buf, at, end, self.wants_udp)
        self.packet = packet
        self.at = at
        self.vlan = vlan
        self.problem = packet.problem
        return True

    def _pass_authentication(self, buf: bytes, at: i64, end: i64) -> bool:
        if at + 8 > end:
            return self._stop("cut")
        words: i64 = buf[at + 1]
        if at + (words + 2) * 4 > end:
            return self._stop("cut")
        if not self._take_level():
            return False
        self.packet.protocol = buf[at]
        self.packet.start = at + (words + 2) * 4
        return True

    def open_frame(self, buf: bytes, at: i64, end: i64) -> bool:
        """Go on with the Ethernet frame at ``at``."""
        if at + 14 > end:
            return self._stop("cut")
        self.macs = buf[at : at + 12]
        found, vlan = link.find_ip(buf, at, end, link.ETHERNET)
        return self._follow(buf, found, vlan, end)

    def _open_type(self, buf: bytes, ethertype: i64, at: i64, end: i64) -> bool:
        """Continue with the content at ``at``, whose type is an EtherType or one that only GRE and Geneve use."""
        if at > end:
            return self._stop("cut")
        if ethertype == _ETHERNET:
            return self.open_frame(buf, at, end)
        self.macs = b""
        found, vlan = link.after_type(buf, ethertype, at, end)
        return self._follow(buf, found, vlan, end)

    def _follow(self, buf: bytes, found: i64, detail: i64, end: i64) -> bool:
        """Continue with the result of `link.find_ip`."""
        if found >= 0:
            return self._enter(buf, found, end, detail)
        if found == link.FRAME:
            return self._take_level() and self.open_frame(buf, detail, end)
        if found == link.SEALED:
            return self._stop("not_ip", link.SEALED_NAMES[detail])
        return self._stop("cut" if found == link.CUT else "not_ip")

    # ---- GRE --------------------------------------------------------------------------------------------------------

    def _open_gre(self, buf: bytes, at: i64, end: i64) -> bool:
        if at + 4 > end:
            return self._stop("cut")
        flags: i64 = u16(buf, at)
        kind: i64 = u16(buf, at + 2)
        if flags & 7:
            return self._stop("not_tcp", "PPTP (GRE version 1)" if flags & 7 == 1 else "")
        if flags & 0x4000:
            return self._stop("not_tcp", "GRE with source routing")
        at += 4
        if flags & 0x8000:  # checksum
            at += 4
        if flags & 0x2000:  # key
            at += 4
        sequence = bool(flags & 0x1000)
        if sequence:
            at += 4
        if kind == _ERSPAN:
            return self.open_frame(buf, at + 8 if sequence else at, end)  # type II has a header, type I has none
        if kind == _ERSPAN_3:
            return self._open_erspan(buf, at, end)
        return self._open_type(buf, kind, at, end)

    def _open_erspan(self, buf: bytes, at: i64, end: i64) -> bool:
        """ERSPAN type III: its header says whether a second one follows, and whether a frame or an IP packet was mirrored."""
        if at + 12 > end:
            return self._stop("cut")
        word: i64 = u16(buf, at + 10)
        at += 20 if word & 1 else 12
        kind: i64 = word >> 10 & 0x1F
        if kind == 0:
            return self.open_frame(buf, at, end)
        return self._enter(buf, at, end, 0) if kind == 2 else self._stop("not_ip")

    # ---- UDP --------------------------------------------------------------------------------------------------------

    def _open_udp(self, buf: bytes, at: i64, end: i64) -> bool:
        """Open a datagram to the port of a tunnel; one that does not look like a tunnel is kept as a datagram."""
        if at + _UDP_HEADER > end:
            return False
        port: i64 = u16(buf, at + 2)
        if port != _VXLAN and port != _TZSP and port != _VXLAN_LINUX and port != _GENEVE:
            return False
        stop: i64 = min(end, at + u16(buf, at + 4))
        at += _UDP_HEADER
        outer, vlan, macs = self.packet, self.vlan, self.macs
        going: bool
        if port == _TZSP:
            going = self._open_tzsp(buf, at, stop)
        elif at + 8 > stop:
            going = self._stop("cut")
        elif port == _GENEVE:
            words: i64 = buf[at] & 0x3F
            if buf[at] >> 6:
                return False
            going = self._open_type(buf, u16(buf, at + 2), at + 8 + words * 4, stop)
        elif buf[at] & 0x08:
            going = self.open_frame(buf, at + 8, stop)
        else:
            return False
        if self.problem and not self.sealed and not (self.problem == "cut" and outer.missing):
            self.packet = outer  # not a tunnel: the port alone proves nothing
            self.vlan = vlan
            self.macs = macs
            self.problem = ""
            return False
        return going

    def _open_tzsp(self, buf: bytes, at: i64, end: i64) -> bool:
        """Open TZSP: version 1, type (received, or to be sent), link type, tags up to the end tag, then the frame."""
        if at + 4 > end:
            return self._stop("cut")
        if buf[at] != 1 or buf[at + 1] > 1:
            return False
        kind: i64 = u16(buf, at + 2)
        at += 4
        while at < end:
            tag: i64 = buf[at]
            at += 1
            if tag == 1:
                if kind == link.ETHERNET:
                    return self.open_frame(buf, at, end)
                return self._stop("not_ip", "802.11 in TZSP") if kind in _TZSP_WIRELESS else False
            if tag:
                if at >= end:
                    break
                size: i64 = buf[at]
                at += 1 + size
        return self._stop("cut")


def unwrapped(octets: bytes, link_type: i64) -> tuple[bytes, int, int] | None:
    """Return the innermost packet of a captured one as it entered the tunnel, its link type, and how many octets are missing.

    The packet is an Ethernet frame, or IP alone where the tunnel holds no frame. Return None for a packet that is not in a
    tunnel, or whose tunnel carries neither TCP nor UDP.
    """
    end: i64 = len(octets)
    at, vlan = link.find_ip(octets, 0, end, link_type)
    if at < 0 and at != link.FRAME:
        return None
    inner: Inner
    if at == link.FRAME:
        inner = Inner(IpPacket(), 0, True)
        inner.open_frame(octets, vlan, end)
    else:
        packet = ip.parse_ip(octets, at, end, True)
        if packet.problem or packet.fragment_key or packet.protocol == ip.TCP:
            return None
        inner = Inner(packet, vlan, True)
    inner.descend(octets)
    macs = inner.macs
    if inner.problem or macs is None:
        return None
    content = octets[inner.at : inner.packet.end]
    missing = int(inner.packet.missing)
    if not macs and not inner.vlan:
        return content, link.RAW, missing
    tags = b"".join([b"\x81\x00" + vid.to_bytes(2, "big") for vid in link.vlan_ids(inner.vlan)])
    ethertype = b"\x08\x00" if octets[inner.at] >> 4 == 4 else b"\x86\xdd"
    return (macs or bytes(12)) + tags + ethertype + content, link.ETHERNET, missing


def sealed_link(link_type: i64) -> str:
    """Return the name of a link type that is not supported."""
    return "802.11" if link_type in _WIRELESS else f"link type {link_type}"
