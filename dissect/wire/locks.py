"""Locks on open files, which end with the process that holds them."""

from __future__ import annotations

import sys

if sys.platform == "win32":
    import msvcrt

    #: A lock keeps other processes from reading what is locked: for files that nobody reads.
    MANDATORY = True

    def lock(descriptor: int, *, shared: bool = False) -> None:
        """Lock a file until it is closed, without waiting; OSError where another process has it (``shared``: alone)."""
        if not shared:
            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)

else:
    import fcntl

    MANDATORY = False

    def lock(descriptor: int, *, shared: bool = False) -> None:
        """Lock a file until it is closed, without waiting; OSError where another process has it (``shared``: alone)."""
        fcntl.flock(descriptor, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)
