"""The relayed traffic as one capture file, written while it is relayed."""

from __future__ import annotations

from dissect.live.run import Companion
from dissect.source.live.reader import Drops
from dissect.source.pcapng_writer import PcapngWriter


class CaptureFile(Companion):
    """Writes each packet to ``writer`` before it is analysed, and ends the file with the run.

    If the file can no longer be written (the disk is full), the run and the relay go on without it.
    """

    name = "the capture file"
    wants_packets = True

    def __init__(self, writer: PcapngWriter) -> None:
        super().__init__()
        self._writer = writer

    def packet(self, time_ns: int, octets: bytes, wire_length: int, link_type: int, interface: str) -> None:
        """Write a packet."""
        self._writer.packet(time_ns, octets, wire_length, link_type, name=interface)

    def tick(self, now_ns: int, drops: Drops) -> None:
        """Write buffered packets."""
        self._writer.flush()

    def close(self) -> None:
        """End the file."""
        self._writer.close()
