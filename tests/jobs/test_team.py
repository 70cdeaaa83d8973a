"""Processes side by side: their messages in rounds, and what is known of one that is gone."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from dissect.jobs.team import Team, WorkerError


class Said(NamedTuple):
    """A message of a worker below."""

    text: str
    file: str


def talker(channel: Any, words: list[str], index: int, count: int) -> None:
    """Say each word, with the own number."""
    for word in words:
        channel.send(Said(f"{word}{index}/{count}", "a.pcap"))
    channel.close()


def killed(channel: Any, index: int, _count: int) -> None:
    """Say something; worker 1 dies then, worker 0 goes on until nobody listens."""
    channel.send(Said("begun", f"{index}.pcap"))
    if index == 1:
        os.kill(os.getpid(), signal.SIGKILL)
    while True:
        channel.send(Said("more", f"{index}.pcap"))


def endless(channel: Any, folder: str, index: int, _count: int) -> None:
    """Leave the process number behind and say something for ever."""
    Path(folder, str(index)).write_text(str(os.getpid()), encoding="ascii")
    while True:
        channel.send(Said("still here", ""))


def test_rounds_have_a_message_of_each_worker() -> None:
    words = [f"w{number}." for number in range(30)]
    with Team(talker, (words,), 2) as team:
        rounds = [[said.text for said in round_] for round_ in team.rounds(lambda: False)]
    assert rounds == [[f"{word}0/2", f"{word}1/2"] for word in words]


def test_a_worker_that_dies_names_its_file() -> None:
    with Team(killed, (), 2) as team, pytest.raises(WorkerError) as lost:
        for _ in team.rounds(lambda: False):
            pass
    assert str(lost.value) == "worker 2 of 2 ended at 1.pcap: killed by SIGKILL"


def test_nobody_is_left_when_it_is_stopped(tmp_path: Path) -> None:
    seen = 0

    def stop() -> bool:
        return seen > 3

    with Team(endless, (str(tmp_path),), 2) as team:
        for _ in team.rounds(stop):
            seen += 1
    assert seen == 4
    for file in tmp_path.iterdir():
        with pytest.raises(ProcessLookupError):
            os.kill(int(file.read_text(encoding="ascii")), 0)


def test_workers_end_when_whoever_started_them_was_killed(tmp_path: Path) -> None:
    """As after kill -9: a process that starts a team, and is not asked whether it wants to end."""
    program = (
        "from tests.jobs.test_team import Team, endless\n"
        "if __name__ == '__main__':\n"
        f"    with Team(endless, ({str(tmp_path)!r},), 2) as team:\n"
        "        rounds = team.rounds(lambda: False)\n"
        "        next(rounds)\n"
        "        print('going', flush=True)\n"
        "        for _ in rounds:\n"
        "            pass\n"
    )
    script = tmp_path / "parent.py"
    script.write_text(program, encoding="ascii")
    root = str(Path(__file__).resolve().parents[2])
    inherited = os.environ.get("PYTHONPATH")
    path = os.pathsep.join([root, *([inherited] if inherited else [])])
    with subprocess.Popen(
        [sys.executable, str(script)], stdout=subprocess.PIPE, env={**os.environ, "PYTHONPATH": path}
    ) as parent:
        assert parent.stdout is not None
        assert parent.stdout.readline() == b"going\n"
        parent.kill()
    workers = [int((tmp_path / name).read_text(encoding="ascii")) for name in ("0", "1")]
    for worker in workers:
        while _runs(worker):  # the limit is that of the test run: it ends, however slow the machine is
            time.sleep(0.02)


def _runs(process: int) -> bool:
    try:
        state = (
            Path(f"/proc/{process}/stat").read_text(encoding="ascii", errors="replace").rpartition(")")[2].split()[0]
        )
    except OSError:
        return False
    return state != "Z"
