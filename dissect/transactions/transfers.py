"""Downloads and uploads as operations: who asks for which piece, and whether all of it came (reference 3.7 and 3.8).

In a download the PLC asks for the pieces with jobs of its own; python-snap7's client sends them unasked instead. Both are one
operation, begun by the request that names the block.
"""

from __future__ import annotations

from typing import Final

from dissect.s7.body import Body
from dissect.s7.control import PI_BLOCK
from dissect.s7.services import LINK_IN, LINK_IN_SECOND
from dissect.s7.tables import (
    DOWNLOAD_BLOCK,
    DOWNLOAD_ENDED,
    END_UPLOAD,
    PI_SERVICE,
    REQUEST_DOWNLOAD,
    START_UPLOAD,
)
from dissect.s7.tables import (
    UPLOAD as UPLOAD_PIECE,
)
from dissect.s7.transfer import FILE_NAME, PIECE, PLAIN_FILE_NAME, SHORT_FILE_NAME
from dissect.transactions.checks import NOT_LOADED
from dissect.transactions.connection import MAX_REMEMBERED
from dissect.transactions.operation import (
    BEYOND_END,
    CUT_SHORT,
    DONE,
    DOWNLOAD,
    FAILED,
    REFUSED,
    UNFINISHED,
    UPLOAD,
    WRONG_ID,
    WRONG_SIZE,
    Operation,
    OperationBook,
)
from dissect.transactions.transaction import ANSWERED, UNANSWERED, Transaction

_NAMES: Final = (FILE_NAME, SHORT_FILE_NAME, PLAIN_FILE_NAME)
_MAX_NAME: Final = 200
#: What a message that ends a transfer says when all went well.
_GOOD: Final = 0


