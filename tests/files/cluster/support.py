"""A Dask cluster for tests: a scheduler and workers, started by their own programs on free ports of loopback, ended by id."""

from __future__ import annotations

import os
import select
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from tests.packets.source.servers import LOOPBACK, free_port, running

#: Work that programs of Dask do in the background, many times a second: sample their own stacks, check whether their loop is
#: late, and measure the machine. It is not needed here, and takes most of their time.
QUIET: Final = {
    "DASK_DISTRIBUTED__WORKER__PROFILE__ENABLED": "False",
    "DASK_DISTRIBUTED__ADMIN__TICK__INTERVAL": "5s",
    "DASK_DISTRIBUTED__ADMIN__SYSTEM_MONITOR__INTERVAL": "30s",
}
#: Seconds that a test waits for an event, and for the start of a cluster.
PATIENCE_S: Final = 120


class Cluster:
    """A scheduler at ``address``, and workers by name; all of them have ``environment``."""

    def __init__(
        self, folder: Path, address: str, scheduler: subprocess.Popen[bytes], environment: Mapping[str, str]
    ) -> None:
        self.folder = folder
        self.address = address
        self.scheduler = scheduler
        self.environment = environment
        self.workers: dict[str, subprocess.Popen[bytes]] = {}

    def begin(self, name: str, *before: str, **environment: str) -> None:
        """Start a worker with one thread; ``before`` is a command that runs it."""
        work = self.folder / name
        work.mkdir(exist_ok=True)
        # Without a nanny, which would restart a killed worker.
        options = ["--nthreads", "1", "--no-nanny", "--no-dashboard", "--host", LOOPBACK, "--name", name]
        command = [*before, *_dask("worker"), self.address, *options, "--local-directory", os.fspath(work)]
        with (work / "log").open("wb") as said:
            self.workers[name] = subprocess.Popen(
                command,
                cwd=work,
                stdin=subprocess.DEVNULL,
                stdout=said,
                stderr=said,
                env={**os.environ, **self.environment, **environment},
            )

    def wait(self, *names: str) -> None:
        """Wait until the scheduler knows workers."""
        for name in names:
            self._await(name)

    def _await(self, name: str) -> None:
        log = self.folder / name / "log"
        deadline = time.monotonic() + PATIENCE_S
        while "Registered to:" not in log.read_text(errors="replace"):
            assert self.workers[name].poll() is None, log.read_text(errors="replace")
            assert time.monotonic() < deadline, log.read_text(errors="replace")
            time.sleep(0.05)

    def end(self, name: str, kill: bool = False) -> None:
        """End a worker and wait for it; ``kill`` gives it no chance to report."""
        process = self.workers.pop(name)
        process.kill() if kill else process.terminate()
        process.wait(PATIENCE_S)


@contextmanager
def cluster(folder: Path, scheme: str = "tcp", **environment: str) -> Iterator[Cluster]:
    """Run a scheduler until the block is over, and then end the workers that were started."""
    environment = QUIET | environment
    port = free_port()
    place = ["--protocol", scheme, "--host", LOOPBACK, "--port", str(port)]
    command = [*_dask("scheduler"), *place, "--no-dashboard", "--no-show"]
    with running(command, port, folder / "scheduler.log", {**os.environ, **environment}) as scheduler:
        made = Cluster(folder, f"{scheme}://{LOOPBACK}:{port}", scheduler, environment)
        try:
            yield made
        finally:
            for process in made.workers.values():
                process.terminate()
            for process in made.workers.values():
                process.wait(PATIENCE_S)


def _dask(what: str) -> list[str]:
    return [sys.executable, "-m", "dask", what]


class Pipes:
    """Captures that are read when the test wants it: named pipes, which keep their readers waiting."""

    def __init__(self, *paths: Path) -> None:
        self.paths = paths
        for path in paths:
            os.mkfifo(path)
        self._writers: dict[Path, int] = {}

    def await_readers(self) -> None:
        """Wait until each of them has a reader."""
        for path in self.paths:
            if path not in self._writers:
                self._writers[path] = _opened(path)

    def without_reader(self) -> Path:
        """Wait until a reader is gone; return the pipe that it read, and forget it."""
        poll = select.poll()
        names = {number: path for path, number in self._writers.items()}
        for number in names:
            poll.register(number, 0)
        found = poll.poll(PATIENCE_S * 1000)
        assert found, "nobody went away"
        path = names[found[0][0]]
        os.close(self._writers.pop(path))
        return path

    def feed(self, path: Path, capture: Path) -> None:
        """Give a reader the awaited data."""
        number = self._writers.pop(path, None)
        number = _opened(path) if number is None else number
        os.set_blocking(number, True)
        with os.fdopen(number, "wb") as file:
            file.write(capture.read_bytes())

    def close(self) -> None:
        """Let all readers go."""
        for number in self._writers.values():
            os.close(number)
        self._writers.clear()


def _opened(path: Path) -> int:
    """Open a pipe for writing when somebody reads it."""
    deadline = time.monotonic() + PATIENCE_S
    while True:
        try:
            return os.open(path, os.O_WRONLY | os.O_NONBLOCK)
        except OSError:
            assert time.monotonic() < deadline, "nobody reads"
            time.sleep(0.02)
