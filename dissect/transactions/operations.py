"""From transactions to operations: which belong together, what came of them (reference 3.7, 3.8, 4.3, 4.7 to 4.11).

`Operations` gets every transaction except reads and writes, in the order in which they end, and collects the operations that
are over in ``over``. It states facts; findings are made elsewhere.

`Transfers` follows downloads and uploads: who requests which piece, and whether all of it arrived (reference 3.7 and 3.8). In
a download the PLC requests the pieces with jobs of its own; python-snap7's client sends them unrequested instead. Both are
one operation, begun by the request that names the block.
"""

from __future__ import annotations

from typing import Final

from dissect.s7.body import Body
from dissect.s7.control import PI_BLOCK
from dissect.s7.layouts import DATA_HEAD
from dissect.s7.message import Pdu
from dissect.s7.parameters import HEADER_SIZE, UserdataHead
from dissect.s7.services import DELETE, LINK_IN, LINK_IN_SECOND, PROGRAM
from dissect.s7.tables import (
    ACKNOWLEDGED,
    ALARM_8,
    ALARM_S,
    ALARM_SQ,
    AR_SEND,
    BLOCK_STATUS_JOB,
    BLOCK_STATUS_V2,
    CHANGE_DRIVEN,
    CHANGE_DRIVEN_MODIFY,
    CYCLIC_TRANSFER,
    DELETE_JOB,
    DIAGNOSTIC_MESSAGE,
    DOWNLOAD_BLOCK,
    DOWNLOAD_ENDED,
    END_UPLOAD,
    FORCE_VARIABLES,
    GROUP_CPU,
    GROUP_CYCLIC,
    GROUP_MODE,
    GROUP_PBC,
    GROUP_SECURITY,
    GROUP_TEST,
    LOCKED,
    MESSAGE_SERVICE,
    MODIFY_VARIABLE,
    NOTIFY,
    NOTIFY_8,
    PI_SERVICE,
    PLC_STOP,
    REQUEST_DOWNLOAD,
    SCAN,
    SEND_PASSWORD,
    SETUP_COMMUNICATION,
    START_UPLOAD,
    UNLOCKED,
    UNSUBSCRIBE,
    USERDATA,
    VARIABLE_STATUS,
)
from dissect.s7.tables import (
    JOB as JOB_PDU,
)
from dissect.s7.tables import (
    UPLOAD as UPLOAD_PIECE,
)
from dissect.s7.transfer import FILE_NAME, PIECE, PLAIN_FILE_NAME, SHORT_FILE_NAME
from dissect.transactions.connection import MAX_REMEMBERED, Connection
from dissect.transactions.operation import (
    BEYOND_END,
    BSEND,
    CONNECT,
    CONTROL,
    CUT_SHORT,
    CYCLIC,
    DONE,
    DOWNLOAD,
    FAILED,
    LONG_ANSWER,
    MESSAGES,
    PASSWORD,
    POLLING,
    REFUSED,
    RUNNING,
    SESSION,
    TEST_JOB,
    UNFINISHED,
    UPLOAD,
    WRONG_ID,
    WRONG_SIZE,
    Activation,
    Operation,
    OperationBook,
)
from dissect.transactions.results import NOT_LOADED, STRAY_PUSH
from dissect.transactions.transaction import ANSWERED, PUSH, UNANSWERED, Transaction
from dissect.wire.octets import u16
from dissect.wire.part import Part

_NAMES: Final = (FILE_NAME, SHORT_FILE_NAME, PLAIN_FILE_NAME)
_MAX_NAME: Final = 200
#: Bodies of requests that are kept for the next one that says the same, and octets of their parameters.
_MAX_BODIES: Final = 32
_MAX_OCTETS: Final = 128
#: Jobs whose answers say something of a transfer; those of the others need not be read.
_TELLING_ANSWERS: Final = frozenset((DOWNLOAD_BLOCK, START_UPLOAD, UPLOAD_PIECE))
#: What a message that ends a transfer says when all went well.
_GOOD: Final = 0


