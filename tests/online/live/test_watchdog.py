"""The heartbeat of a service: only while packets are read, with the time of the last one."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

from dissect.engine.observer import Observer
from dissect.engine.pipeline import Pipeline
from dissect.online.live.watchdog import of_environment
from dissect.packets.source.live.reader import Drops
from tests.cli.support import run, simple

NONE = Drops(0, 0)


class Clock:
    now = 100.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def service(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[socket.socket]:
    path = tmp_path / "notify"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listening:
        listening.bind(str(path))
        listening.settimeout(5)
        monkeypatch.setenv("NOTIFY_SOCKET", str(path))
        monkeypatch.setenv("WATCHDOG_USEC", "60000000")
        monkeypatch.delenv("WATCHDOG_PID", raising=False)
        yield listening


def heard(listening: socket.socket) -> list[str]:
    got = []
    listening.setblocking(False)
    try:
        while True:
            got.append(listening.recv(1000).decode())
    except BlockingIOError:
        return got


def test_it_beats_three_times_within_the_time(service: socket.socket) -> None:
    clock = Clock()
    dog = of_environment(clock)
    assert dog is not None
    pipeline = Pipeline(Observer())
    dog.begin(pipeline)
    for _ in range(60):
        clock.now += 1
        dog.tick(0, NONE)
    dog.close()
    got = heard(service)
    assert (got[0], got[-1]) == ("READY=1", "STOPPING=1")
    assert got[1:-1] == ["WATCHDOG=1\nSTATUS=0 packets, the last at none yet"] * 3


def test_a_run_that_is_no_service_has_none(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("NOTIFY_SOCKET", raising=False)
    assert of_environment() is None
    monkeypatch.setenv("NOTIFY_SOCKET", "relative")
    assert of_environment() is None


@pytest.mark.parametrize(("name", "value"), [("WATCHDOG_USEC", "x"), ("WATCHDOG_USEC", "0"), ("WATCHDOG_PID", "1")])
def test_without_a_watchdog_only_the_status_is_told(
    name: str, value: str, service: socket.socket, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(name, value)
    dog = of_environment(Clock())
    assert dog is not None
    dog.begin(Pipeline(Observer()))
    dog.tick(0, NONE)
    assert heard(service) == ["READY=1", "STATUS=0 packets, the last at none yet"]


def test_nobody_listens(service: socket.socket) -> None:
    service.close()
    dog = of_environment(Clock())
    assert dog is not None
    dog.begin(Pipeline(Observer()))
    dog.close()


def test_a_watched_file_says_its_last_packet(
    service: socket.socket, capfdbinary: pytest.CaptureFixture[bytes], tmp_path: Path
) -> None:
    assert run(capfdbinary, "monitor", "--plain", simple(tmp_path / "a.pcapng")).code == 0
    got = heard(service)
    assert (got[0], got[-1]) == ("READY=1", "STOPPING=1")
