"""`GrowingFile`: a text file that another program may still write to; each read returns what was added since the last."""

from __future__ import annotations

import os
import weakref
from typing import Final

#: At most this many octets of a file are read; no file of this kind is longer.
MAX_READ: Final = 64 * 1024 * 1024
_PIECE: Final = 1024 * 1024


class GrowingFile:
    """Reads ``path`` from its beginning, and on from there. Raises OSError if it cannot be opened or is a directory.

    The file stays open for as long as this object exists, because a live capture drops its privileges before the file grows. A
    file that became shorter was rewritten, and is read from its beginning again; ``begun`` counts how often.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self._descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_BINARY", 0) | getattr(os, "O_CLOEXEC", 0))
        weakref.finalize(self, os.close, self._descriptor)
        self.begun = 0
        self._at = 0
        os.read(self._descriptor, 0)  # raises for a directory, which can be opened but not read

    def more(self) -> bytes:
        """Return the octets written since the last call; none if the file cannot be read."""
        try:
            if os.fstat(self._descriptor).st_size < self._at:
                self._at = os.lseek(self._descriptor, 0, os.SEEK_SET)
                self.begun += 1
            pieces: list[bytes] = []
            while self._at < MAX_READ and (piece := os.read(self._descriptor, min(_PIECE, MAX_READ - self._at))):
                pieces.append(piece)
                self._at += len(piece)
        except OSError:
            return b""
        return b"".join(pieces)
