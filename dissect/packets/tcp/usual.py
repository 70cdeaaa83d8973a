"""`usual_ip` finds the IP packet in everyday frames at less cost than `dissect.packets.tcp.link` finds it in any frame.

It looks at numbers only: an object for a frame would take as long as all else that is done to find its connection.
"""

from __future__ import annotations

from typing import Final

from librt.strings import read_i16_be, read_i32_be, read_i64_be
from mypy_extensions import i64

from dissect.packets.tcp.link import (
    CUT,
    ETHERNET,
    LINUX_SLL,
    LINUX_SLL2,
    OUTER_TAG,
    RAW,
    TAG,
    TYPE_IPV4,
    TYPE_IPV6,
    find_ip,
)

#: The octets of the smallest headers of IPv4 and TCP; a frame with fewer has nothing to look for.
LEAST: Final = 40


def usual_ip(buf: bytes, start: i64, end: i64, link_type: i64) -> tuple[i64, i64]:
    """Return (offset of the IP header, VLAN key) of the frame ``buf[start:end]``, as `find_ip` does.

    The first is negative where there is none, or where fewer than `LEAST` octets are left for it.
    """
    if end - start < LEAST:
        return CUT, 0
    at: i64 = start
    vlan: i64 = 0
    kind: i64 = TYPE_IPV4
    if link_type == ETHERNET:
        at = start + 14
        word: i64 = read_i64_be(buf, start + 12)  # an EtherType; that and a tag; what is behind that
        kind = word >> 48 & 0xFFFF
        if kind == TAG or kind == OUTER_TAG:
            vlan = word >> 32 & 0xFFF
            kind = word >> 16 & 0xFFFF
            at = start + 18
            if kind == TAG:
                word = i64(read_i32_be(buf, at))
                if word & 0xFFF0000:
                    vlan = vlan * 4096 + (word >> 16 & 0xFFF)
                kind = word & 0xFFFF
                at = start + 22
    elif link_type == LINUX_SLL:
        at = start + 16
        kind = i64(read_i16_be(buf, start + 14)) & 0xFFFF
    elif link_type == LINUX_SLL2:
        at = start + 20
        kind = i64(read_i16_be(buf, start)) & 0xFFFF
    elif link_type != RAW:
        kind = 0
    if kind != TYPE_IPV4 and kind != TYPE_IPV6:
        at, vlan = find_ip(buf, start, end, link_type)
    if at + LEAST > end:
        return CUT, 0
    return at, vlan
