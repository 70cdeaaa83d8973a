"""Writes packets as blocks of a pcapng file, and counts them for the statistics at its end. Compiled, as each packet passes."""

from __future__ import annotations

import struct
from typing import Final

from librt.strings import BytesWriter, write_i32_le, write_i64_le
from mypy_extensions import i32, i64

from dissect.packets.source.pcapng import ENHANCED_PACKET, MAX_BLOCK

#: The latest time that a block can hold, nanoseconds since 1970.
MAX_COUNT: Final = 2**64 - 1
_MASK: Final = 0xFFFFFFFF
_MOST_SIGNED: Final = 0x7FFFFFFF
_MOST_NS: Final = 2**62 - 1
_PACKET_HEAD: Final = struct.Struct("<IIIIIII")
#: The padding after a packet, by its size modulo four.
_PADDING: Final = (b"", bytes(3), bytes(2), bytes(1))


def plain_block(interface: int, time_ns: int, octets: bytes, wire_length: int, options: bytes = b"") -> bytes:
    """Return an Enhanced Packet Block with these packed ``options``; see `dissect.packets.source.pcapng_writer.packet_block`.

    Raises ValueError as that does.
    """
    size = len(octets)
    behind = _PADDING[size & 3]
    if options:
        behind += options
    total = 32 + size + len(behind)
    if total > MAX_BLOCK:
        raise ValueError(f"a packet of {size} bytes is larger than a pcapng block may be ({MAX_BLOCK} bytes)")
    time_ns = min(max(time_ns, 0), MAX_COUNT)
    head = _PACKET_HEAD.pack(
        ENHANCED_PACKET, total, interface, time_ns >> 32, time_ns & _MASK, size, max(wire_length, size)
    )
    return b"".join((head, octets, behind, head[4:8]))  # a block has its size at both ends


class InterfaceStatistics:
    """The statistics of one interface at the end of the file; ``received`` and ``dropped`` are -1 if not known."""

    __slots__ = ("dropped", "first_ns", "last_ns", "packets", "received")

    def __init__(self) -> None:
        self.first_ns = 0
        self.last_ns = 0
        self.packets = 0
        self.received = -1
        self.dropped = -1

    def count(self, time_ns: int) -> None:
        """Take note of a packet."""
        if self.packets == 0:
            self.first_ns = self.last_ns = min(max(time_ns, 0), MAX_COUNT)
        elif time_ns > self.last_ns:
            self.last_ns = min(time_ns, MAX_COUNT)
        elif time_ns < self.first_ns:
            self.first_ns = max(time_ns, 0)
        self.packets += 1


class PacketBlocks:
    """Gathers packets of one interface to be written together: ``packets`` of them, in blocks of ``octets`` octets."""

    __slots__ = ("_interface", "_out", "_told", "octets", "packets")

    def __init__(self, interface: int, told: InterfaceStatistics) -> None:
        self.packets: i64 = 0
        self.octets: i64 = 0
        self._out: BytesWriter = BytesWriter()
        self._interface: i64 = interface
        self._told: InterfaceStatistics = told

    def add(self, time_ns: int, octets: bytes, wire_length: i64) -> None:
        """Take the next packet. Raises as `plain_block` does."""
        size: i64 = len(octets)
        padding: i64 = -size & 3
        total: i64 = 32 + size + padding
        if total > MAX_BLOCK or time_ns < 0 or time_ns > _MOST_NS:
            self._out.write(plain_block(int(self._interface), time_ns, octets, int(wire_length)))
        else:
            self._write(time_ns, octets, max(wire_length, size), padding, total)
        self._told.count(time_ns)
        self.packets += 1
        self.octets += total

    def _write(self, since: i64, octets: bytes, on_wire: i64, padding: i64, total: i64) -> None:
        """Write what `plain_block` returns."""
        if on_wire > _MOST_SIGNED:
            on_wire -= 1 << 32  # as a signed number with the same four octets
        size: i64 = len(octets)
        out = self._out
        write_i64_le(out, total << 32 | ENHANCED_PACKET)
        write_i64_le(out, since >> 32 << 32 | self._interface)
        write_i64_le(out, size << 32 | since & _MASK)
        write_i32_le(out, i32(on_wire))
        out.write(octets)
        while padding:
            out.append(0)
            padding -= 1
        write_i32_le(out, i32(total))

    def take(self) -> bytes:
        """Return the gathered blocks, and begin again with none."""
        whole = self._out.getvalue()
        self._out.truncate(0)
        self.packets = 0
        self.octets = 0
        return whole
