"""From a captured frame to the IP packet in it: Ethernet with VLAN tags, Linux cooked, raw IP, BSD loopback."""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.wire.octets import u16

NULL: Final = 0
ETHERNET: Final = 1
RAW_BSD: Final = 12
RAW_OPENBSD: Final = 14
RAW: Final = 101
LOOP: Final = 108
LINUX_SLL: Final = 113
IPV4: Final = 228
IPV6: Final = 229
LINUX_SLL2: Final = 276

#: Answers of `find_ip` instead of an offset.
NOT_IP: Final = -1
CUT: Final = -2
UNSUPPORTED: Final = -3

_ETHERTYPE_IPV4: Final = 0x0800
_ETHERTYPE_IPV6: Final = 0x86DD
_MAX_TAGS: Final = 4


def find_ip(buf: bytes, start: i64, end: i64, link_type: i64) -> tuple[i64, i64]:
    """Return (offset of the IP header, VLAN key) of the frame ``buf[start:end]``.

    The offset is `NOT_IP`, `CUT` or `UNSUPPORTED` when there is none. The VLAN key is 0 for an untagged frame (and for a tag
    with VLAN id 0, which is only a priority), and differs for different stacks of VLAN ids.
    """
    if link_type == ETHERNET:
        return _after_tags(buf, start + 12, start + 14, end)
    if link_type == LINUX_SLL:
        return _after_tags(buf, start + 14, start + 16, end)
    if link_type == LINUX_SLL2:  # its EtherType stands first
        return _after_tags(buf, start, start + 20, end)
    if link_type == RAW or link_type == RAW_BSD or link_type == RAW_OPENBSD or link_type == IPV4 or link_type == IPV6:
        return start, 0
    if link_type == NULL or link_type == LOOP:
        at: i64 = start + 4
        if end - start < 5:
            return CUT, 0
        # The address family is in the byte order of the machine that captured, and IPv6's number differs between
        # systems; the version nibble of the packet itself is the same everywhere.
        version: i64 = buf[at] >> 4
        return (at if version == 4 or version == 6 else NOT_IP), 0
    return UNSUPPORTED, 0


def _after_tags(buf: bytes, type_at: i64, at: i64, end: i64) -> tuple[i64, i64]:
    """Step over VLAN tags: the EtherType stands at ``type_at``, what it announces at ``at``."""
    vlan: i64 = 0
    tags: i64 = 0
    while True:
        if at > end:
            return CUT, 0
        ethertype: i64 = u16(buf, type_at)
        if ethertype == _ETHERTYPE_IPV4 or ethertype == _ETHERTYPE_IPV6:
            return at, vlan
        if (ethertype != 0x8100 and ethertype != 0x88A8 and ethertype != 0x9100) or tags == _MAX_TAGS:
            return NOT_IP, 0
        if at + 4 > end:
            return CUT, 0
        vid: i64 = u16(buf, at) & 0x0FFF
        if vid != 0:
            vlan = vlan * 4096 + vid
        tags += 1
        type_at = at + 2
        at += 4


def vlan_ids(key: i64) -> list[int]:
    """Return the VLAN ids of a key of `find_ip`, the outer tag first, from the number that holds them in twelve bits each."""
    vids: list[int] = []
    while key:
        vids.append(key & 0xFFF)
        key >>= 12
    vids.reverse()
    return vids


def within(name: str, key: i64) -> str:
    """Return what a station or an end of a connection is called: its address, and its network where that has a number.

    Machines that are alike use the same addresses in VLANs of their own.
    """
    return f"{name} in VLAN {vlan_text(key)}" if key else name


def vlan_text(key: i64) -> str:
    """Return the VLAN ids of a key for a person: ``20``, ``5.7`` with the outer tag first; empty for none."""
    return ".".join([str(vid) for vid in vlan_ids(key)])
