"""Packets of a live run that are kept on disk: all of them in a ring of files, or those around findings."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Final

from dissect.alerts.problems import INTERFACE
from dissect.findings.reporter import Finding
from dissect.live.problems import Problem
from dissect.live.writing import WritingCompanion
from dissect.recording.comments import MARK
from dissect.recording.event_capture import EventCapture
from dissect.recording.ring_buffer import RingBuffer
from dissect.source.live.reader import Drops
from dissect.wire.text import printable

#: So often (capture time) the ring looks whether files are too old or too much space is taken.
_LOOK_NS: Final = 1_000_000_000


class RingCompanion(WritingCompanion):
    """Writes every packet to ``ring``; buffered packets are on disk after the next tick."""

    name = "the ring of files"
    label = "ring"
    wants_packets = True

    def __init__(self, ring: RingBuffer, clock: Callable[[], float] = time.monotonic) -> None:
        super().__init__(ring.directory, clock)
        self.ring = ring
        self._looked_ns = 0

    @property
    def lost(self) -> tuple[int, int]:
        """How many packets are in no file, and their octets."""
        return self.ring.lost, self.ring.lost_octets

    @property
    def written(self) -> tuple[int, int]:
        """How many files were finished, and their octets."""
        return self.ring.files, self.ring.octets

    def packet(self, time_ns: int, octets: bytes, wire_length: int, link_type: int, interface: str) -> None:
        """Write a packet; while writing fails, count it."""
        ring = self.ring
        if not self.recovery.failing:
            ring.add(time_ns, octets, wire_length, link_type, interface)
        elif self.recovery.due:
            ring.add(time_ns, octets, wire_length, link_type, interface)
            ring.flush()
            self.resumed()
        else:
            ring.miss(1, len(octets))

    def tick(self, now_ns: int, drops: Drops) -> None:
        """End the present file if it is old enough; write buffered packets; remove what is too old or too much."""
        self.ring.tick(now_ns)
        self.ring.flush()
        if not 0 <= now_ns - self._looked_ns < _LOOK_NS and not self.recovery.failing:
            self._looked_ns = now_ns
            self.ring.look_at_room(now_ns)

    def problem(self, problem: Problem) -> None:
        """Say in the evidence that the interface was down: the next packet gets a comment."""
        if problem.kind == INTERFACE:
            self.ring.comment(f"{MARK} {printable(problem.text)}")

    def close(self) -> None:
        """Finish the present file."""
        self.ring.close()


class KeeperCompanion(WritingCompanion):
    """Keeps the packets around the findings that trigger ``keeper``."""

    name = "keeping packets around findings"
    label = "keep_around"
    wants_packets = True

    def __init__(self, keeper: EventCapture, clock: Callable[[], float] = time.monotonic) -> None:
        super().__init__(keeper.directory, clock)
        self.keeper = keeper

    @property
    def lost(self) -> tuple[int, int]:
        """How many packets around triggers are in no file, and their octets."""
        return self.keeper.lost, self.keeper.lost_octets

    @property
    def written(self) -> tuple[int, int]:
        """How many files were begun, and the octets of those that ended."""
        return self.keeper.files, self.keeper.octets

    def packet(self, time_ns: int, octets: bytes, wire_length: int, link_type: int, interface: str) -> None:
        """Remember a packet, or write it if a file is open."""
        self.keeper.add(time_ns, octets, wire_length, link_type, interface)

    def finding(self, finding: Finding) -> None:
        """Begin a file, or add a comment to a packet."""
        self.keeper.finding(finding)

    def problem(self, problem: Problem) -> None:
        """Say in the evidence that the interface was down."""
        if problem.kind == INTERFACE:
            self.keeper.comment(f"{MARK} {printable(problem.text)}")

    def tick(self, now_ns: int, drops: Drops) -> None:
        """Write the latest packet, on which no further findings come; end the file in time; try again what failed."""
        self.keeper.settle()
        self.keeper.tick(now_ns)
        if self.recovery.failing and self.recovery.due:
            if self.keeper.owes:
                self.keeper.retry()
            else:
                self.keeper.probe()
            self.resumed()

    def close(self) -> None:
        """Finish the present file."""
        self.keeper.close()
