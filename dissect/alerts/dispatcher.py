"""Delivers alerts in threads of their own, so that a slow receiver holds up nothing but itself. Every queue is bounded."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Final, Self

from dissect.alerts.actions import Action, DeliveryError, Printed, to_stderr
from dissect.alerts.alert import Alert
from dissect.alerts.rules import STDERR
from dissect.report import words
from dissect.wire.text import printable

#: Alerts that wait for one action.
MAX_QUEUED: Final = 256
#: Seconds between two complaints about the same action.
COMPLAIN_S: Final = 60.0


class Counts:
    """What became of the alerts for one action: delivered, failed, dropped because too many waited."""

    __slots__ = ("delivered", "dropped", "failed")

    def __init__(self) -> None:
        self.delivered = 0
        self.failed = 0
        self.dropped = 0

    def as_dict(self) -> dict[str, int]:
        """Return the counts, JSON-ready."""
        return {"delivered": self.delivered, "failed": self.failed, "dropped": self.dropped}


class _Lane:
    """The queue and the threads of one action."""

    def __init__(self, action: Action, most: int, tell: Callable[[str], None], clock: Callable[[], float]) -> None:
        self.action = action
        self.counts = Counts()
        self._most = most
        self._tell = tell
        self._clock = clock
        self._waiting: deque[Alert] = deque()
        self._ready = threading.Condition()
        self._closed = False
        self._threads: list[threading.Thread] = []
        self._busy = 0
        self._complained: float | None = None
        self._untold = 0

    def put(self, alert: Alert) -> None:
        """Queue an alert; one that finds the queue full is dropped, counted and told."""
        with self._ready:
            if self._closed or len(self._waiting) >= self._most:
                self.counts.dropped += 1
                complaint = self._complaint(f"{words.count(self._most, 'alert')} wait already, this one is dropped")
            else:
                self._waiting.append(alert)
                complaint = ""
                if len(self._threads) < self.action.parallel and len(self._waiting) + self._busy > len(self._threads):
                    self._start()
                self._ready.notify()
        self._say(complaint)

    def close(self, deadline: float) -> None:
        """Deliver what waits until ``deadline`` (of the lane's clock), then give it up."""
        with self._ready:
            self._closed = True
            self._ready.notify_all()
        for thread in self._threads:
            thread.join(max(0.0, deadline - self._clock()))
        with self._ready:
            left = len(self._waiting)
            self.counts.dropped += left
            self._waiting.clear()
        self.action.close()
        for thread in self._threads:
            thread.join(1.0)
        counts = self.counts
        if counts.failed or counts.dropped:
            lost = f"{counts.failed} failed, {counts.dropped} dropped, {counts.delivered} delivered"
            self._say(f"alerts: action {printable(self.action.name)}: {lost}")

    def _start(self) -> None:
        # No thread of ours may keep the process: what must be waited for, `close` waits for.
        thread = threading.Thread(target=self._work, name=f"alerts {self.action.name}", daemon=True)
        self._threads.append(thread)
        thread.start()

    def _work(self) -> None:
        while True:
            with self._ready:
                while not self._waiting:
                    if self._closed:
                        return
                    self._ready.wait()
                alert = self._waiting.popleft()
                self._busy += 1
            trouble = ""
            try:
                self.action.deliver(alert)
            except DeliveryError as error:
                trouble = str(error)
            except Exception as error:  # noqa: BLE001 - one alert that fails must not end the thread
                trouble = f"{type(error).__name__}: {error}"
            with self._ready:
                self._busy -= 1
                complaint = ""
                if trouble:
                    self.counts.failed += 1
                    complaint = self._complaint(trouble)
                else:
                    self.counts.delivered += 1
            self._say(complaint)

    def _complaint(self, trouble: str) -> str:
        """Return what to say of a lost alert, empty when something was said a moment ago."""
        now = self._clock()
        if self._complained is not None and now - self._complained < COMPLAIN_S:
            self._untold += 1
            return ""
        self._complained = now
        more = f" ({self._untold} more lost since the last word of it)" if self._untold else ""
        self._untold = 0
        return f"alerts: action {printable(self.action.name)}: {printable(trouble)}{more}"

    def _say(self, complaint: str) -> None:
        if complaint:
            with suppress(DeliveryError, OSError, ValueError):  # nobody is there to hear that nobody hears
                self._tell(complaint)


class Dispatcher:
    """Takes alerts from any thread with `submit` and hands each to the actions of its rule.

    ``write`` gets the lines of the action ``stderr``, ``tell`` what there is to say about deliveries; both write to stderr
    unless told otherwise, and are called from threads of the dispatcher. Use it as a context manager, or call `close`.
    """

    def __init__(
        self,
        actions: Mapping[str, Action],
        *,
        write: Callable[[str], None] | None = None,
        tell: Callable[[str], None] | None = None,
        most: int = MAX_QUEUED,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        say = tell if tell is not None else to_stderr
        self._clock = clock
        every = {STDERR: Printed(STDERR, write), **actions}
        self._lanes = {name: _Lane(action, most, say, clock) for name, action in every.items()}
        self._closed = False

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def submit(self, alert: Alert) -> None:
        """Queue an alert for each action of its rule; never waits."""
        for name in alert.rule.actions:
            self._lanes[name].put(alert)

    @property
    def counts(self) -> dict[str, Counts]:
        """What became of the alerts, by action."""
        return {name: lane.counts for name, lane in self._lanes.items()}

    def close(self, timeout: float = 5.0) -> None:
        """Deliver what waits, ``timeout`` seconds at most, then break off; lost alerts are told. May be called twice."""
        if self._closed:
            return
        self._closed = True
        deadline = self._clock() + timeout
        for lane in self._lanes.values():
            lane.close(deadline)
