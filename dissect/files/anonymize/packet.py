"""Rewrites one packet: link, IP and TCP headers with replaced addresses, and the payload that the first pass determined."""

from __future__ import annotations

from typing import Final

from dissect.files.anonymize import account
from dissect.files.anonymize.account import DAMAGED, FRAGMENT, LINK, OTHER, Account, Choices
from dissect.files.anonymize.addresses import MAX_CACHED, AddressMap
from dissect.files.anonymize.checksum import ONES, moved, renewed, total
from dissect.files.anonymize.fragments import Fragment
from dissect.files.anonymize.survey import UDP, Survey
from dissect.files.anonymize.usual_packet import PORTS, UsualPackets
from dissect.packets.tcp import ip, link
from dissect.packets.tcp.stream import SYN
from dissect.wire.octets import u16, u32

_ARP: Final = 0x0806
_FRAGMENTED: Final = frozenset((ip.TCP, ip.UDP))
#: Positions of addresses in link headers.
_LINK_HEADERS: Final = {link.ETHERNET: 14, link.LINUX_SLL: 16, link.LINUX_SLL2: 20}
_ICMP: Final = frozenset((1, 58))
#: TCP options without sensitive content: end, no-operation, segment size, window scale, SACK permitted, SACK, timestamps.
_TCP_OPTIONS: Final = frozenset((0, 1, 2, 3, 4, 5, 8))
_NOP: Final = 1


