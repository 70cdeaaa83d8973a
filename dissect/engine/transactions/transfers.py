"""`Transfers`: follows downloads and uploads step by step, and checks whether all pieces arrived (reference 3.7 and 3.8).

In a download the PLC requests the pieces with its own jobs; python-snap7's client sends them without a request instead. In both
cases the download is one operation. It begins with the request that names the block, or with the first piece if that request
was not captured.

If only one direction of a connection was captured, every step is half a transaction: a request without its answer, or an answer
without its request. Requests are dropped only when the connection ends, answers earlier. So these halves wait until they can be
followed in the order of their packets. An answer does not name the block; it belongs to the latest transfer.
"""

from __future__ import annotations

from typing import Final

from dissect.engine.transactions.connection import MAX_REMEMBERED, Connection
from dissect.engine.transactions.operation import (
    BEYOND_END,
    CUT_SHORT,
    DONE,
    DOWNLOAD,
    FAILED,
    NAMELESS,
    NOT_CAPTURED,
    REFUSED,
    UPLOAD,
    WRONG_ID,
    WRONG_SIZE,
    Activation,
    Operation,
    OperationBook,
)
from dissect.engine.transactions.results import NOT_LOADED, PARAMETER, TransactionError, half_captured
from dissect.engine.transactions.transaction import ANSWERED, UNANSWERED, Transaction
from dissect.protocols.s7.block_names import FILE_SYSTEMS
from dissect.protocols.s7.blocks import HEADER, header_text, is_header
from dissect.protocols.s7.body import Body
from dissect.protocols.s7.control import PI_BLOCK
from dissect.protocols.s7.errors import errors_of
from dissect.protocols.s7.message import Pdu
from dissect.protocols.s7.parameters import HEADER_SIZE
from dissect.protocols.s7.services import DELETE, LINK_IN, LINK_IN_SECOND
from dissect.protocols.s7.tables import (
    DOWNLOAD_BLOCK,
    DOWNLOAD_ENDED,
    END_UPLOAD,
    JOB,
    REQUEST_DOWNLOAD,
    START_UPLOAD,
)
from dissect.protocols.s7.tables import UPLOAD as UPLOAD_PIECE
from dissect.protocols.s7.transfer import FILE_NAME, PIECE, PLAIN_FILE_NAME, SHORT_FILE_NAME
from dissect.wire.part import Part

_NAMES: Final = (FILE_NAME, SHORT_FILE_NAME, PLAIN_FILE_NAME)
_MAX_NAME: Final = 200
#: Maximum number of request bodies that are kept for identical requests, and maximum size of their parameters in octets.
_MAX_BODIES: Final = 32
_MAX_OCTETS: Final = 128
#: Maximum number of half-captured steps of a connection that wait for its end, and maximum size of all that wait. If there are
#: more, they may be followed in the wrong order.
MAX_HALVES: Final = 16384
MAX_HALF_OCTETS: Final = 16 * 1024 * 1024
_OBJECT: Final = 512
#: Jobs whose answer contains data of the transfer; answers to other jobs are not read.
_TELLING_ANSWERS: Final = frozenset((DOWNLOAD_BLOCK, START_UPLOAD, UPLOAD_PIECE))
#: The error code of a message that ends a transfer without an error.
_GOOD: Final = 0


