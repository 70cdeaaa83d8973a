"""The manifest of a live run, written in a thread of its own, so that hashing and waiting for the disk do not delay packets."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

from dissect.files.recording import manifest
from dissect.files.recording.manifest import Manifest
from dissect.online.alerts.problems import EVIDENCE
from dissect.online.live.problems import Problems, Recovery
from dissect.wire.text import Clock, reason

#: At most this many entries wait for the disk.
MAX_WAITING: Final = 10_000
_LOOK_S: Final = 0.5
#: At most this many seconds are spent on waiting entries at the end.
_END_S: Final = 30.0


class ManifestThread:
    """Writes entries in the order in which they are given. ``lost`` counts those that were dropped for lack of memory.

    An entry that cannot be written is tried again after 1, 2, 4 … 60 s; later ones wait. ``head`` is the hash of the latest
    entry on the disk.
    """

    def __init__(self, path: Path, clock: Callable[[], int] = time.time_ns) -> None:
        self.lost = 0
        self.head = ""
        self._path = path
        self._clock = clock
        self._times = Clock()
        self._waiting: queue.Queue[tuple[str, str, Path | None, dict[str, Any]] | None] = queue.Queue(MAX_WAITING)
        self._over = threading.Event()
        self._manifest: Manifest | None = None
        self._recovery = Recovery()
        self._thread: threading.Thread | None = None
        self._problems = Problems()

    def start(self, problems: Problems) -> None:
        """Start the thread; call it after privileges were dropped."""
        self._problems = problems
        self._thread = threading.Thread(target=self._work, name="manifest", daemon=True)
        self._thread.start()

    def add(self, kind: str, path: Path | None = None, **facts: Any) -> None:
        """Add an entry, about the file ``path`` if given; never waits."""
        try:
            self._waiting.put_nowait((kind, self._times.iso(self._clock()), path, facts))
        except queue.Full:
            self.lost += 1

    def close(self) -> None:
        """Write the waiting entries, for a limited time."""
        if self._thread is not None:
            self._over.set()
            self._waiting.put(None) if not self._waiting.full() else None
            self._thread.join(_END_S)

    def _work(self) -> None:
        while True:
            taken = self._waiting.get()
            if taken is None:
                return
            while not self._written(*taken):
                if self._over.wait(_LOOK_S):
                    return
                while not self._recovery.due and not self._over.is_set():
                    self._over.wait(_LOOK_S)

    def _written(self, kind: str, moment: str, path: Path | None, facts: dict[str, Any]) -> bool:
        try:
            if self._manifest is None:
                self._manifest = Manifest(self._path)
            if kind == manifest.LEFT and path is not None and path.name in self._manifest.names:
                return True
            _enter(self._manifest, kind, moment, path, facts)
        except OSError as error:
            if self._recovery.failed():
                self._problems.tell(
                    EVIDENCE, f"the manifest cannot be written: {reason(error)}; it will be tried again"
                )
            return False
        self.head = self._manifest.head
        if self._recovery.failing:
            self._recovery.worked()
            self._problems.tell(EVIDENCE, "the manifest is written again", True)
        return True


def _enter(kept: Manifest, kind: str, moment: str, path: Path | None, facts: dict[str, Any]) -> None:
    """Write an entry; that of a file which the ring has removed since has its name only. Raises OSError."""
    if path is not None:
        with suppress(FileNotFoundError):
            kept.add_file(path, moment, kind, **facts)
            return
        facts = {"name": path.name, **facts}
    kept.add(kind, moment, **facts)
