"""A text file that another program may still write to: each read gives what was added since the one before."""

from __future__ import annotations

import os
import weakref
from typing import Final

#: Octets that are read of a file from its beginning on; what is longer is no file of this kind.
MAX_READ: Final = 64 * 1024 * 1024
_PIECE: Final = 1024 * 1024


class GrowingFile:
    """Reads ``path`` from its beginning, and on from there. OSError when it cannot be opened or is a directory.

    It stays open, because a live capture gives up its rights before the file has grown, and is closed when nobody needs it any
    more. A file that became shorter was begun anew, and is read from its beginning again; ``begun`` counts how often.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self._descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_BINARY", 0) | getattr(os, "O_CLOEXEC", 0))
        weakref.finalize(self, os.close, self._descriptor)
        self.begun = 0
        self._at = 0
        os.read(self._descriptor, 0)  # a directory can be opened, and not read

    def more(self) -> bytes:
        """Return what was written since the last call, nothing where that cannot be read."""
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
