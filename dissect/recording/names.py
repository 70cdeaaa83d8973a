"""Names of the files that evidence goes to: a time everybody can sort by, and nothing a file system could stumble over."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Final

from dissect.source.pcapng_writer import PcapngWriter
from dissect.wire.text import Clock

#: What a file that is not finished ends with.
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
    """Return the name that a file has while it is written."""
    return path.with_name(path.name + PART)


def begin(path: Path, about: tuple[str, str], comment: str = "", batch: int = 0) -> PcapngWriter:
    """Create the unfinished file of ``path``, which has its section header from the first moment it is seen.

    ``about`` is (operating system, application). A kill in between leaves a hidden file without packets.
    """
    part = part_of(path)
    if os.name == "nt":  # where an open file keeps its name
        return PcapngWriter(str(part), "", *about, comment=comment, batch=batch)
    hidden = path.with_name(f".{path.name}.{os.getpid()}.begun")
    writer = PcapngWriter(str(hidden), "", *about, comment=comment, batch=batch, overwrite=True)
    try:
        hidden.replace(part)
    except OSError:
        writer.abandon()
        hidden.unlink(missing_ok=True)
        raise
    writer.path = str(part)
    return writer


def finish(path: Path) -> None:
    """Give a file that is written its own name. Readers see it whole under that name, or not at all."""
    part_of(path).replace(path)
