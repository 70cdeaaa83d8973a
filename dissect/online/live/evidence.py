"""Packets of a live run are kept on disk: all of them in a ring of files, or those around findings."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

from dissect.engine.findings.reporter import Finding
from dissect.engine.pipeline import Pipeline
from dissect.files.recording import manifest
from dissect.files.recording.event_capture import MAX_ALL_OCTETS, MAX_FILES, EventCapture
from dissect.files.recording.ring_buffer import RingBuffer, Witness, earlier_files
from dissect.meaning.report import words
from dissect.meaning.select.comments import MARK
from dissect.online.alerts.problems import HEAD, INTERFACE
from dissect.online.live.manifest import ManifestThread
from dissect.online.live.problems import Problem, Problems
from dissect.online.live.writing import WritingCompanion
from dissect.packets.source.live.reader import Drops
from dissect.wire.text import Clock, printable

#: Interval (capture time) at which the ring checks for files that are too old and for its size.
_LOOK_NS: Final = 1_000_000_000


class ManifestWitness(Witness):
    """Records the files of a ring, and the run, in a manifest."""

    def __init__(self, ring: RingBuffer, about: Mapping[str, object]) -> None:
        self._about: dict[str, Any] = dict(about)
        self._ring = ring
        self._thread = ManifestThread(manifest.manifest_of(ring.directory, ring.name))
        self._times = Clock()
        self._pipeline: Pipeline | None = None

    @property
    def head(self) -> str:
        """The hash of the latest entry on the disk, empty before the first."""
        return self._thread.head

    def begin(self, pipeline: Pipeline, problems: Problems) -> None:
        """Record the facts about the run, and the files that earlier runs left without an entry."""
        self._pipeline = pipeline
        self._thread.start(problems)
        self._thread.add(manifest.BEGIN, **self._about)
        for file in earlier_files(self._ring.directory, self._ring.name):
            self._thread.add(manifest.LEFT, file.path)

    def finished(self, path: Path, packets: int, first_ns: int, last_ns: int) -> None:
        """Write the entry of a file."""
        octets = self._pipeline.counters.octets if self._pipeline is not None else None
        self._thread.add(
            manifest.FILE,
            path,
            packets=packets,
            first=self._times.iso(first_ns),
            last=self._times.iso(last_ns),
            gaps=int(octets.holes) if octets is not None else 0,
            lost=self._ring.lost,
        )

    def removed(self, path: Path) -> None:
        """Record that a file was removed; its entry stays."""
        self._thread.add(manifest.REMOVED, name=path.name)

    def event(self, problem: Problem) -> None:
        """Record an event of the evidence, the interface or the run."""
        self._thread.add(manifest.EVENT, about=problem.kind, text=problem.text, over=problem.over)

    def end(self, ring: RingBuffer) -> None:
        """Record how the run ended, and wait until that is on the disk."""
        self._thread.add(manifest.END, packets=ring.packets, lost=ring.lost, lost_octets=ring.lost_octets)
        self._thread.close()


class RingCompanion(WritingCompanion):
    """Writes every packet to ``ring``; buffered packets are on disk after the next tick.

    With ``about``, facts on the run (who, where, how), it keeps a manifest of the files.
    """

    name = "the ring of files"
    label = "ring"
    wants_packets = True

    def __init__(
        self, ring: RingBuffer, clock: Callable[[], float] = time.monotonic, about: Mapping[str, object] | None = None
    ) -> None:
        super().__init__(ring.directory, clock)
        self.ring = ring
        self._looked_ns = 0
        self._witness: ManifestWitness | None = None
        self._head = ""
        if about is not None:
            self._witness = ring.witness = ManifestWitness(ring, about)

    def begin(self, pipeline: Pipeline) -> None:
        """Begin the manifest, after privileges were dropped."""
        if self._witness is not None:
            self._witness.begin(pipeline, self.problems)

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
        """End the present file if it is old enough; write buffered packets; remove files that are too old or too many."""
        self.ring.tick(now_ns)
        self.ring.flush()
        if not 0 <= now_ns - self._looked_ns < _LOOK_NS and not self.recovery.failing:
            self._looked_ns = now_ns
            self.ring.look_at_room(now_ns)
        if self._witness is not None and self._witness.head != self._head:
            self._head = self._witness.head
            self.problems.heads[self.ring.name] = self._head
            told = f"evidence {self.ring.name}: head {self._head}"
            self.problems.tell(HEAD, told, over=True, shown=False)

    def problem(self, problem: Problem) -> None:
        """Record in the evidence that the interface was down: the next packet gets a comment."""
        if problem.kind == INTERFACE:
            self.ring.comment(f"{MARK} {printable(problem.text)}")
        if self._witness is not None and problem.kind != HEAD:
            self._witness.event(problem)

    def renew(self) -> None:
        """Finish the present file; the next packet begins another."""
        self.ring.close()

    def close(self) -> None:
        """Finish the present file."""
        try:
            self.ring.close()
        finally:
            if self._witness is not None:
                self._witness.end(self.ring)


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

    @property
    def remark(self) -> str:
        """Return how many files were removed to make room for newer ones."""
        removed = self.keeper.removed
        if not removed:
            return ""
        of = f"{removed} of {words.count(self.keeper.files, 'file')} removed, the oldest of the hosts with most"
        return f"{self.name}: {of}; at most {MAX_FILES} files and {words.size(MAX_ALL_OCTETS)} are kept"

    def packet(self, time_ns: int, octets: bytes, wire_length: int, link_type: int, interface: str) -> None:
        """Remember a packet, or write it if a file is open."""
        self.keeper.add(time_ns, octets, wire_length, link_type, interface)

    def finding(self, finding: Finding) -> None:
        """Begin a file, or add a comment to a packet."""
        self.keeper.finding(finding)

    def problem(self, problem: Problem) -> None:
        """Record in the evidence that the interface was down."""
        if problem.kind == INTERFACE:
            self.keeper.comment(f"{MARK} {printable(problem.text)}")

    def tick(self, now_ns: int, drops: Drops) -> None:
        """Write the latest packet, which will get no more findings; end the file in time; retry failed writes."""
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
