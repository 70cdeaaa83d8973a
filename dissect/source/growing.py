"""A text file that another program may still write to: each read gives what was added since the one before."""

from __future__ import annotations

import os
from typing import Final

#: Octets that are read of a file in all; what is longer is no file of this kind.
MAX_READ: Final = 64 * 1024 * 1024


class GrowingFile:
    """Reads ``path`` from its beginning, and on from there. OSError when it cannot be opened.

    A file that became shorter was begun anew, and is read from its beginning again. What cannot be read any more gives nothing.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self._file = open(path, "rb")  # noqa: SIM115, PTH123 - it stays open as long as it may grow
        self._read = 0

    def more(self) -> bytes:
        """Return what was written since the last call."""
        if self._file.closed or self._read >= MAX_READ:
            return b""
        try:
            if os.fstat(self._file.fileno()).st_size < self._file.tell():
                self._file.seek(0)
            octets = self._file.read(MAX_READ - self._read)
        except (OSError, ValueError):
            return b""
        self._read += len(octets)
        return octets

    def close(self) -> None:
        """Release the file."""
        self._file.close()
