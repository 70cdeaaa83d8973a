"""`SelectedEvents`: passes only those events of a session that an expression selects."""

from __future__ import annotations

from collections.abc import Iterable

from dissect.engine.findings.reporter import Finding
from dissect.engine.observer import Observer
from dissect.engine.stations.facts import Fact
from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.operation import Operation
from dissect.engine.transactions.transaction import Transaction
from dissect.meaning.select import Where
from dissect.meaning.select.sieve import Sieve
from dissect.meaning.select.things import MESSAGE, Message
from dissect.online.live.events import CLOSED, Event


class _Passed(Observer):
    """An observer that notes whether the sieve passed anything on."""

    def __init__(self) -> None:
        super().__init__()
        self.hit = False

    def transaction(self, transaction: Transaction) -> None:
        self.hit = True

    def operation(self, operation: Operation) -> None:
        self.hit = True

    def finding(self, finding: Finding) -> None:
        self.hit = True

    def fact(self, fact: Fact) -> None:
        self.hit = True

    def connection_opened(self, connection: Connection) -> None:
        self.hit = True

    def connection_closed(self, connection: Connection) -> None:
        self.hit = True


class SelectedEvents:
    """Passes events that ``where`` selects, or that belong to a selected transaction, and problems of the monitor."""

    def __init__(self, where: Where) -> None:
        self._where = where
        self._told = _Passed()
        self._sieve = Sieve(self._told, where, at_once=True)
        self._messages = where.knows(MESSAGE)

    def of(self, events: Iterable[Event]) -> list[Event]:
        """Return the events that pass."""
        return [event for event in events if self.takes(event)]

    def takes(self, event: Event) -> bool:
        """Return whether an event passes; call it for every event, in their order."""
        what = event.what
        self._told.hit = False
        if isinstance(what, Transaction):
            self._sieve.transaction(what)
        elif isinstance(what, Operation):
            self._sieve.operation(what)
        elif isinstance(what, Finding):
            self._sieve.finding(what)
        elif isinstance(what, Fact):
            self._sieve.fact(what)
        elif isinstance(what, Connection):
            if event.kind == CLOSED:
                self._sieve.connection_closed(what)
            else:
                self._sieve.connection_opened(what)
        elif isinstance(what, tuple):
            found, connection = what
            message = Message(
                "scd", int(found.frame), int(found.time_ns), connection, int(found.side), found.octets, scd=found
            )
            return self._messages and self._where.message(message)
        else:
            return True
        return self._told.hit