class Transfers:
    """Follows the transfers of all connections, and puts them into a book of operations."""

    def __init__(self, book: OperationBook) -> None:
        self._book = book
        self._bodies: dict[bytes, Body] = {}  # of jobs without data, by their parameters: each piece is asked for alike

    def take(self, transaction: Transaction) -> None:
        """Take a job that is over: a step of a transfer, or none."""
        function = transaction.function
        body = self._asked(transaction)
        if body is None:
            return
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
        elif function == PLC_STOP or (function == PI_SERVICE and body.text("service") == PROGRAM):
            what = transaction.function_name if function == PLC_STOP else subject_of(transaction)
            operation = self._book.begin(CONTROL, "", transaction, what)
            self._book.settle(operation, transaction, DONE, REFUSED)
        elif function == PI_SERVICE:
            _follow_blocks(transaction, body)

    def _asked(self, transaction: Transaction) -> Body | None:
        """Return the body of the request; of one that was asked before with the same octets it is the same one."""
        octets = transaction.parameters.octets
        if transaction.rosctr != JOB_PDU or transaction.request_size != HEADER_SIZE + len(octets):
            return transaction.request_body
        body = self._bodies.get(octets)
        if body is not None:
            transaction.known_body = body
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
        piece = answer.find(PIECE)
        if piece is not None:
            self._gather(operation, piece, transaction.response)
        else:
            self._gather(operation, body.find(PIECE), transaction.request)
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
            if len(loaded) < MAX_REMEMBERED or operation.key in loaded:
                frames = [operation.first_frame, operation.last_frame]
                operation.activation = Activation(operation.key, frames, operation.end_ns)
                loaded[operation.key] = operation.activation

    def _gather(self, operation: Operation, piece: Part | None, pdu: Pdu | None) -> None:
        """Take the piece of a block that a PDU carries."""
        if piece is None or pdu is None:
            return
        size = max(piece.number("length"), 0)
        operation.octets += size
        self._book.gather(operation, pdu.data[PIECE.size : PIECE.size + size])

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
        self._gather(operation, answer.find(PIECE), transaction.response)
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
    """Return whether an answer says that no more follows."""
    return transaction.outcome != UNANSWERED and answer.number("more") != 1


def _follow_blocks(transaction: Transaction, body: Body) -> None:
    """Blocks are activated or deleted: note what becomes of those that were loaded, and one that was not loaded before."""
    connection = transaction.connection
    loaded = connection.traits.loaded
    service = body.text("service")
    links = service in {LINK_IN, LINK_IN_SECOND}
    if not links and service != DELETE:
        return
    for part in body.parameters:
        if part.layout is not PI_BLOCK:
            continue
        known = loaded.get(part.note.removeprefix("block "))
        if known is None:
            if links and not connection.mid_stream and not connection.tcp.has_holes:
                transaction.flags |= NOT_LOADED
        elif not links:
            known.deleted = True
        elif not transaction.error_code and transaction.outcome != UNANSWERED:
            known.frame = int(transaction.request_frame)


_CYCLIC_STARTS: Final = frozenset((CYCLIC_TRANSFER, CHANGE_DRIVEN))
_ALARM_PUSHES: Final = frozenset((
    DIAGNOSTIC_MESSAGE, ALARM_8, NOTIFY, SCAN, ACKNOWLEDGED, LOCKED, UNLOCKED, AR_SEND, ALARM_SQ, ALARM_S, NOTIFY_8,
))  # fmt: skip
#: Alarm types of a message service that end a subscription (reference 4.9).
_ALARM_ABORTS: Final = frozenset((0, 4, 6, 8))
_TEST_STARTS: Final = frozenset((BLOCK_STATUS_JOB, VARIABLE_STATUS, MODIFY_VARIABLE, FORCE_VARIABLES, BLOCK_STATUS_V2))

