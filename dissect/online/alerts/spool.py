"""`Spool`: keeps alerts on disk until they are delivered, in a bounded folder of small files.

A file is called ``RANK-TIME-NUMBER.json`` (rank 0 is an error, time in nanoseconds since 1970) and contains the alert as it is
posted. It appears only when it is complete, and is removed after delivery. So even if the program is killed, each alert on disk
is delivered after the next start, at worst twice.
"""

from __future__ import annotations

import os
import re
import time
from pathlib import Path
from typing import IO, Final, NamedTuple

from dissect.engine.findings.catalogue import SEVERITIES
from dissect.online.alerts.waiting import Waiting
from dissect.wire import locks
from dissect.wire.config.saving import PART, save

#: Greatest number of alerts that are kept, and of their octets.
MAX_ALERTS: Final = 4096
MAX_OCTETS: Final = 64 * 1024 * 1024
#: Greatest number of folders, one for each process that uses the same spool at the same time.
_MAX_FOLDERS: Final = 16
_NAME: Final = re.compile(rf"([0-{len(SEVERITIES) - 1}])-([0-9]{{19,20}})-([0-9]{{6}})\.json")
_UNSAFE: Final = re.compile(r"[^A-Za-z0-9._-]+")


class Spooled(NamedTuple):
    """A waiting alert: its rank, size and file; if it could not be written, the file is None and the content in memory."""

    rank: int
    size: int
    path: Path | None
    content: bytes = b""


def default_folder() -> Path:
    """Return the default folder for waiting alerts.

    It is below the state folder of a systemd service, below that of the user, or /var/lib/s7dissect for root.
    """
    service = os.environ.get("STATE_DIRECTORY", "").split(":")[0]
    state = os.environ.get("XDG_STATE_HOME", "")
    if service:
        return Path(service) / "alerts"
    if state:
        return Path(state) / "s7dissect" / "alerts"
    if hasattr(os, "geteuid") and os.geteuid() == 0:
        return Path("/var/lib/s7dissect/alerts")
    return Path.home() / ".local" / "state" / "s7dissect" / "alerts"


class Spool:
    """The alerts of the action ``name`` that wait in ``folder``.

    `prepare` makes the folder, `open` takes over alerts that an earlier run left. ``trouble`` is the reason why alerts are not
    on disk, empty while they are. Several threads need a lock around all methods except `write` (only one thread), `read` and
    `remove`, which wait for the disk and do not change any state.
    """

    def __init__(self, folder: Path, name: str, most: int = MAX_ALERTS, most_octets: int = MAX_OCTETS) -> None:
        self.folder = folder / (_UNSAFE.sub("_", name)[:60].lstrip(".") or "_")
        self.trouble = ""
        self._waiting: Waiting[Spooled] = Waiting(most)
        self._most_octets = most_octets
        self._octets = 0
        self._taken = 0
        self._number = 0
        self._lock: IO[bytes] | None = None

    def __len__(self) -> int:
        return len(self._waiting) + self._taken

    def prepare(self) -> list[Path]:
        """Make the folder; return the folders that were made, the outermost first. Errors go to ``trouble``."""
        made = [one for one in (*reversed(self.folder.parents), self.folder) if not os.path.lexists(one)]
        try:
            self.folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        except OSError as error:
            self._note(error)
            return [one for one in made if one.is_dir()]
        return made

    def open(self) -> None:
        """Lock the folder, or one beside it if another process uses it, and take over the alerts in it."""
        for number in range(1, _MAX_FOLDERS + 1):
            folder = self.folder if number == 1 else self.folder.with_name(f"{self.folder.name}-{number}")
            try:
                folder.mkdir(parents=True, exist_ok=True, mode=0o700)
                lock = (folder / ".lock").open("ab")
            except OSError as error:
                self._note(error)
                return
            try:
                locks.lock(lock.fileno())
            except OSError:
                lock.close()
                continue
            self.folder, self._lock, self.trouble = folder, lock, ""
            self._take_over()
            return
        self.trouble = f"{self.folder}: {_MAX_FOLDERS} processes already use it"

    @property
    def is_open(self) -> bool:
        """Whether the folder is this process's, so that alerts can wait there."""
        return self._lock is not None

    def write(self, rank: int, content: bytes) -> Spooled:
        """Write an alert to disk, if possible; call `keep` next."""
        self._number = (self._number + 1) % 1_000_000
        path: Path | None = None
        if self._lock is not None:
            path = self.folder / f"{rank}-{time.time_ns():020d}-{self._number:06d}.json"
            try:
                save(path, content, 0o600)
                self.trouble = ""
            except OSError as error:
                self._note(error)
                path = None
        return Spooled(rank, len(content), path, b"" if path is not None else content)

    def keep(self, written: Spooled) -> list[Spooled]:
        """Let an alert wait. Return alerts that are dropped to make room, the oldest of the least severe; remove them next."""
        self._octets += written.size
        gone = [self._waiting.put(written.rank, written)]
        while self._octets - sum([one.size for one in gone if one is not None]) > self._most_octets and self._waiting:
            gone.append(self._waiting.lightest())
        dropped = [one for one in gone if one is not None]
        self._octets -= sum([one.size for one in dropped])
        return dropped

    def take(self) -> Spooled | None:
        """Take the oldest of the most severe alerts, None if none waits; call `done` or `put_back` next."""
        one = self._waiting.heaviest()
        if one is not None:
            self._taken += 1
        return one

    def read(self, one: Spooled) -> bytes | None:
        """Return the content of an alert, None if someone has removed its file."""
        if one.path is None:
            return one.content
        try:
            return one.path.read_bytes()
        except OSError:
            return None

    def put_back(self, one: Spooled) -> None:
        """Put back an alert that was not delivered, before all others of its rank."""
        self._taken -= 1
        self._waiting.put_back(one.rank, one)

    def done(self, one: Spooled) -> None:
        """Forget an alert that was delivered or never can be; call `remove` next."""
        self._taken -= 1
        self._octets -= one.size

    def remove(self, one: Spooled) -> None:
        """Remove the file of an alert that no longer waits."""
        if one.path is not None:
            try:
                one.path.unlink(missing_ok=True)
            except OSError as error:
                self._note(error)

    @property
    def lost_at_end(self) -> int:
        """How many waiting alerts are not on disk."""
        count, kept = 0, []
        while (one := self._waiting.heaviest()) is not None:
            kept.append(one)
            count += one.path is None
        for one in reversed(kept):
            self._waiting.put_back(one.rank, one)
        return count

    def close(self) -> None:
        """Leave the folder to the next run."""
        if self._lock is not None:
            self._lock.close()
            self._lock = None

    def _take_over(self) -> None:
        names = sorted([path.name for path in self.folder.iterdir()])
        for name in names:
            path = self.folder / name
            found = _NAME.fullmatch(name)
            try:
                if found is not None and path.is_file() and not path.is_symlink():
                    one = Spooled(int(found[1]), path.stat().st_size, path)
                    self._octets += one.size
                    gone = self._waiting.put(one.rank, one)
                    if gone is not None:
                        self._octets -= gone.size
                        self.remove(gone)
                elif name.startswith(".") and ".json." in name and name.endswith(PART):
                    path.unlink()  # incomplete: the process was killed while it wrote
            except OSError as error:
                self._note(error)

    def _note(self, error: OSError) -> None:
        self.trouble = f"{self.folder}: {error.strerror or error}"
