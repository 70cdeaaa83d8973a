"""Writes packets as blocks of a pcapng file, and counts them for the statistics at its end. Compiled, as each packet passes."""

from __future__ import annotations

import struct
from typing import Final

from dissect.source.pcapng import ENHANCED_PACKET, MAX_BLOCK

#: The latest time that a block can hold, nanoseconds since 1970.
MAX_COUNT: Final = 2**64 - 1
_MASK: Final = 0xFFFFFFFF
_PACKET_HEAD: Final = struct.Struct("<IIIIIII")
#: The padding after a packet, by its size modulo four.
_PADDING: Final = (b"", bytes(3), bytes(2), bytes(1))


def plain_block(interface: int, time_ns: int, octets: bytes, wire_length: int, options: bytes = b"") -> bytes:
    """Return an Enhanced Packet Block with these packed ``options``; see `dissect.source.pcapng_writer.packet_block`.

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


class Told:
    """What the statistics of one interface say at the end of the file; ``received`` and ``dropped`` are -1 if not known."""

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

    __slots__ = ("_blocks", "_interface", "_told", "octets", "packets")

    def __init__(self, interface: int, told: Told) -> None:
        self.packets = 0
        self.octets = 0
        self._blocks: list[bytes] = []
        self._interface = interface
        self._told = told

    def add(self, time_ns: int, octets: bytes, wire_length: int) -> None:
        """Take the next packet."""
        block = plain_block(self._interface, time_ns, octets, wire_length)
        self._blocks.append(block)
        self._told.count(time_ns)
        self.packets += 1
        self.octets += len(block)

    def take(self) -> bytes:
        """Return the blocks that were gathered, and begin again with none."""
        whole = b"".join(self._blocks)
        self._blocks = []
        self.packets = 0
        self.octets = 0
        return whole
