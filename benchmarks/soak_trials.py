"""Trials of the soak: a packet rate for a time, and the result."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from typing import TYPE_CHECKING, Any, Final

from benchmarks.compare import say
from benchmarks.engines import ROOT
from benchmarks.soak_line import NEAR, NoLineError, arrived, wait_for_watcher
from benchmarks.soak_sender import MARKED
from benchmarks.soak_watchers import Watch

if TYPE_CHECKING:
    from pathlib import Path

    from benchmarks.soak_watchers import Watcher

#: A watcher may be this far behind when the sender ends, in seconds, and take this long to end when asked.
GRACE_S: Final = 1.0
END_S: Final = 3.0
#: A search ends when the highest successful rate and the lowest failed one are this close.
_CLOSE: Final = 1.08
_STEP: Final = 1.6
#: The sender may be late by this much; beyond it the rate was not the requested one.
_MOST_BEHIND_S: Final = 0.25


class Trial:
    """The result of one load. Counts of packets; None if unknown. ``held``: every packet was seen, in time."""

    __slots__ = (
        "arrived", "behind_s", "cpu_s", "ended", "interface", "kernel", "lost_events", "marks", "rate", "seconds", "seen",
        "sent", "told",
    )  # fmt: skip

    def __init__(self, sent: dict[str, Any], came: int, told: dict[str, Any], cpu_s: float) -> None:
        self.sent = int(sent["sent"])
        self.rate = float(sent["rate"])
        self.seconds = float(sent["seconds"])
        self.behind_s = float(sent["behind_s"])
        self.marks: list[int] = sent["marks"]
        self.arrived = came
        self.ended = bool(told)
        summary = told.get("summary", told)
        dropped = summary.get("dropped", summary)
        self.seen = int(summary.get("packets", 0))
        self.kernel: int | None = dropped.get("kernel")
        self.interface: int | None = dropped.get("interface")
        self.lost_events = int(summary.get("events_lost", 0))
        self.cpu_s = cpu_s
        self.told: list[tuple[int, bytes]] = []

    @property
    def line_held(self) -> bool:
        """The sender kept its rate, and all it sent was received by the kernel."""
        return self.arrived == self.sent and self.behind_s <= _MOST_BEHIND_S

    @property
    def held(self) -> bool:
        """Nothing was lost anywhere, and all was seen in time."""
        return self.line_held and self.ended and self.seen == self.sent and not self.kernel and not self.interface

    def line(self) -> str:
        """Return it in words."""
        lost = "not known" if self.kernel is None else f"{self.kernel:,}"
        words = f"{self.rate:,.0f}/s for {self.seconds:.0f} s: sent {self.sent:,}, received {self.arrived:,}, "
        words += f"seen {self.seen:,}, dropped by the kernel {lost}, CPU {self.cpu_s:.1f} s"
        if self.behind_s > _MOST_BEHIND_S:
            words += f", sender late by {self.behind_s:.2f} s"
        if not self.ended:
            words += ", did not end in time"
        return f"{words}: {'held' if self.held else 'NOT held'}"

    def as_dict(self) -> dict[str, object]:
        """Return the figures, JSON-ready."""
        return {name: getattr(self, name) for name in self.__slots__ if name not in {"marks", "told"}}


class SenderProcess:
    """The sender in its own process, with the capture laid out once."""

    def __init__(self, capture: Path) -> None:
        self._child = subprocess.Popen(
            [sys.executable, "-m", "benchmarks.soak_sender", NEAR, str(capture)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            # The sender is of this tree, whatever build is measured and wherever it is installed.
            env={**os.environ, "PYTHONPATH": str(ROOT)},
        )
        self._answer()

    def _answer(self) -> dict[str, Any]:
        assert self._child.stdout is not None
        line = self._child.stdout.readline()
        if not line:
            raise NoLineError("the sender ended; what it said stands above")
        told: dict[str, Any] = json.loads(line)
        return told

    def send(self, rate: int, seconds: float, marks: float = 0.0) -> dict[str, Any]:
        """Send, and return the counts."""
        assert self._child.stdin is not None
        self._child.stdin.write(f"{rate} {seconds} {marks}\n")
        self._child.stdin.flush()
        return self._answer()

    def close(self) -> None:
        """End it."""
        assert self._child.stdin is not None
        self._child.stdin.close()
        self._child.wait()
        if self._child.stdout is not None:
            self._child.stdout.close()


def attempt(
    watcher: Watcher,
    sender: SenderProcess,
    rate: int,
    seconds: float,
    work: Path,
    marks: float = 0.0,
    patience: float = 1.0,
) -> Trial:
    """Start a watcher, send, wait a moment, end it; return the result. Raises NoLineError when it does not begin.

    ``patience`` multiplies the time that it may take to end.
    """
    watch = Watch(watcher, work, f'"{MARKED}:'.encode() if marks else b"")
    try:
        if not wait_for_watcher(watcher.settle_s):
            raise NoLineError(f"{watcher.label} did not begin: {watch.close()}")
        before, stopped = arrived()
        sent = sender.send(rate, seconds, marks)
        after, gone = arrived()
        time.sleep(GRACE_S)
        told = watch.end(END_S * patience)
        trial = Trial(sent, after - before - (gone - stopped), told, watch.cpu_s)
        trial.told = watch.seen
    finally:
        watch.close()
    say(f"{watcher.label}: {trial.line()}")
    return trial


def search(watcher: Watcher, sender: SenderProcess, seconds: float, work: Path, most: int) -> Trial | None:
    """Return the successful trial with the highest rate, None if there was none.

    A failed rate is tried once more before it counts, because this machine may have been busy with something else.
    """
    best: Trial | None = None
    low, high, rate = 0, 0, watcher.begin_rate
    while True:
        trial = attempt(watcher, sender, rate, seconds, work)
        if not trial.held:
            trial = attempt(watcher, sender, rate, seconds, work)
        if trial.held:
            low, best = rate, trial
        else:
            high = rate
        if (high and low and high / low <= _CLOSE) or low >= most or rate < 10:
            return best
        if not high:
            rate = min(int(rate * _STEP), most)
        elif not low:
            rate = int(rate / _STEP)
        else:
            rate = int((low * high) ** 0.5)


def delays_ms(trial: Trial) -> list[float]:
    """Return the delay from the sending of its answer to its line for each marked transaction, in milliseconds, in order."""
    found: list[float] = []
    for at, line in trial.told:
        told = json.loads(line)
        number = told.get("pdu_ref")
        if told.get("function", {}).get("code") == 4 and number < len(trial.marks):
            found.append((at - trial.marks[number]) / 1e6)
    return found
