"""Alerts of a live run: the engine applies the rules, the dispatcher delivers alerts in threads of its own."""

from __future__ import annotations

from dissect.acts.act import Act
from dissect.alerts.dispatcher import Dispatcher
from dissect.alerts.engine import AlertEngine
from dissect.engine.pipeline import Pipeline
from dissect.findings.reporter import Finding
from dissect.live.problems import Problem
from dissect.live.run import Companion
from dissect.source.live.reader import Drops
from dissect.transactions.connection import Connection
from dissect.transactions.transaction import Transaction


class AlertCompanion(Companion):
    """Passes every event on to ``engine``, whose alerts ``dispatcher`` delivers."""

    name = "alerting"

    def __init__(self, engine: AlertEngine, dispatcher: Dispatcher) -> None:
        super().__init__()
        self._pipeline: Pipeline | None = None
        self._frames = 0
        self.engine = engine
        self.dispatcher = dispatcher

    def begin(self, pipeline: Pipeline) -> None:
        """Take the pipeline, which counts all packets."""
        self._pipeline = pipeline

    def problem(self, problem: Problem) -> None:
        """Pass it on."""
        self.engine.problem(problem.kind, problem.text, problem.over)

    def connection_opened(self, connection: Connection) -> None:
        """Pass it on; so do the other methods."""
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
        """Give the engine the time, by which it notices silence and rates; start delivery, also of an earlier run's alerts."""
        self.dispatcher.start()
        if self._pipeline is not None and self._pipeline.frames != self._frames:
            self._frames = int(self._pipeline.frames)
            self.engine.captured(int(self._pipeline.now_ns))
        self.engine.tick(now_ns)

    def close(self) -> None:
        """Raise the alerts that were held back, and deliver those that wait."""
        self.engine.finish()
        self.dispatcher.close()