#: Kinds that run until somebody stops them.
ENDLESS: Final = frozenset((CYCLIC, MESSAGES, TEST_JOB, SESSION, POLLING))
_MAX_SUBJECT: Final = 200
#: Where the header states the octets of the data block.
_DATA_LENGTH_AT: Final = 8
#: Protocols of connections that Setup communication is expected on: S7comm, and none when nothing was said.
_OURS: Final = frozenset(("", "s7comm"))


def subject_of(transaction: Transaction) -> str:
    """Return what a request is about: the notes of its parts, or its function; text from the wire, not escaped."""
    body = transaction.request_body
    notes = dict.fromkeys(body.notes) if body is not None else {}
    return ", ".join(notes)[:_MAX_SUBJECT] or transaction.function_name


def payload_size(transaction: Transaction) -> int:
    """Return the octets of the payload of a userdata answer or push: of its data block but the head."""
    if transaction.response_size < HEADER_SIZE:
        return 0
    stated = u16(transaction.response_buf, transaction.response_offset + _DATA_LENGTH_AT)
    return max(int(stated) - DATA_HEAD.size, 0)


def subscription_of(push: Transaction) -> Operation | None:
    """Return the operation that a push of S7comm belongs to, None where no such one runs."""
    going = push.connection.operations
    head = push.parameters.userdata
    if head is None:
        return None
    if head.group == GROUP_CYCLIC:
        return going.find(CYCLIC, str(head.sequence))
    if head.group == GROUP_TEST:
        return going.find(TEST_JOB, f"{head.subfunction}/{head.sequence}")
    if head.group == GROUP_MODE or (head.group == GROUP_CPU and head.subfunction in _ALARM_PUSHES):
        return going.find(MESSAGES, str(push.asked_by))
    return None


