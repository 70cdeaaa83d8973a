"""A process on a worker that runs one task after another, and ends when the process that started it is gone.

A task has a function of this package and its arguments, a working folder, and files whose contents must be the same as on the
sending machine. Tasks arrive on standard input in the form of `multiprocessing` connections; ``(kind, result)`` is sent on the
original standard output.
"""

from __future__ import annotations

import hashlib
import os
import queue
import sys
import threading
import traceback
from collections.abc import Callable, Mapping, Sequence
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, Final, NamedTuple

from dissect.files.jobs.tasks import FileError

#: After this many seconds without a task the process ends, to free its memory.
IDLE_S: Final = 30
#: Kinds of answers: a result, a reason why there is none, or a bug.
FOUND: Final = "found"
REFUSED: Final = "refused"
DEFECT: Final = "defect"


class Order(NamedTuple):
    """A task: ``work(*arguments)`` in ``folder``, which must exist if ``needs_folder``.

    ``files`` are further files that it reads, with their digests, by name.
    """

    folder: str
    needs_folder: bool
    files: Mapping[str, str]
    work: Callable[..., Any]
    arguments: Sequence[Any]


def digest(name: str | Path) -> str:
    """Return the SHA-256 of a file. Raises OSError."""
    with Path(name).open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def carried_out(order: Order) -> tuple[str, Any]:
    """Run a task; return the kind of the answer, and the result or the reason why there is none."""
    try:
        _prepare(order)
        return FOUND, order.work(*order.arguments)
    except FileError as error:
        return REFUSED, str(error)
    except OSError as error:
        return REFUSED, f"{error.filename}: {error.strerror}" if error.filename else str(error)
    except MemoryError:
        return REFUSED, "there is not enough memory"
    except Exception:  # noqa: BLE001 - a defect, which whoever gave the task has to hear of
        return DEFECT, traceback.format_exc()


def _prepare(order: Order) -> None:
    try:
        os.chdir(order.folder)
    except OSError as error:
        if order.needs_folder:
            raise FileError(f"the folder {order.folder} cannot be entered: {error.strerror}") from None
    for name, content in order.files.items():
        try:
            same = digest(name) == content
        except OSError as error:
            raise FileError(f"{name}: {error.strerror}; the command reads it as well") from None
        if not same:
            raise FileError(f"{name}: not what it is where the command was started")


def main() -> None:
    """Run tasks until none came for `IDLE_S`, or the sender is gone."""
    source = Connection(os.dup(0), writable=False)
    target = Connection(os.dup(1), readable=False)
    nothing = os.open(os.devnull, os.O_RDWR)
    os.dup2(nothing, 0)
    os.dup2(nothing, 1)  # so that output of a task cannot get between the answers
    orders: queue.SimpleQueue[Order] = queue.SimpleQueue()
    threading.Thread(target=_receive, args=(source, orders), daemon=True).start()
    while True:
        try:
            order = orders.get(timeout=IDLE_S)
        except queue.Empty:
            return
        target.send(carried_out(order))


def _receive(source: Connection, orders: queue.SimpleQueue[Order]) -> None:
    while True:
        try:
            order = source.recv()
        except EOFError:
            os._exit(0)  # the sender is gone
        orders.put(order)


if __name__ == "__main__":
    main()
    sys.exit(0)
