"""Processes as an executor: one that dies fails its own task, and none outlives whoever started it."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from concurrent.futures import BrokenExecutor
from pathlib import Path

import pytest

from dissect.files.jobs import pool
from dissect.files.jobs.pool import Pool
from dissect.files.jobs.tasks import FileError


def square(number: int) -> tuple[int, int]:
    """Be a task: the result, and which process made it."""
    return number * number, os.getpid()


def killed() -> None:
    """Be a task whose process is killed."""
    os.kill(os.getpid(), signal.SIGKILL)


def interrupted() -> str:
    """Be a task that Ctrl-C strikes, as it strikes all processes of a terminal, or the end of a service all of its own."""
    os.kill(os.getpid(), signal.SIGINT)
    os.kill(os.getpid(), signal.SIGTERM)
    return "goes on"


def endless(folder: str) -> None:
    """Be a task without an end."""
    Path(folder, str(os.getpid())).touch()
    while True:
        time.sleep(0.01)


def refused() -> None:
    """Be a task that cannot be done."""
    raise FileError("it cannot be read", "tcp://a")


def unsendable() -> object:
    """Be a task whose result is none."""
    return lambda: None


def test_who_dies_fails_its_own_task(tmp_path: Path) -> None:
    with Pool(2) as executor:
        dies, lives = executor.submit(killed), executor.submit(square, 7)
        with pytest.raises(BrokenExecutor):
            dies.result()
        assert lives.result()[0] == 49
        with pytest.raises(FileError, match="it cannot be read") as told:
            executor.submit(refused).result()
        assert told.value.where == "tcp://a"
        assert executor.submit(interrupted).result() == "goes on"
        many = [executor.submit(square, number).result() for number in range(8)]
        assert [number for number, _ in many] == [number * number for number in range(8)]
        assert len({process for _, process in many}) <= 2, "a process takes one task after another"
        endings = [executor.submit(endless, str(tmp_path)) for _ in range(3)]
        while len(list(tmp_path.iterdir())) < 2:  # the limit is that of the test run
            time.sleep(0.01)
    assert endings[2].cancelled(), "what waits is not done"
    for ended in endings[:2]:
        with pytest.raises(BrokenExecutor):
            ended.result()
    _gone(tmp_path)


def test_what_cannot_be_sent_fails_its_own_task() -> None:
    with Pool(1) as executor:
        with pytest.raises(Exception, match=r"pickle|local object"):
            executor.submit(unsendable).result()
        with pytest.raises(Exception, match=r"pickle|local object"):
            executor.submit(lambda: None).result()
        assert executor.submit(square, 2).result()[0] == 4


class NoProcess:
    """Stands for a process that the system does not start."""

    def __init__(self, *_: object) -> None:
        raise BlockingIOError(11, "Resource temporarily unavailable")


def test_a_process_that_cannot_be_replaced_keeps_nobody_waiting(monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[str] = []
    with Pool(2, tell=told.append) as executor:
        monkeypatch.setattr(pool, "_Process", NoProcess)
        with pytest.raises(BrokenExecutor):
            executor.submit(killed).result(20)
        assert executor.submit(square, 7).result(20)[0] == 49, "the other one goes on"
        dies, waits = executor.submit(killed), executor.submit(square, 8)
        with pytest.raises(BrokenExecutor):
            dies.result(20)
        for late in (waits, executor.submit(square, 9)):
            with pytest.raises(FileError, match="no other one could be started: Resource temporarily unavailable"):
                late.result(20)
    assert [line.partition("; ")[2] for line in told] == [
        "1 process of -j goes on",
        "files that were not read yet are left out",
    ]


def test_nobody_outlives_a_parent_that_was_killed(tmp_path: Path) -> None:
    script = tmp_path / "parent.py"
    script.write_text(
        "from dissect.files.jobs.pool import Pool\nfrom tests.files.jobs.test_pool import endless\n"
        f"if __name__ == '__main__':\n    with Pool(1) as pool:\n        pool.submit(endless, {str(tmp_path)!r}).result()\n",
        encoding="ascii",
    )
    root = str(Path(__file__).resolve().parents[3])
    inherited = os.environ.get("PYTHONPATH")
    path = os.pathsep.join([root, *([inherited] if inherited else [])])
    with subprocess.Popen([sys.executable, str(script)], env={**os.environ, "PYTHONPATH": path}) as parent:
        while not any(name.name.isdigit() for name in tmp_path.iterdir()):
            assert parent.poll() is None
            time.sleep(0.01)
        parent.kill()
    script.unlink()
    _gone(tmp_path)


def _gone(folder: Path) -> None:
    """Wait until the processes that left their number in a folder are gone."""
    for file in folder.iterdir():
        while _runs(int(file.name)):
            time.sleep(0.01)


def _runs(process: int) -> bool:
    try:
        state = Path(f"/proc/{process}/stat").read_text(encoding="ascii", errors="replace").rpartition(")")[2]
    except OSError:
        return False
    return state.split()[0] != "Z"
