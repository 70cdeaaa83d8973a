"""Reads independent files, one task for each, with any executor; results come in the order of the files.

A task whose process died is tried once more and then abandoned; an error of the task itself counts at once. Nothing else is
done twice, and nothing is left out: every file has a result or the reason why there is none.

The interface between the callers and the executors of tasks (processes of this machine, workers of a cluster):

* An executor is one of `concurrent.futures`. The function and its arguments can be pickled and contain nothing of the calling
  process. The last two arguments are the position of the file among all, from 0, and its name.
* A result can be pickled, is complete in itself, and is limited in size for files of any size; ``about`` names the file.
* Rows are not bounded. One argument of a task (`dissect.cli.task.work`) is a folder that both sides can reach: rows are written
  to a file in it, and the result names that file (`dissect.files.jobs.spool.Spooled`); the recipient removes it. Without such a
  folder the argument is empty, and the rows are in the result, compressed and bounded, so large ones are refused.
* An export to Parquet is divided: its tasks write their files to a subfolder each of that folder, which is then the target of
  the export. The files are moved into place when the result is taken, so a task that died leaves nothing behind.
* Numbers that count over all files are marked in rows (`dissect.files.jobs.numbers`), and replaced when the result is taken.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, wait
from typing import Any, Final, NamedTuple

#: Seconds between checks for a request to stop.
_LOOK_S: Final = 0.2
#: Number of results per process that may wait for an earlier one.
_AHEAD: Final = 4
#: The message for a task whose process died.
DIED: Final = "the process that read it ended: it was killed, or there was no memory left"


class About(NamedTuple):
    """A file that was read: ``loss`` describes damage; ``first_ns`` and ``last_ns`` are 0 if it has no packets."""

    name: str
    loss: str
    octets: int
    first_ns: int = 0
    last_ns: int = 0


class Done(NamedTuple):
    """The task of ``file`` has ended: with ``result``, or with the reason ``why`` and the machine ``where`` ("" for this one).

    ``tries`` is the number of attempts.
    """

    file: str
    result: Any
    why: str = ""
    tries: int = 1
    where: str = ""


class FileError(Exception):
    """An error of a task, as text for people, and the machine ``where`` it occurred, "" for this one."""

    def __init__(self, why: str, where: str = "") -> None:
        super().__init__(why)
        self.where = where


class Files:
    """Runs ``work(*arguments, place, file)`` for each of ``files``, ``at_once()`` at a time.

    ``queued`` more tasks may wait in the executor, so that no process is idle while a result is taken. ``lost`` are the
    exceptions of an executor for a process that died; ``retried`` is called with each file that is tried again, and the machine
    of the process that died.
    """

    def __init__(
        self,
        executor: Executor,
        at_once: Callable[[], int],
        work: Callable[..., Any],
        arguments: Sequence[Any],
        lost: tuple[type[BaseException], ...] = (BrokenExecutor,),
        retried: Callable[[str, str], None] = lambda *_: None,
        queued: int = 0,
    ) -> None:
        self._executor = executor
        self._at_once = at_once
        self._work = work
        self._arguments = arguments
        self._lost = lost
        self._retried = retried
        self._queued = queued

    def run(self, files: Sequence[str], stop: Callable[[], bool]) -> Iterator[Done]:
        """Yield the outcome of each file, in order; end early once ``stop`` returns True."""
        running: dict[Future[Any], int] = {}
        done: dict[int, Done] = {}
        tries = [0] * len(files)
        following = shown = 0
        again: list[int] = []
        try:
            while shown < len(files):
                if shown not in done and stop():
                    return
                at_once = self._at_once()
                while len(running) < at_once + self._queued and (
                    again or (following < len(files) and following < shown + at_once * _AHEAD)
                ):
                    if again:
                        at = again.pop()
                    else:
                        at, following = following, following + 1
                    tries[at] += 1
                    running[self._executor.submit(self._work, *self._arguments, at, files[at])] = at
                finished, _ = wait(running, 0 if shown in done else _LOOK_S, FIRST_COMPLETED)
                for future in finished:
                    at = running.pop(future)
                    outcome = self._outcome(future, files[at], tries[at])
                    if outcome is None:
                        again.append(at)
                    else:
                        done[at] = outcome
                # one file is enough, so that no process waits for a task while several results are taken
                if shown in done:
                    yield done.pop(shown)
                    shown += 1
        finally:
            for future in running:
                future.cancel()

    def _outcome(self, future: Future[Any], file: str, tries: int) -> Done | None:
        """Return the outcome of a task, None if it is to be tried again."""
        try:
            return Done(file, future.result(), tries=tries)
        except self._lost as error:
            where = str(getattr(error, "where", ""))
            if tries > 1:
                return Done(file, None, f"{DIED}; so did the one that read it again", tries, where)
            self._retried(file, where)
            return None
        except FileError as error:
            return Done(file, None, str(error), tries, error.where)
