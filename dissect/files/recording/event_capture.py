"""`EventCapture`: writes the packets around a finding to a separate file: those before it from memory, then those after it.

The caller gives every packet first to `EventCapture.frame` and then to the pipeline, and every finding to
`EventCapture.finding`. Both count packets from 1, so their numbers agree. A packet is written when the next one comes, because
the pipeline reports its findings in between; without a next packet, `EventCapture.settle` writes it.
"""

from __future__ import annotations

import errno
import os
import shutil
from collections import deque
from collections.abc import Collection
from pathlib import Path
from typing import Final

from mypy_extensions import i64

from dissect.engine.findings.reporter import Finding
from dissect.files.recording import names
from dissect.files.recording.recent import MAX_COMMENTS, KeptPacket, RecentPackets
from dissect.files.recording.removing import Removing
from dissect.meaning.select.comments import finding_comment, frames_in_words
from dissect.packets.source.packet import PacketSink
from dissect.packets.source.pcapng_writer import PcapngWriter
from dissect.wire.text import Clock

#: After this many octets a new file begins, if triggers keep coming.
MAX_FILE_OCTETS: Final = 1_000_000_000
#: Maximum number of files that are kept, and of octets in them. Beyond that, the oldest file of the two hosts with most files
#: is deleted, so that a flood between two hosts does not cost the evidence of others.
MAX_FILES: Final = 1000
MAX_ALL_OCTETS: Final = 10_000_000_000


class KeptFiles:
    """The files of a run by the hosts that they concern, and their sizes."""

    def __init__(self) -> None:
        self.files = 0
        self.octets = 0
        self._by_hosts: dict[str, deque[tuple[int, Path, int]]] = {}  # each with its number and size, the oldest first
        self._number = 0
        self._removing = Removing()

    def add(self, hosts: str, path: Path, octets: int) -> None:
        """Remember a file."""
        self._number += 1
        self._by_hosts.setdefault(hosts, deque()).append((self._number, path, octets))
        self.files += 1
        self.octets += octets

    def make_room(self, files: int, octets: int) -> int:
        """Delete files until at most ``files`` with ``octets`` remain; the latest file always stays.

        Return the number of deleted files.
        """
        removed = 0
        while self.files > files or (self.octets > octets and self.files > 1):
            removed += self._remove_one()
        return removed

    def _remove_one(self) -> int:
        """Delete the oldest file of the hosts that have most of them; of several such hosts, the oldest of all.

        Return how many files were deleted: none if one is open in another program; files that could not be deleted earlier
        count as well.
        """
        hosts = min(self._by_hosts, key=lambda one: (-len(self._by_hosts[one]), self._by_hosts[one][0][0]))
        kept = self._by_hosts[hosts]
        _, path, octets = kept.popleft()
        if not kept:
            del self._by_hosts[hosts]
        self.files -= 1
        self.octets -= octets
        return len(self._removing.remove(path))


#: A number above that of every packet.
_NONE: Final = 2**62
#: Octets that `EventCapture.probe` writes.
_PROBE: Final = 64 * 1024


class Owed:
    """The packets that a trigger wants and that are in no file yet: their number, their octets, and the first one's number.

    ``name`` is the name of the trigger, ``hosts`` are the hosts that it concerns.
    """

    __slots__ = ("first", "hosts", "name", "octets", "packets")

    def __init__(self, name: str, hosts: str, packets: list[KeptPacket]) -> None:
        self.name = name
        self.hosts = hosts
        self.first = packets[0].frame if packets else _NONE
        self.packets = len(packets)
        self.octets = sum([len(packet.octets) for packet in packets])

    def add(self, packet: KeptPacket) -> None:
        """Count one more packet to be written."""
        self.first = min(self.first, packet.frame)
        self.packets += 1
        self.octets += len(packet.octets)

    def pay(self, packet: KeptPacket) -> None:
        """Note that one of them was written."""
        self.packets -= 1
        self.octets -= len(packet.octets)


