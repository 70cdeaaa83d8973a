"""`RingBuffer`: writes packets to a ring of files. A new file begins when one is full or old; the oldest is removed.

A file is called ``NAME_00001_20160208T145137Z.pcapng.part`` (its number, and the time of its first packet, UTC) while it is
written, and loses ``.part`` when it is finished: copying ``*.pcapng`` therefore copies only whole files. The ``.part`` that a
killed process leaves behind is readable up to the last packet written.

If the number of files is limited, those of earlier runs count as well, ``.part`` files included, so that the folder does not
grow with each restart. No other file in the folder is touched: a file belongs to the ring if its name follows the ring's
pattern and a comment in its first block names such a ring as its writer. A file that another process is writing is left alone;
its writer holds a lock on it.
"""

from __future__ import annotations

import errno
import os
import re
import shutil
import stat
from collections import deque
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import Final, NamedTuple

from mypy_extensions import i64

from dissect.files.recording import names
from dissect.files.recording.names import PART, SUFFIX
from dissect.files.recording.removing import Removing
from dissect.meaning.select.comments import MARK
from dissect.packets.source.packet import PacketSink
from dissect.packets.source.pcapng_writer import PcapngWriter, section_mark
from dissect.wire import locks
from dissect.wire.text import Clock

#: Octets read from the beginning of a file, enough for its section header.
_HEAD: Final = 4096


class EarlierFile(NamedTuple):
    """A file of an earlier run: path, size in octets, number in that run, the time in its name, and that of the last write."""

    path: Path
    octets: int
    number: int
    time: str
    written_ns: int


class KeptFile(NamedTuple):
    """A file that may be removed to make room: its path, its size in octets, and the time of its last packet."""

    path: Path
    octets: int
    last_ns: int


def mark_of(name: str) -> str:
    """Return the comment by which a ring of this name recognises its files."""
    return f"s7dissect ring {name}"


def earlier_files(directory: Path, name: str) -> list[EarlierFile]:
    """Return the files that rings of this name made in ``directory`` and that are not being written, the oldest first."""
    pattern = re.compile(
        rf"{re.escape(name)}_([0-9]{{5,9}})_([0-9]{{8}}T[0-9]{{6}}Z)(?:-[0-9]{{1,6}})?{re.escape(SUFFIX)}(?:{re.escape(PART)})?"
    )
    found = []
    for path in directory.iterdir():
        match = pattern.fullmatch(path.name)
        status = _status(path, mark_of(name)) if match is not None else None
        if match is not None and status is not None:
            found.append(EarlierFile(path, status.st_size, int(match[1]), match[2], status.st_mtime_ns))
    return sorted(found, key=lambda file: (file.time, file.number))


def lock(descriptor: int) -> None:
    """Lock a file that is being written until it is closed; not on Windows, where an open file cannot be removed anyway."""
    if not locks.MANDATORY:
        # If this file system has no locks, unfinished files are recognised only by their name and comment.
        with suppress(OSError):
            locks.lock(descriptor)


def _status(path: Path, mark: str) -> os.stat_result | None:
    """Return the status of a file of the ring that is not being written; None for any other file."""
    flags = os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_CLOEXEC", 0)
    flags |= getattr(os, "O_BINARY", 0)
    try:
        descriptor = os.open(path, flags)
    except OSError:
        return None
    try:
        status = os.fstat(descriptor)
        if not stat.S_ISREG(status.st_mode) or section_mark(os.read(descriptor, _HEAD)) != mark:
            return None
        locks.lock(descriptor, shared=True)
    except OSError:
        return None
    else:
        return status
    finally:
        os.close(descriptor)


#: A ring without a limit of files remembers this many finished files.
_REMEMBERED: Final = 1000

#: Octets by which a file may exceed its limit: its last packet, and its last blocks.
_OVERSHOOT: Final = 512 * 1024

#: Maximum number of comments that wait for their packet.
_MAX_COMMENTS: Final = 64

