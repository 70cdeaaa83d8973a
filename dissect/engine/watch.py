"""What is watched beside the pairing: operations, which span transactions, and events that matter for security."""

from __future__ import annotations

from dissect.engine.observer import Observer
from dissect.findings.operation_rules import judge_operation, judge_strays, judge_szl
from dissect.findings.plus_rules import PlusWatch
from dissect.findings.reporter import Reporter
from dissect.findings.security_rules import SecurityWatch
from dissect.transactions.connection import Connection
from dissect.transactions.operations import Operations
from dissect.transactions.transaction import Transaction


class Watch:
    """Is shown the transactions that are more than a read or a write of what was written before."""

    def __init__(self, observer: Observer, judge: Reporter) -> None:
        self._observer = observer
        self._judge = judge
        self.operations = Operations()
        self.security = SecurityWatch(judge)
        self.plus = PlusWatch(judge, self.security, self.operations)

    def take(self, transaction: Transaction) -> None:
        """Take a transaction that is no read or write."""
        if transaction.is_plus:
            self.plus.take(transaction)
            self._tell()
            return
        self.operations.take(transaction)
        judge_szl(self._judge, transaction)
        if transaction.flags:
            judge_strays(self._judge, transaction)
        self.security.take(transaction)
        self._tell()

    def end(self, connection: Connection, reason: str) -> None:
        """A connection is over; ``reason`` is one of those of transactions."""
        self.operations.end(connection, reason)
        self.plus.end(connection)
        self._tell()

    def _tell(self) -> None:
        over = self.operations.over
        if not over:
            return
        self.operations.over = []
        for operation in over:
            judge_operation(self._judge, operation)
            self._observer.operation(operation)
