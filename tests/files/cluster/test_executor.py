"""The executor with a client that only takes notes: who has which task when workers come and go."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from typing import Any

import pytest

from dissect.files.cluster import executor
from dissect.files.cluster.executor import Cluster, WorkerLost
from dissect.files.cluster.onworker import DIED
from dissect.files.cluster.workers import Machine, Worker
from dissect.files.jobs.tasks import FileError

OURS = Machine("desk", 1, "3.12.1", "2.0", True, "", [])


class Begun:
    """A future of Dask."""

    def __init__(self) -> None:
        self.status = "pending"
        self._result: Any = None
        self._callback: Callable[[Any], None] = lambda _: None

    def add_done_callback(self, callback: Callable[[Any], None]) -> None:
        self._callback = callback

    def result(self) -> Any:
        return self._result

    def end(self, result: Any) -> None:
        """Be done."""
        self.status, self._result = "finished", result
        self._callback(self)


class Client:
    """A client that notes which worker has which file; ``event`` is what it calls when the scheduler says something."""

    def __init__(self) -> None:
        self.begun: list[tuple[str, str, Begun]] = []
        self.event: Callable[[Any], None] = lambda _: None
        self.scheduler = None

    def subscribe_topic(self, topic: str, handler: Callable[[Any], None]) -> None:
        assert topic == "all"
        self.event = handler

    def submit(
        self, _work: Any, order: Any, *, key: str, workers: list[str], allow_other_workers: bool, pure: bool
    ) -> Begun:
        assert (allow_other_workers, pure, key[:10]) == (False, False, "s7dissect-")
        begun = Begun()
        self.begun.append((workers[0], order.arguments[-1], begun))
        return begun


def cluster(client: Client, *threads: int) -> Cluster:
    workers = [
        Worker(f"tcp://w:{number}", f"w{number}", count, 0, "", OURS, "") for number, count in enumerate(threads)
    ]
    return Cluster(client, workers, OURS, {}, lambda _file, _text: None)


def why(future: Future[Any]) -> BaseException | None:
    assert future.done()
    return future.exception()


def test_no_worker_has_more_than_its_threads() -> None:
    client = Client()
    with cluster(client, 2, 1) as made:
        assert made.slots == 3
        futures = [made.submit(len, file) for file in "abcd"]
        assert sorted(worker for worker, _, _ in client.begun) == ["tcp://w:0", "tcp://w:0", "tcp://w:1"]
        worker, file, begun = client.begun[1]
        begun.end((DIED, b"-9"))
        assert isinstance(why(futures["abcd".index(file)]), WorkerLost)
        assert client.begun[3][:2] == (worker, "d")


def test_who_goes_takes_only_its_own_tasks_along(monkeypatch: pytest.MonkeyPatch) -> None:
    client = Client()
    with cluster(client, 1, 1) as made:
        first, second, third = [made.submit(len, file) for file in "abc"]
        client.event((0.0, {"action": "remove-worker", "worker": client.begun[0][0]}))
        assert str(why(first)) == "worker w0 on desk"
        assert not second.done()
        client.begun[0][2].end((DIED, b""))  # what it says after that is nobody's business any more
        client.event((0.0, {"action": "remove-worker", "worker": client.begun[1][0]}))
        assert isinstance(why(second), WorkerLost)
        assert len(client.begun) == 2
        made.look()
        assert not third.done()
        monkeypatch.setattr(executor, "ANSWER_S", -1)
        made.look()
        error = why(third)
        assert isinstance(error, FileError)
        assert str(error).startswith("the cluster has no worker left")