class Transfers:
    """Follows the transfers of all connections, and puts them into a book of operations."""

    def __init__(self, book: OperationBook) -> None:
        self._book = book

    def take(self, transaction: Transaction) -> None:
        """Take a job that is over: a step of a transfer, or none."""
        function = transaction.function
        request = transaction.request
        if request is None:
            return
        body = request.body
        response = transaction.response
        answer = response.body if response is not None else Body()
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
        elif function == PI_SERVICE:
            _link_in(transaction, body)

    # ---- to the PLC -------------------------------------------------------------------------------------------------

    def _begin_download(self, transaction: Transaction, body: Body) -> None:
        name = _name(body)
        going = transaction.connection.operations.find(DOWNLOAD, name)
        if going is not None:
            self._book.close(going, UNFINISHED, "restarted")
        operation = self._book.begin(DOWNLOAD, name, transaction, name)
        length = body.text("load_length")
        operation.announced = int(length) if length.isascii() and length.isdigit() else -1
        if not _went_well(transaction):
            self._book.settle(operation, transaction, DONE, REFUSED)

    def _download_piece(self, transaction: Transaction, body: Body, answer: Body) -> None:
        operation = transaction.connection.operations.find(DOWNLOAD, _name(body))
        if operation is None:
            return
        operation.add(transaction)
        if operation.complete:
            operation.odd(BEYOND_END, "a segment was requested after the last one", int(transaction.request_frame))
        piece = answer.find(PIECE) or body.find(PIECE)
        operation.octets += max(piece.number("length"), 0) if piece is not None else 0
        operation.complete = _last(transaction, answer)
        if transaction.error_code:
            self._book.settle(operation, transaction, DONE, FAILED)

    def _end_download(self, transaction: Transaction, body: Body) -> None:
        operation = transaction.connection.operations.find(DOWNLOAD, _name(body))
        if operation is None:
            return
        operation.add(transaction)
        code = max(body.number("error_code"), _GOOD)
        if code:
            operation.error_code = code
            self._book.close(operation, FAILED)
            return
        self._check_size(operation, transaction)
        self._book.settle(operation, transaction, DONE, FAILED)
        if operation.result == DONE:
            loaded = transaction.connection.traits.loaded
            if len(loaded) < MAX_REMEMBERED:
                loaded.add(operation.key)

    def _check_size(self, operation: Operation, transaction: Transaction) -> None:
        frame = int(transaction.request_frame)
        if operation.connection.tcp.has_holes:
            return  # pieces may be in the holes
        if not operation.complete:
            operation.odd(CUT_SHORT, f"ended after {operation.octets} bytes although more was announced", frame)
        elif operation.announced >= 0 and operation.octets != operation.announced:
            detail = f"{operation.octets} bytes, {operation.announced} announced"
            operation.odd(WRONG_SIZE, detail, frame)

    # ---- from the PLC -----------------------------------------------------------------------------------------------

    def _begin_upload(self, transaction: Transaction, body: Body, answer: Body) -> None:
        key = f"{transaction.asked_by}/{answer.number('upload_id')}"
        going = transaction.connection.operations.find(UPLOAD, key)
        if going is not None:
            self._book.close(going, UNFINISHED, "restarted")
        operation = self._book.begin(UPLOAD, key, transaction, _name(body))
        length = answer.text("total")
        operation.announced = int(length) if length.isascii() and length.isdigit() else -1
        if not _went_well(transaction):
            self._book.settle(operation, transaction, DONE, REFUSED)

    def _find_upload(self, transaction: Transaction, body: Body) -> Operation | None:
        """Return the upload a step belongs to; a step that names another id than the only one going on is odd."""
        operations = transaction.connection.operations
        named = operations.find(UPLOAD, f"{transaction.asked_by}/{body.number('upload_id')}")
        if named is not None:
            return named
        going = [one for one in operations.these if one.kind == UPLOAD and one.asked_by == transaction.asked_by]
        if going:
            detail = f"upload {body.number('upload_id')}, the PLC assigned {going[-1].key.partition('/')[2]}"
            going[-1].odd(WRONG_ID, detail, int(transaction.request_frame))
        return None

    def _upload_piece(self, transaction: Transaction, body: Body, answer: Body) -> None:
        operation = self._find_upload(transaction, body)
        if operation is None:
            return
        operation.add(transaction)
        if operation.complete:
            operation.odd(BEYOND_END, "a segment was requested after the last one", int(transaction.request_frame))
        piece = answer.find(PIECE)
        operation.octets += max(piece.number("length"), 0) if piece is not None else 0
        operation.complete = _last(transaction, answer)
        if transaction.error_code:
            self._book.settle(operation, transaction, DONE, FAILED)

    def _end_upload(self, transaction: Transaction, body: Body) -> None:
        operation = self._find_upload(transaction, body)
        if operation is None:
            return
        operation.add(transaction)
        if not operation.octets and operation.parts == 2:
            operation.odd(CUT_SHORT, "ended before a segment was requested", int(transaction.request_frame))
        else:
            self._check_size(operation, transaction)
        self._book.settle(operation, transaction, DONE, FAILED)


def _name(body: Body) -> str:
    """Return the block or file that a step names, for a person and as a key."""
    for part in body.parameters:
        if part.layout in _NAMES:
            return part.note[:_MAX_NAME]
    return ""


def _went_well(transaction: Transaction) -> bool:
    return transaction.outcome == ANSWERED and not transaction.error_code


def _last(transaction: Transaction, answer: Body) -> bool:
    """Tell whether an answer says that no more follows."""
    return transaction.outcome != UNANSWERED and answer.number("more") != 1


def _link_in(transaction: Transaction, body: Body) -> None:
    """A block is activated: note one that was not loaded on this connection, where that would have been seen."""
    connection = transaction.connection
    if body.text("service") not in {LINK_IN, LINK_IN_SECOND} or connection.mid_stream or connection.tcp.has_holes:
        return
    for part in body.parameters:
        if part.layout is PI_BLOCK and part.note.removeprefix("block ") not in connection.traits.loaded:
            transaction.flags |= NOT_LOADED