_KILO: Final = 1000
_MAX_KILO: Final = 10**9
_MAX_SECONDS: Final = 10**8
_MAX_FILES: Final = 100_000
_MAX_TOTAL: Final = 10**12
_MAX_DAYS: Final = 36_500
_DAY_NS: Final = 86_400_000_000_000


class RingLimits:
    """The limits of a ring, 0 for none.

    ``octets`` and ``duration_ns`` (capture time) are those of a file; ``files`` is the number of files that are kept, ``total``
    the octets of all of them together, and ``age_ns`` how long a file is kept after its last packet.

    Raises ValueError for one of the last three without one of the first two, because a file that is being written cannot be
    removed.
    """

    def __init__(self, octets: int = 0, duration_ns: int = 0, files: int = 0, total: int = 0, age_ns: int = 0) -> None:
        for word, number in (("files:N", files), ("total:KB", total), ("days:N", age_ns)):
            if number and not (octets or duration_ns):
                raise ValueError(
                    f"{word} limits the files of a ring, so filesize:KB or duration:SECONDS is needed as well"
                )
        self.octets = octets
        self.duration_ns = duration_ns
        self.files = files
        self.total = total
        self.age_ns = age_ns

    @property
    def removes(self) -> bool:
        """Whether files are removed automatically."""
        return bool(self.files or self.total or self.age_ns)


def parse_limits(words: Iterable[str]) -> RingLimits:
    """Parse limits in the form of dumpcap, such as ``filesize:1000``, ``duration:3600``, ``files:24``, and two of our own.

    ``filesize`` and ``total`` are in units of 1000 octets, ``duration`` in seconds and ``days`` in days (also 0.5). Raises
    ValueError, with a message for people, for anything else.
    """
    octets = duration_ns = files = total = age_ns = 0
    for word in words:
        kind, _, text = word.partition(":")
        if kind == "filesize":
            octets = int(_number(word, text, 1, _MAX_KILO)) * _KILO
        elif kind == "duration":
            duration_ns = round(_number(word, text, 0.001, _MAX_SECONDS, whole=False) * 1_000_000_000)
        elif kind == "files":
            files = int(_number(word, text, 1, _MAX_FILES))
        elif kind == "total":
            total = int(_number(word, text, 1, _MAX_TOTAL)) * _KILO
        elif kind == "days":
            age_ns = round(_number(word, text, 0.001, _MAX_DAYS, whole=False) * _DAY_NS)
        else:
            raise ValueError(
                f"{word!r} is not one of filesize:KB, duration:SECONDS, files:NUMBER, total:KB, days:NUMBER"
            )
    return RingLimits(octets, duration_ns, files, total, age_ns)


def _number(word: str, text: str, least: float, most: float, whole: bool = True) -> float:
    pattern = r"[0-9]{1,12}" if whole else r"[0-9]{1,12}(\.[0-9]{1,9})?"
    number = float(text) if re.fullmatch(pattern, text) else -1.0
    if not least <= number <= most:
        raise ValueError(f"{word!r}: expected a {'whole ' if whole else ''}number from {least} to {most}")
    return number


class Witness:
    """Observes the files of a ring; this base class does nothing."""

    def finished(self, path: Path, packets: int, first_ns: int, last_ns: int) -> None:
        """A file is complete, or (with the suffix of an unfinished one) was abandoned."""

    def removed(self, path: Path) -> None:
        """A file was removed to make room."""


