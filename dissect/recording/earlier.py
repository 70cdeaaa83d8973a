"""Files that a ring made in earlier runs: they count for its limits, and nothing else in the folder is touched.

A file is the ring's own when its name is one that a ring of this name gives, and its first block says in a comment that such
a ring wrote it. One that is being written by another process is left alone: its writer holds a lock on it.
"""

from __future__ import annotations

import os
import re
import stat
from contextlib import suppress
from pathlib import Path
from typing import Final, NamedTuple

from dissect.recording.names import PART, SUFFIX
from dissect.source.pcapng_writer import section_mark

try:
    import fcntl
except ImportError:  # not on Windows, where an open file cannot be removed anyway
    fcntl = None  # type: ignore[assignment]

#: Octets at the beginning of a file that are looked at: its section header and more.
_HEAD: Final = 4096


class EarlierFile(NamedTuple):
    """A file of an earlier run: where, how many octets, its number in that run, and the time in its name."""

    path: Path
    octets: int
    number: int
    time: str


def mark_of(name: str) -> str:
    """Return the comment by which a ring of this name knows its files."""
    return f"s7dissect ring {name}"


def earlier_files(directory: Path, name: str) -> list[EarlierFile]:
    """Return the files that rings of this name made in ``directory`` and that nobody writes to, the oldest first."""
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
    """Hold a file that is being written, until it is closed. Where there are no locks nothing happens."""
    if fcntl is not None:
        # Without locks on this file system, files with .part there are judged by name and mark alone.
        with suppress(OSError):
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)


def _size(path: Path, mark: str) -> int:
    """Return the size of a file of ours that nobody writes to, -1 for any other."""
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
