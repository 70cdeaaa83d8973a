"""`Cluster`: an executor for tasks on the workers of a Dask cluster. It assigns each task to one worker itself.

When a worker dies, only its own tasks fail: their futures raise `WorkerLost`, and the caller decides whether to retry. A file
that one worker cannot read is given to a second worker before the task fails. A worker that cannot read files that others can
read gets no further tasks.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import BrokenExecutor, Executor, Future
from functools import partial
from pathlib import Path
from typing import Any, Final
from uuid import uuid4

from dissect.files.cluster.connect import ANSWER_S, Patience, brief
from dissect.files.cluster.onworker import ANSWERED, answer
from dissect.files.cluster.reader import DEFECT, FOUND, Order
from dissect.files.cluster.workers import Machine, Worker, obstacle, workers_of
from dissect.files.jobs.tasks import FileError
from dissect.packets.source.remote import bounded, is_remote, shown

#: After this many files in a row that a worker cannot read, but others can, it gets no further tasks.
_BLIND: Final = 3
#: The scheduler is asked every this many seconds whether it is still running.
_ASK_S: Final = 5
#: After this many seconds without an answer, the scheduler counts as gone. That is longer than at the start, because it may be
#: busy.
SILENCE_S: Final = 30


class WorkerLost(BrokenExecutor):
    """A worker, or its process, ended during a task; ``where`` says which one."""

    def __init__(self, where: str) -> None:
        super().__init__(where)
        self.where = where


def _received(sent: bytes) -> Any:
    """Return the result that a process on a worker sent, unpickled in the same way as Dask does with all results."""
    from distributed.protocol.pickle import loads

    return loads(sent)


class _Task:
    def __init__(self, future: Future[Any], order: Order, file: str) -> None:
        self.future = future
        self.order = order
        self.file = file
        self.begun: Any = None  # the future of Dask
        self.refused: dict[str, FileError] = {}  # by address of the worker that could not read the file

    def settle(self, result: Any, error: BaseException | None = None) -> None:
        """Set the result or the error of the future, unless it was cancelled."""
        self.begun = None
        if self.future.cancelled() or not (self.future.running() or self.future.set_running_or_notify_cancel()):
            return
        if error is not None:
            self.future.set_exception(error)
        else:
            self.future.set_result(result)


class _Hand:
    """A usable worker, and its present tasks."""

    def __init__(self, worker: Worker) -> None:
        self.worker = worker
        self.tasks: list[_Task] = []
        self.failures = 0
        #: Whether the worker gets no further tasks.
        self.retired = False


class Cluster(Executor):
    """The usable ``workers`` of the cluster that ``client`` (a `distributed.Client`) is connected to.

    The last argument of a task is its file. A task runs in the folder of this process, if the worker has that folder; ``files``
    are further files that tasks read, with their digests, by name. ``say`` is called with messages on workers, each with the
    file that it concerns, None for none.
    """

    def __init__(
        self,
        client: Any,
        workers: Sequence[Worker],
        ours: Machine,
        files: Mapping[str, str],
        say: Callable[[str | None, str], None],
    ) -> None:
        self._client = client
        self._ours = ours
        self._files = files
        self._say = say
        self._lock = threading.RLock()
        self._hands = {worker.address: _Hand(worker) for worker in workers}
        self._waiting: list[_Task] = []
        self._joining: set[str] = set()
        self._alone_since = 0.0
        self._deserted = False
        self._gone = ""
        self._heard = time.monotonic()
        self._ask_at = self._heard + _ASK_S
        self._closed = False
        #: Whether a worker that should have been used could not be used.
        self.troubled = False
        client.subscribe_topic("all", self._event)

    @property
    def slots(self) -> int:
        """Number of tasks that the workers can run at once; 1 without workers, so that one task waits for workers to come."""
        with self._lock:
            return max(1, sum([hand.worker.threads for hand in self._able()]))

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Take a task; it begins when a worker has a thread for it."""
        if kwargs:
            raise TypeError("tasks take no keyword arguments")
        file = str(args[-1])
        order = Order(str(Path.cwd()), not (is_remote(file) or Path(file).is_absolute()), self._files, fn, args)
        task = _Task(Future(), order, file)
        with self._lock:
            if self._gone:
                task.settle(None, FileError(self._gone))
            elif self._deserted:
                task.settle(None, self._nobody())
            else:
                self._waiting.append(task)
                self._assign()
        return task.future

    def look(self) -> None:
        """Check the cluster: fail all tasks if the scheduler is silent or no worker is left; use workers that joined.

        Call it regularly while waiting for results.
        """
        if time.monotonic() > self._ask_at:
            self._ask_at = float("inf")  # do not ask again before the answer
            threading.Thread(target=self._ask, daemon=True).start()
        with self._lock:
            joining, self._joining = self._joining, set()
        if joining:
            threading.Thread(target=self._take_in, args=(sorted(joining),), daemon=True).start()
        with self._lock:
            if self._able() or not self._waiting:
                self._alone_since = 0.0
            elif not self._alone_since:
                self._alone_since = time.monotonic()
            elif time.monotonic() - self._alone_since > ANSWER_S:
                self._deserted = True
                for task in self._take_waiting():
                    task.settle(None, self._nobody())

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Begin no further tasks; workers finish the files that they are reading, but the results are dropped."""
        with self._lock:
            self._closed = True
            self._waiting.clear()
            for hand in self._hands.values():
                hand.tasks.clear()

    # ---- giving tasks --------------------------------------------------------------------------------------------------

    def _assign(self) -> None:
        for task in list(self._waiting):
            free = [hand for hand in self._able() if len(hand.tasks) < hand.worker.threads]
            if not free:
                return
            able = [hand for hand in free if hand.worker.address not in task.refused]
            if able:
                self._waiting.remove(task)
                self._begin(task, max(able, key=lambda hand: hand.worker.threads - len(hand.tasks)))
            elif not self._others(task):
                self._waiting.remove(task)
                self._give_up(task)

    def _able(self) -> list[_Hand]:
        return [hand for hand in self._hands.values() if not hand.retired]

    def _others(self, task: _Task) -> bool:
        """Return whether there is a worker that has not tried a task."""
        return any([hand.worker.address not in task.refused for hand in self._able()])

    def _begin(self, task: _Task, hand: _Hand) -> None:
        hand.tasks.append(task)
        begun = task.begun = self._client.submit(
            answer,
            task.order,
            key=f"s7dissect-{uuid4().hex}",
            workers=[hand.worker.address],
            allow_other_workers=False,
            pure=False,
        )
        begun.add_done_callback(partial(self._over, task, hand))

    def _nobody(self) -> FileError:
        return FileError(f"the cluster has no worker left ({self._address()})")

    def _take_waiting(self) -> list[_Task]:
        waiting, self._waiting = self._waiting, []
        return waiting

    # ---- what becomes of them: called by threads of Dask ---------------------------------------------------------------

    def _over(self, task: _Task, hand: _Hand, begun: Any) -> None:
        error: BaseException | None = None
        how, written = "", b""
        if task.begun is begun:
            try:
                how, written = begun.result()
            except BaseException as raised:  # noqa: BLE001 - of any kind; it is looked at below
                error = raised
        with self._lock:
            if task.begun is not begun or self._closed:
                return
            task.begun = None
            if task in hand.tasks:
                hand.tasks.remove(task)
            if begun.status == "cancelled":
                self._give_all_up(f"the connection to the scheduler {self._address()} was lost", task)
            elif error is not None:
                task.settle(None, FileError(brief(error), hand.worker.label))
            elif how == ANSWERED:
                self._answered(task, hand, *_received(written))
            else:
                task.settle(None, WorkerLost(hand.worker.label))
            self._assign()

    def _answered(self, task: _Task, hand: _Hand, kind: str, result: Any) -> None:
        label = hand.worker.label
        if kind == FOUND:
            hand.failures = 0
            for address, error in task.refused.items():
                self._blame(address, task.file, error)
            task.settle(result)
        elif kind == DEFECT:
            task.settle(None, RuntimeError(f"{label}: {result}"))
        else:
            task.refused[hand.worker.address] = FileError(str(result), label)
            if len(task.refused) == 1 and self._others(task):
                self._waiting.insert(0, task)
            else:
                self._give_up(task)

    def _give_up(self, task: _Task) -> None:
        task.settle(None, next(iter(task.refused.values())))

    def _blame(self, address: str, file: str, error: FileError) -> None:
        """Note that a worker could not read a file that a different one could."""
        self.troubled = True
        self._say(file, f"{error}; another worker read it ({error.where})")
        hand = self._hands.get(address)
        if hand is None:
            return
        hand.failures += 1
        if hand.failures >= _BLIND and not hand.retired and len(self._able()) > 1:
            hand.retired = True
            self._say(None, f"{hand.worker.label}: gets no more files, because others can read what it cannot")

    def _give_all_up(self, why: str, *besides: _Task) -> None:
        """Fail every unfinished task, and those in ``besides``; no further tasks begin."""
        self._gone = why
        left = [*besides, *self._take_waiting()]
        for hand in self._hands.values():
            left += hand.tasks
            hand.tasks.clear()
        for each in left:
            each.settle(None, FileError(self._gone))

    def _address(self) -> str:
        return shown(str(self._client.scheduler.address)) if self._client.scheduler is not None else "of the cluster"

    def _ask(self) -> None:
        """Ask the scheduler whether it still answers. A closed connection is noticed without this."""
        try:
            bounded(lambda: self._client.sync(self._client.scheduler.identity), SILENCE_S)
            heard = True
        except Exception:  # noqa: BLE001 - what an answer is not: no time, or an error of the transport
            heard = False
        now = time.monotonic()
        with self._lock:
            if heard:
                self._heard = now
            elif now - self._heard > SILENCE_S and not (self._closed or self._gone):
                self._give_all_up(f"the scheduler {self._address()} has not answered for {SILENCE_S} seconds")
            self._ask_at = now + _ASK_S

    # ---- who comes and goes --------------------------------------------------------------------------------------------

    def _event(self, event: tuple[float, Any]) -> None:
        """Take a message of the scheduler on its workers. Called in the client's event loop, so it must not block."""
        message = event[1] if isinstance(event[1], dict) else {}
        address = str(message.get("worker", ""))
        with self._lock:
            if message.get("action") == "remove-worker":
                self._joining.discard(address)
                hand = self._hands.pop(address, None)
                for task in hand.tasks if hand is not None else ():
                    task.settle(None, WorkerLost(hand.worker.label if hand is not None else address))
            elif message.get("action") == "add-worker":
                self._joining.add(address)

    def _take_in(self, addresses: Sequence[str]) -> None:
        try:
            workers = workers_of(self._client, Patience(), addresses)
        except Exception as error:  # noqa: BLE001 - the cluster went on without them; if all are gone that is said
            self._say(None, f"a worker that joined cannot be asked: {brief(error)}")
            return
        for worker in workers:
            why = obstacle(worker, self._ours)
            with self._lock:
                if self._closed:
                    return
                if not why:
                    self._hands.setdefault(worker.address, _Hand(worker))
                    self._deserted = False
                    self._assign()
                    continue
                self.troubled = True
            self._say(None, f"{worker.label}: {why}")
