"""Transactions and values of a share as rows: written there, with a mark where the number of the transaction belongs.

The mark is a number of 19 digits, drawn anew for each run, so that nothing in a capture can be taken for it.
"""

from __future__ import annotations

import secrets

from dissect.engine.order import Order
from dissect.jobs.parts import Rows
from dissect.jobs.share import Share
from dissect.report.words import Places
from dissect.report.writer import Choice, Writer
from dissect.transactions.connection import Connection
from dissect.transactions.transaction import UNANSWERED, Transaction
from dissect.variables.collector import Collector
from dissect.variables.writers import ValueWriter


class TransactionRows(Rows):
    """Writes the transactions that are chosen."""

    def __init__(self, share: Share, order: Order, writer: Writer, choose: Choice | None) -> None:
        super().__init__(share)
        self._order = order
        self._writer = writer
        self._choose = choose
        self._number = 8 * 10**18 + secrets.randbelow(10**18)
        self.mark = str(self._number)

    def begin(self, places: Places) -> None:
        """Name packets with ``places``. What the output begins with is written once, by whoever merges."""
        self._writer.begin(places)
        self._writer.take()

    def transaction(self, transaction: Transaction) -> None:
        """Write a transaction."""
        number = int(transaction.number)
        if self._choose is not None and not self._choose(transaction):
            self.unshown.append(number)
            return
        packet = 0
        if transaction.outcome != UNANSWERED:
            packet = int(max(transaction.request_frame, transaction.response_frame))
        transaction.number = self._number
        self._writer.transaction(transaction)
        transaction.number = number
        self.add(self._order.stamp, number, packet, self._writer.take())


class ValueRows(Rows):
    """Writes the rows of values that a collector has."""

    def __init__(self, share: Share, order: Order, writer: ValueWriter, collector: Collector) -> None:
        super().__init__(share)
        self._order = order
        self._writer = writer
        self._collector = collector
        self._known = 0

    def begin(self, places: Places) -> None:
        """Name packets with ``places``. What the output begins with is written once, by whoever merges."""
        self._writer.begin(places)
        self._writer.values([])
        self._writer.take()

    def transaction(self, transaction: Transaction) -> None:
        """Write the values of a transaction."""
        self._collector.transaction(transaction)
        rows = self._collector.take()
        if rows:
            self._writer.values(rows)
            self.add(self._order.stamp, 0, 0, self._writer.take())

    def connection_closed(self, connection: Connection) -> None:
        """Let the collector forget a connection."""
        self._collector.connection_closed(connection)

    def gather(self) -> None:
        """Take what else there is to say of the variables."""
        plcs = self._collector.plcs
        self.variables = self._collector.known
        self.kept = self._collector.kept
        self.plcs = plcs[self._known :]
        self._known = len(plcs)
        self.found = self._collector.found
