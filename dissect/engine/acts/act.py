"""`Act`: an action of a client on a device, done or only tried, with its outcome and the packets that show it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from dissect.engine.acts.tables import (
    ACCEPTED,
    ACTS,
    FAILED,
    IN_PART,
    NOT_CAPTURED,
    REFUSED,
    UNANSWERED,
    UNCONFIRMED,
    UNFINISHED,
    Kind,
)
from dissect.engine.transactions import operation as operations
from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.operation import DONE, TRANSFERS, Operation
from dissect.engine.transactions.plus_loads import beginning_of
from dissect.engine.transactions.results import RETURN_VALUE, TransactionError, refusal
from dissect.engine.transactions.transaction import PUSH, Transaction
from dissect.protocols.s7plus.tables import PARTIAL_ERROR
from dissect.protocols.s7plus.tables import RETURN_CODES as PLUS_CODES
from dissect.wire.copies import leaves
from dissect.wire.text import printable

if TYPE_CHECKING:
    from dissect.engine.program.carved import CarvedBlock

_OUTCOMES: Final[dict[str, str]] = {
    operations.DONE: ACCEPTED,
    operations.REFUSED: REFUSED,
    operations.FAILED: FAILED,
    operations.UNFINISHED: UNFINISHED,
    operations.NOT_CAPTURED: NOT_CAPTURED,
}


class Act:
    """An action of a client on a device.

    ``kind`` is one of `dissect.engine.acts.tables`, ``slug`` the finding that it makes, and ``command`` the kind of operation
    of its one request, empty for none. Side ``asked_by`` of ``connection`` did it. ``subject`` is its object (text from the
    wire, not escaped); ``text`` is for a finding, empty if the finding should name the request. ``frames`` are the packets that
    show it, ``transactions`` the numbers of its requests, ``octets`` is the size of what it carried. ``error`` is why it was
    refused, ``reason`` why there is no answer. ``operation`` is the operation of a transfer, None for other acts. ``shown`` is
    the packet that completes its first request; ``likely`` is True if a request and its answer only probably belong together.
    ``number`` is the number of the act in its run, 0 while it is unfinished.
    """

    __slots__ = (
        "asked_by", "begin_ns", "command", "connection", "end_ns", "error", "first_frame", "frames", "kind", "last_frame",
        "likely", "number", "octets", "operation", "outcome", "reason", "shown", "slug", "subject", "text", "transactions",
    )  # fmt: skip

    def __init__(self, kind: str, connection: Connection, asked_by: int) -> None:
        self.kind = kind
        row = ACTS[kind]
        self.slug: str = row.slug
        self.command: str = "" if row.lasts else row.operation
        self.connection = connection
        self.asked_by = asked_by
        self.number = 0
        self.subject = ""
        self.text = ""
        self.first_frame = 0
        self.last_frame = 0
        self.frames: list[int] = []
        self.begin_ns = 0
        self.end_ns = 0
        self.octets = 0
        self.outcome = ACCEPTED
        self.reason = ""
        self.error: TransactionError | None = None
        self.transactions: list[int] = []
        self.operation: Operation | None = None
        self.shown = 0
        self.likely = False

    def __repr__(self) -> str:
        return f"Act({self.number}, {self.kind!r}, {self.subject!r}, {self.outcome!r})"

    def __str__(self) -> str:
        """Return who did what and with what result: ``10.0.0.1 to 10.0.0.2: PLC stop, accepted``."""
        what = self.subject or self.kind.replace("_", " ")
        return printable(f"{self.client} to {self.server}: {what}, {self.outcome.replace('_', ' ')}")

    @property
    def row(self) -> Kind:
        """The row of its kind."""
        return ACTS[self.kind]

    @property
    def client(self) -> str:
        """Address of the client that did it."""
        return str(self.connection.tcp.ends[self.asked_by].host)

    @property
    def server(self) -> str:
        """Address of the device that was the target."""
        return str(self.connection.tcp.ends[1 - self.asked_by].host)

    @property
    def error_code(self) -> int:
        """The code of ``error``, 0 for none."""
        return self.error.code if self.error is not None else 0

    def blocks(self) -> list[CarvedBlock]:
        """Return the blocks that the act carried, in wire order; call this while its operation still has its contents."""
        from dissect.engine.program.carved import carve  # late: few captures have transfers

        operation = self.operation
        carried = operation is not None and operation.kind in TRANSFERS and operation.octets > 0
        return carve(operation) if operation is not None and carried else []


def _arguments(act: Act) -> tuple[object, ...]:
    return act.kind, act.connection, act.asked_by


leaves(Act, taken=_arguments)


def act_of(kind: str, transaction: Transaction, subject: str, code: int = -1) -> Act:
    """Return the act that a transaction is or begins.

    ``code`` is the error of its item, 0 for none; by default the error of the transaction counts.
    """
    act = Act(kind, transaction.connection, int(transaction.asked_by))
    act.subject = subject
    first, begin_ns, left_out = beginning_of(transaction)
    frames = transaction.frames
    act.frames = frames if not first or first in frames else [first, *frames]
    act.first_frame, act.last_frame = act.frames[0], act.frames[-1]
    act.end_ns = max(int(transaction.request_ns), int(transaction.response_ns))
    act.begin_ns = begin_ns or act.end_ns
    act.octets = int(transaction.request_size) + left_out
    act.transactions = [int(transaction.number)]
    act.shown = int(transaction.request_frame or transaction.response_frame)
    act.likely = bool(transaction.is_likely)
    act.outcome, act.error = outcome_of(transaction, code)
    act.reason = transaction.reason if act.outcome == UNANSWERED else ""
    return act


def outcome_of(transaction: Transaction, code: int = -1) -> tuple[str, TransactionError | None]:
    """Return the outcome and the error of the request of an act; ``code`` is as for `act_of`."""
    if transaction.unseen:
        return NOT_CAPTURED, None
    if not transaction.response_frame:
        return (UNCONFIRMED if transaction._outcome == PUSH else UNANSWERED), None
    error = refusal(transaction) if code < 0 else None
    if code > 0:
        error = TransactionError(RETURN_VALUE, code, PLUS_CODES.name(code), PLUS_CODES.text(code))
    if error is None:
        return ACCEPTED, None
    return (IN_PART if transaction.is_plus and error.code == PARTIAL_ERROR else REFUSED), error


def act_of_operation(kind: str, operation: Operation) -> Act:
    """Return the act that a transfer was, which is over."""
    act = Act(kind, operation.connection, operation.asked_by)
    act.operation = operation
    act.subject = operation.subject
    act.first_frame, act.last_frame = int(operation.first_frame), int(operation.last_frame)
    act.frames = sorted({act.first_frame, act.last_frame})
    act.begin_ns, act.end_ns = int(operation.begin_ns), int(operation.end_ns)
    act.octets = int(operation.octets)
    act.transactions = operation.transactions
    act.shown = operation.places[0][1] if operation.steps else act.first_frame
    act.likely = operation.likely > 0
    act.outcome = _OUTCOMES.get(operation.result, UNFINISHED)
    if act.outcome == UNFINISHED and (not operation.octets or (operation.steps and DONE not in operation.steps)):
        act.outcome = UNANSWERED
    act.error = operation.error
    act.reason = operation.reason
    return act
