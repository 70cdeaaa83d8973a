"""Processes of this machine as an executor: what one of them dies of is the failure of its own task, and of no other.

Each process has a pipe and a thread of its own. In an executor whose processes share a queue (`concurrent.futures`), one that
dies breaks all of them, and nobody can say at which file.

They are spawned: a fork copies locks and buffers in whatever state they are, and the ends of the other processes' pipes.
"""

from __future__ import annotations

import gc
import multiprocessing
import os
import queue
import shutil
import signal
import threading
import traceback
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, Executor, Future
from contextlib import contextmanager
from typing import Any, TypeVar

from dissect.jobs.tasks import FileError
from dissect.report import words

T = TypeVar("T")


class _Process:
    """A process, and the pipe to it. ``folder`` and ``collects`` are those of `Pool`."""

    def __init__(self, folder: str, collects: tuple[int, ...]) -> None:
        context: Any = multiprocessing.get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(target=_serve, args=(theirs, folder, collects), daemon=True)
        with _uninterrupted():
            self._process.start()
        theirs.close()

    def call(self, fn: Callable[..., Any], arguments: tuple[Any, ...]) -> Any:
        """Return what a function returns there, or raise what it raises there. BrokenExecutor when the process dies of it."""
        try:
            self._pipe.send((fn, arguments))
            well, found = self._pipe.recv()
        except (EOFError, OSError):
            raise BrokenExecutor("the process ended") from None
        if well:
            return found
        raise found

    def end(self) -> None:
        """End the process, whatever it is doing. To be called once no thread is in `call`, or for that to return."""
        self._process.kill()
        self._process.join()

    def close(self) -> None:
        """Forget the pipe."""
        self._pipe.close()


class Pool(Executor):
    """``count`` processes; each does a task at a time, what is more waits.

    The future of a task whose process died raises `concurrent.futures.BrokenExecutor`; another process takes its place.
    Where none can be started the others go on, and without any left each task raises `dissect.jobs.tasks.FileError`; ``tell``
    hears of it, in a thread of the pool.

    ``folder`` is one that the processes remove when whoever started them was killed and cannot. ``collects`` are the
    thresholds of their collector (`gc.set_threshold`), empty for Python's own.
    """

    def __init__(
        self,
        count: int,
        folder: str = "",
        collects: tuple[int, ...] = (),
        tell: Callable[[str], None] = lambda _: None,
    ) -> None:
        self._folder = folder
        self._collects = collects
        self._tell = tell
        self._left = count
        self._why = ""
        self._tasks: queue.SimpleQueue[tuple[Future[Any], Callable[..., Any], tuple[Any, ...]] | None] = (
            queue.SimpleQueue()
        )
        self._over = False
        self._change = threading.Lock()
        self._processes = [_Process(folder, collects) for _ in range(count)]
        self._threads = [threading.Thread(target=self._work, args=(at,), daemon=True) for at in range(count)]
        for thread in self._threads:
            thread.start()

    def submit(self, fn: Callable[..., T], /, *args: Any, **kwargs: Any) -> Future[T]:
        """Have a task done by the next process that is free."""
        if kwargs:
            raise TypeError("tasks take no keyword arguments")
        future: Future[T] = Future()
        with self._change:
            if self._left:
                self._tasks.put((future, fn, args))
            else:
                future.set_exception(FileError(self._why))
        return future

    def _work(self, at: int) -> None:
        """Be the thread of a process."""
        while (task := self._tasks.get()) is not None:
            future, fn, arguments = task
            if not future.set_running_or_notify_cancel():
                continue
            try:
                found = self._processes[at].call(fn, arguments)
            except BrokenExecutor as error:
                future.set_exception(error)  # first: whoever waits for it waits for no other process
                if not self._replace(at):
                    return
            except Exception as error:  # noqa: BLE001 - as every executor hands it on
                future.set_exception(error)
            else:
                future.set_result(found)
        self._processes[at].close()

    def _replace(self, at: int) -> bool:
        """Put a process in the place of one that died; return whether that was possible."""
        with self._change:
            if self._over:
                return True
            self._processes[at].end()
            self._processes[at].close()
            try:
                self._processes[at] = _Process(self._folder, self._collects)
            except Exception as error:  # noqa: BLE001 - whatever it is, nobody may wait for that process
                reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
                self._why = f"a process of -j ended and no other one could be started: {reason}"
            else:
                return True
            self._left -= 1
            left = self._left
            if not left:
                self._give_up()
        goes_on = f"{words.count(left, 'process', 'processes')} of -j {'goes' if left == 1 else 'go'} on"
        self._tell(f"{self._why}; {goes_on if left else 'files that were not read yet are left out'}")
        return False

    def _give_up(self) -> None:
        """Fail the tasks that wait: there is no process left. ``_change`` is held."""
        try:
            while (task := self._tasks.get_nowait()) is not None:
                if task[0].set_running_or_notify_cancel():
                    task[0].set_exception(FileError(self._why))
        except queue.Empty:
            pass

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End all processes; what they were doing is lost, and what waits for them is not done."""
        with self._change:
            self._over = True
        try:
            while (task := self._tasks.get_nowait()) is not None:
                task[0].cancel()
        except queue.Empty:
            pass
        for _ in self._threads:
            self._tasks.put(None)
        for process in self._processes:
            process.end()
        for thread in self._threads:
            thread.join()


@contextmanager
def _uninterrupted() -> Iterator[None]:
    """Have what is started meanwhile begin without Ctrl-C, which reaches every process of a terminal."""
    if threading.current_thread() is not threading.main_thread():
        yield  # only the main thread may say so; the process itself does a moment later
        return
    handler = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, handler)


# ---- in the process -----------------------------------------------------------------------------------------------------


def _serve(pipe: Any, folder: str, collects: tuple[int, ...]) -> None:
    """Be a process of a pool: do one task after another, as long as there is somebody who gives them."""
    # These may reach all processes, and whoever started them knows what to do.
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)
    if collects:
        gc.set_threshold(*collects)
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_watch, args=(parent, folder), daemon=True).start()
    while True:
        try:
            fn, arguments = pipe.recv()
        except EOFError:
            return
        try:
            outcome = True, fn(*arguments)
        except Exception as error:  # noqa: BLE001 - it belongs to whoever wants the task done
            error.add_note(f"In a process of -j:\n{''.join(traceback.format_exception(error))}")
            outcome = False, error
        try:
            pipe.send(outcome)
        except Exception as error:  # noqa: BLE001 - what cannot be pickled
            pipe.send((False, TypeError(str(error))))


def _watch(parent: Any, folder: str) -> None:
    """End when whoever started this process is gone, however that ended."""
    parent.join()
    if folder:
        shutil.rmtree(folder, ignore_errors=True)
    os._exit(1)
