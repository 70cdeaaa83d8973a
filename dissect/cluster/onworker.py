"""What a Dask worker does with a task: it has a process of its own do it (`dissect.cluster.reader`).

Tasks of a worker are threads of one process, where two would share the working folder, standard output and the memory limit of
the worker; and a task that dies of its file would take the worker and all results it holds along. A process stays for the next
task of its kind.
"""

from __future__ import annotations

import subprocess
import sys
import threading
from contextlib import suppress
from typing import Final

from dissect.cluster.reader import LENGTH

#: Whether the process answered or ended instead.
ANSWERED: Final = "answered"
DIED: Final = "died"

_lock: Final = threading.Lock()
_idle: Final[list[subprocess.Popen[bytes]]] = []


def answer(order: bytes) -> tuple[str, bytes]:
    """Have a task done, a pickled `dissect.cluster.reader.Order`.

    Return ``(ANSWERED, what the process wrote)``, or ``(DIED, how it ended)``.
    """
    while True:
        with _lock:
            fresh = not _idle
            process = _started() if fresh else _idle.pop()
        written = _asked(process, order)
        if written is not None:
            with _lock:
                _idle.append(process)
            return ANSWERED, written
        code = process.wait()
        for pipe in (process.stdin, process.stdout):
            with suppress(OSError):  # what could not be written cannot be written now
                if pipe is not None:
                    pipe.close()
        if fresh or code:  # one that waited too long for a task ends with 0
            return DIED, str(code).encode()


def _started() -> subprocess.Popen[bytes]:
    command = [sys.executable, "-P", "-m", "dissect.cluster.reader"]
    return subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)


def _asked(process: subprocess.Popen[bytes], order: bytes) -> bytes | None:
    """Return the answer of a process, pickled; None when it ended instead."""
    assert process.stdin is not None
    assert process.stdout is not None
    try:
        process.stdin.write(order)
        process.stdin.flush()
        head = process.stdout.read(LENGTH)
        size = int.from_bytes(head, "big")
        written = process.stdout.read(size)
    except BrokenPipeError:
        return None
    return written if len(head) == LENGTH and len(written) == size else None
