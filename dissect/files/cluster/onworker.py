"""Runs on a Dask worker: passes each task on to a separate process (`dissect.files.cluster.reader`).

A Dask worker runs its tasks as threads of one process. These would share the working folder, standard output and the worker's
memory limit, and a task that crashes would end the worker and lose all results in it. A process is used again for later tasks.
"""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from multiprocessing.connection import Connection
from typing import Final

from dissect.files.cluster.reader import Order

#: Kinds of results: the process answered, or it ended instead.
ANSWERED: Final = "answered"
DIED: Final = "died"


class _Process:
    """A process of `dissect.files.cluster.reader`, and the connections to it."""

    def __init__(self) -> None:
        command = [sys.executable, "-P", "-m", "dissect.files.cluster.reader"]
        (ours_in, theirs_out), (theirs_in, ours_out) = os.pipe(), os.pipe()
        try:
            self._process = subprocess.Popen(command, stdin=theirs_in, stdout=theirs_out, stderr=subprocess.DEVNULL)
        finally:
            os.close(theirs_in)
            os.close(theirs_out)
        self._answers = Connection(ours_in, writable=False)
        self._orders = Connection(ours_out, readable=False)

    def answer(self, order: Order) -> bytes | None:
        """Return the octets of the answer to a task; None if the process ended instead."""
        try:
            self._orders.send(order)
            return self._answers.recv_bytes()
        except (EOFError, OSError):
            return None

    def end(self) -> int:
        """Close the connections, which ends the process if it still runs; return its exit code."""
        self._orders.close()
        self._answers.close()
        return self._process.wait()


_lock: Final = threading.Lock()
_idle: Final[list[_Process]] = []


def answer(order: Order) -> tuple[str, bytes]:
    """Run a task; return ``(ANSWERED, octets that the process sent)``, or ``(DIED, exit code)``."""
    while True:
        with _lock:
            process = _idle.pop() if _idle else None
        fresh = process is None
        process = process or _Process()
        sent = process.answer(order)
        if sent is not None:
            with _lock:
                _idle.append(process)
            return ANSWERED, sent
        code = process.end()
        if fresh or code:  # an old process that was idle for too long has ended with 0: try a fresh one
            return DIED, str(code).encode()