class Transfers:
    """Follows the transfers of all connections, and enters them in a book of operations."""

    def __init__(self, book: OperationBook) -> None:
        self._book = book
        self._bodies: dict[bytes, Body] = {}  # of jobs without data, by parameters: requests for pieces are identical
        self._half_octets = 0
        self._ordered = True  # False while waiting steps are processed

    def take(self, transaction: Transaction) -> None:
        """Take a finished job, which may be a step of a transfer."""
        connection = transaction.connection
        if half_captured(transaction) and not connection.answered:
            self._wait(transaction)
            return
        if connection.operations.halves:
            self.follow_halves(connection)
        self._follow(transaction)

    def _wait(self, transaction: Transaction) -> None:
        connection = transaction.connection
        size = _held(transaction)
        if len(connection.operations.halves) >= MAX_HALVES or self._half_octets + size > MAX_HALF_OCTETS:
            self.follow_halves(connection)
        connection.operations.halves.append(transaction)
        self._half_octets += size

    def follow_halves(self, connection: Connection) -> None:
        """Follow the waiting steps of a connection that is over, or of which both directions were captured after all."""
        waiting = connection.operations.halves
        connection.operations.halves = []
        self._ordered = False
        for transaction in sorted(waiting, key=_frame):
            self._half_octets -= _held(transaction)
            self._follow(transaction)
        self._ordered = True

    def _follow(self, transaction: Transaction) -> None:
        function = transaction.function
        body = self._asked(transaction)
        if body is None:
            if not half_captured(transaction):
                return
            body = Body()
        answer = Body()
        if function in _TELLING_ANSWERS:
            response = transaction.response
            answer = response.body if response is not None else answer
        if function == REQUEST_DOWNLOAD:
            self._begin_download(transaction, body)
        elif function == DOWNLOAD_BLOCK:
            self._download_piece(transaction, body, answer)
        elif function == DOWNLOAD_ENDED:
            self._end_download(transaction, body)
        elif function == START_UPLOAD:
            self._begin_upload(transaction, body, answer)
        elif function == UPLOAD_PIECE:
            self._upload_piece(transaction, body, answer)
        elif function == END_UPLOAD:
            self._end_upload(transaction, body)

    def _asked(self, transaction: Transaction) -> Body | None:
        """Return the body of the request, None if there is none; identical requests share one body."""
        octets = transaction.parameters.octets
        if transaction.rosctr != JOB or transaction.request_size != HEADER_SIZE + len(octets):
            return transaction.request_body
        body = self._bodies.get(octets)
        if body is not None:
            transaction._known_body = body
            return body
        body = transaction.request_body
        if body is not None and len(octets) <= _MAX_OCTETS:
            if len(self._bodies) >= _MAX_BODIES:
                self._bodies.clear()
            self._bodies[octets] = body
        return body

    # ---- to the PLC -------------------------------------------------------------------------------------------------

    def _begin_download(self, transaction: Transaction, body: Body) -> None:
        name = _name(body)
        going = transaction.connection.operations.find(DOWNLOAD, name)
        if going is not None:
            self._book.break_off(going, "restarted")
        operation = self._begin(DOWNLOAD, name, transaction, name)
        length = body.text("load_length")
        operation.announced = int(length) if length.isascii() and length.isdigit() else -1
        if not _goes_on(transaction):
            self._book.settle(operation, transaction, DONE, REFUSED)

    def _begin(self, kind: str, key: str, transaction: Transaction, name: str) -> Operation:
        operation = self._book.begin(kind, key, transaction, name or NAMELESS)
        operation.half_captured = half_captured(transaction)
        operation.lacking = _lacking(operation)
        return operation

    def _begin_late(self, kind: str, key: str, transaction: Transaction, name: str, asked_by: int) -> Operation:
        """Begin a transfer with one of its pieces, because earlier steps were not captured."""
        operation = self._begin(kind, key, transaction, name)
        operation.asked_by = asked_by
        operation.lacking = _lacking(operation)
        operation.begun = False
        return operation

    def _add(self, operation: Operation, transaction: Transaction) -> None:
        operation._add(transaction)
        if half_captured(transaction):
            operation.half_captured = True

    def _find_download(self, transaction: Transaction, body: Body) -> Operation | None:
        """Return the download that a step belongs to; if that has no name yet, the first step that names the block sets it."""
        going = transaction.connection.operations
        name = _name(body)
        if not transaction.request_frame:
            return going.latest(DOWNLOAD, -1)
        found = going.find(DOWNLOAD, name)
        if found is None:
            found = going.find(DOWNLOAD, "")
            if found is not None:
                found.key = found.subject = name
        return found

    def _download_piece(self, transaction: Transaction, body: Body, answer: Body) -> None:
        operation = self._find_download(transaction, body)
        piece, carrier, sender = answer.find(PIECE), transaction.response, 1 - int(transaction.asked_by)
        if piece is None and (piece := body.find(PIECE)) is not None:
            carrier, sender = transaction.request, int(transaction.asked_by)
        if operation is None:
            if transaction.error_code or not _begins_late(transaction):
                return
            name = _name(body)
            operation = self._begin_late(DOWNLOAD, name, transaction, name, sender)
        else:
            self._add(operation, transaction)
        if operation.complete:
            operation._odd(BEYOND_END, "a segment was requested after the last one", _frame(transaction))
        self._gather(operation, piece, carrier)
        operation.complete = _last(transaction, answer)
        if transaction.unseen and operation.octets == operation.announced:
            operation.complete = True  # the client's own jobs carry the pieces
        if transaction.error_code:
            self._book.settle(operation, transaction, DONE, FAILED)

    def _end_download(self, transaction: Transaction, body: Body) -> None:
        operation = self._find_download(transaction, body)
        if operation is None:
            return
        self._add(operation, transaction)
        code = max(body.number("error_code"), _GOOD)
        if code:
            codes = errors_of(transaction.function)
            operation.error = TransactionError(PARAMETER, code, codes.name(code), codes.text(code))
            self._book.close(operation, FAILED)
            return
        self._check_size(operation, transaction)
        if not transaction.request_frame and not transaction.error_code:
            self._book.close(operation, NOT_CAPTURED)  # only the request would show whether the PLC reported an error
        else:
            self._book.settle(operation, transaction, DONE, FAILED)
        if operation.result == DONE:
            loaded = transaction.connection.traits.loaded
            if len(loaded) < MAX_REMEMBERED or operation.key in loaded:
                frames = [operation.first_frame, operation.last_frame]
                operation.activation = Activation(operation.key, frames, operation.end_ns)
                loaded[operation.key] = operation.activation

    def _gather(self, operation: Operation, piece: Part | None, pdu: Pdu | None) -> None:
        """Take the piece of a block in a PDU, and note where pieces may be missing."""
        if piece is None or pdu is None:
            return
        size = max(piece.number("length"), 0)
        octets = pdu.data[PIECE.size : PIECE.size + size]
        lacking = _lacking(operation)
        if operation.gap < 0 and lacking != operation.lacking:
            operation.gap = int(operation.octets)
        if operation.gap < 0 and len(octets) < size:
            operation.gap = int(operation.octets) + len(octets)
        # After steps have waited, it is unknown between which pieces a gap was: only the first piece surely precedes it.
        operation.lacking = lacking if self._ordered else 0
        operation.octets += size
        if operation.subject == NAMELESS and is_header(octets):
            operation.subject = header_text(Part(HEADER, octets, 0, HEADER.size))
        self._book.gather(operation, octets)

    def _check_size(self, operation: Operation, transaction: Transaction) -> None:
        frame = _frame(transaction)
        if operation.connection.tcp.has_holes or operation.half_captured or not operation.begun:
            return  # the capture may lack pieces, or the announced size
        if not operation.complete:
            operation._odd(CUT_SHORT, f"ended after {operation.octets} bytes although more was announced", frame)
        elif operation.announced >= 0 and operation.octets != operation.announced:
            detail = f"{operation.octets} bytes, {operation.announced} announced"
            operation._odd(WRONG_SIZE, detail, frame)

    # ---- from the PLC -----------------------------------------------------------------------------------------------

    def _begin_upload(self, transaction: Transaction, body: Body, answer: Body) -> None:
        key = _upload_key(transaction, answer)
        going = transaction.connection.operations.find(UPLOAD, key)
        if going is not None:
            self._book.break_off(going, "restarted")
        operation = self._begin(UPLOAD, key, transaction, _name(body))
        length = answer.text("total")
        operation.announced = int(length) if length.isascii() and length.isdigit() else -1
        if not _goes_on(transaction):
            self._book.settle(operation, transaction, DONE, REFUSED)

    def _find_upload(self, transaction: Transaction, body: Body) -> Operation | None:
        """Return the upload that a step belongs to, None for none; note a step with an id that is not that of the upload."""
        operations = transaction.connection.operations
        latest = operations.latest(UPLOAD, int(transaction.asked_by))
        if not transaction.request_frame:
            return latest
        named = operations.find(UPLOAD, _upload_key(transaction, body))
        if named is not None or latest is None:
            return named
        told = latest.key.partition("/")[2]
        if told == _NO_ID and latest.half_captured:
            latest.key = _upload_key(transaction, body)
            return latest
        if not half_captured(transaction):
            detail = f"upload {body.number('upload_id')}, the PLC assigned {told}"
            latest._odd(WRONG_ID, detail, _frame(transaction))
        return None

    def _upload_piece(self, transaction: Transaction, body: Body, answer: Body) -> None:
        operation = self._find_upload(transaction, body)
        piece = answer.find(PIECE)
        if operation is None:
            others = transaction.connection.operations.latest(UPLOAD, int(transaction.asked_by)) is not None
            if others or transaction.error_code or not _begins_late(transaction):
                return
            key = _upload_key(transaction, body)
            operation = self._begin_late(UPLOAD, key, transaction, "", int(transaction.asked_by))
        else:
            self._add(operation, transaction)
        if operation.complete:
            operation._odd(BEYOND_END, "a segment was requested after the last one", _frame(transaction))
        self._gather(operation, piece, transaction.response)
        operation.complete = _last(transaction, answer)
        if transaction.error_code:
            self._book.settle(operation, transaction, DONE, FAILED)

    def _end_upload(self, transaction: Transaction, body: Body) -> None:
        operation = self._find_upload(transaction, body)
        if operation is None:
            return
        self._add(operation, transaction)
        if not operation.octets and operation.parts == 2 and not operation.half_captured:
            operation._odd(CUT_SHORT, "ended before a segment was requested", _frame(transaction))
        else:
            self._check_size(operation, transaction)
        self._book.settle(operation, transaction, DONE, FAILED)


