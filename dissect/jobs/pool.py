"""Processes of this machine as an executor: what one of them dies of is the failure of its own task, and of no other.

Each process is an executor by itself (`concurrent.futures.ProcessPoolExecutor` of one, by spawn). In one of several, a process
that dies breaks all of them, and nobody can say at which file.
"""

from __future__ import annotations

import gc
import multiprocessing
import os
import shutil
import signal
import threading
from collections.abc import Callable
from concurrent.futures import BrokenExecutor, Executor, Future, ProcessPoolExecutor
from typing import Any, Final, TypeVar

#: Seconds that a process may take to end once it was told to.
_END_S: Final = 5.0

T = TypeVar("T")


class _Slot:
    """One process, and the executor it belongs to."""

    def __init__(self, folder: str, collects: tuple[int, ...]) -> None:
        self.executor = ProcessPoolExecutor(1, multiprocessing.get_context("spawn"), _begin, (folder, collects))
        self.process: Any = None

    def submit(self, fn: Callable[..., T], *arguments: Any) -> Future[T]:
        if self.process is not None:
            return self.executor.submit(fn, *arguments)
        # The first task starts the process. Ctrl-C reaches every process of a terminal; what to do then is decided here.
        before = {child.pid for child in multiprocessing.active_children()}
        main = threading.current_thread() is threading.main_thread()
        handler = signal.signal(signal.SIGINT, signal.SIG_IGN) if main else None
        try:
            future = self.executor.submit(fn, *arguments)
        finally:
            if main:
                signal.signal(signal.SIGINT, handler)
        self.process = next((child for child in multiprocessing.active_children() if child.pid not in before), None)
        return future

    def end(self) -> None:
        if self.process is not None and self.process.is_alive():
            self.process.terminate()
            self.process.join(_END_S)
            if self.process.is_alive():
                self.process.kill()
        self.executor.shutdown(wait=True, cancel_futures=True)


class Pool(Executor):
    """``count`` processes with a task each; a task for which there is none is refused.

    The future of a task whose process died raises `concurrent.futures.BrokenExecutor`; another process takes its place.
    ``folder`` is one that the processes remove when whoever started them was killed and cannot. ``collects`` are the
    thresholds of their collector (`gc.set_threshold`), empty for Python's own.
    """

    def __init__(self, count: int, folder: str = "", collects: tuple[int, ...] = ()) -> None:
        self._count = count
        self._folder = folder
        self._collects = collects
        self._free: list[_Slot] = []
        self._busy: set[_Slot] = set()

    def submit(self, fn: Callable[..., T], /, *args: Any, **kwargs: Any) -> Future[T]:
        """Start a task. RuntimeError when all processes have one."""
        if kwargs:
            raise TypeError("tasks take no keyword arguments")
        if len(self._busy) >= self._count:
            raise RuntimeError(f"all {self._count} processes are busy")
        slot = self._free.pop() if self._free else _Slot(self._folder, self._collects)
        self._busy.add(slot)
        future = slot.submit(fn, *args)
        future.add_done_callback(lambda done: self._done(slot, done))
        return future

    def _done(self, slot: _Slot, future: Future[T]) -> None:
        self._busy.discard(slot)
        if not future.cancelled() and not isinstance(future.exception(), BrokenExecutor):
            self._free.append(slot)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End all processes; what they were doing is lost."""
        for slot in (*self._busy, *self._free):
            slot.end()
        self._busy.clear()
        self._free.clear()


def _begin(folder: str, collects: tuple[int, ...]) -> None:
    """Begin as a process of a pool: Ctrl-C is not for it, and it ends when whoever started it is gone, however that ended."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if collects:
        gc.set_threshold(*collects)
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_watch, args=(parent, folder), daemon=True).start()


def _watch(parent: Any, folder: str) -> None:
    parent.join()
    if folder:
        shutil.rmtree(folder, ignore_errors=True)
    os._exit(1)
