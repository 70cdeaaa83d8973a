"""Finds the IP packet in a captured frame: of Ethernet, Linux cooked, raw IP, BSD loopback or PPP.

Between an EtherType and IP there may be VLAN tags, LLC with SNAP (RFC 1042), MPLS labels (RFC 3032), PPPoE (RFC 2516), an HSR
tag (IEC 62439-3), Cisco's CMD and VN-Tag, MACsec without encryption (IEEE 802.1AE). None of these holds addresses. Frames in
frames, which do, are opened by `dissect.packets.tcp.tunnel`.
"""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.wire.octets import u16

NULL: Final = 0
ETHERNET: Final = 1
PPP: Final = 9
RAW_BSD: Final = 12
RAW_OPENBSD: Final = 14
PPP_HDLC: Final = 50
RAW: Final = 101
LOOP: Final = 108
LINUX_SLL: Final = 113
IPV4: Final = 228
IPV6: Final = 229
LINUX_SLL2: Final = 276

#: What `find_ip` returns instead of an offset.
NOT_IP: Final = -1
CUT: Final = -2
UNSUPPORTED: Final = -3
#: An Ethernet frame is in the frame (MPLS): the second number says where.
FRAME: Final = -4
#: What follows cannot be read: the second number is a key of `SEALED_NAMES`.
SEALED: Final = -5

TYPE_IPV4: Final = 0x0800
TYPE_IPV6: Final = 0x86DD
#: The EtherTypes of a VLAN tag, and of one that stands in front of others (IEEE 802.1Q).
TAG: Final = 0x8100
OUTER_TAG: Final = 0x88A8
_VN_TAG: Final = 0x8926
_HSR: Final = 0x892F
_CMD: Final = 0x8909
MPLS: Final = 0x8847
_MPLS_MULTICAST: Final = 0x8848
_PPPOE: Final = 0x8864
_MACSEC: Final = 0x88E5
_MAX_TAGS: Final = 4
#: Headers other than tags, and MPLS labels, in one frame.
_MAX_HEADERS: Final = 4
_MAX_LABELS: Final = 16
_SNAP: Final = b"\xaa\xaa\x03\x00\x00\x00"
#: Instead of the offset of an EtherType: no EtherType follows, IP does.
_IP: Final = -16
#: PPP protocols that are compressed, encrypted or cut into pieces (IANA): Van Jacobson, multilink, encryption, compression.
_PPP_SEALED: Final = frozenset((0x2D, 0x2F, 0x3D, 0x53, 0x55, 0xFB, 0xFD))

#: Encapsulations that cannot be read, by EtherType.
SEALED_NAMES: Final[dict[int, str]] = {_MACSEC: "MACsec", _PPPOE: "PPP that is compressed, encrypted or in pieces"}


def find_ip(buf: bytes, start: i64, end: i64, link_type: i64) -> tuple[i64, i64]:
    """Return (offset of the IP header, VLAN key) of the frame ``buf[start:end]``.

    Where there is no IP header the first number is `NOT_IP`, `CUT`, `UNSUPPORTED`, `FRAME` or `SEALED`. The VLAN key is 0 for
    an untagged frame (and for a tag with VLAN id 0, which is only a priority), and differs for different stacks of VLAN ids.
    """
    if link_type == ETHERNET:
        return _after_tags(buf, start + 12, start + 14, end)
    if link_type == LINUX_SLL:
        return _after_tags(buf, start + 14, start + 16, end)
    if link_type == LINUX_SLL2:  # the EtherType comes first
        return _after_tags(buf, start, start + 20, end)
    if link_type == RAW or link_type == RAW_BSD or link_type == RAW_OPENBSD or link_type == IPV4 or link_type == IPV6:
        return start, 0
    if link_type == NULL or link_type == LOOP:
        at: i64 = start + 4
        if end - start < 5:
            return CUT, 0
        # The address family is in the byte order of the machine that captured, and IPv6's number differs between systems; the
        # version nibble of the packet itself is the same everywhere.
        version: i64 = buf[at] >> 4
        return (at if version == 4 or version == 6 else NOT_IP), 0
    if link_type == PPP or link_type == PPP_HDLC:
        return _serial(buf, start, end)
    return UNSUPPORTED, 0


def _after_tags(buf: bytes, type_at: i64, at: i64, end: i64) -> tuple[i64, i64]:
    """Return what `find_ip` does, for an EtherType at ``type_at`` whose content is at ``at``."""
    if at > end:
        return CUT, 0
    ethertype: i64 = u16(buf, type_at)
    if ethertype == TYPE_IPV4 or ethertype == TYPE_IPV6:
        return at, 0
    return after_type(buf, ethertype, at, end)


def after_type(buf: bytes, ethertype: i64, at: i64, end: i64) -> tuple[i64, i64]:
    """Return what `find_ip` does, for content of this EtherType at ``at``."""
    vlan: i64 = 0
    tags: i64 = 0
    headers: i64 = 0
    type_at: i64
    while ethertype != TYPE_IPV4 and ethertype != TYPE_IPV6:
        if ethertype == TAG or ethertype == OUTER_TAG or ethertype == 0x9100 or ethertype == 0x9200:
            if tags == _MAX_TAGS:
                return NOT_IP, 0
            if at + 4 > end:
                return CUT, 0
            vid: i64 = u16(buf, at) & 0x0FFF
            if vid != 0:
                vlan = vlan * 4096 + vid
            tags += 1
            type_at = at + 2
            at += 4
        else:
            if headers == _MAX_HEADERS:
                return NOT_IP, 0
            headers += 1
            type_at, at = _after_header(buf, ethertype, at, end)
            if type_at == _IP:
                return at, vlan
            if type_at < 0:
                return type_at, at
        ethertype = u16(buf, type_at)
    return at, vlan