#: The id in the key of an upload whose id was not captured.
_NO_ID: Final = "-1"


def _lacking(operation: Operation) -> int:
    """Return how many octets of the side that sends the pieces are missing so far; they may include pieces."""
    sender = operation.asked_by if operation.kind == DOWNLOAD else 1 - operation.asked_by
    stream = operation.connection.tcp.streams[sender]
    return int(stream.position) - int(stream.octets)


def _upload_key(transaction: Transaction, body: Body) -> str:
    """Return the key of the upload with the id that ``body`` states."""
    return f"{transaction.asked_by}/{body.number('upload_id')}"


def _name(body: Body) -> str:
    """Return the block or file that a step names, as text and key; empty for none."""
    for part in body.parameters:
        if part.layout in _NAMES:
            return part.note[:_MAX_NAME]
    return ""


def _goes_on(transaction: Transaction) -> bool:
    """Return whether further steps may follow a first step: it was accepted, or half of it was not captured."""
    return not transaction.error_code and (transaction._outcome == ANSWERED or half_captured(transaction))


def _begins_late(transaction: Transaction) -> bool:
    """Return whether a step may begin a transfer whose earlier steps were not captured."""
    if transaction._outcome == UNANSWERED and not half_captured(transaction):
        return False  # an unanswered request comes here late: its transfer may be over
    connection = transaction.connection
    return connection.mid_stream or connection.tcp.has_holes or half_captured(transaction)


