"""`Dispatcher`: delivers alerts in separate threads, so that a slow receiver delays nothing else. Every queue is bounded.

Actions with a spool keep alerts that cannot be delivered; this run or the next one tries again, the most severe first.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Final, Self

from dissect.meaning.report import words
from dissect.online.alerts.actions import Action, DeliveryError, Posting, Printed, RefusedError, to_stderr
from dissect.online.alerts.alert import Alert
from dissect.online.alerts.lane import Counts, Lane
from dissect.online.alerts.rules import STDERR
from dissect.online.alerts.spool import Spool, default_folder
from dissect.online.alerts.waiting import RANKS, Complaints, Waiting

#: Seconds until a receiver that is down is tried again: at first, and at most.
FIRST_S: Final = 1.0
LONGEST_S: Final = 60.0


class SpoolLane:
    """A lane (see `Lane`) for an action whose alerts wait on disk.

    One thread writes alerts to ``spool``, others deliver them from there. While the receiver does not answer, the most severe
    alert is tried after 1, 2, 4 … 60 s. An alert that the receiver refuses for good is dropped. A folder that cannot be used at
    the start is tried again as often, when there is an alert for it; until then alerts wait in memory.
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
        self._reopen_at = 0.0
        self._reopen_pause = FIRST_S
        self._threads: list[threading.Thread] = []

    def start(self) -> None:
        """Take over and deliver the alerts that an earlier run left. May be called twice."""
        with self._changed:
            if self._threads or self._closed:
                return
            self.spool.open()
            self._reopen_at = self._clock() + FIRST_S
            left = len(self.spool)
            trouble = self.spool.trouble
            workers = [self._write, *[self._deliver] * self.action.parallel]
            # Daemon threads: they must not keep the process alive; `close` waits for what is important.
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
        """Queue an alert. If the queue is full, the oldest of the least severe is dropped, counted and reported."""
        self.start()
        with self._changed:
            gone = alert if self._closed else self._fresh.put(RANKS[alert.severity], alert)
            if gone is not None:
                self.counts.dropped += 1
            self._changed.notify_all()
        if gone is not None:
            self._complaints.about("room", f"no room, dropped: {gone.severity} {gone.message()}")

    def close(self, deadline: float) -> None:
        """Write alerts in memory to disk, deliver until ``deadline`` (by the clock), and leave the rest to the next run."""
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
            # An alert that is still being written counts as lost: it is not certain to reach the disk.
            self.counts.dropped += self._fresh.clear() + self._writing + self.spool.lost_at_end
            left = len(self.spool) - self.spool.lost_at_end
            self.spool.close()
        counts = self.counts
        if counts.failed or counts.dropped:
            self._complaints.say(f"{counts.failed} failed, {counts.dropped} dropped, {counts.delivered} delivered")
        if left:
            waiting = words.count(left, "alert waits", "alerts wait")
            self._complaints.say(f"{waiting} in {self.spool.folder} for the next run")

    # ---- threads ----------------------------------------------------------------------------------------------------

    def _write(self) -> None:
        """Write alerts from memory to disk; runs in a thread."""
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
                back = self._reopened()
            if back:
                self._complaints.say(f"alerts wait in {self.spool.folder} again")
            # Without the lock, because a disk may take seconds and the capturing thread must not wait for the lock that long.
            written = self.spool.write(RANKS[alert.severity], alert.as_json().encode("ascii"))
            with self._changed:
                dropped = self.spool.keep(written)
                self.counts.dropped += len(dropped)
                trouble = self.spool.trouble
                self._writing -= 1
                self._changed.notify_all()
            for one in dropped:
                self.spool.remove(one)
            if dropped:
                self._complaints.about("room", f"the spool is full, dropped: {words.count(len(dropped), 'alert')}")
            if trouble:
                self._complaints.about("spool", f"{trouble}: alerts wait in memory only")

    def _reopened(self) -> bool:
        """If it is time, try again to use the folder; return whether that works now. Needs the lock."""
        now = self._clock()
        if self.spool.is_open or now < self._reopen_at:
            return False
        self.spool.open()
        self._reopen_at = now + self._reopen_pause
        self._reopen_pause = min(self._reopen_pause * 2, LONGEST_S)
        return self.spool.is_open

    def _deliver(self) -> None:
        """Deliver alerts from disk; runs in a thread."""
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
            content = self.spool.read(taken)
            refused = trouble = ""
            try:
                if content is not None:
                    self.action.post(content)
            except RefusedError as error:
                refused = str(error)
            except DeliveryError as error:
                trouble = str(error)
            except Exception as error:  # noqa: BLE001 - one alert that fails must not end the thread
                refused = f"{type(error).__name__}: {error}"
            if not trouble:
                self.spool.remove(taken)
            with self._changed:
                if trouble:
                    self.spool.put_back(taken)
                    self._not_before = self._clock() + self._pause
                    self._pause = min(self._pause * 2, LONGEST_S)
                else:
                    self.spool.done(taken)
                    if content is not None:
                        self._pause = FIRST_S
                    if refused:
                        self.counts.failed += 1
                    elif content is not None:
                        self.counts.delivered += 1
                self._changed.notify_all()
            if trouble:
                self._complaints.about("down", f"{trouble}; delivery will be retried")
            elif refused:
                self._complaints.about("refused", refused)


#: At most this many alerts wait for one action.
MAX_QUEUED: Final = 256


class Dispatcher:
    """Takes alerts from any thread with `submit`, and passes each on to the actions of its rule.

    ``write`` gets the lines of the action ``stderr``, ``tell`` messages on deliveries. By default both write to stderr; they
    are called from threads of the dispatcher. Alerts for a webhook wait on disk until they are delivered
    (`dissect.online.alerts.spool`). Use it as a context manager, or call `close`.
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
        self._lanes: dict[str, Lane | SpoolLane] = {}
        for name, action in every.items():
            if isinstance(action, Posting):
                spool = Spool(action.spool if action.spool is not None else default_folder(), name)
                self._lanes[name] = SpoolLane(action, spool, most, say, clock)
            else:
                self._lanes[name] = Lane(action, most, say, clock)
        self._closed = False

    def prepare(self) -> list[Path]:
        """Make the folders in which alerts wait; return those that did not exist, the outermost first.

        Call it before this process gives up the privileges that are needed to make them.
        """
        made: list[Path] = []
        for lane in self._lanes.values():
            if isinstance(lane, SpoolLane):
                made += lane.spool.prepare()
        return made

    def start(self) -> None:
        """Begin to deliver alerts that an earlier run left. Starts threads; may be called twice."""
        for lane in self._lanes.values():
            lane.start()

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
        """How many alerts were delivered, failed and dropped, by action."""
        return {name: lane.counts for name, lane in self._lanes.items()}

    def close(self, timeout: float = 5.0) -> None:
        """Deliver waiting alerts for at most ``timeout`` seconds, then break off and report lost ones. May be called twice."""
        if self._closed:
            return
        self._closed = True
        deadline = self._clock() + timeout
        for lane in self._lanes.values():
            lane.close(deadline)