def _after_header(buf: bytes, ethertype: i64, at: i64, end: i64) -> tuple[i64, i64]:
    """Step over the header at ``at``, of an EtherType other than a VLAN tag; return offsets of the next EtherType and content.

    If no EtherType follows, return `_IP` and the offset of IP; if nothing can be found, the result of `find_ip` for that case.
    """
    size: i64
    if 0 < ethertype <= 1500:  # a length, which LLC follows
        head = buf[at : min(at + 6, end)]
        if not _SNAP.startswith(head):
            return NOT_IP, 0
        size = 8
    elif ethertype == _HSR or ethertype == _VN_TAG:
        size = 6
    elif ethertype == _CMD:  # version, number of options of four octets each
        if at + 2 > end:
            return CUT, 0
        options: i64 = buf[at + 1]
        size = 4 + options * 4
    elif ethertype == MPLS or ethertype == _MPLS_MULTICAST:
        return _after_labels(buf, at, end)
    elif ethertype == _PPPOE:
        if at + 6 > end:
            return CUT, 0
        return _after_ppp(buf, at + 6, end) if u16(buf, at) == 0x1100 else (NOT_IP, 0)
    elif ethertype == _MACSEC:
        if at + 1 > end:
            return CUT, 0
        # Encrypted, or with the address of a station (SCI), which a header stepped over here must not hold.
        if buf[at] & 0xAC:
            return SEALED, _MACSEC
        size = 8
    else:
        return NOT_IP, 0
    if at + size > end:
        return CUT, 0
    return at + size - 2, at + size


def _after_labels(buf: bytes, at: i64, end: i64) -> tuple[i64, i64]:
    """Step over a stack of MPLS labels.

    No field gives the type of the content: if it begins with an IP version it is IP, otherwise a frame. A control word may
    precede the frame. A control word begins with four bits of 0 (RFC 4385), but the frame's first address may as well.
    """
    for _ in range(_MAX_LABELS):
        if at + 4 > end:
            return CUT, 0
        bottom: i64 = buf[at + 2] & 1
        at += 4
        if bottom:
            break
    else:
        return NOT_IP, 0
    if at >= end:
        return CUT, 0
    version: i64 = buf[at] >> 4
    if version == 4 or version == 6:
        return _IP, at
    if version:
        return NOT_IP, 0
    if at + 14 <= end and _is_usual(u16(buf, at + 12)) and not (at + 18 <= end and _is_usual(u16(buf, at + 16))):
        return FRAME, at
    return FRAME, at + 4


def _is_usual(ethertype: i64) -> bool:
    """Return whether this is the EtherType of IP or of a VLAN tag."""
    return ethertype == TYPE_IPV4 or ethertype == TYPE_IPV6 or ethertype == TAG or ethertype == OUTER_TAG


def _serial(buf: bytes, at: i64, end: i64) -> tuple[i64, i64]:
    """Return what `find_ip` does, for PPP with address and control octets (RFC 1662) or without, or for Cisco's HDLC."""
    if at + 2 > end:
        return CUT, 0
    head: i64 = u16(buf, at)
    if head == 0x0F00 or head == 0x8F00:
        return _after_tags(buf, at + 2, at + 4, end)
    type_at, found = _after_ppp(buf, at + 2 if head == 0xFF03 else at, end)
    return (found, 0) if type_at == _IP else (type_at, found)


def _after_ppp(buf: bytes, at: i64, end: i64) -> tuple[i64, i64]:
    """Step over a PPP protocol number, of two octets or compressed to one (RFC 1661, 6.5); return what `_after_header` does."""
    if at >= end:
        return CUT, 0
    protocol: i64 = buf[at]
    if protocol & 1:
        at += 1
    elif at + 2 > end:
        return CUT, 0
    else:
        protocol = u16(buf, at)
        at += 2
    if protocol == 0x21 or protocol == 0x57:
        return _IP, at
    return (SEALED, _PPPOE) if protocol in _PPP_SEALED else (NOT_IP, 0)


def vlan_ids(key: i64) -> list[int]:
    """Return the VLAN ids of a VLAN key, the outer tag first; each is twelve bits of the key."""
    vids: list[int] = []
    while key:
        vids.append(key & 0xFFF)
        key >>= 12
    vids.reverse()
    return vids


def within(name: str, key: i64) -> str:
    """Return ``name``, the address of a station or of an end of a connection, with its VLAN if it is in one.

    Identical machines may use the same addresses, each in a VLAN of its own.
    """
    return f"{name} in VLAN {vlan_text(key)}" if key else name


def vlan_text(key: i64) -> str:
    """Return the VLAN ids of a key as text: ``20``, or ``5.7`` with the outer tag first; empty for none."""
    return ".".join([str(vid) for vid in vlan_ids(key)])
