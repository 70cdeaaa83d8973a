"""A Dask cluster for tests: a scheduler and workers as their programs start them, on free ports of loopback, ended by their ids."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from tests.source.servers import LOOPBACK, free_port, running

#: Seconds until a cluster that does not come up fails the test.
_PATIENCE_S: Final = 120


class Cluster:
    """A scheduler at ``address``, and workers by name."""

    def __init__(self, folder: Path, address: str) -> None:
        self.folder = folder
        self.address = address
        self.workers: dict[str, subprocess.Popen[bytes]] = {}

    def start(self, *names: str, **environment: str) -> None:
        """Start workers, one thread each, and wait until the scheduler knows them."""
        for name in names:
            work = self.folder / name
            work.mkdir(exist_ok=True)
            # Without a nanny: whoever kills the worker wants it to stay away. In its own folder: paths that are not shared show.
            options = ["--nthreads", "1", "--no-nanny", "--no-dashboard", "--host", LOOPBACK, "--name", name]
            self.workers[name] = _begun(
                [*_dask("worker"), self.address, *options, "--local-directory", os.fspath(work)], work, environment
            )
        for name in names:
            self._await(name)

    def _await(self, name: str) -> None:
        log = self.folder / name / "log"
        deadline = time.monotonic() + _PATIENCE_S
        while "Registered to:" not in log.read_text(errors="replace"):
            assert self.workers[name].poll() is None, log.read_text(errors="replace")
            assert time.monotonic() < deadline, log.read_text(errors="replace")
            time.sleep(0.05)

    def end(self, name: str, kill: bool = False) -> None:
        """End a worker and wait for it; ``kill`` gives it no chance to say so."""
        process = self.workers.pop(name)
        process.kill() if kill else process.terminate()
        process.wait(_PATIENCE_S)


@contextmanager
def cluster(folder: Path) -> Iterator[Cluster]:
    """Run a scheduler until the block is over, and end the workers that were started then."""
    port = free_port()
    command = [*_dask("scheduler"), "--host", LOOPBACK, "--port", str(port), "--no-dashboard", "--no-show"]
    with running(command, port, folder / "scheduler.log"):
        made = Cluster(folder, f"tcp://{LOOPBACK}:{port}")
        try:
            yield made
        finally:
            for process in made.workers.values():
                process.terminate()
            for process in made.workers.values():
                process.wait(_PATIENCE_S)


def _dask(what: str) -> list[str]:
    return [sys.executable, "-m", "dask", what]


def _begun(command: list[str], folder: Path, environment: Mapping[str, str]) -> subprocess.Popen[bytes]:
    with (folder / "log").open("wb") as said:
        return subprocess.Popen(
            command,
            cwd=folder,
            stdin=subprocess.DEVNULL,
            stdout=said,
            stderr=said,
            env={**os.environ, **environment},
        )