class Operations(OperationBook):
    """Follows the operations of all connections."""

    def __init__(self) -> None:
        super().__init__()
        self._transfers: Transfers | None = None

    def take(self, transaction: Transaction) -> None:
        """Take a transaction that is over: it may begin an operation, belong to one, or end one."""
        parameters = transaction.parameters
        head = parameters.userdata
        if head is not None:
            if transaction.rosctr == USERDATA:
                self._userdata(transaction, head)
        elif parameters.function == SETUP_COMMUNICATION:
            self._set_up(transaction)
        elif REQUEST_DOWNLOAD <= parameters.function <= PLC_STOP:
            if self._transfers is None:
                from dissect.transactions.operations import Transfers

                self._transfers = Transfers(self)
            self._transfers.take(transaction)

    def end(self, connection: Connection, reason: str) -> None:
        """A connection is over, ``reason`` is how (one of those of transactions): so are its operations."""
        if connection.cr_seen and not connection.operations.set_up and connection.protocol in _OURS:
            self._never_set_up(connection, reason)
        for operation in list(connection.operations.these):
            self.close(operation, RUNNING if operation.kind in ENDLESS else UNFINISHED, reason)

    # ---- connections ------------------------------------------------------------------------------------------------

    def _set_up(self, transaction: Transaction) -> None:
        connection = transaction.connection
        if connection.operations.set_up:
            return
        connection.operations.set_up = True
        operation = self.begin(CONNECT, "", transaction, _negotiated(transaction))
        _from_the_beginning(operation)
        self.settle(operation, transaction, DONE, REFUSED)

    def _never_set_up(self, connection: Connection, reason: str) -> None:
        tcp = connection.tcp
        operation = Operation(
            CONNECT, connection, int(connection.client_side), "", int(tcp.last_ns), int(tcp.last_frame)
        )
        operation.subject = connection.refused or "no Setup communication"
        _from_the_beginning(operation)
        self.close(operation, REFUSED if connection.refused else UNFINISHED, "" if connection.refused else reason)

    # ---- userdata ---------------------------------------------------------------------------------------------------

    def _userdata(self, transaction: Transaction, head: UserdataHead) -> None:
        answer = transaction.response_parameters
        told = answer.userdata if answer is not None else None
        if transaction.outcome == PUSH:
            self._push(transaction)
        elif head.group == GROUP_PBC:
            self._send(transaction, head)
        elif self._part_of_long_answer(transaction, head, told):
            return
        elif head.group == GROUP_CYCLIC:
            self._cyclic(transaction, head, told)
        elif head.group == GROUP_TEST:
            self._test_job(transaction, head, told)
        elif head.group == GROUP_CPU and head.subfunction == MESSAGE_SERVICE:
            self._messages(transaction)
        elif head.group == GROUP_SECURITY and head.subfunction == SEND_PASSWORD and transaction.request_frame:
            self.settle(self.begin(PASSWORD, "", transaction, ""), transaction, DONE, REFUSED)

    def _part_of_long_answer(self, transaction: Transaction, head: UserdataHead, told: UserdataHead | None) -> bool:
        """Follow an answer in parts: the first says that more is to come, each further one is asked for by sequence number."""
        more = told is not None and told.last_data_unit != 0
        if not more and not transaction.connection.operations.these:
            return False  # nearly always: neither the first part of several nor a further one
        sequence = told.sequence if told is not None else head.sequence
        key = f"{head.group}/{head.subfunction}/{sequence}"
        operation = transaction.connection.operations.find(LONG_ANSWER, key)
        if operation is not None and head.sequence == sequence:
            operation.add(transaction)
        elif more:
            if operation is not None:
                self.close(operation, UNFINISHED, "restarted")
            operation = self.begin(LONG_ANSWER, key, transaction, subject_of(transaction))
        else:
            return False
        operation.octets += payload_size(transaction)
        _join(operation, transaction)
        if transaction.outcome == UNANSWERED or transaction.error_code or not more:
            self.settle(operation, transaction, DONE, FAILED)
        return True

    def _send(self, transaction: Transaction, head: UserdataHead) -> None:
        """Follow a BSEND in pieces, each of which the partner answers; one that fits one PDU is no operation."""
        request = transaction.request
        if request is None:
            return
        from dissect.s7.pbc import BSEND_DATA, goes_on  # late: see `Pdu.body`
        from dissect.s7.syntaxes import r_id_text

        body = request.body
        r_id = body.number("r_id")
        key = f"{transaction.asked_by}/{r_id}"
        operation = transaction.connection.operations.find(BSEND, key)
        if goes_on(head):
            if operation is None:
                return
            operation.add(transaction)
        else:
            if operation is not None:
                self.close(operation, UNFINISHED, "restarted")
            if r_id < 0 or head.last_data_unit == 0:
                return
            operation = self.begin(BSEND, key, transaction, r_id_text(r_id))
            operation.announced = body.number("total_length")
        piece = body.find(BSEND_DATA)
        operation.octets += piece.end - piece.offset if piece is not None else 0
        _join(operation, transaction)
        operation.complete = head.last_data_unit == 0
        if operation.complete and operation.octets != operation.announced and not operation.connection.tcp.has_holes:
            detail = f"{operation.octets} bytes, {operation.announced} announced"
            operation.odd(WRONG_SIZE, detail, int(transaction.request_frame))
        if operation.complete or transaction.error_code:
            self.settle(operation, transaction, DONE, FAILED)

    def _cyclic(self, transaction: Transaction, head: UserdataHead, told: UserdataHead | None) -> None:
        job = told.sequence if told is not None else head.sequence
        going = transaction.connection.operations
        if head.subfunction in _CYCLIC_STARTS:
            self._begin_job(CYCLIC, str(job), transaction)
        elif head.subfunction == CHANGE_DRIVEN_MODIFY:
            changed = going.find(CYCLIC, str(head.sequence))
            if changed is not None:
                changed.add(transaction)
                changed.octets += payload_size(transaction)
        elif head.subfunction == UNSUBSCRIBE:
            from dissect.s7.cyclic import CYCLIC_UNSUBSCRIBE  # late, as the others below: see `Pdu.body`

            body = transaction.request_body
            named = body.find(CYCLIC_UNSUBSCRIBE) if body is not None else None
            stopped = going.find(CYCLIC, str(named.number("job"))) if named is not None else None
            if stopped is not None:
                stopped.add(transaction)
                self.settle(stopped, transaction, DONE, FAILED)

    def _begin_job(self, kind: str, key: str, transaction: Transaction) -> None:
        """Begin a job with the number that the PLC assigned; the one that had this number is over."""
        accepted = _went_well(transaction)
        older = transaction.connection.operations.find(kind, key) if accepted else None
        if older is not None:
            self.close(older, DONE, "number reused")
        operation = self.begin(kind, key, transaction, subject_of(transaction))
        operation.octets = payload_size(transaction)
        if not accepted:
            self.settle(operation, transaction, DONE, REFUSED)

    def _test_job(self, transaction: Transaction, head: UserdataHead, told: UserdataHead | None) -> None:
        going = transaction.connection.operations
        if head.subfunction in _TEST_STARTS:
            number = told.sequence if told is not None else head.sequence
            self._begin_job(TEST_JOB, f"{head.subfunction}/{number}", transaction)
            return
        from dissect.s7.programmer_layouts import JOB

        body = transaction.request_body
        for part in body.data if body is not None else []:
            named = (
                going.find(TEST_JOB, f"{part.number('function')}/{part.number('job')}") if part.layout is JOB else None
            )
            if named is not None:
                named.add(transaction)
                if head.subfunction == DELETE_JOB:
                    self.settle(named, transaction, DONE, FAILED)

    def _messages(self, transaction: Transaction) -> None:
        from dissect.s7.alarm_layouts import MESSAGE_REQUEST
        from dissect.s7.alarms import NO_EVENTS, events_text

        going = transaction.connection.operations
        running = going.find(MESSAGES, str(transaction.asked_by))
        body = transaction.request_body
        asked = body.find(MESSAGE_REQUEST) if body is not None else None
        stops = asked is None or events_text(asked) == NO_EVENTS
        if body is not None and body.number("alarm_type") in _ALARM_ABORTS:
            stops = True
        if running is not None:
            running.add(transaction)
            if stops:
                self.settle(running, transaction, DONE, FAILED)
            return
        if stops:
            return
        operation = self.begin(MESSAGES, str(transaction.asked_by), transaction, subject_of(transaction))
        if transaction.outcome != ANSWERED or transaction.error_code:
            self.settle(operation, transaction, DONE, REFUSED)

    def _push(self, transaction: Transaction) -> None:
        """Something was sent unasked: find the subscription it belongs to."""
        operation = subscription_of(transaction)
        if operation is not None:
            operation.add(transaction)
            operation.pushes += 1
            operation.octets += payload_size(transaction)
        elif not transaction.connection.mid_stream and not transaction.connection.tcp.has_holes:
            transaction.flags |= STRAY_PUSH


def _join(operation: Operation, transaction: Transaction) -> None:
    """Add a part of a long answer or BSEND; with the last one it is whole."""
    from dissect.transactions.multipart import Joiner  # late, as few captures have such things

    going = operation.connection.operations
    if going.joiner is None:
        going.joiner = Joiner()
    chain = going.joiner.feed(transaction)
    if chain is not None:
        operation.content = chain.octets
        operation.content_head = UserdataHead(chain.type, chain.group, chain.subfunction, chain.sequence)


def _from_the_beginning(operation: Operation) -> None:
    """Let an operation begin with its TCP connection, where that was captured."""
    tcp = operation.connection.tcp
    if tcp.known_start:
        operation.begin_ns = int(tcp.first_ns)
        operation.first_frame = int(tcp.first_frame)


def _negotiated(transaction: Transaction) -> str:
    answer = transaction.response_parameters
    granted = answer.setup if answer is not None else None
    asked = transaction.parameters.setup
    if granted is None:
        return f"asks PDU {asked.pdu_length}" if asked is not None else "Setup communication"
    return str(granted)
