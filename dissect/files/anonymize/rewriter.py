"""Second pass: rewrites every packet that can be published, in order."""

from __future__ import annotations

from collections import deque
from typing import Final

from mypy_extensions import i64

from dissect.files.anonymize.account import Account
from dissect.files.anonymize.fragments import Fragment, Fragments
from dissect.files.anonymize.packet import Packets
from dissect.files.anonymize.usual_packet import UsualPackets
from dissect.packets.source.packet import PacketSink
from dissect.packets.source.packet_blocks import PacketBlocks
from dissect.packets.source.pcapng_writer import PcapngWriter
from dissect.packets.tcp.tunnel import unwrapped

#: Maximum size of packets that are held back behind a fragment of an incomplete datagram.
MAX_WAITING: Final = 32 * 1024 * 1024
_COST: Final = 256
#: Size of the blocks that are passed to the writer.
_TOGETHER: Final = 65_536
#: The latest time that can be read back, in 2262: readers limit later times to it.
_LAST_NS: Final = 2**63 - 1


class _Waiting:
    """A packet that is written as soon as those before it are."""

    __slots__ = ("link_type", "packet", "size", "time_ns", "wire_length")

    def __init__(self, packet: bytes | Fragment, time_ns: int, wire_length: int, link_type: int, size: int) -> None:
        self.packet = packet
        self.time_ns = time_ns
        self.wire_length = wire_length
        self.link_type = link_type
        self.size = size


class Rewriter(PacketSink):
    """Reads the packets of a capture again, and writes them to ``writer`` with times later by ``shift_ns``."""

    def __init__(self, packets: Packets, writer: PcapngWriter, counts: Account, shift_ns: int = 0) -> None:
        self._packets = packets
        self._usual: UsualPackets = packets.usual
        self._writer = writer
        self._account = counts
        self._shift_ns = shift_ns
        self._fragments = Fragments()
        self._waiting: deque[_Waiting] = deque()
        self._size = 0
        self._blocks: PacketBlocks | None = None  # cached, for packets of this link type
        self._link_type = -1

    def comment(self, text: str) -> None:
        """Drop a comment: its content is unknown."""
        self._account.comments += 1

    def secrets(self, text: bytes) -> None:
        """Drop session keys: they would decrypt everything."""
        self._account.secrets += 1

    def frame(self, time_ns: i64, buf: bytes, start: i64, end: i64, wire_length: i64, link_type: i64) -> None:
        """Take a packet."""
        self._account.packets += 1
        octets = buf[start:end]
        new: bytes | Fragment | None = self._usual.renew(self._account.packets, octets, int(link_type))
        if new is None:
            inner = unwrapped(octets, link_type)
            if inner is not None:
                octets, link_type, missing = inner
                wire_length = len(octets) + missing
            new = self._packets.renew(self._account.packets, octets, int(link_type))
        if new is None:
            return
        if not self._waiting and isinstance(new, bytes):
            self._write(int(time_ns), new, int(wire_length), int(link_type))
            return
        size = int(end - start) + _COST
        self._waiting.append(_Waiting(new, int(time_ns), int(wire_length), int(link_type), size))
        self._size += size
        if isinstance(new, Fragment):
            whole = self._fragments.add(new, int(time_ns))
            if whole is not None:
                self._packets.whole(self._account.packets, *whole)
        while self._size > MAX_WAITING and self._fragments.give_up():
            self._drain()
        self._drain()

    def finish(self) -> None:
        """Write the packets that still wait for missing fragments, at the end of the capture."""
        while self._fragments.give_up():
            pass
        self._drain()
        if self._blocks is not None:
            self._writer.put(self._blocks)

    def _drain(self) -> None:
        """Write the packets that need not wait any longer."""
        while self._waiting:
            first = self._waiting[0]
            new: bytes | None
            if isinstance(first.packet, Fragment):
                if not first.packet.settled:
                    return
                new = first.packet.result
            else:
                new = first.packet
            self._waiting.popleft()
            self._size -= first.size
            if new is None:
                self._packets.unsettled()
                continue
            self._write(first.time_ns, new, first.wire_length, first.link_type)

    def _write(self, time_ns: int, octets: bytes, wire_length: int, link_type: int) -> None:
        self._account.written += 1
        blocks = self._blocks
        if blocks is None or link_type != self._link_type:
            if blocks is not None:
                self._writer.put(blocks)
            blocks = self._writer.blocks(link_type)
            self._blocks = blocks
            self._link_type = link_type
        blocks.add(min(time_ns + self._shift_ns, _LAST_NS), octets, wire_length)
        if blocks.octets >= _TOGETHER:
            self._writer.put(blocks)
