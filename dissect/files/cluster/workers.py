"""The workers of a cluster: their addresses, their software, and why a worker cannot be used."""

from __future__ import annotations

import inspect
import threading
from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any, Final, NamedTuple

from dissect.files.cluster import probe
from dissect.files.cluster.connect import ClusterError, Patience, brief
from dissect.packets.source.remote import bounded

#: The distributions of those extras of this package that reading captures or writing results may need.
EXTRAS: Final[Mapping[str, Sequence[str]]] = {
    "data": ("duckdb", "pyarrow"),
    "eds": ("canopen", "defusedxml"),
    "remote": ("aiohttp", "fsspec", "s3fs", "sshfs"),
    "s7plus": ("s7commplus", "defusedxml"),
    "scd": ("anycrc", "numpy"),
    "tags": ("python-calamine", "defusedxml"),
    "tls": ("cryptography",),
    "zstd": ("zstandard",),
}
#: Extras without which results differ silently: if they are installed here, workers must have them, too.
_SILENT: Final = ("tls",)

#: The expression that workers evaluate: it runs the source of `dissect.files.cluster.probe`, then calls its function.
_EXPRESSION: Final = "(exec(source, globals()), facts(extras))[1]"


class Machine(NamedTuple):
    """The result of `dissect.files.cluster.probe.facts`: this package (``version`` "" if it cannot be used), and the rest."""

    host: str
    process: int
    python: str
    version: str
    compiled: bool
    problem: str
    extras: list[str]
    dask: str = ""


class Worker(NamedTuple):
    """A worker: the scheduler's data about it, and its ``machine``; if it did not answer, None, and ``silence`` says why.

    ``memory`` is its limit in bytes, 0 for none. ``running`` is the number of its present tasks.
    """

    address: str
    name: str
    threads: int
    memory: int
    dask: str
    machine: Machine | None
    silence: str

    @property
    def label(self) -> str:
        """The name of the worker for users."""
        host = f" on {self.machine.host}" if self.machine is not None and self.machine.host else ""
        return f"worker {self.address}{host}" if self.name in {"", self.address} else f"worker {self.name}{host}"


@cache
def here() -> Machine:
    """Return the facts on this machine."""
    return Machine(**probe.facts(EXTRAS))


def workers_of(client: Any, patience: Patience, addresses: Sequence[str] | None = None) -> list[Worker]:
    """Return the workers of a cluster, or those at ``addresses``, sorted by name. All are asked at once, within ``patience``.

    Raises `ClusterError` if the scheduler does not answer in that time.
    """
    try:
        info = bounded(lambda: client.scheduler_info(n_workers=-1), patience.left)
    except TimeoutError:
        raise ClusterError(f"the scheduler did not list its workers within {patience.whole} seconds") from None
    known: Mapping[str, Any] = info["workers"]
    asked = [address for address in known if addresses is None or address in addresses]
    answers: dict[str, Any] = {}
    threads = [threading.Thread(target=_ask, args=(client, address, answers), daemon=True) for address in asked]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(patience.left)
    silence = f"does not answer within {patience.whole} seconds"
    found = [_worker(address, known[address], answers.get(address), silence) for address in asked]
    return sorted(found, key=lambda worker: (worker.name, worker.address))


def _ask(client: Any, address: str, answers: dict[str, Any]) -> None:
    names = {"source": inspect.getsource(probe), "extras": {name: list(needed) for name, needed in EXTRAS.items()}}
    try:
        answers[address] = client.run(eval, _EXPRESSION, names, workers=[address])[address]
    except Exception as error:  # noqa: BLE001 - it is said of this worker
        answers[address] = error


def _worker(address: str, info: Mapping[str, Any], answer: object, silence: str) -> Worker:
    machine = None
    if isinstance(answer, dict):
        machine, silence = Machine(**answer), ""
    elif isinstance(answer, BaseException):
        silence = f"cannot be asked: {brief(answer)}"
    return Worker(
        address,
        str(info.get("name", "")),
        max(1, int(info.get("nthreads") or 1)),
        int(info.get("memory_limit") or 0),
        machine.dask if machine is not None else "",
        machine,
        silence,
    )


def obstacle(worker: Worker, ours: Machine) -> str:
    """Return why a worker cannot be used by ``ours`` (no results, or different ones); "" if it can."""
    theirs = worker.machine
    if theirs is None:
        return worker.silence
    if not theirs.version:
        return f"does not have s7dissect: {theirs.problem}; pip install s7dissect=={ours.version}"
    if theirs.version != ours.version:
        return f"has s7dissect {theirs.version}, here is {ours.version}; pip install s7dissect=={ours.version}"
    missing = [name for name in _SILENT if name in ours.extras and name not in theirs.extras]
    if missing:
        return f"has no extra {missing[0]}, which is installed here; pip install 's7dissect[{missing[0]}]'"
    return ""


def lacks(worker: Worker, ours: Machine) -> list[str]:
    """Return the extras that are installed here but not on a worker; tasks that need one fail there with a message."""
    return [name for name in ours.extras if worker.machine is not None and name not in worker.machine.extras]
