"""Alerts of a live run: the engine applies the rules, the dispatcher delivers alerts in threads of its own."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from typing import Final

from dissect.engine.acts.act import Act
from dissect.engine.findings.reporter import Finding
from dissect.engine.pipeline import Pipeline
from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.transaction import Transaction
from dissect.online.alerts.alert import Alert
from dissect.online.alerts.dispatcher import Dispatcher
from dissect.online.alerts.engine import AlertEngine
from dissect.online.live.problems import Problem
from dissect.online.live.run import Companion
from dissect.packets.source.live.reader import Drops
from dissect.wire.text import count

#: At most this many alerts wait between the end of a dispatcher and the beginning of the next one; the oldest are dropped.
MAX_BETWEEN: Final = 4096


class Succession:
    """Takes alerts for ``dispatcher`` while the previous one, which uses the same folders of waiting alerts, is still ending.

    ``tell`` is called with a message if alerts were dropped for lack of room.
    """

    def __init__(self, before: Dispatcher, dispatcher: Dispatcher, tell: Callable[[str], None]) -> None:
        self._dispatcher = dispatcher
        self._tell = tell
        self._waiting: deque[Alert] = deque()
        self._dropped = 0
        self._ending = threading.Thread(target=before.close, name="alerts of the rules before", daemon=True)

    def begin(self) -> None:
        """End the previous one in a thread of its own, because delivery may take seconds."""
        self._ending.start()

    @property
    def over(self) -> bool:
        """Whether the dispatcher before has ended."""
        return not self._ending.is_alive()

    def submit(self, alert: Alert) -> None:
        """Deliver an alert, at once or when the previous dispatcher has ended."""
        if self._waiting or not self.over:
            if len(self._waiting) >= MAX_BETWEEN:
                self._waiting.popleft()
                self._dropped += 1
            self._waiting.append(alert)
        else:
            self._dispatcher.submit(alert)

    def pass_on(self, wait: bool = False) -> bool:
        """Deliver the waiting alerts once the previous dispatcher has ended; return whether it has."""
        if wait:
            self._ending.join()
        if not self.over:
            return False
        self._dispatcher.start()
        while self._waiting:
            self._dispatcher.submit(self._waiting.popleft())
        if self._dropped:
            dropped, self._dropped = self._dropped, 0
            self._tell(f"alerts: {count(dropped, 'alert')} dropped, there was no room while the rules before ended")
        return True


class AlertCompanion(Companion):
    """Passes every event on to ``engine``, whose alerts ``dispatcher`` delivers. `replace` gives it other rules."""

    name = "alerting"

    def __init__(self, engine: AlertEngine, dispatcher: Dispatcher) -> None:
        super().__init__()
        self._pipeline: Pipeline | None = None
        self._frames = 0
        self.engine = engine
        self.dispatcher = dispatcher
        self._succession: Succession | None = None

    def replace(self, engine: AlertEngine, dispatcher: Dispatcher, succession: Succession) -> None:
        """Continue with other rules: ``engine`` gives its alerts to ``succession``, which passes them to ``dispatcher``.

        Call it in the thread of the run.
        """
        if self._succession is not None:
            self._succession.pass_on(wait=True)
        engine.take_over(self.engine)
        self.engine, self.dispatcher, self._succession = engine, dispatcher, succession
        succession.begin()

    @property
    def settled(self) -> bool:
        """Whether alerts of earlier rules were delivered, or abandoned, so that the rules may be replaced again."""
        return self._succession is None or self._succession.over

    def begin(self, pipeline: Pipeline) -> None:
        """Take the pipeline, which counts all packets."""
        self._pipeline = pipeline

    def problem(self, problem: Problem) -> None:
        """Pass it on."""
        self.engine.problem(problem.kind, problem.text, problem.over)

    def connection_opened(self, connection: Connection) -> None:
        """Pass the event on; the other methods do the same."""
        self.engine.connection_opened(connection)

    def connection_closed(self, connection: Connection) -> None:
        """Pass it on."""
        self.engine.connection_closed(connection)

    def transaction(self, transaction: Transaction) -> None:
        """Pass it on."""
        self.engine.transaction(transaction)

    def act(self, act: Act) -> None:
        """Pass it on."""
        self.engine.act(act)

    def finding(self, finding: Finding) -> None:
        """Pass it on."""
        self.engine.finding(finding)

    def repeated(self, finding: Finding) -> None:
        """Pass it on."""
        self.engine.repeated(finding)

    def tick(self, now_ns: int, drops: Drops) -> None:
        """Tell the engine the time, so that it notices silence and rates; start delivery, also of an earlier run's alerts."""
        if self._succession is None or self._succession.pass_on():
            self.dispatcher.start()
        if self._pipeline is not None and self._pipeline.frames != self._frames:
            self._frames = int(self._pipeline.frames)
            self.engine.captured(int(self._pipeline.now_ns))
        self.engine.tick(now_ns)

    def close(self) -> None:
        """Raise the alerts that were held back, and deliver those that wait."""
        self.engine.finish()
        if self._succession is not None:
            self._succession.pass_on(wait=True)
        self.dispatcher.close()
