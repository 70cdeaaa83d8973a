"""Packets of a live run that are kept on disk: all of them in a ring of files, or those around findings."""

from __future__ import annotations

from dissect.findings.reporter import Finding
from dissect.live.run import Companion
from dissect.recording.event_capture import EventCapture
from dissect.recording.ring_buffer import RingBuffer
from dissect.source.live.reader import Drops


class RingCompanion(Companion):
    """Writes every packet to ``ring``; buffered packets are on disk after the next tick."""

    name = "the ring of files"
    wants_packets = True

    def __init__(self, ring: RingBuffer) -> None:
        super().__init__()
        self.ring = ring

    def packet(self, time_ns: int, octets: bytes, wire_length: int, link_type: int, interface: str) -> None:
        """Write a packet."""
        self.ring.add(time_ns, octets, wire_length, link_type, interface)

    def tick(self, now_ns: int, drops: Drops) -> None:
        """End the present file if it is old enough; write buffered packets."""
        self.ring.tick(now_ns)
        self.ring.flush()

    def close(self) -> None:
        """Finish the present file."""
        self.ring.close()


class KeeperCompanion(Companion):
    """Keeps the packets around the findings that trigger ``keeper``."""

    name = "keeping packets around findings"
    wants_packets = True

    def __init__(self, keeper: EventCapture) -> None:
        super().__init__()
        self.keeper = keeper

    def packet(self, time_ns: int, octets: bytes, wire_length: int, link_type: int, interface: str) -> None:
        """Remember a packet, or write it if a file is open."""
        self.keeper.add(time_ns, octets, wire_length, link_type, interface)

    def finding(self, finding: Finding) -> None:
        """Begin a file, or add a comment to a packet."""
        self.keeper.finding(finding)

    def tick(self, now_ns: int, drops: Drops) -> None:
        """Write the latest packet, on which no further findings come; end the file if its time is over."""
        self.keeper.settle()
        self.keeper.tick(now_ns)

    def close(self) -> None:
        """Finish the present file."""
        self.keeper.close()
