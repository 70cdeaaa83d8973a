"""Signals: `timeout` sends SIGTERM twice, which is one; who presses Ctrl-C twice means it."""

from __future__ import annotations

import signal

import pytest

from dissect.cli import run as running
from dissect.cli.watching import LiveInterruption


class Taken:
    def __init__(self) -> None:
        self.stops = 0

    def stop(self) -> None:
        self.stops += 1


@pytest.mark.parametrize(
    ("numbers", "times", "broken_off"),
    [
        ((signal.SIGTERM, signal.SIGTERM), (0.0, 0.0), False),
        ((signal.SIGTERM, signal.SIGTERM), (0.0, 0.4), False),
        ((signal.SIGTERM, signal.SIGTERM), (0.0, 0.6), True),
        ((signal.SIGINT, signal.SIGINT), (0.0, 0.0), True),
        ((signal.SIGTERM, signal.SIGINT), (0.0, 0.1), True),
        ((signal.SIGINT, signal.SIGTERM), (0.0, 0.1), True),
    ],
)
def test_a_second_signal(
    numbers: tuple[int, ...], times: tuple[float, ...], broken_off: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    taken = Taken()
    asked = iter(times)
    monkeypatch.setattr(running, "time", type("Time", (), {"monotonic": staticmethod(lambda: 100 + next(asked))}))
    with LiveInterruption(taken.stop) as interruption:
        signal.raise_signal(numbers[0])
        assert (interruption.asked, taken.stops) == (True, 1)
        if broken_off:
            with pytest.raises(KeyboardInterrupt):
                signal.raise_signal(numbers[1])
        else:
            signal.raise_signal(numbers[1])
    assert taken.stops == 1
