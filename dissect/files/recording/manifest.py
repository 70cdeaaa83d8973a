"""The manifest of a ring: a line of JSON for each finished file and each event, chained by hashes.

Each entry contains the SHA-256 of the line before it, so that nothing can be changed, removed or reordered before an entry
whose hash was noted elsewhere (``head``). The chain alone proves nothing: anyone who can write to the folder can write a new
chain.

An entry is on the disk before the next one is made, and the file that it names is there before the entry. A kill may cut the
last line; the next run ends it, chains it unchanged, and lists the files without an entry.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any, BinaryIO, Final, NamedTuple

from dissect.files.recording.names import PART, SUFFIX
from dissect.wire import locks
from dissect.wire.config.hostile import ContentError, read_json

#: The end of the name of a manifest, after the name of its ring.
ENDING: Final = ".manifest.jsonl"
#: The end of the name of a part of one, which `s7dissect evidence export` writes.
PART_ENDING: Final = f".part{ENDING}"
#: Used as the hash before the first line.
NOTHING: Final = "0" * 64

# Kinds of entries.
BEGIN: Final = "begin"
FILE: Final = "file"
LEFT: Final = "left"
REMOVED: Final = "removed"
EVENT: Final = "event"
END: Final = "end"
#: A file that was made from others, such as the report of an incident.
MADE: Final = "made"

#: Octets of a line, and of a manifest, that are read.
_LONGEST: Final = 64 * 1024
_MOST: Final = 1 << 30
_PIECE: Final = 1 << 20
_NAME: Final = re.compile(r"[A-Za-z0-9._-]{1,200}")
_SECRET_OPTION: Final = re.compile(r"--?[a-z-]*(?:password|secret|token|credential)[a-z-]*", re.IGNORECASE)
_IN_ADDRESS: Final = re.compile(r"(?<=://)[^/@\s]+@|(?<=[?#])\S+")


def manifest_of(directory: Path, name: str) -> Path:
    """Return the path of the manifest of the ring ``name``."""
    return directory / f"{name}{ENDING}"


def hash_of(line: bytes) -> str:
    """Return the hash of a line, without its end."""
    return hashlib.sha256(line).hexdigest()


def content_hash(path: Path) -> str:
    """Return the hash of a file. Raises OSError."""
    with path.open("rb") as file:
        return _hash_of_rest(file)


def _hash_of_rest(file: BinaryIO) -> str:
    found = hashlib.sha256()
    while piece := file.read(_PIECE):
        found.update(piece)
    return found.hexdigest()


def masked(words: Iterable[str]) -> list[str]:
    """Return a command line without its secrets: values of secret options, users and queries in addresses."""
    found: list[str] = []
    hide = False
    for word in words:
        option, equals, _ = word.partition("=")
        if hide:
            found.append("…")
            hide = False
        elif _SECRET_OPTION.fullmatch(option):
            found.append(f"{option}=…" if equals else word)
            hide = not equals
        else:
            found.append(_IN_ADDRESS.sub("…", word))
    return found


class Manifest:
    """Appends entries to a manifest. Every method may raise OSError; an entry that could not be written leaves no trace.

    ``head`` is the hash of the latest entry, ``entries`` the number of entries.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.head = NOTHING
        self.entries = 0
        self.names: set[str] = set()
        self._size = 0
        if path.exists():
            self._take_over()

    def _take_over(self) -> None:
        lines, whole = _lines(self.path)
        for line in lines:
            self.head = hash_of(line)
            self.entries += 1
            with suppress(ContentError, AttributeError):
                self.names.add(str(read_json(line).get("name")))
        self._size = self.path.stat().st_size
        if not whole:  # a kill cut the last line: it stays, and is chained unchanged
            self._append(b"\n")

    def add(self, kind: str, time: str, **facts: Any) -> None:
        """Write an entry, and wait until it is on the disk."""
        entry = {"kind": kind, "time": time, **facts, "previous": self.head}
        line = json.dumps(entry, ensure_ascii=True).encode("ascii")
        self._append(line + b"\n")
        self.head = hash_of(line)
        self.entries += 1
        self.names.add(str(facts.get("name")))

    def add_file(self, path: Path, time: str, kind: str = FILE, **facts: Any) -> None:
        """Write the entry of a file, which is brought to the disk before; the ring may remove it in the meantime."""
        # Windows syncs only files that may be written.
        access = os.O_RDWR if locks.MANDATORY else os.O_RDONLY
        with os.fdopen(os.open(path, access | getattr(os, "O_BINARY", 0)), "rb") as file:
            os.fsync(file.fileno())
            octets = os.fstat(file.fileno()).st_size
            sha256 = _hash_of_rest(file)
        self.add(kind, time, name=path.name, sha256=sha256, octets=octets, **facts)

    def _append(self, octets: bytes) -> None:
        flags = os.O_WRONLY | os.O_CREAT | os.O_APPEND | getattr(os, "O_BINARY", 0)
        descriptor = os.open(self.path, flags, 0o640)
        try:
            try:
                rest = memoryview(octets)
                while rest:
                    rest = rest[os.write(descriptor, rest) :]
                os.fsync(descriptor)
            except OSError:
                os.ftruncate(descriptor, self._size)
                raise
        finally:
            os.close(descriptor)
        self._size += len(octets)


