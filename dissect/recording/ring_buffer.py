"""`RingBuffer`: writes packets to a ring of files. A new file begins when one is full or old; the oldest is removed.

A file is called ``NAME_00001_20160208T145137Z.pcapng.part`` (its number, and the time of its first packet, UTC) while it is
written, and loses ``.part`` when it is finished: copying ``*.pcapng`` therefore copies only whole files. The ``.part`` that a
killed process leaves behind is readable up to the last packet written.

Where the number of files is limited, those of earlier runs count as well, ``.part`` files included, so that the folder does
not grow with each restart. Nothing else in the folder is touched: a file belongs to the ring when a ring of this name would
give it its name, and its first block says in a comment that such a ring wrote it. A file that another process is writing is
left alone; its writer holds a lock on it.
"""

from __future__ import annotations

import os
import re
import stat
from collections import deque
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import Final, NamedTuple

from mypy_extensions import i64

from dissect.recording import names
from dissect.recording.names import PART, SUFFIX
from dissect.source.packet import PacketSink
from dissect.source.pcapng_writer import PcapngWriter, section_mark
from dissect.wire.text import Clock

try:
    import fcntl
except ImportError:  # not on Windows, where an open file cannot be removed anyway
    fcntl = None  # type: ignore[assignment]

#: Octets read from the beginning of a file, enough for its section header.
_HEAD: Final = 4096


class EarlierFile(NamedTuple):
    """A file of an earlier run: its path, size in octets, number in that run, and the time in its name."""

    path: Path
    octets: int
    number: int
    time: str


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
        size = _size(path, mark_of(name)) if match is not None else -1
        if match is not None and size >= 0:
            found.append(EarlierFile(path, size, int(match[1]), match[2]))
    return sorted(found, key=lambda file: (file.time, file.number))


def lock(descriptor: int) -> None:
    """Lock a file that is being written until it is closed; does nothing on systems without locks."""
    if fcntl is not None:
        # If this file system has no locks, unfinished files are recognised only by their name and comment.
        with suppress(OSError):
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)


def _size(path: Path, mark: str) -> int:
    """Return the size of a file of the ring that is not being written; -1 for any other file."""
    flags = os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_CLOEXEC", 0)
    try:
        descriptor = os.open(path, flags)
    except OSError:
        return -1
    try:
        status = os.fstat(descriptor)
        if not stat.S_ISREG(status.st_mode) or section_mark(os.read(descriptor, _HEAD)) != mark:
            return -1
        if fcntl is not None:
            fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except OSError:
        return -1
    else:
        return status.st_size
    finally:
        os.close(descriptor)


#: A ring without a limit of files remembers so many finished files.
_REMEMBERED: Final = 1000

#: Octets by which a file may exceed its limit: its last packet, and its last blocks.
_OVERSHOOT: Final = 512 * 1024

#: At most so many comments wait for their packet.
_MAX_COMMENTS: Final = 64

_KILO: Final = 1000
_MAX_KILO: Final = 10**9
_MAX_SECONDS: Final = 10**8
_MAX_FILES: Final = 100_000


class RingLimits:
    """The limits of a ring: ``octets`` and ``duration_ns`` (capture time) of a file, and how many ``files`` are kept; 0: none.

    Raises ValueError for a number of files without one of the other limits.
    """

    def __init__(self, octets: int = 0, duration_ns: int = 0, files: int = 0) -> None:
        if files and not (octets or duration_ns):
            raise ValueError(
                "files:N sets the number of files to keep, so filesize:KB or duration:SECONDS is needed as well"
            )
        self.octets = octets
        self.duration_ns = duration_ns
        self.files = files


def parse_limits(words: Iterable[str]) -> RingLimits:
    """Parse limits in the form of dumpcap: words such as ``filesize:1000``, ``duration:3600``, ``files:24``.

    ``filesize`` is in units of 1000 octets, ``duration`` in seconds (also 0.5). ValueError, for a person, for anything else.
    """
    octets = duration_ns = files = 0
    for word in words:
        kind, _, text = word.partition(":")
        if kind == "filesize":
            octets = int(_number(word, text, 1, _MAX_KILO)) * _KILO
        elif kind == "duration":
            duration_ns = round(_number(word, text, 0.001, _MAX_SECONDS, whole=False) * 1_000_000_000)
        elif kind == "files":
            files = int(_number(word, text, 1, _MAX_FILES))
        else:
            raise ValueError(f"{word!r} is not one of filesize:KB, duration:SECONDS, files:NUMBER")
    return RingLimits(octets, duration_ns, files)


def _number(word: str, text: str, least: float, most: float, whole: bool = True) -> float:
    pattern = r"[0-9]{1,12}" if whole else r"[0-9]{1,12}(\.[0-9]{1,9})?"
    number = float(text) if re.fullmatch(pattern, text) else -1.0
    if not least <= number <= most:
        raise ValueError(f"{word!r}: expected a {'whole ' if whole else ''}number from {least} to {most}")
    return number


