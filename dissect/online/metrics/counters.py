"""`Metrics`: a companion of a live run that counts the events of an observer.

Counts of the pipeline (packets, TPDUs, PDUs, findings, gaps) are not kept again: `exposition` reads those counters in another
thread when a scraper fetches the metrics. That thread only reads numbers, and lists or dicts that it copies in one step. So
each metric is consistent in itself, but two metrics may differ by a packet.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Final

from mypy_extensions import i64

from dissect.engine.pipeline import Pipeline
from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.operation import Operation
from dissect.engine.transactions.results import MESSAGE, RETURN_VALUE, SHORT_CODES, TransactionError
from dissect.engine.transactions.transaction import ANSWERED, HOLE, UNANSWERED, Transaction
from dissect.meaning.report.certainty import add_doubt
from dissect.online.live.run import Companion
from dissect.online.metrics.functions import OTHER, Functions
from dissect.packets.source.live.reader import Drops
from dissect.protocols.s7.errors import ERROR_CLASSES, ERROR_CODES
from dissect.protocols.s7.tables import RETURN_CODES
from dissect.protocols.s7plus.tables import RETURN_CODES as PLUS_CODES

#: Separates several labels in one key.
SEPARATOR: Final = "\0"


class Metrics(Companion):
    """Counts transactions, errors, operations and connections; keeps drops and lag of a live source.

    Without a live run, call `begin` with the pipeline whose events it gets. Unknown values are not exported: an unknown number
    of drops is not 0. ``clock`` returns the time of this machine in nanoseconds since 1970.
    """

    name = "metrics"

    def __init__(self, clock: Callable[[], int] = time.time_ns) -> None:
        super().__init__()
        self.functions: Functions = Functions()
        self.unanswered: dict[str, int] = {}  # by reason
        self.likely: dict[str, int] = {}  # pairs that are only likely, by doubt; they are in no answer time
        self.not_captured: dict[str, int] = {}  # of the unanswered: answers in a gap of the capture, by certainty
        self.errors: dict[str, int] = {}  # by part and class, joined by SEPARATOR
        self.operations: dict[str, int] = {}  # by kind and result, joined by SEPARATOR
        self.opened: int = 0
        self.ended: dict[str, int] = {}  # by how
        self.pipeline: Pipeline | None = None
        self.drops: Drops = Drops(None, None)
        self.lag_ns: int | None = None
        self._clock = clock
        self._queue: Callable[[], tuple[int, int]] | None = None
        self._classes: frozenset[int] = frozenset([code.number >> 8 for code in ERROR_CODES])

    # ---- the run ------------------------------------------------------------------------------------------------------

    def begin(self, pipeline: Pipeline) -> None:
        """Take the pipeline that feeds this observer; its counters are read when metrics are fetched."""
        self.pipeline = pipeline

    def tick(self, now_ns: int, drops: Drops) -> None:
        """Note the packets lost so far, and the lag of the capture's clock behind that of this machine."""
        self.drops = drops
        self.lag_ns = self._clock() - now_ns

    def watch_queue(self, queue: Callable[[], tuple[int, int]]) -> None:
        """Set ``queue``, which returns (events that wait now, events lost so far); it is called from another thread."""
        self._queue = queue

    @property
    def queue(self) -> tuple[int, int] | None:
        """Return (events that wait, events lost); None without a queue."""
        return self._queue() if self._queue is not None else None

    # ---- observer -----------------------------------------------------------------------------------------------------

    def transaction(self, transaction: Transaction) -> None:
        """Count a transaction."""
        row = self.functions.of(transaction.parameters)
        outcome: i64 = transaction._outcome
        row.outcomes[outcome] = row.outcomes[outcome] + 1
        if outcome == ANSWERED:
            if transaction.is_likely:
                add_doubt(self.likely, transaction)
            else:
                row.add_latency(transaction.response_ns - transaction.request_ns)
        elif outcome == UNANSWERED:
            if transaction.reason == HOLE:
                certainty = transaction.certainty
                self.not_captured[certainty] = self.not_captured.get(certainty, 0) + 1
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
            key = f"{error.part}{SEPARATOR}{self._class(error)}"
            self.errors[key] = self.errors.get(key, 0) + 1
        if not errors:  # the answer is a refusal without a code
            key = f"{OTHER}{SEPARATOR}{OTHER}"
            self.errors[key] = self.errors.get(key, 0) + 1

    def _class(self, error: TransactionError) -> str:
        """Return the class of an error: a code of one octet itself, the high octet of a longer one; else ``other``."""
        if error.part in SHORT_CODES:
            return error.name if error.code in RETURN_CODES else OTHER
        if error.part == RETURN_VALUE:
            return error.name if error.code in PLUS_CODES else OTHER
        if error.part == MESSAGE:
            return error.name
        number: int = error.code >> 8
        return ERROR_CLASSES.name(number) if number in ERROR_CLASSES or number in self._classes else OTHER
