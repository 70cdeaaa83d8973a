"""Delivery through a spool: what cannot be delivered now is tried again, in order of weight, by this run or the next one."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Final

from dissect.alerts.actions import DeliveryError, Posting, RefusedError
from dissect.alerts.alert import Alert
from dissect.alerts.lane import Counts
from dissect.alerts.spool import Spool
from dissect.alerts.waiting import RANKS, Complaints, Waiting
from dissect.report import words

#: Seconds until a receiver that is down is tried again: the first time, and at most.
FIRST_S: Final = 1.0
LONGEST_S: Final = 60.0


class SpoolLane:
    """What `Lane` is, for an action whose alerts wait on disk.

    One thread writes alerts to ``spool``, others deliver them from there; while the receiver does not answer, one attempt is
    made after 1, 2, 4 … 60 s, with the heaviest that waits. An alert that the receiver refuses for good is given up.
    """

    def __init__(
        self,
        action: Posting,
        spool: Spool,
        most: int,
        tell: Callable[[str], None],
        clock: Callable[[], float],
    ) -> None:
        self.action = action
        self.spool = spool
        self.counts = Counts()
        self._complaints = Complaints(action.name, tell, clock)
        self._clock = clock
        self._fresh: Waiting[Alert] = Waiting(most)
        self._changed = threading.Condition()
        self._writing = 0
        self._closed = False
        self._over = False
        self._not_before = 0.0
        self._pause = FIRST_S
        self._threads: list[threading.Thread] = []

    def start(self) -> None:
        """Take over what an earlier run left, and deliver it. May be called twice."""
        with self._changed:
            if self._threads or self._closed:
                return
            self.spool.open()
            left = len(self.spool)
            trouble = self.spool.trouble
            workers = [self._write, *[self._deliver] * self.action.parallel]
            # No thread of ours may keep the process: what must be waited for, `close` waits for.
            self._threads = [
                threading.Thread(target=work, name=f"alerts {self.action.name}", daemon=True) for work in workers
            ]
            for thread in self._threads:
                thread.start()
        if trouble:
            self._complaints.about("spool", f"{trouble}: alerts that cannot be delivered before the end are lost")
        if left:
            self._complaints.say(f"{words.count(left, 'alert')} of an earlier run will be delivered")

    def put(self, alert: Alert) -> None:
        """Queue an alert. Where there is no room the oldest of the lightest is dropped, counted and reported."""
        self.start()
        with self._changed:
            gone = alert if self._closed else self._fresh.put(RANKS[alert.severity], alert)
            if gone is not None:
                self.counts.dropped += 1
            self._changed.notify_all()
        if gone is not None:
            self._complaints.about("room", f"no room, dropped: {gone.severity} {gone.message()}")

    def close(self, deadline: float) -> None:
        """Write to disk what waits in memory, deliver until ``deadline`` (of the clock), and leave the rest to the next run."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()
            while (len(self._fresh) or self._writing) and self._clock() < deadline and self._threads:
                self._changed.wait(0.05)
            while len(self.spool) and self._not_before <= self._clock() < deadline and self._threads:
                self._changed.wait(0.05)
            self._over = True
            self._changed.notify_all()
        self.action.close()
        for thread in self._threads:
            thread.join(1.0)
        with self._changed:
            self.counts.dropped += self._fresh.clear() + self.spool.lost_at_end
            left = len(self.spool) - self.spool.lost_at_end
            self.spool.close()
        counts = self.counts
        if counts.failed or counts.dropped:
            self._complaints.say(f"{counts.failed} failed, {counts.dropped} dropped, {counts.delivered} delivered")
        if left:
            self._complaints.say(f"{words.count(left, 'alert')} wait in {self.spool.folder} for the next run")

    # ---- threads ----------------------------------------------------------------------------------------------------

    def _write(self) -> None:
        """Bring alerts from memory to disk."""
        while True:
            with self._changed:
                while not len(self._fresh):
                    if self._closed:
                        return
                    self._changed.wait()
                alert = self._fresh.heaviest()
                if alert is None:
                    continue
                self._writing += 1
            content = alert.as_json().encode("ascii")
            with self._changed:
                dropped = self.spool.put(RANKS[alert.severity], content)
                self.counts.dropped += len(dropped)
                trouble = self.spool.trouble
                self._writing -= 1
                self._changed.notify_all()
            if dropped:
                self._complaints.about("room", f"the spool is full, dropped: {words.count(len(dropped), 'alert')}")
            if trouble:
                self._complaints.about("spool", f"{trouble}: alerts wait in memory only")

    def _deliver(self) -> None:
        """Deliver what waits on disk."""
        while True:
            with self._changed:
                taken = None
                while taken is None:
                    if self._over:
                        return
                    wait = self._not_before - self._clock()
                    if wait > 0:
                        self._changed.wait(min(wait, 0.5))
                    else:
                        taken = self.spool.take()
                        if taken is None:
                            self._changed.wait(0.5)
                one, content = taken
            refused = trouble = ""
            try:
                self.action.post(content)
            except RefusedError as error:
                refused = str(error)
            except DeliveryError as error:
                trouble = str(error)
            except Exception as error:  # noqa: BLE001 - one alert that fails must not end the thread
                refused = f"{type(error).__name__}: {error}"
            with self._changed:
                if trouble:
                    self.spool.put_back(one)
                    self._not_before = self._clock() + self._pause
                    self._pause = min(self._pause * 2, LONGEST_S)
                else:
                    self.spool.done(one)
                    self._pause = FIRST_S
                    if refused:
                        self.counts.failed += 1
                    else:
                        self.counts.delivered += 1
                self._changed.notify_all()
            if trouble:
                self._complaints.about("down", f"{trouble}; delivery will be retried")
            elif refused:
                self._complaints.about("refused", refused)
