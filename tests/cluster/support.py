"""A Dask cluster for tests: a scheduler and workers, started by their own programs on free ports of loopback, ended by id."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from tests.source.servers import LOOPBACK, free_port, running

#: Seconds until a cluster that does not come up fails the test.
_PATIENCE_S: Final = 120


class Cluster:
    """A scheduler at ``address``, and workers by name."""

    def __init__(self, folder: Path, address: str, scheduler: subprocess.Popen[bytes]) -> None:
        self.folder = folder
        self.address = address
        self.scheduler = scheduler
        self.workers: dict[str, subprocess.Popen[bytes]] = {}

    def begin(self, name: str, **environment: str) -> None:
        """Start a worker with one thread."""
        work = self.folder / name
        work.mkdir(exist_ok=True)
        # Without a nanny, which would start a worker that was killed anew.
        options = ["--nthreads", "1", "--no-nanny", "--no-dashboard", "--host", LOOPBACK, "--name", name]
        command = [*_dask("worker"), self.address, *options, "--local-directory", os.fspath(work)]
        with (work / "log").open("wb") as said:
            self.workers[name] = subprocess.Popen(
                command,
                cwd=work,
                stdin=subprocess.DEVNULL,
                stdout=said,
                stderr=said,
                env={**os.environ, **environment},
            )

    def wait(self, *names: str) -> None:
        """Wait until the scheduler knows workers."""
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
    with running(command, port, folder / "scheduler.log") as scheduler:
        made = Cluster(folder, f"tcp://{LOOPBACK}:{port}", scheduler)
        try:
            yield made
        finally:
            for process in made.workers.values():
                process.terminate()
            for process in made.workers.values():
                process.wait(_PATIENCE_S)


def _dask(what: str) -> list[str]:
    return [sys.executable, "-m", "dask", what]
