"""One observer that stands for several: a failing one is reported once and dropped, and the others go on."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from dissect.engine.observer import Observer
from dissect.findings.finding import Finding
from dissect.transactions.connection import Connection
from dissect.transactions.operation import Operation
from dissect.transactions.payloads import ScdMessage
from dissect.transactions.table import Side
from dissect.transactions.transaction import Transaction

#: Is told which observer failed, and how.
Failed = Callable[[Observer, Exception], None]


class Fanout(Observer):
    """Hands every event to ``observers``, in their order; what only some want goes only to those.

    ``failed`` is called once for an observer that raises, which is told nothing more from then on.
    """

    def __init__(self, observers: Iterable[Observer], failed: Failed) -> None:
        super().__init__()
        self._observers = list(observers)
        self._failed = failed
        self.wants_pdus = any([observer.wants_pdus for observer in self._observers])
        self.wants_tpdus = any([observer.wants_tpdus for observer in self._observers])

    @property
    def observers(self) -> list[Observer]:
        """Those who are still told."""
        return list(self._observers)

    def drop(self, observer: Observer, error: Exception) -> None:
        """Tell ``observer``, which failed, nothing more."""
        if observer in self._observers:
            self._observers = [one for one in self._observers if one is not observer]
            self._failed(observer, error)

    def _each(self, tell: Callable[[Observer], None], observers: Iterable[Observer]) -> None:
        for observer in observers:
            try:
                tell(observer)
            except Exception as error:  # noqa: BLE001 - whatever it is, it must not cost the others what happens
                self.drop(observer, error)

    def connection_opened(self, connection: Connection) -> None:
        """Hand it on, as all the others."""
        self._each(lambda one: one.connection_opened(connection), self._observers)

    def connection_closed(self, connection: Connection) -> None:
        """Hand it on."""
        self._each(lambda one: one.connection_closed(connection), self._observers)

    def tpdu(self, frame: int, time_ns: int, side: Side, octets: bytes) -> None:
        """Hand it on to those who want it."""
        self._each(
            lambda one: one.tpdu(frame, time_ns, side, octets), [one for one in self._observers if one.wants_tpdus]
        )

    def ibh_packet(self, frame: int, time_ns: int, side: Side, octets: bytes) -> None:
        """Hand it on to those who want it."""
        self._each(
            lambda one: one.ibh_packet(frame, time_ns, side, octets),
            [one for one in self._observers if one.wants_tpdus],
        )

    def pdu(self, frame: int, time_ns: int, side: Side, octets: bytes, cut: bool) -> None:
        """Hand it on to those who want it."""
        self._each(
            lambda one: one.pdu(frame, time_ns, side, octets, cut), [one for one in self._observers if one.wants_pdus]
        )

    def plus_pdu(self, frame: int, time_ns: int, side: Side, octets: bytes, cut: bool) -> None:
        """Hand it on to those who want it."""
        self._each(
            lambda one: one.plus_pdu(frame, time_ns, side, octets, cut),
            [one for one in self._observers if one.wants_pdus],
        )

    def scd(self, frame: int, time_ns: int, side: Side, found: ScdMessage) -> None:
        """Hand it on to those who want it."""
        self._each(lambda one: one.scd(frame, time_ns, side, found), [one for one in self._observers if one.wants_pdus])

    def transaction(self, transaction: Transaction) -> None:
        """Hand it on."""
        self._each(lambda one: one.transaction(transaction), self._observers)

    def operation(self, operation: Operation) -> None:
        """Hand it on."""
        self._each(lambda one: one.operation(operation), self._observers)

    def finding(self, finding: Finding) -> None:
        """Hand it on."""
        self._each(lambda one: one.finding(finding), self._observers)

    def comment(self, frame: int, text: str) -> None:
        """Hand it on."""
        self._each(lambda one: one.comment(frame, text), self._observers)
