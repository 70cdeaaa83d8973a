"""One incident from the evidence of a ring: its files, and the part of the manifest that proves them.

The files are copied whole, so that their hashes are those of the chain. The part of the manifest begins with the first entry
about one of them and continues to the end of the chain, so that it includes a hash that was noted later.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from dissect.files.recording.manifest import (
    BEGIN,
    ENDING,
    FILE,
    LEFT,
    MADE,
    PART_ENDING,
    WHOLE,
    Manifest,
    entries_of,
    state_of,
)
from dissect.files.recording.names import PART, SUFFIX
from dissect.meaning.select.window import Window, parse_moment

_PIECE: Final = 1 << 20
_MODE: Final = 0o640
#: The name of the chain for files that were made from them.
ACCOUNT: Final = f"incident{ENDING}"


class Chosen:
    """The contents of an incident: paths of files, and the lines of each manifest that belong to them.

    ``problems`` are lines that the user must know about it.
    """

    def __init__(self) -> None:
        self.files: list[Path] = []
        self.parts: dict[Path, list[bytes]] = {}
        self.problems: list[str] = []


def choose(directory: Path, begin_ns: int, end_ns: int) -> Chosen:
    """Return the part of a folder of evidence that may contain packets from ``begin_ns`` to ``end_ns``. Raises OSError."""
    chosen = Chosen()
    for path in sorted(directory.iterdir()):
        if path.name.endswith(ENDING):
            _choose_of(path, begin_ns, end_ns, chosen)
        elif path.name.endswith(SUFFIX + PART):
            chosen.problems.append(
                f"{path.name} is being written or was left by a kill, and is in no entry: HUP to the probe finishes it"
            )
    return chosen


def _choose_of(manifest: Path, begin_ns: int, end_ns: int, chosen: Chosen) -> None:
    first = -1
    lines, entries = entries_of(manifest)
    taken: set[str] = set()
    for at, entry in enumerate(entries):
        if not _holds(entry, begin_ns, end_ns):
            continue
        name = str(entry["name"])
        state = state_of(manifest.parent, name, entry)
        if state in {"missing", "changed"}:
            chosen.problems.append(f"{name} is {state}")
        if state == "missing" or name in taken:
            continue
        taken.add(name)
        chosen.files.append(manifest.parent / name)
        if state not in {WHOLE, "changed"}:
            chosen.problems.append(f"{name} is {state}")
        first = at if first < 0 else first
    if first >= 0:
        chosen.parts[manifest] = lines[first:]


def _holds(entry: dict[str, Any], begin_ns: int, end_ns: int) -> bool:
    """Return whether the file of an entry may contain packets of a time; True for one left by a kill: its range is unknown."""
    if not isinstance(entry.get("name"), str) or entry.get("kind") not in {FILE, LEFT}:
        return False
    try:
        first, last = [parse_moment(str(entry[one])).resolve(0, 0) for one in ("first", "last")]
    except (KeyError, ValueError):
        return entry.get("kind") == LEFT
    return first <= end_ns and last >= begin_ns


def window_of(text: str, around_ns: int) -> tuple[int, int]:
    """Return the time range around an alert, whose time is given as in its JSON. Raises ValueError."""
    at = parse_moment(text).resolve(0, 0)
    return at - around_ns, at + around_ns


def resolved(window: Window) -> tuple[int, int]:
    """Return the range of a window with dates. Raises ValueError for a window that needs a capture to be complete."""
    one, other = window.resolve(0, 2**62), window.resolve(10**15, 2**62)
    if one != other:
        raise ValueError("give both ends as date and time, such as 2026-11-29T04:00..2026-11-29T04:05")
    return one


def copy_into(chosen: Chosen, out: Path) -> None:
    """Copy the files, and write the parts of their manifests. Raises OSError."""
    for path in chosen.files:
        with path.open("rb") as source:
            target = os.open(out / path.name, os.O_WRONLY | os.O_CREAT | os.O_EXCL, _MODE)
            with os.fdopen(target, "wb") as copy:
                while piece := source.read(_PIECE):
                    copy.write(piece)
    for manifest, lines in chosen.parts.items():
        name = manifest.name.removesuffix(ENDING) + PART_ENDING
        descriptor = os.open(out / name, os.O_WRONLY | os.O_CREAT | os.O_EXCL, _MODE)
        with os.fdopen(descriptor, "wb") as part:
            part.write(b"".join([line + b"\n" for line in lines]))


def account(out: Path, time: str, made: Sequence[Path], **facts: Any) -> str:
    """Write which files were exported, and the hashes of the files made from them; return the hash of the last entry."""
    kept = Manifest(out / ACCOUNT)
    kept.add(BEGIN, time, **facts)
    for path in made:
        kept.add_file(path, time, MADE)
    return kept.head
