"""Alerts while a line is watched: the engine asks its rules, the dispatcher delivers in threads of its own."""

from __future__ import annotations

from dissect.alerts.dispatcher import Dispatcher
from dissect.alerts.engine import AlertEngine
from dissect.findings.reporter import Finding
from dissect.live.run import Companion
from dissect.source.live.reader import Drops
from dissect.transactions.connection import Connection
from dissect.transactions.transaction import Transaction


class AlertCompanion(Companion):
    """Shows everything to ``engine``, whose alerts ``dispatcher`` delivers."""

    name = "alerting"

    def __init__(self, engine: AlertEngine, dispatcher: Dispatcher) -> None:
        super().__init__()
        self.engine = engine
        self.dispatcher = dispatcher

    def connection_opened(self, connection: Connection) -> None:
        """Pass it on, as all the others."""
        self.engine.connection_opened(connection)

    def connection_closed(self, connection: Connection) -> None:
        """Pass it on."""
        self.engine.connection_closed(connection)

    def transaction(self, transaction: Transaction) -> None:
        """Pass it on."""
        self.engine.transaction(transaction)

    def finding(self, finding: Finding) -> None:
        """Pass it on."""
        self.engine.finding(finding)

    def tick(self, now_ns: int, drops: Drops) -> None:
        """Silence and rates are noticed by time alone; what an earlier run could not deliver is sent once this one goes."""
        self.dispatcher.start()
        self.engine.tick(now_ns)

    def close(self) -> None:
        """Tell what was held back, and deliver what waits."""
        self.engine.finish()
        self.dispatcher.close()
