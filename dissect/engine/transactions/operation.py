"""`Operation`: several transactions that belong together, such as a block download or a subscription with its pushes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from mypy_extensions import i64

from dissect.engine.transactions.results import RETURN_VALUE, TransactionError, refusal
from dissect.protocols.s7.block_names import FILE_SYSTEMS
from dissect.protocols.s7.parameters import UserdataHead
from dissect.protocols.s7plus.tables import RETURN_CODES as PLUS_CODES
from dissect.wire.copies import leaves
from dissect.wire.part import Part
from dissect.wire.text import printable

if TYPE_CHECKING:
    from dissect.engine.transactions.connection import Connection
    from dissect.engine.transactions.multipart import Joiner
    from dissect.engine.transactions.plus_operations import PlusOpen
    from dissect.engine.transactions.transaction import Transaction

#: Maximum number of open operations on one connection; beyond that the oldest is closed.
MAX_OPEN: Final = 64

# The kinds of operations.
CONNECT: Final = "connect"
DOWNLOAD: Final = "download"
UPLOAD: Final = "upload"
LONG_ANSWER: Final = "long_answer"
BSEND: Final = "bsend"
CYCLIC: Final = "cyclic"
MESSAGES: Final = "messages"
TEST_JOB: Final = "test_job"
PASSWORD: Final = "password"  # noqa: S105 - the name of a kind, no secret
SESSION: Final = "session"
DELETE: Final = "delete"
CONTROL: Final = "control"
POLLING: Final = "polling"
TRANSFER: Final = "transfer"
#: Every kind with a sentence.
KINDS: Final[dict[str, str]] = {
    CONNECT: "A connection is set up: TCP, COTP and Setup communication.",
    DOWNLOAD: "A block is loaded into the PLC; the PLC requests it in segments.",
    UPLOAD: "A block is read from the PLC in segments.",
    LONG_ANSWER: "An answer too long for one PDU is requested in parts.",
    BSEND: "A program sends data too long for one PDU to its partner's program, in segments.",
    CYCLIC: "A client subscribes to values, and the PLC sends them cyclically or on change.",
    MESSAGES: "A client subscribes to messages of the PLC: modes, diagnostics, alarms.",
    TEST_JOB: "A test function of the programming device runs: monitor, modify, force, block status.",
    PASSWORD: "A password is sent to the PLC.",
    SESSION: "A client opens an S7comm-plus session and later deletes it.",
    DELETE: "A block is deleted from the PLC.",
    CONTROL: "A client stops or starts the PLC, or resets its memory.",
    POLLING: "A client reads the same S7comm-plus variables again and again.",
    TRANSFER: "A client streams data into an object by S7comm-plus; the protocol does not say what kind of data.",
}

#: Kinds that carry blocks.
TRANSFERS: Final = frozenset((DOWNLOAD, UPLOAD))

# The results of operations.
DONE: Final = "done"
REFUSED: Final = "refused"
FAILED: Final = "failed"
UNFINISHED: Final = "unfinished"
RUNNING: Final = "running"
NOT_CAPTURED: Final = "not_captured"
#: Every result with a sentence.
RESULTS: Final[dict[str, str]] = {
    DONE: "It completed.",
    REFUSED: "The first request was refused.",
    FAILED: "It started, and a later step was refused or reported an error.",
    UNFINISHED: "Its end is missing: the connection or the capture ended first, or a request was not answered.",
    RUNNING: "A subscription or test job that was running when the connection or the capture ended.",
    NOT_CAPTURED: "The capture lacks the packets that show how it ended, mostly because only one direction was captured.",
}
#: Results without a failure, as far as was captured.
NO_FAILURES: Final = frozenset((DONE, RUNNING, NOT_CAPTURED))

#: The subject of a transfer if no step that names the block was captured.
NAMELESS: Final = "name not captured"

# Contradictions in an operation (`Oddity.name`).
WRONG_ID: Final = "wrong_id"
BEYOND_END: Final = "beyond_end"
WRONG_SIZE: Final = "wrong_size"
CUT_SHORT: Final = "cut_short"

#: The end of the name of a block that must be activated.
_PASSIVE: Final = f", {FILE_SYSTEMS['P']}"
#: Maximum number of transaction numbers, and of oddities, that are kept of an operation.
_KEPT: Final = 1000
_MAX_ODDITIES: Final = 8
#: Maximum number of characters in the subject of an operation.
MAX_SUBJECT: Final = 200
#: Maximum size in octets that is kept of one block or file during its transfer, and of all of them together. Blocks of an
#: S7-300/400 have up to 64 KiB, files of an NC a few MiB.
MAX_CONTENT: Final = 8 * 1024 * 1024
MAX_CONTENTS: Final = 64 * 1024 * 1024


class Oddity:
    """A contradiction in an operation: ``name`` is one of the words above, ``frame`` the packet that shows it."""

    __slots__ = ("detail", "frame", "name")

    def __init__(self, name: str, detail: str, frame: int) -> None:
        self.name = name
        self.detail = detail
        self.frame = frame


class Activation:
    """The state of a block after its download: ``frame`` is the packet of the request that activated it, 0 for none yet.

    ``name`` is the block with the file system into which it was loaded, as in the download request; ``frames`` are the first
    and last packet of the download, ``time_ns`` is the time of its end. ``deleted``: a client deleted the block instead.
    """

    __slots__ = ("deleted", "frame", "frames", "name", "time_ns")

    def __init__(self, name: str, frames: list[int], time_ns: int) -> None:
        self.name = name
        self.frames = frames
        self.time_ns = time_ns
        self.frame = 0
        self.deleted = False

    def __repr__(self) -> str:
        return f"Activation({printable(self.name)}{f', packet {self.frame}' if self.frame else ', not activated'})"

    @property
    def due(self) -> bool:
        """True while the block is in the passive file system, where it has no effect until it is activated."""
        return not self.frame and not self.deleted and self.name.endswith(_PASSIVE)


class Operation:
    """Several transactions that belong together.

    ``asked_by`` is the side of ``connection`` that began it; ``subject`` is its object (text from the wire, not escaped).
    ``parts`` counts the transactions; ``transactions`` has the numbers of the first thousand; ``pushes`` counts the pushes
    among them, ``likely`` the pairs that are only likely. Times are nanoseconds since 1970. ``begun`` is False if the beginning
    of a transfer was not captured; ``half_captured`` is True if requests or answers of it are missing, because only one
    direction was captured.

    ``octets`` is the size of the carried data: block content, joined answer, values. ``announced`` is the size stated
    beforehand, -1 for none. ``content`` depends on the kind. For a long answer or a BSEND it is the joined payload, once that
    is complete; ``places`` then has, for each part, its end in ``content`` and its packet. For a download or upload it is the
    captured part of the block or file, once the operation is over (in S7comm-plus the whole PDUs with the blocks, each with its
    place, and in ``steps`` with its outcome); ``dropped`` is the number of further octets that were too many to keep. For other
    kinds it is empty.

    ``gap`` is the number of octets of ``content`` before the first gap in the sender's data, where a piece may be missing; -1
    for no gap. ``activation`` is the state of a block that was completely loaded.
    """

    __slots__ = (
        "_held",
        "_pieces",
        "activation",
        "announced",
        "asked_by",
        "begin_ns",
        "begun",
        "complete",
        "connection",
        "content",
        "content_head",
        "dropped",
        "end_ns",
        "error",
        "first_frame",
        "first_push_ns",
        "gap",
        "half_captured",
        "key",
        "kind",
        "lacking",
        "last_frame",
        "last_push_ns",
        "likely",
        "number",
        "octets",
        "oddities",
        "parts",
        "places",
        "pushes",
        "reason",
        "result",
        "steps",
        "subject",
        "transactions",
    )

    def __init__(self, kind: str, connection: Connection, asked_by: int, key: str, begin_ns: i64, frame: i64) -> None:
        self.number = 0
        self.kind = kind
        self.connection = connection
        self.asked_by = asked_by
        self.key = key  # identifies it among the operations of its kind on the connection
        self.subject = ""
        self.begin_ns: i64 = begin_ns
        self.end_ns: i64 = begin_ns
        self.first_frame: i64 = frame
        self.last_frame: i64 = frame
        self.transactions: list[int] = []
        self.parts: i64 = 0
        self.likely: i64 = 0
        self.pushes: i64 = 0
        self.first_push_ns: i64 = 0
        self.last_push_ns: i64 = 0
        self.octets: i64 = 0
        self.announced = -1
        self.complete = False  # the last piece came
        self.begun = True
        self.half_captured = False
        self.result = ""
        self.reason = ""
        self.error: TransactionError | None = None
        self.oddities: list[Oddity] = []
        self.content = b""
        self.content_head: UserdataHead | None = None
        self.places: list[tuple[int, int]] = []
        self.steps: list[str] = []  # of a load of S7comm-plus: the result of each request
        self._pieces: list[bytes] = []  # the pieces of a block while it is transferred
        self._held = 0  # size of `pieces` in octets
        self.dropped = 0
        self.gap = -1
        self.lacking = 0  # number of octets missing from the sender of the pieces when the latest piece was taken
        self.activation: Activation | None = None

    def __repr__(self) -> str:
        return f"Operation({self.number}, {self.kind!r}, {self.subject!r}, {self.result!r})"

    def __str__(self) -> str:
        """Return its kind, subject and result: ``upload DB 1, active: done, 636 bytes``."""
        carried = f", {self.octets} bytes" if self.octets else ""
        return printable(f"{self.kind.replace('_', ' ')} {self.subject}: {self.result or 'under way'}{carried}")

    @property
    def error_code(self) -> int:
        """The code of ``error``, 0 for none."""
        return self.error.code if self.error is not None else 0

    @property
    def duration_ns(self) -> int:
        """Time from the first packet to the last."""
        return self.end_ns - self.begin_ns

    def content_parts(self) -> list[Part]:
        """Return the parts of the joined answer or BSEND, newly made at each call; empty for other kinds (reference 4.3)."""
        head = self.content_head
        if head is None:
            return []
        from dissect.protocols.s7.bodies import parse_joined  # imported late: see `Pdu.body`

        return parse_joined(head.group, head.subfunction, head.type, self.content)

    def frames_of(self, start: int, end: int) -> list[int]:
        """Return the first and last packet that carried these octets of a joined answer; just one if they are the same."""
        found = [frame for at, frame in self.places if at > start]
        ends = [frame for at, frame in self.places if at >= end]
        return sorted({found[0] if found else self.last_frame, ends[0] if ends else self.last_frame})

    def _add(self, transaction: Transaction) -> None:
        """Count a transaction as part of this operation."""
        self.parts += 1
        if transaction.is_likely:
            self.likely += 1
        if len(self.transactions) < _KEPT:
            self.transactions.append(int(transaction.number))
        self._reach(transaction.request_frame, transaction.request_ns)
        self._reach(transaction.response_frame, transaction.response_ns)

    def _reach(self, frame: i64, time_ns: i64) -> None:
        """Extend the operation to packet ``frame`` at ``time_ns``; frame 0 means no packet."""
        if frame == 0:
            return
        self.last_frame = max(self.last_frame, frame)
        self.end_ns = max(self.end_ns, time_ns)

    def _push(self, transaction: Transaction, octets: int) -> None:
        """Add a push with this many octets to this operation."""
        self._add(transaction)
        self._count_push(transaction, octets)

    def _count_push(self, transaction: Transaction, octets: int) -> None:
        """Count a transaction that is already in it as a push with this many octets."""
        if self.pushes == 0:
            self.first_push_ns = transaction.response_ns
        self.last_push_ns = transaction.response_ns
        self.pushes += 1
        self.octets += octets

    @property
    def push_interval_ns(self) -> int:
        """Mean time from one push to the next, 0 for fewer than two; other transactions do not count."""
        return int(self.last_push_ns - self.first_push_ns) // int(self.pushes - 1) if self.pushes > 1 else 0

    def _odd(self, name: str, detail: str, frame: int) -> None:
        """Note a contradiction."""
        if len(self.oddities) < _MAX_ODDITIES:
            self.oddities.append(Oddity(name, detail, frame))


class OpenOperations:
    """The unfinished operations of a connection."""

    __slots__ = ("halves", "joiner", "plus", "set_up", "these")

    def __init__(self) -> None:
        self.these: list[Operation] = []
        self.halves: list[Transaction] = []  # half-captured steps of transfers, until they can be put in order
        self.joiner: Joiner | None = None  # exists once something came in parts
        self.plus: PlusOpen | None = None  # those of S7comm-plus
        self.set_up = False  # the first Setup communication was made an operation

    def find(self, kind: str, key: str) -> Operation | None:
        """Return the open operation of a kind with this key, None if there is none."""
        for operation in self.these:
            if operation.kind == kind and operation.key == key:
                return operation
        return None

    def latest(self, kind: str, asked_by: int) -> Operation | None:
        """Return the latest open operation of a kind that side ``asked_by`` began (-1: either), None if there is none."""
        for operation in reversed(self.these):
            if operation.kind == kind and asked_by in (-1, operation.asked_by):
                return operation
        return None


class OperationBook:
    """Begins and closes operations. ``over`` are the operations that are closed and numbered, but not reported yet."""

    def __init__(self) -> None:
        self.count = 0
        self.over: list[Operation] = []
        self.evicted = 0
        self._held = 0  # size of the pieces of all open transfers, in octets

    def begin(self, kind: str, key: str, transaction: Transaction, subject: str) -> Operation:
        """Open an operation with its first transaction."""
        frame, time_ns = transaction.request_frame, transaction.request_ns
        if not frame:
            frame, time_ns = transaction.response_frame, transaction.response_ns
        connection = transaction.connection
        operation = Operation(kind, connection, int(transaction.asked_by), key, time_ns, frame)
        operation.subject = subject
        operation._add(transaction)
        going = connection.operations.these
        if len(going) >= MAX_OPEN:
            self.evicted += 1
            self.close(going[0], UNFINISHED, "too many at once")
        going.append(operation)
        return operation

    def gather(self, operation: Operation, octets: bytes, alone: bool = False) -> bool:
        """Keep a piece of a transfer if there is room (`MAX_CONTENT`, `MAX_CONTENTS`); return whether there was.

        ``alone``: the piece is complete without the earlier ones.
        """
        size = len(octets)
        lacks = operation.dropped > 0 and not alone  # all later pieces are dropped, too: `content` must not have a gap
        if lacks or operation._held + size > MAX_CONTENT or self._held + size > MAX_CONTENTS:
            operation.dropped += size
            return False
        operation._pieces.append(octets)
        operation._held += size
        self._held += size
        return True

    def close(self, operation: Operation, result: str, reason: str = "") -> None:
        """Close an operation with this result."""
        if operation._pieces:
            operation.content = b"".join(operation._pieces)
            operation._pieces = []
            self._held -= operation._held
            operation._held = 0
        self.count += 1
        operation.number = self.count
        operation.result = result
        operation.reason = reason
        going = operation.connection.operations.these
        if operation in going:
            going.remove(operation)
        self.over.append(operation)

    def break_off(self, operation: Operation, reason: str) -> None:
        """Close an operation without its end; its result is unknown if only one direction was captured."""
        if operation.half_captured and not operation.connection.answered:
            self.close(operation, NOT_CAPTURED)
        else:
            self.close(operation, UNFINISHED, reason)

    def settle(
        self, operation: Operation, transaction: Transaction, went_well: str, went_wrong: str, code: int = -1
    ) -> None:
        """Close an operation with ``went_well`` or ``went_wrong``, by the result of its last transaction; ``code`` as below."""
        result, reason, error = result_of(transaction, went_well, went_wrong, code)
        if error is not None:
            operation.error = error
        self.close(operation, result, reason)


def result_of(
    transaction: Transaction, went_well: str, went_wrong: str, code: int = -1
) -> tuple[str, str, TransactionError | None]:
    """Return the result of a transaction as the end of its operation, the reason, and the error if it went wrong.

    ``code`` is the error of an S7comm-plus item of that transaction, 0 for none; by default the error of the transaction
    counts.
    """
    if transaction.unseen:
        return NOT_CAPTURED, "", None
    if not transaction.response_frame:
        return UNFINISHED, transaction.reason, None
    error = refusal(transaction) if code < 0 else None
    if code > 0:
        error = TransactionError(RETURN_VALUE, code, PLUS_CODES.name(code), PLUS_CODES.text(code))
    return (went_well if error is None else went_wrong), "", error


def _taken(operation: Operation) -> tuple[str, Connection, int, str, int, int]:
    return operation.kind, operation.connection, 0, "", 0, 0


leaves(Activation, Oddity)
leaves(Operation, taken=_taken)
