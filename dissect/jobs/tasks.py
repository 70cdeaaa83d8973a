"""Files that stand for themselves, a task each, done by any executor; results come in the order of the files.

A task whose process died is done once more, and given up then; what a task itself cannot do is its failure at once. Nothing is
done twice otherwise, and nothing is left out: every file has a result or the reason why there is none.

The seam between those who want tasks done and those who do them (processes of this machine, workers of a cluster):

* An executor is one of `concurrent.futures`. What it gets, the function and its arguments, can be pickled and holds nothing of
  the process that gives it. The last two arguments are the place of the file among all, from 0, and its name.
* A result can be pickled, stands for itself, and is bounded, however large the file is; ``about`` says which file it is of.
* Rows are not bounded. One argument of a task (`dissect.cli.task.work`) is a folder that both sides can reach: rows go to a
  file in it, and the result names that file (`dissect.jobs.spool.Spooled`); whoever takes the result removes it. Where there is
  no such folder the argument is empty, and the rows are in the result, compressed and bounded, so large ones are refused.
* An export to Parquet is divided: its tasks write files of their own into that folder, which is then the one the export goes
  to, in a subfolder for each task. They are moved to their place when the result is taken, so a task that died leaves nothing.
* Numbers that count over all files are marked in rows (`dissect.jobs.numbers`), and replaced when the result is taken.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, wait
from typing import Any, Final, NamedTuple

#: Seconds after which it is looked whether somebody wants to stop.
_LOOK_S: Final = 0.2
#: Results for each process that may wait for one that comes before them.
_AHEAD: Final = 4
#: What is said of a task whose process died.
DIED: Final = "the process that read it ended: it was killed, or there was no memory left"


class About(NamedTuple):
    """A file that was read: ``loss`` is what is wrong with it, ``first_ns`` and ``last_ns`` are 0 where it has no packet."""

    name: str
    loss: str
    octets: int
    first_ns: int = 0
    last_ns: int = 0


class Done(NamedTuple):
    """The task of ``file`` is over: with ``result``, or ``why`` there is none, and ``where`` that was, "" for this machine.

    ``tries`` says how often it was begun.
    """

    file: str
    result: Any
    why: str = ""
    tries: int = 1
    where: str = ""


class FileError(Exception):
    """What a task cannot do, in words for a person, and ``where`` it cannot, "" for this machine."""

    def __init__(self, why: str, where: str = "") -> None:
        super().__init__(why)
        self.where = where


class Files:
    """Does ``work(*arguments, place, file)`` for each of ``files``, ``at_once()`` at a time.

    ``queued`` more tasks may wait in the executor, so that nobody waits for one while a result is taken. ``lost`` are
    exceptions by which an executor says that a process died; ``retried`` is told of a file that is begun again, and where the
    process that died was.
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
        """Yield what became of each file, in their order; ends early once ``stop`` returns True."""
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
                if shown in done:  # one, so that nobody waits for a task while several are taken
                    yield done.pop(shown)
                    shown += 1
        finally:
            for future in running:
                future.cancel()

    def _outcome(self, future: Future[Any], file: str, tries: int) -> Done | None:
        """Return what became of a task, None when it is to be done again."""
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
