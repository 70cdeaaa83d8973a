"""Names of evidence files: with a time by which they can be sorted, and only characters that all file systems allow."""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import Final

from dissect.packets.source.pcapng_writer import PcapngWriter
from dissect.wire.text import Clock

#: The ending of the name of an unfinished file.
PART: Final = ".part"
SUFFIX: Final = ".pcapng"

_UNSAFE: Final = re.compile(r"[^A-Za-z0-9._-]+")
_MAX_WORD: Final = 80


def file_word(text: str) -> str:
    """Return ``text`` as a part of a file name: letters, digits, ``.``, ``_`` and ``-``, never hidden, never empty."""
    return _UNSAFE.sub("_", text)[:_MAX_WORD].lstrip(".-") or "_"


def time_word(time_ns: int, clock: Clock, fraction: bool = False) -> str:
    """Return a time as ``20160208T145137Z``, with ``fraction`` as ``20160208T145137.916123000Z`` (UTC)."""
    date, _, time = clock.iso(time_ns)[:-1].partition("T")
    whole, _, rest = time.partition(".")
    return f"{date.replace('-', '')}T{whole.replace(':', '')}{'.' + rest if fraction else ''}Z"


def unused(directory: Path, stem: str) -> Path:
    """Return a path in ``directory`` that neither a finished nor an unfinished file has."""
    path = directory / f"{stem}{SUFFIX}"
    number = 1
    while path.exists() or part_of(path).exists():
        number += 1
        path = directory / f"{stem}-{number}{SUFFIX}"
    return path


def part_of(path: Path) -> Path:
    """Return the name of a file while it is written."""
    return path.with_name(path.name + PART)


def begin(
    path: Path,
    about: tuple[str, str],
    comment: str = "",
    batch: int = 0,
    make_room: Callable[[], bool] | None = None,
) -> PcapngWriter:
    """Create the unfinished file of ``path``; when it becomes visible, it already has its section header.

    ``about`` is (operating system, application), ``make_room`` the function that `PcapngWriter` calls on a full disk. If the
    process is killed in between, a hidden file without packets remains.
    """
    part = part_of(path)
    if os.name == "nt":  # Windows cannot rename an open file
        return PcapngWriter(str(part), "", *about, comment=comment, batch=batch, make_room=make_room)
    hidden = path.with_name(f".{path.name}.{os.getpid()}.begun")
    try:
        writer = PcapngWriter(
            str(hidden), "", *about, comment=comment, batch=batch, overwrite=True, make_room=make_room
        )
    except OSError:
        hidden.unlink(missing_ok=True)  # an empty file also occupies a place in the folder
        raise
    try:
        hidden.replace(part)
    except OSError:
        writer.abandon()
        hidden.unlink(missing_ok=True)
        raise
    writer.path = str(part)
    return writer


def finish(path: Path) -> None:
    """Give a complete file its final name, under which readers only ever see complete files."""
    part_of(path).replace(path)
