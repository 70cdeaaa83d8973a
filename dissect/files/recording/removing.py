"""`Removing`: deletes files whose time is over, later those that somebody has open at the moment."""

from __future__ import annotations

from pathlib import Path

from dissect.wire import locks


class Removing:
    """Deletes files. Windows refuses that while a program has the file open: it is tried again with the next one."""

    def __init__(self) -> None:
        self._read_by_others: list[Path] = []

    def remove(self, path: Path) -> list[Path]:
        """Delete a file and those that are left from before; return those that are gone. Raises OSError."""
        self._read_by_others.append(path)
        gone: list[Path] = []
        for one in [*self._read_by_others]:
            try:
                one.unlink(missing_ok=True)
            except PermissionError:
                if not locks.MANDATORY:
                    raise
                continue
            self._read_by_others.remove(one)
            gone.append(one)
        return gone
