"""What a Dask worker does with a task: it has a process of its own do it (`dissect.cluster.reader`).

Tasks of a worker are threads of one process, where two would share the working folder, standard output and the memory limit of
the worker; and a task that dies of its file would take the worker and all results it holds along. A process stays for the next
task of its kind.
"""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from multiprocessing.connection import Connection
from typing import Final

from dissect.cluster.reader import Order

#: Whether the process answered or ended instead.
ANSWERED: Final = "answered"
DIED: Final = "died"


class _Process:
    """A process of `dissect.cluster.reader`, and the connections to it."""

    def __init__(self) -> None:
        command = [sys.executable, "-P", "-m", "dissect.cluster.reader"]
        (ours_in, theirs_out), (theirs_in, ours_out) = os.pipe(), os.pipe()
        try:
            self._process = subprocess.Popen(command, stdin=theirs_in, stdout=theirs_out, stderr=subprocess.DEVNULL)
        finally:
            os.close(theirs_in)
            os.close(theirs_out)
        self._answers = Connection(ours_in, writable=False)
        self._orders = Connection(ours_out, readable=False)

    def answer(self, order: Order) -> bytes | None:
        """Return the answer to a task as it was sent; None when the process ended instead."""
        try:
            self._orders.send(order)
            return self._answers.recv_bytes()
        except (EOFError, OSError):
            return None

    def end(self) -> int:
        """Close the connections, which ends the process if nothing else did; return its exit code."""
        self._orders.close()
        self._answers.close()
        return self._process.wait()


_lock: Final = threading.Lock()
_idle: Final[list[_Process]] = []


def answer(order: Order) -> tuple[str, bytes]:
    """Have a task done; return ``(ANSWERED, what the process sent)``, or ``(DIED, how it ended)``."""
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
        if fresh or code:  # one that waited too long for a task ends with 0
            return DIED, str(code).encode()
