"""Tasks of any executor: results in the order of the files, one more try where a process died, and nothing left out."""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Callable
from concurrent.futures import BrokenExecutor, Executor, Future
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from dissect.files.jobs.tasks import DIED, Done, FileError, Files

FILES = [f"{number}.pcap" for number in range(40)]


class Shuffled(Executor):
    """Has tasks done in any order: some at once, the others when a later one is begun; with each fourth, and ``last``, all."""

    def __init__(self, seed: int, last: str) -> None:
        self._last = last
        self._chance = random.Random(seed)
        self._waiting: list[tuple[Future[Any], Callable[[], Any]]] = []
        self.begun: Counter[str] = Counter()
        self.most = 0

    def submit(self, fn: Callable[..., Any], /, *args: Any, **_kwargs: Any) -> Future[Any]:
        """Take a task, and do those that have their turn."""
        future: Future[Any] = Future()
        self.begun[args[-1]] += 1
        self._waiting.append((future, lambda: fn(*args)))
        self.most = max(self.most, len(self._waiting))
        self._chance.shuffle(self._waiting)
        over = self._last in self.begun or len(self.begun) % 4 == 0
        while len(self._waiting) > 3 or (self._waiting and (over or self._chance.random() < 0.5)):
            done, task = self._waiting.pop()
            try:
                done.set_result(task())
            except BaseException as error:  # noqa: BLE001 - as an executor hands it on
                done.set_exception(error)
        return future


def lines(folder: str, place: int, file: str) -> str:
    """Be a task."""
    if file in {"7.pcap", "30.pcap"}:
        raise FileError(f"{file}: not a capture")
    assert FILES[place] == file
    return f"{folder}/{file}"


@given(st.integers(0, 2**32))
def test_results_come_in_order_whoever_is_first(seed: int) -> None:
    executor = Shuffled(seed, FILES[-1])
    done = list(Files(executor, lambda: 5, lines, ("a",)).run(FILES, lambda: False))
    assert [one.file for one in done] == FILES
    assert [one.result for one in done if not one.why] == [
        f"a/{file}" for file in FILES if file not in {"7.pcap", "30.pcap"}
    ]
    assert [one.why for one in done if one.why] == ["7.pcap: not a capture", "30.pcap: not a capture"]
    assert set(executor.begun.values()) == {1}, "nothing is read twice"
    assert executor.most <= 5, "no more at once than are wanted"


class Late(Executor):
    """Does the tasks it has when it has three, and all that there are with the last file."""

    def __init__(self) -> None:
        self._waiting: list[tuple[Future[Any], Callable[[], Any]]] = []

    def submit(self, fn: Callable[..., Any], /, *args: Any, **_kwargs: Any) -> Future[Any]:
        """Take a task."""
        future: Future[Any] = Future()
        self._waiting.append((future, lambda: fn(*args)))
        if len(self._waiting) == 3 or args[-1] == FILES[19]:
            for done, task in self._waiting:
                done.set_result(task())
            self._waiting = []
        return future


def test_tasks_wait_in_the_executor() -> None:
    """One at once, and two more, or this would have no end."""
    done = list(Files(Late(), lambda: 1, lambda _, file: file, (), queued=2).run(FILES[:20], lambda: False))
    assert [one.result for one in done] == FILES[:20]


class Here(Executor):
    """Does each task at once."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **_kwargs: Any) -> Future[Any]:
        """Do it."""
        future: Future[Any] = Future()
        try:
            future.set_result(fn(*args))
        except Exception as error:  # noqa: BLE001
            future.set_exception(error)
        return future


class Dying:
    """A task whose process dies at some files: once, or each time."""

    def __init__(self, once: set[str], always: set[str]) -> None:
        self._once = once
        self._always = always

    def __call__(self, _place: int, file: str) -> str:
        if file in self._always or file in self._once:
            self._once.discard(file)
            raise BrokenExecutor("a process ended")
        return file.upper()


def test_what_died_is_read_once_more_and_then_named() -> None:
    said: list[str] = []
    work = Dying({"2.pcap", "3.pcap"}, {"5.pcap"})
    done = list(
        Files(Here(), lambda: 2, work, (), retried=lambda file, _: said.append(file)).run(FILES[:8], lambda: False)
    )
    assert sorted(said) == ["2.pcap", "3.pcap", "5.pcap"]
    assert [one for one in done if one.why] == [Done("5.pcap", None, f"{DIED}; so did the one that read it again", 2)]
    assert [one.result for one in done if not one.why] == [file.upper() for file in FILES[:8] if file != "5.pcap"]
    assert {one.file for one in done if one.tries == 2} == {"2.pcap", "3.pcap", "5.pcap"}


def test_who_stops_has_what_is_done() -> None:
    done: list[Done] = []
    done.extend(Files(Here(), lambda: 1, lines, ("a",)).run(FILES, lambda: len(done) >= 3))
    assert [one.file for one in done] == FILES[:3]