def _lines(path: Path) -> tuple[list[bytes], bool]:
    """Return the lines of a manifest, and whether the last one is whole."""
    with path.open("rb") as file:
        content = file.read(_MOST)
    *lines, rest = content.split(b"\n")
    return ([*lines, rest], False) if rest else (lines, True)


# ---- looking at it --------------------------------------------------------------------------------------------------


class Verdict(NamedTuple):
    """The state of a file or of the chain: ``state`` is a word, ``well`` is whether it is correct."""

    name: str
    state: str
    well: bool


WHOLE: Final = "whole"


def verified(directory: Path, heads: Iterable[str] = ()) -> Iterator[Verdict]:
    """Yield the verdicts on the evidence in a folder: on each chain, on each file in it, and on files in no chain.

    ``heads`` are hashes of entries that were noted elsewhere; each must be in a chain. Raises OSError.
    """
    covered: set[str] = set()
    known: set[str] = set()
    wanted = {head.lower() for head in heads}
    paths = sorted([path for path in directory.iterdir() if path.name.endswith(ENDING)])
    for path in paths:
        yield from _chain(path, covered, known, wanted)
    for path in sorted(directory.iterdir()):
        if path.name.endswith((SUFFIX, SUFFIX + PART)) and path.name not in covered:
            unfinished = path.name.endswith(PART)
            yield Verdict(path.name, "unfinished, in no entry" if unfinished else "in no entry", False)
    for head in sorted(wanted - known):
        yield Verdict(head, "is the hash of no entry: entries were changed or removed since it was noted", False)


def _chain(path: Path, covered: set[str], known: set[str], wanted: set[str]) -> Iterator[Verdict]:
    """Yield the verdicts on one manifest and its files."""
    lines, whole = _lines(path)
    # A part of a chain begins anywhere and is marked as a part; the missing files stayed with the rest.
    part = path.name.endswith(PART_ENDING)
    before = _previous(lines) if part else NOTHING
    behind = f"part of a chain, behind {before}; " if part else ""
    entries: dict[str, dict[str, Any]] = {}
    removed: set[str] = set()
    anchored = 0
    for number, line in enumerate(lines, 1):
        entry = _entry(line)
        last = number == len(lines)
        if entry is None:
            cut = (last and not whole) or (not last and _is_begin(lines[number]))
            yield Verdict(f"{path.name}:{number}", "was cut off by a kill" if cut else "is not an entry", False)
        elif entry.get("previous") != before:
            yield Verdict(f"{path.name}:{number}", "does not follow the entry before it: the chain is broken", False)
        before = hash_of(line)
        known.add(before)
        if before in wanted:
            anchored = number
        name = entry.get("name") if entry is not None else None
        if entry is not None and isinstance(name, str):
            if entry.get("kind") == REMOVED:
                removed.add(name)
            elif entry.get("kind") in {FILE, LEFT, MADE}:
                entries[name] = entry
    proof = f"; entries 1 to {anchored} are those whose hash is known" if anchored else ""
    yield Verdict(path.name, f"{behind}{len(lines)} entries, head {before}{proof}", True)
    covered.update(entries)
    for name, entry in entries.items():
        if not part or (path.parent / name).exists():
            yield _file(path.parent, name, entry, name in removed)


def _previous(lines: list[bytes]) -> str:
    entry = _entry(lines[0]) if lines else None
    return str(entry.get("previous")) if entry is not None else NOTHING


def entries_of(path: Path) -> tuple[list[bytes], list[dict[str, Any]]]:
    """Return the lines of a manifest with their contents, empty for a line that is not an entry. Raises OSError."""
    lines, _ = _lines(path)
    return lines, [_entry(line) or {} for line in lines]


def state_of(directory: Path, name: str, entry: dict[str, Any]) -> str:
    """Return the state of the file of an entry, in a word or two."""
    return _file(directory, name, entry, False).state


def _is_begin(line: bytes) -> bool:
    entry = _entry(line)
    return entry is not None and entry.get("kind") == BEGIN


def _entry(line: bytes) -> dict[str, Any] | None:
    try:
        entry = read_json(line) if len(line) <= _LONGEST else None
    except ContentError:
        return None
    return entry if isinstance(entry, dict) else None


def _file(directory: Path, name: str, entry: dict[str, Any], removed: bool) -> Verdict:
    path = directory / name
    if not _NAME.fullmatch(name) or not path.is_file() or path.is_symlink():
        return Verdict(name, "removed by the ring" if removed else "missing", removed)
    try:
        same = path.stat().st_size == entry.get("octets") and content_hash(path) == entry.get("sha256")
    except OSError as error:
        return Verdict(name, f"cannot be read: {error.strerror}", False)
    if not same:
        return Verdict(name, "changed", False)
    if entry.get("kind") == LEFT:
        return Verdict(
            name, "whole since it was found: a kill or a power cut left it, what it held before is unknown", False
        )
    return Verdict(name, WHOLE, True)