class RingBuffer(PacketSink):
    """Writes every packet to the files of a ring in ``directory``. An `OSError` names the file it is about.

    A file begins with its first packet, so a silent line leaves no empty ones; call `tick` when time passes without packets.
    Only files that a ring of this name made in the folder, in this run or an earlier one, count for ``files`` and are removed;
    with a limit of ``octets`` as well, all of them together take ``files`` times that much and 512 KiB for each. ``packets``
    counts what was written, ``finished`` names the files of this run that are whole and there, the oldest first; ``removed``
    counts those that had to go. After an error the file at hand stays as it is, and the next packet begins another.
    """

    def __init__(
        self,
        directory: str | os.PathLike[str],
        limits: RingLimits | None = None,
        name: str = "s7dissect",
        application: str = "",
        os_name: str = "",
        batch: int = 0,
    ) -> None:
        self.packets = 0
        self.removed = 0
        self._directory = Path(directory)
        self._limits = limits if limits is not None else RingLimits()
        self.finished: deque[Path] = deque(maxlen=None if self._limits.files else _REMEMBERED)
        self._name = names.file_word(name)
        self._about = (os_name, application)
        self._batch = batch
        self._number = 0
        self._path: Path | None = None
        self._writer: PcapngWriter | None = None
        self._since_ns = 0
        self._clock = Clock()
        self._comments: list[str] = []
        self._directory.mkdir(parents=True, exist_ok=True)
        self._kept: deque[tuple[Path, int]] = deque()  # files that may be removed, with their octets, the oldest first
        self._octets = 0
        if self._limits.files:
            for file in earlier_files(self._directory, self._name):
                self._keep(file.path, file.octets)
                self._number = max(self._number, file.number)
            self._make_room(0)

    def frame(self, time_ns: i64, buf: bytes, start: i64, end: i64, wire_length: i64, link_type: i64) -> None:
        """Write a packet, to a new file if the present one is full or old."""
        self.add(int(time_ns), buf[start:end], int(wire_length), int(link_type))

    def comment(self, text: str) -> None:
        """Take a comment about the packet that comes next."""
        if len(self._comments) < _MAX_COMMENTS:
            self._comments.append(text)

    def add(self, time_ns: int, octets: bytes, wire_length: int, link_type: int, interface: str = "") -> None:
        """Write a packet that ``interface`` captured."""
        self.tick(time_ns)
        writer = self._writer
        if writer is None:
            writer = self._begin(time_ns)
        comments = self._comments
        if comments:
            self._comments = []
        try:
            writer.packet(time_ns, octets, wire_length, link_type, comments, interface)
        except OSError:
            self._give_up()
            raise
        self.packets += 1
        if self._limits.octets and writer.octets >= self._limits.octets:
            self._end()

    def tick(self, now_ns: int) -> None:
        """End the present file when it is old enough; ``now_ns`` is the time by the clock of the capture."""
        if self._writer is None or not self._limits.duration_ns:
            return
        if now_ns < self._since_ns:
            self._since_ns = now_ns  # the clock was set back: do not wait until it has caught up
        elif now_ns - self._since_ns >= self._limits.duration_ns:
            self._end()

    def flush(self) -> None:
        """Write buffered packets (with ``batch``)."""
        if self._writer is not None:
            self._writer.flush()

    def close(self) -> None:
        """Finish the present file. May be called twice."""
        if self._writer is not None:
            self._end()

    @property
    def path(self) -> Path | None:
        """The file being written, None when there is none at the moment."""
        return names.part_of(self._path) if self._path is not None else None

    def _begin(self, time_ns: int) -> PcapngWriter:
        if self._limits.files:
            self._make_room(1)
        self._number += 1
        stem = f"{self._name}_{self._number:05d}_{names.time_word(time_ns, self._clock)}"
        path = names.unused(self._directory, stem)
        writer = names.begin(path, self._about, comment=mark_of(self._name), batch=self._batch)
        lock(writer.fileno())
        self._path = path
        self._writer = writer
        self._since_ns = time_ns
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
            self._keep(names.part_of(path), writer.octets)
            raise
        self.finished.append(path)
        self._keep(path, writer.octets)

    def _give_up(self) -> None:
        """Writing failed: leave the present file as it is; the next packet begins a new one."""
        if self._writer is not None:
            self._writer.abandon()
            if self._path is not None:
                self._keep(names.part_of(self._path), self._writer.octets)
        self._writer = None
        self._path = None

    def _keep(self, path: Path, octets: int) -> None:
        if self._limits.files:
            self._kept.append((path, octets))
            self._octets += octets

    def _make_room(self, more: int) -> None:
        """Remove the oldest files until there is room for ``more`` files."""
        limits = self._limits
        most = limits.files * (limits.octets + _OVERSHOOT)
        while self._kept:
            crowded = len(self._kept) + more > limits.files
            heavy = limits.octets and self._octets + more * limits.octets > most
            if not crowded and not heavy:
                return
            path, octets = self._kept.popleft()
            self._octets -= octets
            if self.finished and self.finished[0] == path:
                self.finished.popleft()
            path.unlink(missing_ok=True)
            self.removed += 1