class EventCapture(PacketSink):
    """Keeps ``before_ns`` and ``after_ns`` (capture time) around each trigger, in ``directory``. An `OSError` names its file.

    Raises ValueError for a time below 0.

    ``slugs`` are the findings that trigger; `trigger` may also be called for other reasons. A trigger while a file is open
    keeps it open for longer. At most ``max_octets`` of packets wait in memory; if that covers less than ``before_ns``, a
    comment in the file says so. ``finished`` are the latest files; ``files`` counts all files, ``triggers`` all triggers,
    ``removed`` files that were replaced by newer ones (`MAX_FILES`, `MAX_ALL_OCTETS`), ``untold`` comments that came too late
    to be written.

    After an error the packets of the trigger are still to be written: call `retry` regularly, which writes those still in
    memory to a new file. ``lost`` and ``lost_octets`` count the packets that are in no file although a trigger wanted them.

    A file is called ``SLUG_20160208T145137.916123000Z.pcapng`` after its first trigger, and ends with ``.part`` while it grows.
    """

    def __init__(
        self,
        directory: str | os.PathLike[str],
        before_ns: int,
        after_ns: int,
        max_octets: int = 64 * 1024 * 1024,
        slugs: Collection[str] = (),
        application: str = "",
        os_name: str = "",
        keep_free: int = 0,
    ) -> None:
        if before_ns < 0 or after_ns < 0:
            raise ValueError("the time before and after a trigger cannot be less than 0")
        self.capture_filter = ""
        self.frames = 0
        self.files = 0
        self.triggers = 0
        self.removed = 0
        self.untold = 0
        self.lost = 0
        self.lost_octets = 0
        self.octets = 0
        self.finished: list[Path] = []
        self._directory = Path(directory)
        self._before_ns = before_ns
        self._after_ns = after_ns
        self._slugs = frozenset(slugs)
        self._about = (os_name, application)
        self._keep_free = keep_free
        self._name = ""
        self._recent = RecentPackets(max_octets, before_ns)
        self._latest: KeptPacket | None = None  # the latest packet, which is not written yet, even if a file is open
        self._comments: list[str] = []
        self._late: list[str] = []  # comments on packets that were already written
        self._writer: PcapngWriter | None = None
        self._path = Path()
        self._pair = ""  # the hosts of the first trigger of the current file
        self._kept = KeptFiles()
        self._until_ns = 0
        self._owed: Owed | None = None
        self._clock = Clock()
        self._directory.mkdir(parents=True, exist_ok=True)

    # ---- packets ----------------------------------------------------------------------------------------------------

    def frame(self, time_ns: i64, buf: bytes, start: i64, end: i64, wire_length: i64, link_type: i64) -> None:
        """Keep a packet; the module docstring says when to call this."""
        self.add(int(time_ns), buf[start:end], int(wire_length), int(link_type))

    def comment(self, text: str) -> None:
        """Take a comment about the next packet."""
        if len(self._comments) < MAX_COMMENTS:
            self._comments.append(text)

    def add(self, time_ns: int, octets: bytes, wire_length: int, link_type: int, interface: str = "") -> None:
        """Keep a packet that ``interface`` captured."""
        try:
            self.settle()
            self.tick(time_ns)
        finally:  # an error concerns the previous packet: this one is kept, and counted as in the pipeline
            self.frames += 1
            packet = KeptPacket(self.frames, time_ns, octets, wire_length, link_type, interface, self._comments)
            self._comments = []
            self._latest = packet
            self._recent.add(packet)

    def settle(self) -> None:
        """Write the latest packet, if a file is open: no further findings concern it."""
        packet = self._latest
        self._latest = None
        writer = self._writer
        if packet is not None and self._owed is not None:
            self._owed.add(packet)
        if packet is None or writer is None:
            return
        for comment in self._late:
            packet.say(comment)
        self._late = []
        self._write(writer, packet)
        if writer.octets >= MAX_FILE_OCTETS:
            self._end()

    def tick(self, now_ns: int) -> None:
        """End the file when the time after its last trigger is over; ``now_ns`` is the time by the clock of the capture."""
        if self._writer is None and self._owed is None:
            return
        if now_ns > self._until_ns or now_ns < self._until_ns - self._span_ns:
            self.settle()
            self._forgive()
            self._end()

    def close(self) -> None:
        """Finish the present file, and forget all packets. May be called twice."""
        self.settle()
        self._forgive()
        self._end()
        self._recent.clear()

    @property
    def directory(self) -> Path:
        """The folder of the files."""
        return self._directory

    @property
    def _span_ns(self) -> int:
        """Tolerance for times before the end of the file; a time further back means that the clock was set back."""
        return self._before_ns + self._after_ns + 60_000_000_000

    # ---- findings ---------------------------------------------------------------------------------------------------

    def finding(self, finding: Finding) -> None:
        """Add a finding as a comment to its packets; one of ``slugs`` that no other finding explains is also a trigger."""
        frames = [int(frame) for frame in finding.frames]
        comment = finding_comment(finding)
        if finding.slug in self._slugs and not finding.because:
            hosts = f"{finding.client} {finding.server}" if finding.client else ""
            self.trigger(finding.slug, int(finding.time_ns), comment, frames, hosts)
        else:
            self._say(comment, frames)

    def trigger(
        self, name: str, time_ns: int, comment: str = "", frames: Collection[int] = (), hosts: str = ""
    ) -> None:
        """Keep the packets around the latest one. ``name`` becomes part of the file name; ``comment`` is about ``frames``.

        ``hosts`` are the hosts that it concerns, in any form that is the same each time.
        """
        self.triggers += 1
        if comment:
            self._say(comment, list(frames))
        latest = self._latest
        now_ns = latest.time_ns if latest is not None else time_ns
        if self._owed is None and self._writer is None:
            self._until_ns = now_ns + self._after_ns
            self._owed = Owed(name, hosts, [packet for packet in self._recent.within(now_ns) if packet is not latest])
            self.retry()
        self._until_ns = now_ns + self._after_ns

    @property
    def owes(self) -> bool:
        """Whether packets of a trigger wait because writing failed: `retry` tries again."""
        return self._owed is not None

    def retry(self) -> None:
        """Write the packets that are still owed, and in memory, to a file; after an `OSError` they are still owed."""
        owed = self._owed
        if owed is None:
            return
        latest = self._latest
        self._begin(owed, latest.time_ns if latest is not None else self._until_ns - self._after_ns)
        writer = self._writer
        self._owed = None
        for packet in self._recent:
            if packet is not latest and packet.frame >= owed.first and writer is not None:
                self._write(writer, packet, owed)
        self.lost += owed.packets
        self.lost_octets += owed.octets

    def probe(self) -> None:
        """Find out whether a file can be written; raise `OSError` if not."""
        path = self._directory / f".{os.getpid()}.probe"
        try:
            path.write_bytes(bytes(_PROBE))
        finally:
            path.unlink(missing_ok=True)

    def _forgive(self) -> None:
        """The time of the trigger is over: its unwritten packets are lost."""
        owed = self._owed
        self._owed = None
        if owed is not None:
            self.lost += owed.packets
            self.lost_octets += owed.octets

    def _say(self, comment: str, frames: list[int]) -> None:
        """Add a comment to packets that are still in memory; if all are written, add it to a later one."""
        latest = self._latest
        told = False
        for frame in frames:
            packet = self._recent.find(frame)
            if packet is None and latest is not None and latest.frame == frame:
                packet = latest  # it is larger than all of the memory, so `_recent` does not have it
            if packet is not None:
                packet.say(comment)
                told = told or self._writer is None or packet is latest
        if not told:
            self._say_late(f"{comment} [about {frames_in_words(frames)}, before this one]")

    def _say_late(self, comment: str) -> None:
        """Add a comment on packets that were written to the first packet that is not written yet."""
        last = self._latest
        if last is None and self._writer is None:
            last = self._recent.last
        if last is not None:
            last.say(comment)
        elif self._writer is not None and len(self._late) < MAX_COMMENTS:
            self._late.append(comment)
        else:
            self.untold += 1

    # ---- the file ---------------------------------------------------------------------------------------------------

    def _begin(self, owed: Owed, time_ns: int) -> None:
        """Begin a file for the owed packets."""
        self.removed += self._kept.make_room(MAX_FILES - 1, MAX_ALL_OCTETS)
        self._pair = owed.hosts
        stem = f"{names.file_word(owed.name)}_{names.time_word(time_ns, self._clock, fraction=True)}"
        self._path = names.unused(self._directory, stem)
        if self._keep_free and shutil.disk_usage(self._directory).free < self._keep_free:
            raise OSError(errno.ENOSPC, "less is free than --keep-free asks for", str(self._directory))
        self._writer = names.begin(self._path, self._about, comment=self._told_before())
        self._writer.capture_filter = self.capture_filter
        self.files += 1
        self._name = owed.name

    def _told_before(self) -> str:
        """Return the comment for a file whose beginning is missing because there was not enough memory; else empty."""
        shortened = self._recent.shortened
        if not shortened:
            return ""
        return f"s7dissect: memory ran short: so far {shortened} packets were dropped before their time was over"

    def _write(self, writer: PcapngWriter, packet: KeptPacket, owed: Owed | None = None) -> None:
        """Write a packet, one of those ``owed``; after an error, it and the following ones are still owed."""
        try:
            writer.packet(
                packet.time_ns, packet.octets, packet.wire_length, packet.link_type, packet.comments, packet.interface
            )
        except OSError:
            writer.abandon()
            self.octets += writer.octets
            self._writer = None
            if owed is None:
                owed = Owed(self._name, self._pair, [packet])
            self._owed = owed
            owed.first = packet.frame
            raise
        if owed is not None:
            owed.pay(packet)

    def _end(self) -> None:
        writer = self._writer
        self._writer = None
        if writer is None:
            return
        self.untold += len(self._late)
        self._late = []
        writer.close()
        names.finish(self._path)
        self._kept.add(self._pair, self._path, int(writer.octets))
        self.removed += self._kept.make_room(MAX_FILES, MAX_ALL_OCTETS)
        self.octets += writer.octets
        self.finished.append(self._path)
        del self.finished[:-MAX_COMMENTS]