class Packets:
    """Rewrites packets. ``counts`` counts the replacements; ``usual`` handles ordinary packets."""

    def __init__(self, survey: Survey, addresses: AddressMap, choices: Choices, counts: Account) -> None:
        self._survey = survey
        self._addresses = addresses
        self._others = choices.keep_others
        self._account = counts
        self.usual = UsualPackets(survey.tracks, addresses, counts)

    def renew(self, frame: int, octets: bytes, link_type: int) -> bytes | Fragment | None:
        """Return the rewritten form of packet ``frame``, which is not an ordinary one; None if it is dropped. Never raises.

        A `Fragment` is filled once its datagram is complete (`whole`).
        """
        end = len(octets)
        at, vlan = link.find_ip(octets, 0, end, link_type)
        if at == link.UNSUPPORTED:
            return self._blank(octets, link_type, LINK)
        if at < 0:
            return self._no_ip(octets, link_type) if self._others else self._drop(OTHER)
        packet = ip.parse_ip(octets, at, end, True)
        if packet.problem:
            return self._blank(octets, link_type, DAMAGED)
        fragment = bool(packet.fragment_key or packet.fragment_offset or packet.more)
        if fragment and (packet.protocol not in _FRAGMENTED or packet.missing or not packet.fragment_key):
            return self._blank(octets, link_type, FRAGMENT)
        new = bytearray(end)
        new[:at] = self._link_again(octets[:at], link_type)
        self._ip(octets, new, int(at), int(packet.start))
        if fragment:
            return self._fragment(octets, new, packet, int(vlan))
        if not self._followed(frame, octets, new, packet, int(vlan)):
            if not self._others:
                cut = packet.protocol == ip.TCP and packet.end - packet.start < 20
                return self._drop(DAMAGED if cut else OTHER)
            self._other(octets, new, packet)
        if packet.end < end:
            self._account.mask(account.PADDING, octets[packet.end :])
        return bytes(new)

    def whole(self, frame: int, fragments: list[Fragment], datagram: bytes) -> None:
        """Settle the fragments of a segment or datagram that packet ``frame`` completes."""
        packet = ip.IpPacket()
        packet.addresses = fragments[0].addresses
        packet.protocol = fragments[0].protocol
        packet.end = len(datagram)
        new = bytearray(len(datagram))
        written = self._followed(frame, datagram, new, packet, fragments[0].vlan)
        if not written and self._others:
            self._other(datagram, new, packet)
            written = True
        for fragment in fragments:
            fragment.settle(bytes(new) if written else None)

    def unsettled(self) -> None:
        """Drop a fragment because its datagram stayed incomplete or belongs to a different protocol."""
        self._drop(FRAGMENT)

    def _followed(self, frame: int, octets: bytes, new: bytearray, packet: ip.IpPacket, vlan: int) -> bool:
        """Write the IP payload if the first pass followed it; return False otherwise."""
        if packet.protocol == ip.TCP:
            return self._tcp(frame, octets, new, packet, vlan)
        return packet.protocol == ip.UDP and self._udp(frame, octets, new, packet, vlan)

    def _blank(self, octets: bytes, link_type: int, reason: str) -> bytes | None:
        """Return an unreadable packet with zeros after its link header, if other protocols are written, too."""
        if not self._others:
            return self._drop(reason)
        size = _LINK_HEADERS.get(link_type, 0)
        if size > len(octets):
            size = 0
        self._account.mask(account.BLANK, octets[size:])
        return self._link(octets[:size], link_type) + bytes(len(octets) - size) if size else bytes(len(octets))

    def _drop(self, reason: str) -> bytes | None:
        self._account.drop(reason)
        return None

    # ---- link -------------------------------------------------------------------------------------------------------

    def _link_again(self, head: bytes, link_type: int) -> bytes:
        """Return `_link` of a header from the cache: the same header comes with many packets."""
        links = self.usual.links
        rewritten = links.get((link_type, head))
        if rewritten is None:
            if len(links) >= MAX_CACHED:
                links.clear()
            rewritten = links[link_type, head] = self._link(head, link_type)
        return rewritten

    def _link(self, head: bytes, link_type: int) -> bytes:
        """Return a link header with replaced addresses."""
        if link_type == link.ETHERNET:
            return self._addresses.mac(head[:6]) + self._addresses.mac(head[6:12]) + head[12:]
        if link_type == link.LINUX_SLL:
            return head[:6] + self._station(head[6:14], u16(head, 4)) + head[14:]
        if link_type == link.LINUX_SLL2:
            return head[:12] + self._station(head[12:20], head[11]) + head[20:]
        return head

    def _station(self, field: bytes, size: int) -> bytes:
        """Return the address field of a Linux cooked header: anything but an Ethernet address becomes zeros."""
        if size != 6 or len(field) < 6:
            return bytes(len(field))
        return self._addresses.mac(field[:6]) + bytes(len(field) - 6)

    def _no_ip(self, octets: bytes, link_type: int) -> bytes | None:
        """Return a packet other than IP: ARP keeps its structure with replaced addresses, the rest only the link header."""
        size = _LINK_HEADERS.get(link_type, 0)
        if not size or len(octets) < size:
            return self._blank(octets, link_type, OTHER)
        new = bytearray(len(octets))
        new[:size] = self._link(octets[:size], link_type)
        type_at = 0 if link_type == link.LINUX_SLL2 else size - 2
        body = octets[size : size + 28]
        if u16(octets, type_at) == _ARP and len(body) == 28 and body[4:6] == b"\x06\x04":
            new[size : size + 28] = b"".join((
                body[:8],
                self._addresses.mac(body[8:14]),
                self._addresses.ip(body[14:18]),
                self._addresses.mac(body[18:24]),
                self._addresses.ip(body[24:28]),
            ))  # fmt: skip
        else:
            self._account.mask(account.FOREIGN, octets[size:])
        return bytes(new)

    # ---- IP ---------------------------------------------------------------------------------------------------------

    def _ip(self, octets: bytes, new: bytearray, at: int, end: int) -> None:
        """Write the IP header with replaced addresses; options and extension headers, which may contain some, are blanked."""
        addresses = self._addresses
        if octets[at] >> 4 == 6:
            new[at : at + 8] = octets[at : at + 8]
            new[at + 8 : at + 24] = addresses.ip(octets[at + 8 : at + 24])
            new[at + 24 : at + 40] = addresses.ip(octets[at + 24 : at + 40])
            self._extensions(octets, new, at + 40, end, octets[at + 6])
            return
        new[at : at + 12] = octets[at : at + 12]
        was, becomes, rewritten = self.usual.pair(octets[at + 12 : at + 20])
        new[at + 12 : at + 20] = rewritten
        if end > at + 20:
            new[at + 20 : end] = bytes((_NOP,)) * (end - at - 20)
            self._account.mask(account.OPTIONS, octets[at + 20 : end])
        stored = int(u16(octets, at + 10))
        if stored and end == at + 20:
            stored = moved(stored, was, becomes)
        else:
            new[at + 10 : at + 12] = b"\0\0"
            old = octets[at : at + 10] + b"\0\0" + octets[at + 12 : end]
            stored = renewed(stored, old, bytes(new[at:end]), b"", b"")
        new[at + 10 : at + 12] = stored.to_bytes(2, "big")

    def _extensions(self, octets: bytes, new: bytearray, at: int, end: int, kind: int) -> None:
        """Write the IPv6 extension headers between ``at`` and ``end``; only padding remains of their contents."""
        while at + 8 <= end:
            size = 8 if kind == 44 else (octets[at + 1] + 2) * 4 if kind == 51 else (octets[at + 1] + 1) * 8
            stop = min(at + size, end)
            new[at : at + 2] = octets[at : at + 2]
            if kind in {0, 60}:
                left = stop - at - 4
                new[at + 2 : at + 4] = bytes((_NOP, min(left, 255)))  # PadN
            elif kind == 44:
                new[at:stop] = octets[at:stop]
            if kind != 44:
                self._account.mask(account.OPTIONS, octets[at + 2 : stop])
            kind = octets[at]
            at = stop

    # ---- TCP and others ---------------------------------------------------------------------------------------------

    def _tcp(self, frame: int, octets: bytes, new: bytearray, packet: ip.IpPacket, vlan: int) -> bool:
        """Write a TCP segment; return False if it is unreadable or its connection was not followed."""
        at, end = int(packet.start), int(packet.end)
        if end - at < 20:
            return False
        word = u16(octets, at + 12)
        data = at + (word >> 12 << 2)
        if data < at + 20 or data > end:
            return False
        tag = vlan.to_bytes(8, "big") if vlan else b""
        track = self._survey.find(packet.addresses + octets[at : at + 4] + tag, frame)
        if track is None:
            empty = data == end and not packet.missing
            if not empty or PORTS.isdisjoint((u16(octets, at), u16(octets, at + 2))):
                return False
        new[at : at + 20] = octets[at : at + 20]
        if data > at + 20:
            new[at + 20 : data] = self._tcp_options(octets[at + 20 : data])
        if track is not None and data < end:
            seq = (u32(octets, at + 4) + (1 if word & SYN else 0)) & 0xFFFFFFFF
            new[data:end], zeroed = track.render(seq, octets[data:end])
            self._account.zeroed += zeroed
        self._checksum(octets, new, packet, at + 16)
        return True

    def _udp(self, frame: int, octets: bytes, new: bytearray, packet: ip.IpPacket, vlan: int) -> bool:
        """Write a datagram of a conversation that a binding claims; return False for any other."""
        at, end = int(packet.start), int(packet.end)
        if end - at < 8:
            return False
        tag = vlan.to_bytes(8, "big") if vlan else b""
        if self._survey.find(UDP + packet.addresses + octets[at : at + 4] + tag, frame) is None:
            return False
        data = at + 8
        stop = min(end, max(data, at + u16(octets, at + 4)))
        new[at:data] = octets[at:data]
        new[data:stop] = self._survey.datagram(frame, octets[data:stop])
        self._account.mask(account.PADDING, octets[stop:end])
        self._checksum(octets, new, packet, at + 6)
        return True

    def _tcp_options(self, options: bytes) -> bytes:
        """Return TCP options; those that may reveal something become no-operations."""
        new = bytearray(options)
        at = 0
        while at < len(options) and options[at] != 0:
            size = 1 if options[at] == _NOP else options[at + 1] if at + 1 < len(options) else 0
            if size < 1 or (size < 2 and options[at] != _NOP) or at + size > len(options):
                break
            if options[at] not in _TCP_OPTIONS:
                new[at : at + size] = bytes((_NOP,)) * size
                self._account.mask(account.OPTIONS, options[at : at + size])
            at += size
        self._account.mask(account.OPTIONS, options[at:])
        new[at:] = bytes(len(options) - at)
        return bytes(new)

    def _other(self, octets: bytes, new: bytearray, packet: ip.IpPacket) -> None:
        """Write the harmless fields of a different protocol: ports, lengths, kinds."""
        at, end = int(packet.start), int(packet.end)
        size, sum_at = 0, 0
        if packet.protocol == ip.TCP:
            size, sum_at = 20, at + 16
        elif packet.protocol == ip.UDP:
            size, sum_at = 8, at + 6
        elif packet.protocol in _ICMP:
            size, sum_at = 4, at + 2
        if not size or end - at < size:
            self._account.mask(account.FOREIGN, octets[at:end])
            return
        new[at : at + size] = octets[at : at + size]
        data = at + (u16(octets, at + 12) >> 12 << 2 if packet.protocol == ip.TCP else size)
        if data <= end and packet.protocol == ip.TCP:
            new[at + 20 : data] = self._tcp_options(octets[at + 20 : data])
        headers = self._survey.headers(octets[data:end]) if packet.protocol in _FRAGMENTED and data < end else None
        if headers is not None:
            new[data:end] = headers
        else:
            self._account.mask(account.FOREIGN, octets[max(data, at + size) : end])
        self._checksum(octets, new, packet, sum_at)

    def _checksum(self, octets: bytes, new: bytearray, packet: ip.IpPacket, at: int) -> None:
        """Write the checksum of the IP payload at ``at``."""
        start, end = int(packet.start), int(packet.end)
        size = end - start + int(packet.missing)
        stored = int(u16(octets, at))
        was, becomes, addresses = self.usual.pair(packet.addresses)
        left = stored - was - (size >> 16) - (size & 0xFFFF) - int(packet.protocol)
        if stored and packet.protocol != 1 and left % ONES:  # neither absent nor left to the network card
            old, rewritten = octets[start:end], bytes(new[start:end])
            if old != rewritten:
                was += total(old)
                becomes += total(rewritten)
            value = moved(stored, was, becomes)
            new[at : at + 2] = value.to_bytes(2, "big")
            return
        behind = size.to_bytes(4, "big") + int(packet.protocol).to_bytes(4, "big")
        old_pseudo = packet.addresses + behind
        new_pseudo = addresses + behind
        if packet.protocol == 1:
            old_pseudo = new_pseudo = b""
        old = octets[start:at] + b"\0\0" + octets[at + 2 : end]
        new[at : at + 2] = b"\0\0"
        value = renewed(stored, old, bytes(new[start:end]), old_pseudo, new_pseudo)
        new[at : at + 2] = value.to_bytes(2, "big")

    def _fragment(self, octets: bytes, new: bytearray, packet: ip.IpPacket, vlan: int) -> Fragment:
        """Return a fragment with the headers ``new``; its payload follows when its datagram is complete."""
        start, end = int(packet.start), int(packet.end)
        fragment = Fragment(new, start, end, octets[start:end])
        fragment.key = packet.fragment_key + vlan.to_bytes(8, "big")
        fragment.offset = int(packet.fragment_offset)
        fragment.more = bool(packet.more)
        fragment.addresses = packet.addresses
        fragment.protocol = int(packet.protocol)
        fragment.vlan = vlan
        fragment.blank = self._others
        return fragment