def _frame(transaction: Transaction) -> int:
    """Return the first packet of a step that was captured."""
    return int(transaction.request_frame or transaction.response_frame)


def _held(transaction: Transaction) -> int:
    """Return how many octets of memory a waiting step needs."""
    return _OBJECT + len(transaction._request_buf) + len(transaction._response_buf)


def _last(transaction: Transaction, answer: Body) -> bool:
    """Return whether an answer says that no further pieces follow."""
    return transaction._outcome != UNANSWERED and answer.number("more") != 1


def follow_blocks(transaction: Transaction, body: Body) -> None:
    """Note a service that activates or deletes blocks on the loaded blocks; flag the activation of one that was not loaded."""
    connection = transaction.connection
    loaded = connection.traits.loaded
    service = body.text("service")
    links = service in {LINK_IN, LINK_IN_SECOND}
    if not links and service != DELETE:
        return
    for part in body.parameters:
        if part.layout is not PI_BLOCK:
            continue
        name = part.note.removeprefix("block ")
        # A block deleted from both file systems is also deleted from the passive one, where it waits for its activation.
        known = loaded.get(name if links else name.replace(FILE_SYSTEMS["B"], FILE_SYSTEMS["P"]))
        if known is None:
            if links and not (connection.mid_stream or connection.tcp.has_holes or half_captured(transaction)):
                transaction._flags |= NOT_LOADED
        elif transaction.error_code or transaction._outcome == UNANSWERED:
            continue  # the service had no effect
        elif not links:
            known.deleted = True
        else:
            known.frame = int(transaction.request_frame)
