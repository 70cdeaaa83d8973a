"""`Pool`: an executor with processes on this machine. If a process dies, only its own task fails.

Each process has its own pipe and thread. In `concurrent.futures`, processes share a queue: one that dies breaks all of them,
and it is not known which file was the cause.

Processes are spawned, not forked: a fork would copy locks and buffers in any state, and the ends of the other processes' pipes.
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

from dissect.files.jobs.tasks import FileError
from dissect.meaning.report import words

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
        """Call a function in the process; return its result or raise its exception. BrokenExecutor if the process dies."""
        try:
            self._pipe.send((fn, arguments))
            well, result = self._pipe.recv()
        except (EOFError, OSError):
            raise BrokenExecutor("the process ended") from None
        if well:
            return result
        raise result

    def end(self) -> None:
        """Kill the process. A thread that is in `call` then returns."""
        self._process.kill()
        self._process.join()

    def close(self) -> None:
        """Close the pipe."""
        self._pipe.close()


class Pool(Executor):
    """``count`` processes, each with one task at a time; further tasks wait.

    The future of a task whose process died raises `concurrent.futures.BrokenExecutor`; a new process is started. If that fails,
    the others continue; if none is left, each task raises `dissect.files.jobs.tasks.FileError`. ``tell`` is called with a
    message, in a thread of the pool.

    The processes remove ``folder`` if the process that started them was killed. ``collects`` are thresholds for their garbage
    collector (`gc.set_threshold`), empty for Python's defaults.
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
        """Give a task to the next free process."""
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
        """Run the tasks of a process; the main function of its thread."""
        while (task := self._tasks.get()) is not None:
            future, fn, arguments = task
            if not future.set_running_or_notify_cancel():
                continue
            try:
                result = self._processes[at].call(fn, arguments)
            except BrokenExecutor as error:
                future.set_exception(error)  # first, so that the caller need not wait for a new process
                if not self._replace(at):
                    return
            except Exception as error:  # noqa: BLE001 - as every executor hands it on
                future.set_exception(error)
            else:
                future.set_result(result)
        self._processes[at].close()

    def _replace(self, at: int) -> bool:
        """Replace a process that died; return whether that was possible."""
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
        """Fail the waiting tasks, as no process is left; the caller holds ``_change``."""
        try:
            while (task := self._tasks.get_nowait()) is not None:
                if task[0].set_running_or_notify_cancel():
                    task[0].set_exception(FileError(self._why))
        except queue.Empty:
            pass

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Kill all processes; their current tasks are lost, and waiting tasks are not run."""
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
    """A context in which new processes start with SIGINT ignored: Ctrl-C reaches every process of a terminal."""
    if threading.current_thread() is not threading.main_thread():
        yield  # only the main thread may set signal handlers; the new process does it itself a moment later
        return
    handler = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, handler)


# ---- in the process -----------------------------------------------------------------------------------------------------


def _serve(pipe: Any, folder: str, collects: tuple[int, ...]) -> None:
    """Run one task after another; the main function of a process of a pool."""
    # These signals may reach all processes; the process that started them handles them.
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
    """End this process when the one that started it is gone."""
    parent.join()
    if folder:
        shutil.rmtree(folder, ignore_errors=True)
    os._exit(1)
