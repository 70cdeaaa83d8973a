"""Reads the packets in a block of the kernel's packet ring (TPACKET_V3, linux/if_packet.h)."""

from __future__ import annotations

import struct
import sys
from typing import Final

from mypy_extensions import i64

from dissect.packets.source.packet import PacketSink
from dissect.packets.source.pcap import u32le
from dissect.wire.build import COMPILED

#: The ``tpacket3_hdr`` of a packet: offset of the next packet, seconds, nanoseconds, size captured and on the wire, status,
#: offset of the link layer, VLAN TCI, VLAN TPID; then, from the ``sockaddr_ll`` after it, the kind of packet.
_PACKET: Final = struct.Struct("=IIIIIIH6xIH20xB")
_SIZE: Final = 59

_VLAN_VALID: Final = 0x10
_TPID_VALID: Final = 0x40
_DEFAULT_TPID: Final = 0x8100
_OUTGOING: Final = 4
#: Offset of a VLAN tag in a frame: after the two addresses.
_TAG_AT: Final = 12
_TAG: Final = struct.Struct(">HH")
#: The kernel writes in the byte order of the machine.
_LITTLE: Final[bool] = sys.byteorder == "little"


def deliver_block(block: bytes, first: i64, count: i64, sink: PacketSink, link_type: i64, skip_outgoing: bool) -> i64:
    """Give the ``count`` packets of ``block``, the first of them at ``first``, to ``sink``; return how many were delivered.

    The kernel takes the VLAN tag out of a frame and puts it into the header; it is put back here. ``skip_outgoing`` leaves out
    packets being sent, because a loopback interface receives the same packets as well.
    """
    size: i64 = len(block)
    at: i64 = first
    delivered: i64 = 0
    left: i64 = count
    by_index: bool = COMPILED and _LITTLE
    next_at: i64
    seconds: i64
    nanoseconds: i64
    captured: i64
    wire: i64
    status: i64
    mac: i64
    tci: i64
    tpid: i64
    kind: i64
    while left > 0 and at + _SIZE <= size:
        left -= 1
        if by_index:
            next_at, seconds, nanoseconds = u32le(block, at), u32le(block, at + 4), u32le(block, at + 8)
            captured, wire, status = u32le(block, at + 12), u32le(block, at + 16), u32le(block, at + 20)
            mac = u32le(block, at + 24) & 0xFFFF
            tci = u32le(block, at + 32)
            tpid = u32le(block, at + 36) & 0xFFFF
            kind = block[at + 58]
        else:
            next_at, seconds, nanoseconds, captured, wire, status, mac, tci, tpid, kind = _PACKET.unpack_from(block, at)
        if not (skip_outgoing and kind == _OUTGOING):
            start: i64 = at + mac
            end: i64 = min(start + captured, size)
            time_ns: i64 = seconds * 1_000_000_000 + nanoseconds
            if (tci or status & _VLAN_VALID) and link_type == 1 and end - start >= _TAG_AT:
                tag = _TAG.pack(tpid if status & _TPID_VALID else _DEFAULT_TPID, tci & 0xFFFF)
                frame = block[start : start + _TAG_AT] + tag + block[start + _TAG_AT : end]
                sink.frame(time_ns, frame, 0, len(frame), wire + 4, link_type)
            else:
                sink.frame(time_ns, block, start, end, wire, link_type)
            delivered += 1
        if not next_at:
            break
        at += next_at
    return delivered
