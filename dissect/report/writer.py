"""What writes results in one format, and what hands it the results that a command is about.

A `Writer` is told of results, as any observer is, and keeps what it makes of them in ``lines`` until `Writer.take`. A feed
stands between the pipeline and the writer, because the pipeline tells of everything: of transactions, operations, findings.
"""

from __future__ import annotations

from collections.abc import Callable

from mypy_extensions import mypyc_attr

from dissect.engine.observer import Observer
from dissect.report.places import Places
from dissect.report.styled import Line
from dissect.transactions.connection import Connection
from dissect.transactions.operation import Operation
from dissect.transactions.payloads import ScdMessage
from dissect.transactions.transaction import Transaction
from dissect.wire.clock import Clock

#: Tells whether a transaction is wanted.
Choice = Callable[[Transaction], bool]


@mypyc_attr(allow_interpreted_subclasses=True)
class Writer(Observer):
    """Writes results in one format: override the methods for what it takes, and name that in `dissect.report.formats`.

    ``lines`` are all text as it is to be written (`str`), or all lines with a style (`Line`), which a terminal wraps and
    colours. ``clock`` writes times as the user wants to read them (`Clock.moment`, or `Clock.iso` for programs, always UTC),
    ``verbose`` asks for everything there is (option -V of `show`). Names and values come from the wire: what goes to a person
    passes `dissect.wire.text.printable`.

    Of the methods of an observer it is told `transaction`, `operation`, and for PDUs `pdu`, `plus_pdu`, `tpdu` and
    `ibh_packet` (only of those that carry no PDU), `comment`; beside them `packet` and `scd_message`. PDUs may hold passwords:
    see `dissect.s7.hiding.without_secrets`.
    """

    def __init__(self, clock: Clock | None = None, verbose: bool = False) -> None:
        super().__init__()
        self.places: Places = Places([], False)
        self.clock: Clock = clock if clock is not None else Clock()
        self.verbose: bool = verbose
        self.lines: list[str | Line] = []

    def begin(self, places: Places) -> None:
        """Name packets with ``places``; called once, before the first result."""
        self.places = places

    def packet(self, octets: bytes) -> None:
        """Take the TPKT or IBH-NetLink packet that the next PDU is in, header included."""

    def scd_message(self, found: ScdMessage, connection: Connection) -> None:
        """Take an SCD message: one of its own, or one in an item of S7."""

    def take(self) -> list[str | Line]:
        """Return the lines collected since the last call."""
        lines = self.lines
        self.lines = []
        return lines


class TransactionFeed(Observer):
    """Hands transactions to a writer, all or those that are chosen."""

    def __init__(self, writer: Writer, choose: Choice | None = None) -> None:
        super().__init__()
        self._writer: Writer = writer
        self._choose: Choice | None = choose

    def transaction(self, transaction: Transaction) -> None:
        """Hand on a transaction."""
        if self._choose is None or self._choose(transaction):
            self._writer.transaction(transaction)


class OperationFeed(Observer):
    """Hands operations to a writer, all or those of ``kinds``."""

    def __init__(self, writer: Writer, kinds: frozenset[str] = frozenset()) -> None:
        super().__init__()
        self._writer: Writer = writer
        self._kinds: frozenset[str] = kinds

    def operation(self, operation: Operation) -> None:
        """Hand on an operation."""
        if not self._kinds or operation.kind in self._kinds:
            self._writer.operation(operation)
