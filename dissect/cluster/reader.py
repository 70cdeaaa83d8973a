"""A process on a worker that does one task after another, and ends when whoever started it is gone.

A task is a function of this package and its arguments, the folder it is done in, and files that have to be as they are where
the task comes from. It arrives on standard input, as processes of `multiprocessing` send it; ``(kind, result)`` leaves on what
was standard output.
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

from dissect.jobs.tasks import FileError

#: Seconds without a task after which the process gives its memory back.
IDLE_S: Final = 30
#: Kinds of answers: a result, what stands in the way of one, or a defect.
FOUND: Final = "found"
REFUSED: Final = "refused"
DEFECT: Final = "defect"


class Order(NamedTuple):
    """A task: ``work(*arguments)`` in ``folder``, which has to be there if it ``needs_folder``.

    ``files`` are those it reads besides, by name, with their digests.
    """

    folder: str
    needs_folder: bool
    files: Mapping[str, str]
    work: Callable[..., Any]
    arguments: Sequence[Any]


def digest(name: str | Path) -> str:
    """Return what tells two contents of a file apart. Raises OSError."""
    with Path(name).open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def carried_out(order: Order) -> tuple[str, Any]:
    """Do a task; return the kind of the answer, and the result or the reason why there is none."""
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
    """Do tasks until there are none for a while, or nobody is there who sends any."""
    source = Connection(os.dup(0), writable=False)
    target = Connection(os.dup(1), readable=False)
    nothing = os.open(os.devnull, os.O_RDWR)
    os.dup2(nothing, 0)
    os.dup2(nothing, 1)  # no output of a task can get between the answers
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
            os._exit(0)  # whoever sent them is gone, however that ended
        orders.put(order)


if __name__ == "__main__":
    main()
    sys.exit(0)
