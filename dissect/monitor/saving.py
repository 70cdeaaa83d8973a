"""Saving what is shown as a file of text: never over another one, and never through a link that somebody laid there."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Final

from dissect.recording.names import time_word
from dissect.wire.clock import Clock

#: Names that are tried before it is given up.
_TRIES: Final = 1000


def save(directory: Path, time_ns: int, lines: Iterable[str]) -> Path:
    """Write ``lines`` to a new file in ``directory`` named after a time; return its path. OSError when that cannot be."""
    stem = f"s7dissect-{time_word(time_ns, Clock())}"
    for number in range(1, _TRIES):
        path = directory / (f"{stem}.txt" if number == 1 else f"{stem}-{number}.txt")
        try:
            file = path.open("x", encoding="utf-8", errors="backslashreplace", newline="\n")
        except FileExistsError:
            continue
        with file:
            file.writelines([f"{line}\n" for line in lines])
        return path
    raise FileExistsError(f"{directory}: too many files {stem}…")
