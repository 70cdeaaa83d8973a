"""Counting while the traffic passes: an `Observer` that only adds one here and there.

`Metrics` counts what an observer is told. What the pipeline counts anyhow (packets, TPDUs, PDUs, findings, holes) is not
counted again: `families` reads it there when somebody asks. That somebody is another thread. Everything he reads is a number,
or a list or dict copied in one step, so a single family is always consistent in itself; two families may be a packet apart.
"""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.conversation import Observer
from dissect.metrics.functions import OTHER, Functions
from dissect.pipeline import Pipeline
from dissect.s7.errors import ERROR_CLASSES, ERROR_CODES
from dissect.s7.tables import RETURN_CODES
from dissect.s7plus.tables import RETURN_CODES as PLUS_CODES
from dissect.transactions.connection import Connection
from dissect.transactions.operation import Operation
from dissect.transactions.transaction import ANSWERED, UNANSWERED, Transaction, TransactionError

#: Stands between the labels of one count where they are one key.
SEPARATOR: Final = "\0"


class Metrics(Observer):
    """Counts transactions, errors, operations and connections; knows what a live source tells about itself.

    `attach` gives it the pipeline whose counters belong to the same run. What the ``set_`` methods were never told is not
    exported: an unknown number of drops is not the same as none.
    """

    def __init__(self) -> None:
        super().__init__()
        self.functions: Functions = Functions()
        self.unanswered: dict[str, int] = {}  # by reason
        self.errors: dict[str, int] = {}  # by where and class, with SEPARATOR between them
        self.operations: dict[str, int] = {}  # by kind and result, the same
        self.opened: i64 = 0
        self.ended: dict[str, int] = {}  # by how
        self.pipeline: Pipeline | None = None
        self.kernel_drops: int | None = None
        self.interface_drops: int | None = None
        self.queue_depth: int | None = None
        self.events_lost: int | None = None
        self.lag_ns: int | None = None
        self._classes: frozenset[int] = frozenset([code.number >> 8 for code in ERROR_CODES])

    # ---- what the capture says of itself ------------------------------------------------------------------------------

    def attach(self, pipeline: Pipeline) -> None:
        """Take the pipeline that tells this observer; its counters are read when they are asked for."""
        self.pipeline = pipeline

    def set_drops(self, kernel: int | None, interface: int | None) -> None:
        """Packets lost so far, as `LiveReader.drops` has them; None: not known."""
        self.kernel_drops = kernel
        self.interface_drops = interface

    def set_queue(self, depth: int, lost: int) -> None:
        """Events that wait to be shown or written now, and those given up so far because too many waited."""
        self.queue_depth = depth
        self.events_lost = lost

    def set_lag(self, lag_ns: int) -> None:
        """How far the analysis was behind the wall clock when it took the latest packets."""
        self.lag_ns = lag_ns

    # ---- observer -----------------------------------------------------------------------------------------------------

    def transaction(self, transaction: Transaction) -> None:
        """Count a transaction."""
        row = self.functions.of(transaction.parameters)
        outcome: i64 = transaction.outcome
        row.outcomes[outcome] = row.outcomes[outcome] + 1
        if outcome == ANSWERED:
            row.add_latency(transaction.response_ns - transaction.request_ns)
        elif outcome == UNANSWERED:
            self.unanswered[transaction.reason] = self.unanswered.get(transaction.reason, 0) + 1
        if transaction.has_errors:
            row.errors += 1
            self._count_errors(transaction)

    def operation(self, operation: Operation) -> None:
        """Count an operation."""
        key = f"{operation.kind}{SEPARATOR}{operation.result}"
        self.operations[key] = self.operations.get(key, 0) + 1

    def connection_opened(self, connection: Connection) -> None:
        """Count a connection that was recognised."""
        self.opened += 1

    def connection_closed(self, connection: Connection) -> None:
        """Count the end of a connection."""
        ending = connection.ending
        how = ending.how if ending is not None else OTHER
        self.ended[how] = self.ended.get(how, 0) + 1

    def _count_errors(self, transaction: Transaction) -> None:
        errors = transaction.errors
        for error in errors:
            where = "item" if error.where.startswith("item ") else error.where
            key = f"{where}{SEPARATOR}{self._class(where, error)}"
            self.errors[key] = self.errors.get(key, 0) + 1
        if not errors:  # the answer says no in a way that has no code
            key = f"{OTHER}{SEPARATOR}{OTHER}"
            self.errors[key] = self.errors.get(key, 0) + 1

    def _class(self, where: str, error: TransactionError) -> str:
        """Return the class of a code: of one octet the code itself, of two the high octet; what has no name is ``other``."""
        if where == "item":
            return error.name if error.code in RETURN_CODES else OTHER
        if where == "return value":
            return error.name if error.code in PLUS_CODES else OTHER
        if where == "message":
            return error.name
        number: int = error.code >> 8
        return ERROR_CLASSES.name(number) if number in ERROR_CLASSES or number in self._classes else OTHER
