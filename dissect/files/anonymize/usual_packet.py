"""Rewrites ordinary packets in few steps: TCP in IPv4 without options, complete, with checksums.

`dissect.files.anonymize.packet` rewrites every packet; the functions here give the same results for ordinary ones, and nothing
for others. Compiled: each slice ends after its beginning and within the packet.
"""

from __future__ import annotations

from typing import Final

from dissect.engine.transactions.connection import ISO_TSAP_PORT
from dissect.files.anonymize import account
from dissect.files.anonymize.account import Account
from dissect.files.anonymize.addresses import MAX_CACHED, AddressMap
from dissect.files.anonymize.checksum import ONES, moved, total
from dissect.files.anonymize.track import Track, track_at
from dissect.packets.tcp import ip, link
from dissect.packets.tcp.stream import SYN
from dissect.protocols.ibh.tables import NETLINK_PORT
from dissect.wire.octets import u16, u32

#: TCP ports whose packets stay if they have no payload.
PORTS: Final = frozenset((ISO_TSAP_PORT, NETLINK_PORT))
#: The first octet of an IPv4 header without options.
_PLAIN: Final = 0x45
_HEADER: Final = 20
_FRAGMENT: Final = 0x3FFF
#: TCP options that most hosts send with each segment and that stay: two no-operations and timestamps.
_TIMES: Final = b"\x01\x01\x08\x0a"
_TIMES_SIZE: Final = 12


class UsualPackets:
    """Rewrites ordinary packets. ``links`` maps link headers to their replacements, by type and octets."""

    def __init__(self, tracks: dict[bytes, list[Track]], addresses: AddressMap, counts: Account) -> None:
        self.links: dict[tuple[int, bytes], bytes] = {}
        self._tracks = tracks
        self._addresses = addresses
        self._account = counts
        self._pairs: dict[bytes, tuple[int, int, bytes]] = {}

    def pair(self, addresses: bytes) -> tuple[int, int, bytes]:
        """Return the sum of two addresses, the sum of their replacements, and the replacements."""
        known = self._pairs.get(addresses)
        if known is None:
            if len(self._pairs) >= MAX_CACHED:
                self._pairs.clear()
            half = len(addresses) // 2
            new = self._addresses.ip(addresses[:half]) + self._addresses.ip(addresses[half:])
            known = (total(addresses), total(new), new)
            self._pairs[addresses] = known
        return known

    def renew(self, frame: int, octets: bytes, link_type: int) -> bytes | None:
        """Return the rewritten form of packet ``frame``; None for any other packet, and for a new link header."""
        end = len(octets)
        ip_at, vlan = link.find_ip(octets, 0, end, link_type)
        at = int(ip_at)
        start = at + _HEADER
        if at < 0 or end < start + _HEADER or octets[at] != _PLAIN or octets[at + 9] != ip.TCP:
            return None
        stop = at + u16(octets, at + 2)
        word = u16(octets, start + 12)
        data = start + (word >> 12 << 2)
        stored, stored_ip = u16(octets, start + 16), u16(octets, at + 10)
        if u16(octets, at + 6) & _FRAGMENT or not start + _HEADER <= data <= stop <= end or not stored or not stored_ip:
            return None
        head = self.links.get((link_type, octets[:at]))
        if head is None:
            return None
        options = octets[start + _HEADER : data]
        if options and (len(options) != _TIMES_SIZE or options[:4] != _TIMES):
            return None
        addresses = octets[at + 12 : start]
        was, becomes, replacements = self.pair(addresses)
        if (stored - was - (stop - start) - ip.TCP) % ONES == 0:
            return None  # left to the network card
        key = addresses + octets[start : start + 4]
        if vlan:
            key += int(vlan).to_bytes(8, "big")
        track = track_at(self._tracks.get(key), frame)
        if track is None and (data != stop or PORTS.isdisjoint((u16(octets, start), u16(octets, start + 2)))):
            return None
        payload = octets[data:stop]
        old_sum, new_sum = was, becomes
        if track is not None and payload:
            seq = (u32(octets, start + 4) + (1 if word & SYN else 0)) & 0xFFFFFFFF
            new, zeroed = track.render(seq, payload)
            self._account.zeroed += zeroed
            if new != payload:
                old_sum += total(payload)
                new_sum += total(new)
                payload = new
        padding = octets[stop:]
        if padding:
            self._account.mask(account.PADDING, padding)
            padding = bytes(len(padding))
        return b"".join((
            head,
            octets[at : at + 10],
            moved(stored_ip, was, becomes).to_bytes(2, "big"),
            replacements,
            octets[start : start + 16],
            moved(stored, old_sum, new_sum).to_bytes(2, "big"),
            octets[start + 18 : data],
            payload,
            padding,
        ))  # fmt: skip
