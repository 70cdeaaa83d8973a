"""`Event`: something that happened in a live run, and `Collector`, the observer that makes events."""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import Final

from mypy_extensions import i64

from dissect.engine.findings.reporter import Finding
from dissect.engine.observer import Observer
from dissect.engine.stations.facts import BLOCK, MAC, Fact
from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.operation import Operation
from dissect.engine.transactions.payloads import ScdMessage
from dissect.engine.transactions.side import Side
from dissect.engine.transactions.transaction import Transaction

#: Kinds of events. A ``PROBLEM`` is a sentence on the monitor itself, an ``ALERT`` the sentence of an alert.
OPENED: Final = "connection_opened"
CLOSED: Final = "connection_closed"
TRANSACTION: Final = "transaction"
OPERATION: Final = "operation"
FINDING: Final = "finding"
SCD: Final = "scd"
DEVICE: Final = "device"
PROBLEM: Final = "problem"
ALERT: Final = "alert"
KINDS: Final = frozenset((OPENED, CLOSED, TRANSACTION, OPERATION, FINDING, SCD, DEVICE, PROBLEM))


class Event:
    """An event: its ``kind``, its object ``what``, and its time by the clock of the capture.

    An open connection may change after the event; ``facts`` has the values of a connection for JSON at the time of the event.
    ``interface`` is the interface that captured it if there are several; else empty.
    """

    __slots__ = ("facts", "interface", "kind", "time_ns", "what")

    def __init__(
        self,
        kind: str,
        time_ns: int,
        what: Connection | Transaction | Operation | Finding | Fact | tuple[ScdMessage, Connection] | str,
        facts: dict[str, object] | None = None,
    ) -> None:
        self.kind = kind
        self.time_ns = time_ns
        self.what = what
        self.facts = facts
        self.interface = ""

    @property
    def connection(self) -> int:
        """The number of the connection that it is about, 0 for none."""
        what = self.what
        if isinstance(what, Connection):
            return int(what.number)
        if isinstance(what, Transaction | Operation):
            return int(what.connection.number)
        if isinstance(what, tuple):
            return int(what[1].number)
        return int(what.connection) if isinstance(what, Finding | Fact) else 0

    def __repr__(self) -> str:
        return f"Event({self.kind!r}, {self.time_ns}, {self.what!r})"


class Collector(Observer):
    """Counts events, and keeps those of the wanted ``kinds`` in ``fresh`` until they are taken.

    ``describe`` returns the facts of a connection; ``scd``: SCD messages are decoded.
    """

    def __init__(
        self, describe: Callable[[Connection], dict[str, object]], kinds: Collection[str] = KINDS, scd: bool = True
    ) -> None:
        super().__init__()
        self.wants_pdus = scd
        self.fresh: list[Event] = []
        self.opened: i64 = 0
        self.closed: i64 = 0
        self.transactions: i64 = 0
        self.unanswered: i64 = 0
        self.with_errors: i64 = 0
        self.now_ns: Callable[[], int] = lambda: 0  # time by the clock of the capture, for ends without a packet
        #: If there are several interfaces, the one that captured the present packet.
        self.interface: Callable[[], str] | None = None
        self._interfaces: dict[int, str] = {}  # by the numbers of connections that are open
        self._over: list[int] = []
        self._describe = describe
        self._kinds: frozenset[str] = frozenset(kinds)
        self._shows_transactions: bool = TRANSACTION in kinds

    def connection_opened(self, connection: Connection) -> None:
        """Count a connection."""
        self.opened += 1
        if self.interface is not None:
            self._interfaces[int(connection.number)] = self.interface()
        if OPENED in self._kinds:
            self.fresh.append(Event(OPENED, connection.tcp.last_ns, connection, self._describe(connection)))

    def connection_closed(self, connection: Connection) -> None:
        """Count a connection that is over."""
        self.closed += 1
        self._over.append(int(connection.number))
        if CLOSED in self._kinds:
            ending = connection.ending
            time_ns = ending.time_ns if ending is not None else self.now_ns()
            self.fresh.append(Event(CLOSED, time_ns, connection, self._describe(connection)))

    def taken(self) -> list[Event]:
        """Return the events since the last call, each with its interface if there are several."""
        fresh, self.fresh = self.fresh, []
        if self.interface is not None:
            for event in fresh:
                event.interface = self._interfaces.get(event.connection, "")
            for number in self._over:
                self._interfaces.pop(number, None)
        self._over.clear()
        return fresh

    def transaction(self, transaction: Transaction) -> None:
        """Count a transaction."""
        self.transactions += 1
        if transaction.missed:
            self.unanswered += 1
        if transaction.has_errors:
            self.with_errors += 1
        if self._shows_transactions:
            time_ns: i64 = max(transaction.request_ns, transaction.response_ns)
            self.fresh.append(Event(TRANSACTION, time_ns, transaction))

    def operation(self, operation: Operation) -> None:
        """Keep an operation."""
        if OPERATION in self._kinds:
            self.fresh.append(Event(OPERATION, operation.begin_ns + operation.duration_ns, operation))

    def finding(self, finding: Finding) -> None:
        """Keep a finding."""
        if FINDING in self._kinds:
            self.fresh.append(Event(FINDING, finding.time_ns, finding))

    def repeated(self, finding: Finding) -> None:
        """Keep the number of findings that were only counted."""
        self.finding(finding)

    def fact(self, fact: Fact) -> None:
        """Keep a new fact; a MAC address only if it replaces a different one, and no names of blocks."""
        if DEVICE in self._kinds and fact.fresh and fact.key != BLOCK and (fact.before or fact.key != MAC):
            self.fresh.append(Event(DEVICE, fact.time_ns, fact))

    def scd(self, frame: i64, time_ns: i64, side: Side, found: ScdMessage) -> None:
        """Keep a message."""
        if SCD in self._kinds:
            self.fresh.append(Event(SCD, time_ns, (found, side.connection)))
