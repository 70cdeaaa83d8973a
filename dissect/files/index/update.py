"""Updates the catalogue of a folder: reads files that are new or have changed, and forgets files that are gone."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from dissect.files.index.facts import FileFacts
from dissect.files.index.store import Store

#: Endings of the names of captures, before the ending of a compression.
_CAPTURES: Final = (".pcap", ".pcapng", ".cap", ".ntar")
_COMPRESSED: Final = (".gz", ".zst")
#: At most this many changes are written together, and none waits longer than this for the next file.
_TOGETHER: Final = 200
_LONGEST_S: Final = 1.0


@dataclass
class Changes:
    """The results of an update: files by outcome.

    ``unreadable`` gives the reason by name (for a folder with a slash at the end); ``damaged`` describes what is missing from a
    file; ``whole`` is False if the update was stopped.
    """

    read: list[str] = field(default_factory=list)
    unchanged: int = 0
    gone: list[str] = field(default_factory=list)
    unreadable: dict[str, str] = field(default_factory=dict)
    damaged: dict[str, str] = field(default_factory=dict)
    whole: bool = True


def captures(folder: Path, unreadable: dict[str, str] | None = None) -> Iterator[str]:
    """Yield the captures in a folder and below it, by names relative to it, sorted; hidden files and folders are left out.

    Symbolic links to folders are not followed. Unreadable files and folders are added to ``unreadable``, with the reason; the
    names of folders end with a slash there. Raises `OSError` when the folder itself cannot be read.
    """
    with os.scandir(folder) as entries:
        found = sorted(entries, key=lambda entry: entry.name)
    for entry in found:
        if entry.name.startswith("."):
            continue
        name = entry.name
        try:
            if entry.is_dir(follow_symlinks=False):
                name += "/"
                below: dict[str, str] = {}
                yield from [name + each for each in captures(Path(entry.path), below)]
                if unreadable is not None:
                    unreadable.update({name + each: why for each, why in below.items()})
            elif is_capture(name) and entry.is_file():
                yield name
        except FileNotFoundError:
            continue  # the file was removed in the meantime
        except OSError as error:
            if unreadable is not None:
                unreadable[name] = error.strerror or str(error)


def is_capture(name: str) -> bool:
    """Return whether a file has the name of a capture."""
    stem = name.lower()
    for ending in _COMPRESSED:
        stem = stem.removesuffix(ending)
    # tcpdump's ring buffer appends a number to the name: ring.pcap12.
    return stem.rstrip("0123456789").endswith(_CAPTURES)


class _Batch:
    """Changes of the catalogue that are written together: each transaction waits for the disk."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._waiting: list[FileFacts | str] = []
        self._written = time.monotonic()

    def add(self, change: FileFacts | str) -> None:
        """Take the facts about a file, or the name of one to forget; write them when there are many or after a second."""
        self._waiting.append(change)
        if len(self._waiting) >= _TOGETHER or time.monotonic() - self._written >= _LONGEST_S:
            self.write()

    def write(self) -> None:
        """Write the waiting changes."""
        waiting, self._waiting = self._waiting, []
        if waiting:
            self._store.write(waiting)
        self._written = time.monotonic()


def update(store: Store, folder: Path, read: Callable[[str, FileFacts], FileFacts | str | None]) -> Changes:
    """Read the files that the catalogue does not know yet, with ``read``, and forget those that no longer exist.

    ``read`` is given the path of a file, and facts with name, size and time of change. It returns the facts, a text that says
    why the file cannot be read, or None to stop. Raises `StoreError` and `OSError`.
    """
    batch = _Batch(store)
    try:
        return _update(store, batch, folder, read)
    finally:
        batch.write()


def _update(
    store: Store, batch: _Batch, folder: Path, read: Callable[[str, FileFacts], FileFacts | str | None]
) -> Changes:
    changes = Changes()
    known = store.known()
    names = list(captures(folder, changes.unreadable))
    hidden = tuple([name for name in changes.unreadable if name.endswith("/")])
    for name in known.keys() - set(names) - changes.unreadable.keys():
        if name.startswith(hidden):
            continue  # it may exist, but only for users who may look into the folder: keep its facts
        batch.add(name)
        changes.gone.append(name)
    for name in names:
        path = folder / name
        try:
            state = path.stat()
        except OSError as error:
            changes.unreadable[name] = error.strerror or str(error)
            continue
        if known.get(name) == (state.st_size, state.st_mtime_ns):
            changes.unchanged += 1
            continue
        found = read(str(path), FileFacts(name, state.st_size, state.st_mtime_ns))
        if found is None:
            changes.whole = False
            break
        if isinstance(found, str) or found.broken_off:
            changes.unreadable[name] = found if isinstance(found, str) else found.damage
            batch.add(name)
            continue
        batch.add(found)
        changes.read.append(name)
        if found.damage:
            changes.damaged[name] = found.damage
    changes.gone.sort()
    return changes
