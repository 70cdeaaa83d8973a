"""The server of the metrics comes back: when its address was taken, and when it ended."""

from __future__ import annotations

import socket
import urllib.request

import pytest

from dissect.online.live.problems import Problems
from dissect.online.metrics.counters import Metrics
from dissect.online.metrics.keeper import MetricsKeeper
from dissect.online.metrics.server import door_of
from dissect.online.net.addresses import Address, AddressError
from dissect.packets.source.live.reader import Drops

NONE = Drops(None, None)


class Clock:
    def __init__(self) -> None:
        self.now = 1000.0

    def __call__(self) -> float:
        return self.now


def kept(port: int) -> tuple[MetricsKeeper, Clock, Problems]:
    clock = Clock()
    metrics = Metrics()
    keeper = MetricsKeeper(door_of(metrics, Address("127.0.0.1", port)), clock)
    return keeper, clock, keeper.problems


def answers(keeper: MetricsKeeper) -> bool:
    assert keeper._server is not None
    with urllib.request.urlopen(keeper._server.url, timeout=30) as told:
        return bool(told.read())


def waits(keeper: MetricsKeeper, clock: Clock, seconds: list[float]) -> list[float]:
    """Let time pass in tenths of seconds; return after how many seconds each try came."""
    tries: list[float] = []
    opened = keeper._door.open

    def tried() -> object:
        tries.append(clock.now)
        return opened()

    keeper._door.open = tried  # type: ignore[method-assign, assignment]
    begun = clock.now
    while len(tries) < len(seconds) and clock.now < begun + 1000:
        clock.now = round(clock.now + 0.1, 1)
        keeper.tick(0, NONE)
    keeper._door.open = opened  # type: ignore[method-assign]
    return [round(later - earlier, 1) for earlier, later in zip([begun, *tries], tries, strict=False)]


def test_a_port_that_is_taken_is_tried_again_until_it_is_free() -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        keeper, clock, problems = kept(port)
        with pytest.raises(AddressError) as taken:
            keeper.open()
        keeper.missed(str(taken.value))
        keeper.tick(0, NONE)  # nothing yet: rights are not given up
        assert problems.take() == []
        keeper.start()
        assert waits(keeper, clock, [1, 2, 4, 8, 16, 32, 60, 60]) == [1, 2, 4, 8, 16, 32, 60, 60]
        (told,) = problems.take()  # once, not with each try
        assert told.kind == "metrics"
        assert told.text.startswith(f"the metrics server does not answer: 127.0.0.1:{port}: Address already in use")
        assert not told.over
    clock.now += 60
    keeper.tick(0, NONE)
    try:
        assert answers(keeper)
        (over,) = problems.take()
        assert over.over
        assert over.text.startswith("the metrics server answers again after 4.05 min") or "again after" in over.text
        assert problems.counts["metrics"] == 1
    finally:
        keeper.close()


def test_a_server_that_ends_comes_back() -> None:
    keeper, clock, problems = kept(0)
    keeper.open()
    keeper.start()
    try:
        assert answers(keeper)
        for _ in range(2):
            server = keeper._server
            assert server is not None
            server._listener.shutdown()
            server._thread.join(30)
            keeper.tick(0, NONE)
            (told,) = problems.take()
            assert told.text == "the metrics server does not answer: its thread ended; it will be tried again"
            clock.now += 5
            keeper.tick(0, NONE)
            (over,) = problems.take()
            assert over.text == "the metrics server answers again after 5.00 s"
            assert answers(keeper)
            assert keeper._server is not server
    finally:
        keeper.close()


def test_a_socket_that_is_closed_ends_the_thread_quietly(capfd: pytest.CaptureFixture[str]) -> None:
    keeper, _, problems = kept(0)
    server = keeper.open()
    keeper.start()
    server._listener.socket.close()
    server._listener.shutdown()
    server._thread.join(30)
    assert not server.alive
    keeper.tick(0, NONE)
    assert [problem.kind for problem in problems.take()] == ["metrics"]
    keeper.close()
    assert capfd.readouterr().err == ""
