"""`Lane`: the queue and the threads of an action without a spool: a program, a line, a datagram."""

from __future__ import annotations

import threading
from collections.abc import Callable

from dissect.meaning.report import words
from dissect.online.alerts.actions import Action, DeliveryError
from dissect.online.alerts.alert import Alert
from dissect.online.alerts.waiting import RANKS, Complaints, Waiting


class Counts:
    """The alerts of one action: how many were delivered, failed, or dropped because too many waited."""

    __slots__ = ("delivered", "dropped", "failed")

    def __init__(self) -> None:
        self.delivered = 0
        self.failed = 0
        self.dropped = 0

    def as_dict(self) -> dict[str, int]:
        """Return the counts for JSON."""
        return {"delivered": self.delivered, "failed": self.failed, "dropped": self.dropped}


class Lane:
    """The queue and the threads of one action."""

    def __init__(self, action: Action, most: int, tell: Callable[[str], None], clock: Callable[[], float]) -> None:
        self.action = action
        self.counts = Counts()
        self._clock = clock
        self._complaints = Complaints(action.name, tell, clock)
        self._waiting: Waiting[Alert] = Waiting(most)
        self._ready = threading.Condition()
        self._closed = False
        self._threads: list[threading.Thread] = []
        self._busy = 0

    def start(self) -> None:
        """Do nothing: no alerts wait from an earlier run, and threads start with the first alert."""

    def put(self, alert: Alert) -> None:
        """Queue an alert. If the queue is full, the oldest of the least severe is dropped, counted and reported."""
        with self._ready:
            gone = alert if self._closed else self._waiting.put(RANKS[alert.severity], alert)
            if gone is not None:
                self.counts.dropped += 1
            if not self._closed:
                if len(self._threads) < self.action.parallel and len(self._waiting) + self._busy > len(self._threads):
                    self._start()
                self._ready.notify()
        if gone is not None:
            waiting = words.count(self._waiting.most, "alert")
            self._complaints.about("room", f"{waiting} are already waiting, dropped: {gone.severity} {gone.message()}")

    def close(self, deadline: float) -> None:
        """Deliver waiting alerts until ``deadline`` (by the lane's clock), then drop the rest."""
        with self._ready:
            self._closed = True
            self._ready.notify_all()
        for thread in self._threads:
            thread.join(max(0.0, deadline - self._clock()))
        with self._ready:
            self.counts.dropped += self._waiting.clear()
        self.action.close()
        for thread in self._threads:
            thread.join(1.0)
        counts = self.counts
        if counts.failed or counts.dropped:
            self._complaints.say(f"{counts.failed} failed, {counts.dropped} dropped, {counts.delivered} delivered")

    def _start(self) -> None:
        # A daemon thread: it must not keep the process alive; `close` waits for what is important.
        thread = threading.Thread(target=self._work, name=f"alerts {self.action.name}", daemon=True)
        self._threads.append(thread)
        thread.start()

    def _work(self) -> None:
        while True:
            with self._ready:
                alert = self._waiting.heaviest()
                while alert is None:
                    if self._closed:
                        return
                    self._ready.wait()
                    alert = self._waiting.heaviest()
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
                if trouble:
                    self.counts.failed += 1
                else:
                    self.counts.delivered += 1
            if trouble:
                self._complaints.about("failed", trouble)
