"""Locks on open files; a lock ends with the process that holds it."""

from __future__ import annotations

import sys

if sys.platform == "win32":
    import msvcrt

    #: A lock keeps other processes from reading the locked file, so it is for files that are not read.
    MANDATORY = True

    def lock(descriptor: int, *, shared: bool = False) -> None:
        """Lock a file until it is closed, without waiting; OSError if another process has it (``shared``: has it alone)."""
        if not shared:
            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)

else:
    import fcntl

    MANDATORY = False

    def lock(descriptor: int, *, shared: bool = False) -> None:
        """Lock a file until it is closed, without waiting; OSError if another process has it (``shared``: has it alone)."""
        fcntl.flock(descriptor, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)
