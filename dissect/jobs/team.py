"""Processes that work side by side, each telling what it does through a pipe of its own.

They are started anew (spawn), not forked, and end by themselves when nobody listens any more: a worker that has something to
say to a parent that was killed cannot, and it says something with each stretch of packets.
"""

from __future__ import annotations

import signal
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from multiprocessing import connection, get_context
from types import TracebackType
from typing import Any, Final, Self

#: Messages of a worker that wait until those of the others have come; it waits itself when there are more.
AHEAD: Final = 8
#: How long to wait before it is looked whether somebody wants to stop.
_LOOK_S: Final = 0.2
#: How long a worker that has closed its pipe may take to end.
_END_S: Final = 5.0


class WorkerError(Exception):
    """A worker ended before its work was done. ``worker`` counts from 1; ``file`` is what it worked on, as far as it said."""

    def __init__(self, worker: int, count: int, file: str, why: str) -> None:
        where = f" at {file}" if file else ""
        super().__init__(f"worker {worker} of {count} ended{where}: {why}")


class Team:
    """``count`` processes that run ``target(channel, *arguments, index, count)``; leaving the block ends them.

    ``target`` sends whatever can be pickled, with an attribute ``file`` where it knows one. It closes the channel at its end.
    """

    def __init__(self, target: Callable[..., None], arguments: Sequence[Any], count: int) -> None:
        self._count = count
        self._files = [""] * count
        context = get_context("spawn")
        self._channels: list[Any] = []
        self._workers: list[Any] = []
        # Ctrl-C reaches every process of a terminal. What to do then is decided here; workers inherit that they ignore it.
        before = signal.signal(signal.SIGINT, signal.SIG_IGN)
        try:
            for index in range(count):
                ours, theirs = context.Pipe(duplex=False)
                worker = context.Process(target=target, args=(theirs, *arguments, index, count), daemon=True)
                worker.start()
                theirs.close()
                self._channels.append(ours)
                self._workers.append(worker)
        finally:
            signal.signal(signal.SIGINT, before)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for worker, channel in zip(self._workers, self._channels, strict=True):
            channel.close()
            worker.terminate()
        for worker in self._workers:
            worker.join(_END_S)
            if worker.is_alive():
                worker.kill()
                worker.join()

    def rounds(self, stop: Callable[[], bool]) -> Iterator[list[Any]]:
        """Yield the first message of each worker, then the second of each, until all have closed their pipes.

        Ends early once ``stop`` returns True. Raises `WorkerError` when a worker says less than another one.
        """
        said: list[deque[Any]] = [deque() for _ in self._channels]
        open_ = set(range(self._count))
        while not stop():
            while all(said):
                yield [messages.popleft() for messages in said]
                if stop():
                    return
            for index in set(range(self._count)) - open_:
                if not said[index] and (any(said) or self._failed(index)):
                    raise WorkerError(index + 1, self._count, self._files[index], self._why(index))
            if not open_:
                return
            wanted = {self._channels[index]: index for index in open_ if len(said[index]) < AHEAD}
            for channel in connection.wait(list(wanted), _LOOK_S):
                index = wanted[channel]
                try:
                    message = self._channels[index].recv()
                except (EOFError, ConnectionError):
                    open_.discard(index)
                else:
                    self._files[index] = getattr(message, "file", self._files[index])
                    said[index].append(message)

    def _failed(self, index: int) -> bool:
        self._workers[index].join(_END_S)
        return bool(self._workers[index].exitcode != 0)

    def _why(self, index: int) -> str:
        self._failed(index)
        code = self._workers[index].exitcode
        if code is None:
            return "it closed its pipe"
        if code < 0:
            try:
                return f"killed by {signal.Signals(-code).name}"
            except ValueError:
                return f"killed by signal {-code}"
        return f"exit code {code}"
