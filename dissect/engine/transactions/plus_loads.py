"""`Load`: everything that a session of S7comm-plus loads, as one operation.

An engineering tool loads a program in one request or in hundreds: an object for each block, inside a sequence that it begins
and ends, or without one. All of it takes effect together. So these requests are one download, until the end of the sequence or,
without a sequence, of the session.
"""

from __future__ import annotations

from mypy_extensions import i64

from dissect.engine.transactions.operation import (
    DONE,
    DOWNLOAD,
    FAILED,
    MAX_SUBJECT,
    NOT_CAPTURED,
    REFUSED,
    UNFINISHED,
    Operation,
    OperationBook,
    result_of,
)
from dissect.engine.transactions.transaction import Transaction
from dissect.protocols.s7plus.event import Event


class Load:
    """The load of a session: its operation, None until something was loaded, and the number of open sequences."""

    __slots__ = ("_depth", "_latest", "_operation", "_reason", "_results")

    def __init__(self) -> None:
        self._operation: Operation | None = None
        self._depth = 0
        self._latest: i64 = 0  # the number of the latest transaction
        self._reason = ""
        self._results: set[str] = set()  # results of all requests that loaded something

    @property
    def in_sequence(self) -> bool:
        """Return whether a sequence is open: what was loaded in it does not count yet."""
        return self._depth > 0

    def take(self, book: OperationBook, event: Event, transaction: Transaction, code: int) -> None:
        """Take a request that loads something; ``code`` is its error, 0 for none."""
        operation = self._operation
        if operation is None or operation.result:  # the book closed it, because too many were open
            operation = self._operation = book.begin(DOWNLOAD, "", transaction, "")
            self._results = set()
            operation.first_frame, operation.begin_ns, _ = beginning_of(transaction)
        elif self._latest != transaction.number:
            operation._add(transaction)
        _name(operation, event.text)
        if self._latest == transaction.number:
            return
        self._latest = transaction.number
        left_out = beginning_of(transaction)[2]
        operation.octets += int(transaction.request_size) + left_out
        result, reason, error = result_of(transaction, DONE, REFUSED, code)
        if book.gather(operation, transaction.request_octets, alone=True):
            operation.places.append((operation._held, int(transaction.request_frame)))
            operation.steps.append(result)
        operation.dropped += left_out
        self._reason = self._reason or reason
        operation.error = operation.error or error
        self._results.add(result)

    def confirm(self, transaction: Transaction, code: int) -> None:
        """The client states that the loaded objects are consistent."""
        operation = self._operation
        if operation is not None and not operation.result and code == 0 and transaction.response_frame:
            operation._add(transaction)
            _name(operation, "consistent")

    def begun(self, transaction: Transaction) -> None:
        """A sequence was begun."""
        if transaction.response_frame and not transaction.refused:
            self._depth += 1

    def ended(self, book: OperationBook, transaction: Transaction) -> None:
        """A sequence was ended; if the CPU refuses the end of the outer one, nothing loaded in it counts."""
        self._depth = max(0, self._depth - 1)
        operation = self._operation
        if self._depth or operation is None or operation.result:
            return
        operation._add(transaction)
        result, reason, error = result_of(transaction, DONE, FAILED)
        self._reason = self._reason or reason
        operation.error = operation.error or error
        if result != DONE:
            operation.steps = [result] * len(operation.steps)
        self.close(book, result)

    def close(self, book: OperationBook, ended: str = DONE) -> None:
        """Close the operation, if there is one; ``ended`` is the result of its last step."""
        operation = self._operation
        self._operation = None
        self._depth = 0
        if operation is not None and not operation.result:
            result = _result(self._results, ended)
            book.close(operation, result, self._reason if result == UNFINISHED else "")
        self._reason = ""
        self._results = set()


def _result(results: set[str], ended: str) -> str:
    """Return the result of a load from the results of its requests and of its end."""
    if ended != DONE:
        return ended
    if REFUSED in results:
        return FAILED if DONE in results else REFUSED
    for result in (UNFINISHED, NOT_CAPTURED):
        if result in results:
            return result
    return DONE


def _name(operation: Operation, text: str) -> None:
    """Add new names to the subject of an operation."""
    if f", {text}," not in f", {operation.subject},":
        operation.subject = f"{operation.subject}, {text}".removeprefix(", ")[:MAX_SUBJECT]


def beginning_of(transaction: Transaction) -> tuple[int, int, int]:
    """Return packet and time of the first frame of a request, and the number of its octets that were not kept."""
    begun = transaction.connection._begun
    found = begun.get((int(transaction.pdu_ref), int(transaction.request_frame))) if begun is not None else None
    if found is None:
        return int(transaction.request_frame), int(transaction.request_ns), 0
    return found
