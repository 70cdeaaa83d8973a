"""The traffic of a run as one capture file, written during the run."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

from dissect.online.live.writing import WritingCompanion
from dissect.packets.source.live.reader import Drops
from dissect.packets.source.pcapng_writer import PcapngWriter


class CaptureFile(WritingCompanion):
    """Writes each packet to ``writer`` before it is analysed, and ends the file with the run.

    While the file cannot be written (the disk is full), packets are counted, and the run and the relay continue; after 1, 2, 4
    … 60 s writing is tried again, after the last complete packet.
    """

    name = "the capture file"
    label = "file"
    wants_packets = True

    def __init__(self, writer: PcapngWriter, clock: Callable[[], float] = time.monotonic) -> None:
        super().__init__(Path(writer.path).parent, clock)
        self._writer = writer
        self._lost = (0, 0)

    @property
    def lost(self) -> tuple[int, int]:
        """How many packets are not in the file, and their octets."""
        return self._lost

    @property
    def written(self) -> tuple[int, int]:
        """One file, and its octets."""
        return 1, self._writer.octets

    def recover(self, error: OSError) -> bool:
        """Count the gathered packets that are lost; return False if the file permanently ends in the middle of a packet."""
        self._miss(*self._writer.unwritten)
        return self._writer.resume() and super().recover(error)

    def packet(self, time_ns: int, octets: bytes, wire_length: int, link_type: int, interface: str) -> None:
        """Write a packet; while writing fails, count it."""
        if not self.recovery.due:
            self._miss(1, len(octets))
            return
        self._writer.packet(time_ns, octets, wire_length, link_type, name=interface)
        if self.recovery.failing:
            self._writer.flush()
            self.resumed()

    def tick(self, now_ns: int, drops: Drops) -> None:
        """Write buffered packets."""
        self._writer.flush()

    def close(self) -> None:
        """End the file; if it cannot be written, it ends after its last complete packet."""
        try:
            self._writer.close()
        except OSError:
            self._miss(*self._writer.unwritten)
            if not self.recovery.failing:
                raise

    def _miss(self, packets: int, octets: int) -> None:
        self._lost = (self._lost[0] + packets, self._lost[1] + octets)
