"""`Operations`: combines transactions that belong together into operations (reference 3.7, 3.8, 4.3, 4.7 to 4.11).

It takes every transaction except reads and writes, in the order in which they end, and collects finished operations in
``over``. It only states facts; findings are made elsewhere. Downloads and uploads are followed by
`dissect.engine.transactions.transfers`; operations of a single command, such as a stop, are made by `dissect.engine.acts.book`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.operation import (
    BSEND,
    CONNECT,
    CYCLIC,
    DONE,
    FAILED,
    LONG_ANSWER,
    MAX_SUBJECT,
    MESSAGES,
    NOT_CAPTURED,
    POLLING,
    REFUSED,
    RUNNING,
    SESSION,
    TEST_JOB,
    UNFINISHED,
    WRONG_SIZE,
    Operation,
    OperationBook,
)
from dissect.engine.transactions.results import STRAY_PUSH, half_captured
from dissect.engine.transactions.transaction import ANSWERED, ORPHAN, PUSH, UNANSWERED, Transaction
from dissect.protocols.s7.layouts import DATA_HEAD
from dissect.protocols.s7.parameters import HEADER_SIZE, UserdataHead
from dissect.protocols.s7.tables import (
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
    END_UPLOAD,
    FORCE_VARIABLES,
    GROUP_CPU,
    GROUP_CYCLIC,
    GROUP_MODE,
    GROUP_PBC,
    GROUP_TEST,
    LOCKED,
    MESSAGE_SERVICE,
    MODIFY_VARIABLE,
    NOTIFY,
    NOTIFY_8,
    READ_SZL,
    REQUEST_DOWNLOAD,
    SCAN,
    SETUP_COMMUNICATION,
    UNLOCKED,
    UNSUBSCRIBE,
    USERDATA,
    VARIABLE_STATUS,
)
from dissect.wire.octets import u16

if TYPE_CHECKING:
    from dissect.engine.transactions.transfers import Transfers

_CYCLIC_STARTS: Final = frozenset((CYCLIC_TRANSFER, CHANGE_DRIVEN))
_ALARM_PUSHES: Final = frozenset((
    DIAGNOSTIC_MESSAGE, ALARM_8, NOTIFY, SCAN, ACKNOWLEDGED, LOCKED, UNLOCKED, AR_SEND, ALARM_SQ, ALARM_S, NOTIFY_8,
))  # fmt: skip
#: Alarm types of a message service that end a subscription (reference 4.9).
_ALARM_ABORTS: Final = frozenset((0, 4, 6, 8))
_TEST_STARTS: Final = frozenset((BLOCK_STATUS_JOB, VARIABLE_STATUS, MODIFY_VARIABLE, FORCE_VARIABLES, BLOCK_STATUS_V2))

#: Kinds that continue until they are stopped.
ENDLESS: Final = frozenset((CYCLIC, MESSAGES, TEST_JOB, SESSION, POLLING))
#: Offset of the length of the data block in the header.
_DATA_LENGTH_AT: Final = 8
#: Protocols of connections on which Setup communication is expected: S7comm, and connections without any message.
_OURS: Final = frozenset(("", "s7comm"))


def _went_well(transaction: Transaction) -> bool:
    """Return whether a request was accepted; if only the answer was captured, it counts alone."""
    answered = transaction._outcome == ANSWERED or (transaction._outcome == ORPHAN and half_captured(transaction))
    return answered and not transaction.refused


def subject_of(transaction: Transaction) -> str:
    """Return the subject of a request: the notes of its parts, or else its function; text from the wire, not escaped."""
    body = transaction.request_body
    notes = dict.fromkeys(body.notes) if body is not None else {}
    return ", ".join(notes)[:MAX_SUBJECT] or transaction.function_name


def _joined(subject: str, more: str) -> str:
    """Return the subject of a repeated subscription: the messages so far (``subject``) and ``more``."""
    words = dict.fromkeys(subject.split(", "))
    for word in more.removeprefix("events: ").split(", "):
        if word not in words and f"events: {word}" not in words:
            words[word] = None
    return ", ".join(words)[:MAX_SUBJECT]


def payload_size(transaction: Transaction) -> int:
    """Return the size of the payload of a userdata answer or push, which is its data block without the head."""
    if transaction.response_size < HEADER_SIZE:
        return 0
    stated = u16(transaction._response_buf, transaction._response_offset + _DATA_LENGTH_AT)
    return max(int(stated) - DATA_HEAD.size, 0)


def subscription_of(push: Transaction) -> Operation | None:
    """Return the open operation that a push of S7comm belongs to, None if there is none."""
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
        """Take a finished transaction: it may begin an operation, belong to one, or end one."""
        parameters = transaction.parameters
        head = parameters.userdata
        if head is not None:
            if transaction.rosctr == USERDATA:
                self._userdata(transaction, head)
        elif parameters.function == SETUP_COMMUNICATION:
            self._set_up(transaction)
        elif REQUEST_DOWNLOAD <= parameters.function <= END_UPLOAD:
            if self._transfers is None:
                # imported late, because few captures have transfers
                from dissect.engine.transactions.transfers import Transfers

                self._transfers = Transfers(self)
            self._transfers.take(transaction)

    def end(self, connection: Connection, reason: str) -> None:
        """A connection is over: close its operations. ``reason`` is one of the reasons of transactions."""
        if connection.cr_seen and not connection.operations.set_up and connection.protocol in _OURS:
            self._never_set_up(connection, reason)
        if self._transfers is not None and connection.operations.halves:
            self._transfers.follow_halves(connection)
        for operation in list(connection.operations.these):
            if operation.kind in ENDLESS:
                self.close(operation, RUNNING, reason)
            else:
                self.break_off(operation, reason)

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
        if transaction._outcome == PUSH:
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

    def _part_of_long_answer(self, transaction: Transaction, head: UserdataHead, told: UserdataHead | None) -> bool:
        """Follow an answer in parts: the first part says that more follow, which are then requested by its sequence number.

        Return False for an answer in one part.
        """
        more = told is not None and told.last_data_unit != 0
        if not more and not transaction.connection.operations.these:
            return False  # an answer in one part, as most are
        sequence = told.sequence if told is not None else head.sequence
        if transaction.refused and head.sequence:
            sequence = head.sequence  # a refusal of a further part need not name the answer
        key = f"{head.group}/{head.subfunction}/{sequence}"
        operation = transaction.connection.operations.find(LONG_ANSWER, key)
        if operation is not None and head.sequence == sequence:
            operation._add(transaction)
        elif more:
            if operation is not None:
                self.close(operation, UNFINISHED, "restarted")
            operation = self.begin(LONG_ANSWER, key, transaction, subject_of(transaction))
        else:
            return False
        operation.octets += payload_size(transaction)
        _join(operation, transaction)
        if (
            not more
            and transaction._outcome == ANSWERED
            and not operation.content
            and transaction.connection.tcp.has_holes
        ):
            self.close(operation, NOT_CAPTURED)  # a part is in a gap
        elif transaction._outcome == UNANSWERED or transaction.refused or not more:
            self.settle(operation, transaction, DONE, FAILED)
        return True

    def _send(self, transaction: Transaction, head: UserdataHead) -> None:
        """Follow a BSEND in pieces, each answered by the partner; a BSEND in one PDU is not an operation."""
        body = transaction.request_body
        if body is None:
            return
        from dissect.protocols.s7.pbc import BSEND_DATA, goes_on  # imported late: see `Pdu.body`
        from dissect.protocols.s7.syntaxes import r_id_text

        r_id = body.number("r_id")
        key = f"{transaction.asked_by}/{r_id}"
        operation = transaction.connection.operations.find(BSEND, key)
        if goes_on(head):
            if operation is None:
                return
            operation._add(transaction)
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
            operation._odd(WRONG_SIZE, detail, int(transaction.request_frame))
        if operation.complete or transaction.refused:
            self.settle(operation, transaction, DONE, FAILED)

    def _cyclic(self, transaction: Transaction, head: UserdataHead, told: UserdataHead | None) -> None:
        job = told.sequence if told is not None else head.sequence
        going = transaction.connection.operations
        if head.subfunction in _CYCLIC_STARTS:
            self._begin_job(CYCLIC, str(job), transaction)
        elif head.subfunction == CHANGE_DRIVEN_MODIFY:
            changed = going.find(CYCLIC, str(head.sequence))
            if changed is not None:
                changed._add(transaction)
                changed.octets += payload_size(transaction)
        elif head.subfunction == UNSUBSCRIBE:
            # imported late, like the others below: see `Pdu.body`
            from dissect.protocols.s7.cyclic import CYCLIC_UNSUBSCRIBE

            body = transaction.request_body
            named = body.find(CYCLIC_UNSUBSCRIBE) if body is not None else None
            stopped = going.find(CYCLIC, str(named.number("job"))) if named is not None else None
            if stopped is not None:
                stopped._add(transaction)
                self.settle(stopped, transaction, DONE, FAILED)

    def _begin_job(self, kind: str, key: str, transaction: Transaction) -> None:
        """Begin a job with the number that the PLC assigned; an older job with this number is over."""
        accepted = _went_well(transaction)
        older = transaction.connection.operations.find(kind, key) if accepted else None
        if older is not None:
            self.close(older, DONE, "number reused")
        subject = subject_of(transaction)
        if kind == TEST_JOB:
            head = transaction.parameters.userdata
            subject = f"{head.subfunction_name}: {subject}" if head is not None else subject
        operation = self.begin(kind, key, transaction, subject)
        operation.octets = payload_size(transaction)
        if not accepted:
            self.settle(operation, transaction, DONE, REFUSED)

    def _test_job(self, transaction: Transaction, head: UserdataHead, told: UserdataHead | None) -> None:
        going = transaction.connection.operations
        if head.subfunction in _TEST_STARTS:
            number = told.sequence if told is not None else head.sequence
            self._begin_job(TEST_JOB, f"{head.subfunction}/{number}", transaction)
            return
        from dissect.protocols.s7.programmer_layouts import JOB

        body = transaction.request_body
        for part in body.data if body is not None else []:
            named = (
                going.find(TEST_JOB, f"{part.number('function')}/{part.number('job')}") if part.layout is JOB else None
            )
            if named is not None:
                named._add(transaction)
                if head.subfunction == DELETE_JOB:
                    self.settle(named, transaction, DONE, FAILED)

    def _messages(self, transaction: Transaction) -> None:
        from dissect.protocols.s7.alarm_layouts import MESSAGE_REQUEST
        from dissect.protocols.s7.alarms import NO_EVENTS, events_text

        going = transaction.connection.operations
        running = going.find(MESSAGES, str(transaction.asked_by))
        body = transaction.request_body
        asked = body.find(MESSAGE_REQUEST) if body is not None else None
        stops = asked is None or events_text(asked) == NO_EVENTS
        if body is not None and body.number("alarm_type") in _ALARM_ABORTS:
            stops = True
        if running is not None:
            running._add(transaction)
            if stops:
                self.settle(running, transaction, DONE, FAILED)
            elif not transaction.refused:
                running.subject = _joined(running.subject, subject_of(transaction))
            return
        if stops:
            return
        operation = self.begin(MESSAGES, str(transaction.asked_by), transaction, subject_of(transaction))
        if transaction._outcome != ANSWERED or transaction.refused:
            self.settle(operation, transaction, DONE, REFUSED)

    def _push(self, transaction: Transaction) -> None:
        """Take a push and find its subscription."""
        operation = subscription_of(transaction)
        if operation is not None:
            operation._push(transaction, payload_size(transaction))
        elif not transaction.connection.mid_stream and not transaction.connection.tcp.has_holes:
            head = transaction.parameters.userdata
            if head is None or not head.usend:  # a USEND comes from the PLC's program and needs no subscription
                transaction._flags |= STRAY_PUSH


def _join(operation: Operation, transaction: Transaction) -> None:
    """Add a part of a long answer or BSEND; the last one gives the operation its ``content``."""
    from dissect.engine.transactions.multipart import Joiner  # imported late, because few captures have long answers

    going = operation.connection.operations
    if going.joiner is None:
        going.joiner = Joiner()
    chain = going.joiner.feed(transaction)
    if chain is not None:
        operation.content = chain.octets
        operation.places = chain.places
        operation.content_head = UserdataHead(chain.type, chain.group, chain.subfunction, chain.sequence)
        if chain.group == GROUP_CPU and chain.subfunction == READ_SZL:
            _hold_to_its_head(operation, int(transaction.response_frame))


def _hold_to_its_head(operation: Operation, frame: int) -> None:
    """Note an SZL in parts that has fewer records than its head states; packet ``frame`` ends it."""
    from dissect.protocols.s7.szl import shortage, stated_size  # imported late: see `Pdu.body`

    octets = operation.content
    operation.announced = stated_size(octets)
    lacking = operation.announced - len(octets)
    if lacking > 0:
        length, count = u16(octets, 4), u16(octets, 6)
        detail = shortage(u16(octets, 0), length, count, length * count - lacking)
        operation._odd(WRONG_SIZE, detail, frame)


def _from_the_beginning(operation: Operation) -> None:
    """Let an operation begin with the SYN of its TCP connection, if the SYN was captured."""
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
