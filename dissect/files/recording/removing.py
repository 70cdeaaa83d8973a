"""`Removing`: deletes files when their time is over; files that are open in another program are deleted later."""

from __future__ import annotations

from pathlib import Path

from dissect.wire import locks


class Removing:
    """Deletes files. Windows refuses to delete a file that a program has open: it is tried again with the next one."""

    def __init__(self) -> None:
        self._read_by_others: list[Path] = []

    def remove(self, path: Path) -> list[Path]:
        """Delete a file and those left from before; return those that were deleted. Raises OSError."""
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
