"""Delivers alerts in threads of their own, so that a slow receiver holds up nothing but itself. Every queue is bounded."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Final, Self

from dissect.alerts.actions import Action, Posting, Printed, to_stderr
from dissect.alerts.alert import Alert
from dissect.alerts.lane import Counts, Lane
from dissect.alerts.rules import STDERR
from dissect.alerts.spool import Spool, default_folder
from dissect.alerts.spool_lane import SpoolLane

#: Alerts that wait for one action.
MAX_QUEUED: Final = 256


class Dispatcher:
    """Takes alerts from any thread with `submit` and hands each to the actions of its rule.

    ``write`` gets the lines of the action ``stderr``, ``tell`` what there is to say about deliveries; both write to stderr
    unless told otherwise, and are called from threads of the dispatcher. Alerts for a webhook wait on disk until they are
    delivered (`dissect.alerts.spool`). Use it as a context manager, or call `close`.
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
        """Make the folders in which alerts wait; return those that were not there, the outermost first.

        To be called before this process gives up rights that making them takes.
        """
        made: list[Path] = []
        for lane in self._lanes.values():
            if isinstance(lane, SpoolLane):
                made += lane.spool.prepare()
        return made

    def start(self) -> None:
        """Begin to deliver what an earlier run left. Makes threads; may be called twice."""
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