class RingBuffer(PacketSink):
    """Writes every packet to the files of a ring in ``directory``. An `OSError` names its file.

    A file begins with its first packet, so a silent network leaves no empty ones; call `tick` when time passes without packets.
    Only files that a ring of this name made in the folder, in this run or an earlier one, count for the limits and are removed.
    With a limit of ``octets`` as well, ``files`` files may take that many times as much, plus 512 KiB for each. On a full disk,
    and while less than ``keep_free`` octets are free, the oldest files are removed first, if there is any limit.

    ``packets`` counts what was written, ``finished`` names the complete files of this run that still exist, the oldest first;
    ``removed`` counts removed ones. After an error the current file is left unchanged, and the next packet begins a new one;
    ``lost`` and ``lost_octets`` count the packets that are in no file, including those that the caller reported with `miss`.
    ``capture_filter`` is written into the interfaces of its files.
    """

    def __init__(
        self,
        directory: str | os.PathLike[str],
        limits: RingLimits | None = None,
        name: str = "s7dissect",
        application: str = "",
        os_name: str = "",
        batch: int = 0,
        keep_free: int = 0,
    ) -> None:
        self.packets = 0
        self.removed = 0
        self.files = 0
        self.witness = Witness()
        self.capture_filter = ""
        self.lost = 0
        self.lost_octets = 0
        self._lost_told = 0
        self.octets = 0
        self._directory = Path(directory)
        self._limits = limits if limits is not None else RingLimits()
        self.finished: deque[Path] = deque(maxlen=None if self._limits.removes else _REMEMBERED)
        self._name = names.file_word(name)
        self._about = (os_name, application)
        self._batch = batch
        self._keep_free = keep_free
        self._number = 0
        self._path: Path | None = None
        self._writer: PcapngWriter | None = None
        self._since_ns = 0
        self._last_ns = 0
        self._clock = Clock()
        self._comments: list[str] = []
        self._directory.mkdir(parents=True, exist_ok=True)
        self._kept: deque[KeptFile] = deque()  # files that may be removed, the oldest first
        self._octets = 0
        self._removing = Removing()  # Wireshark may have a file open, or the thread that hashes it
        if self._limits.removes:
            for file in earlier_files(self._directory, self._name):
                self._keep(file.path, file.octets, file.written_ns)
                self._number = max(self._number, file.number)
            self._make_room(0)

    @property
    def name(self) -> str:
        """The common part of the names of its files."""
        return self._name

    @property
    def directory(self) -> Path:
        """The folder of the files."""
        return self._directory

    def frame(self, time_ns: i64, buf: bytes, start: i64, end: i64, wire_length: i64, link_type: i64) -> None:
        """Write a packet; begin a new file if the current one is full or old."""
        self.add(int(time_ns), buf[start:end], int(wire_length), int(link_type))

    def comment(self, text: str) -> None:
        """Take a comment about the next packet."""
        if len(self._comments) < _MAX_COMMENTS:
            self._comments.append(text)

    def add(self, time_ns: int, octets: bytes, wire_length: int, link_type: int, interface: str = "") -> None:
        """Write a packet that ``interface`` captured."""
        try:
            self.tick(time_ns)
            writer = self._writer
            if writer is None:
                writer = self._begin(time_ns)
        except OSError:
            self.miss(1, len(octets))
            raise
        comments = self._comments
        if comments:
            self._comments = []
        if self.lost > self._lost_told:
            comments = [f"{MARK} {self.lost - self._lost_told} packets before this one were not written", *comments]
        self.packets += 1
        try:
            writer.packet(time_ns, octets, wire_length, link_type, comments, interface)
        except OSError:
            self._give_up()
            raise
        self._lost_told = self.lost
        self._last_ns = time_ns
        if self._limits.octets and writer.octets >= self._limits.octets:
            self._end()

    def miss(self, packets: int, octets: int) -> None:
        """Count packets that are in no file."""
        self.lost += packets
        self.lost_octets += octets

    def tick(self, now_ns: int) -> None:
        """End the current file when it is old enough; ``now_ns`` is the time by the clock of the capture."""
        if self._writer is None or not self._limits.duration_ns:
            return
        if now_ns < self._since_ns:
            self._since_ns = now_ns  # the clock was set back: do not wait until it has caught up
        elif now_ns - self._since_ns >= self._limits.duration_ns:
            self._end()

    def look_at_room(self, now_ns: int) -> None:
        """Remove files that are too old, have too many octets, or while too little disk space is free.

        Call it every second or so. Raises `OSError` while too little is free and nothing can be removed; then the current file
        is finished.
        """
        limits = self._limits
        while self._kept and limits.age_ns and self._kept[0].last_ns < now_ns - limits.age_ns:
            self._remove_oldest()
        while self._kept and limits.total and self._octets + self._being_written > limits.total:
            self._remove_oldest()
        try:
            self._keep_room()
        except OSError:
            self._end()
            raise

    def flush(self) -> None:
        """Write buffered packets (with ``batch``)."""
        if self._writer is not None:
            try:
                self._writer.flush()
            except OSError:
                self._give_up()
                raise

    def close(self) -> None:
        """Finish the present file. May be called twice."""
        if self._writer is not None:
            self._end()

    @property
    def path(self) -> Path | None:
        """The file being written, None if there is none at the moment."""
        return names.part_of(self._path) if self._path is not None else None

    @property
    def _being_written(self) -> int:
        return self._writer.octets if self._writer is not None else 0

    def _begin(self, time_ns: int) -> PcapngWriter:
        if self._limits.removes:
            self._make_room(1)
        self._keep_room()
        self._number += 1
        stem = f"{self._name}_{self._number:05d}_{names.time_word(time_ns, self._clock)}"
        path = names.unused(self._directory, stem)
        writer = names.begin(
            path, self._about, comment=mark_of(self._name), batch=self._batch, make_room=self._remove_oldest
        )
        writer.capture_filter = self.capture_filter
        lock(writer.fileno())
        self._path = path
        self._writer = writer
        self._since_ns = time_ns
        self._last_ns = time_ns
        return writer

    def _end(self) -> None:
        """Finish the present file."""
        writer, path = self._writer, self._path
        self._writer = None
        self._path = None
        if writer is None or path is None:
            return
        try:
            writer.close()
            names.finish(path)
        except OSError:
            self._leave(writer, path)
            raise
        self.files += 1
        self.octets += writer.octets
        self.finished.append(path)
        self._keep(path, writer.octets, self._last_ns)
        self.witness.finished(path, writer.packets, self._since_ns, self._last_ns)

    def _give_up(self) -> None:
        """Writing failed: leave the current file unchanged; the next packet begins a new one."""
        writer, path = self._writer, self._path
        self._writer = None
        self._path = None
        if writer is not None and path is not None:
            writer.abandon()
            self._leave(writer, path)

    def _leave(self, writer: PcapngWriter, path: Path) -> None:
        """Count the packets that are missing in an unfinished file, which stays."""
        packets, octets = writer.unwritten
        self.packets -= packets
        self.miss(packets, octets)
        self._keep(names.part_of(path), writer.octets, self._last_ns)
        self.witness.finished(names.part_of(path), writer.packets - packets, self._since_ns, self._last_ns)

    def _keep(self, path: Path, octets: int, last_ns: int) -> None:
        if self._limits.removes:
            self._kept.append(KeptFile(path, octets, last_ns))
            self._octets += octets

    def _make_room(self, more: int) -> None:
        """Remove the oldest files until there is room for ``more`` files."""
        limits = self._limits
        most = limits.files * (limits.octets + _OVERSHOOT)
        coming = more * limits.octets
        while self._kept:
            crowded = limits.files and len(self._kept) + more > limits.files
            heavy = limits.files and limits.octets and self._octets + coming > most
            large = limits.total and self._octets + coming > limits.total
            if not crowded and not heavy and not large:
                return
            self._remove_oldest()

    def _keep_room(self) -> None:
        """Remove the oldest files until ``keep_free`` octets are free; raise `OSError` if that is not possible."""
        if not self._keep_free:
            return
        while shutil.disk_usage(self._directory).free < self._keep_free:
            if not self._remove_oldest():
                raise OSError(errno.ENOSPC, "less is free than --keep-free asks for", str(self._directory))

    def _remove_oldest(self) -> bool:
        """Remove the oldest file; return False if there is none."""
        if not self._kept:
            return False
        file = self._kept.popleft()
        self._octets -= file.octets
        if self.finished and self.finished[0] == file.path:
            self.finished.popleft()
        for path in self._removing.remove(file.path):
            self.witness.removed(path)
            self.removed += 1
        return True
