"""Requests and answers of a connection: opens, pairs and closes transactions (reference section 5).

`Dialogue` is given every S7 PDU in order. It returns the transaction a PDU completes and puts those that end beside it (a
request whose reference was used again, an orphan that waited long enough) into ``also``. It states facts, as `flags` of the
transaction; what they are worth is judged elsewhere.
"""

from __future__ import annotations

import struct
from typing import Final

from mypy_extensions import i64

from dissect.s7.items import data_size
from dissect.s7.message import parse_pdu
from dissect.s7.parameters import Parameters
from dissect.s7.tables import ACK, ACK_DATA, JOB, READ_VAR, SETUP_COMMUNICATION, SUCCESS, USERDATA, WRITE_VAR
from dissect.transactions.pairing import MAX_OPEN, USERDATA_KEY
from dissect.transactions.table import Side
from dissect.transactions.transaction import (
    ANSWERED,
    CAPTURE_ENDED,
    HOLE,
    ORPHAN,
    PUSH,
    REFERENCE_REUSED,
    TABLE_FULL,
    UNANSWERED,
    Transaction,
)
from dissect.wire.build import COMPILED
from dissect.wire.octets import u16

# Facts about a transaction (`Transaction.flags`).
FUNCTION_MISMATCH: Final = 1
COUNT_MISMATCH: Final = 2
SIZE_MISMATCH: Final = 4
REORDERED: Final = 8
BAD_DATA: Final = 16
EXPECTED_ORPHAN: Final = 32  # mid-stream start, one direction only, or a hole: no wonder

_HEAD: Final = struct.Struct(">BBH")


class Dialogue:
    """Pairs the PDUs of all connections."""

    def __init__(self) -> None:
        self.count: i64 = 0
        self.also: list[Transaction] = []
        self.holding: list[Side] = []  # sides with an answer held since somebody last looked

    def ask(
        self,
        side: Side,
        rosctr: i64,
        pdu_ref: i64,
        parameters: Parameters,
        buf: bytes,
        at: i64,
        size: i64,
        frame: i64,
        time_ns: i64,
    ) -> Transaction | None:
        """A request: open a transaction. Returns it only when its answer was captured before it."""
        connection = side.connection
        side.requests += 1
        self.count += 1
        transaction = Transaction(self.count, connection, side.index, rosctr, pdu_ref, parameters)
        transaction.request_frame = frame
        transaction.request_ns = time_ns
        transaction.request_buf = buf
        transaction.request_offset = at
        transaction.request_size = size
        key: i64 = pdu_ref if rosctr == JOB else pdu_ref | USERDATA_KEY
        requests = connection.open_requests[side.index]
        if requests.orphans is not None:
            orphan = requests.match_orphan(key, side.end_seq)
            if orphan is not None:
                if orphan.response_frame < frame:
                    transaction.flags |= REORDERED
                self._join(transaction, orphan)
                return transaction
        replaced = requests.add(key, transaction)
        while replaced is not None:
            earlier = replaced.earlier
            replaced.earlier = None
            self.also.append(self.unanswered(replaced, REFERENCE_REUSED))
            replaced = earlier
        if requests.count > MAX_OPEN:
            oldest = requests.oldest()
            if oldest is not None:
                self.also.append(self.unanswered(oldest, TABLE_FULL))
        return None

    def answer(
        self,
        side: Side,
        rosctr: i64,
        pdu_ref: i64,
        parameters: Parameters,
        buf: bytes,
        at: i64,
        size: i64,
        data_at: i64,
        frame: i64,
        time_ns: i64,
    ) -> Transaction | None:
        """An answer: complete the oldest request it fits, or hold it for a moment. Returns the completed transaction."""
        connection = side.connection
        requests = connection.open_requests[1 - side.index]
        key: i64 = pdu_ref if rosctr != USERDATA else pdu_ref | USERDATA_KEY
        transaction = requests.take(key)
        if transaction is not None and parameters.function >= 0 and not _same_function(transaction.parameters, parameters):
            if side.holes or (side.peer is not None and side.peer.holes):
                requests.add(key, transaction)  # its own answer, or this one's request, may be in a hole
                transaction = None
            else:
                transaction.flags |= FUNCTION_MISMATCH
        if transaction is None:
            self._orphan(side, key, rosctr, pdu_ref, parameters, buf, at, size, data_at, frame, time_ns)
            return None
        transaction.response_frame = frame
        transaction.response_ns = time_ns
        transaction.response_buf = buf
        transaction.response_offset = at
        transaction.response_size = size
        transaction.response_rosctr = rosctr
        transaction.response_parameters = parameters
        transaction.outcome = ANSWERED
        self._check(transaction, parameters, data_at)
        connection.answered += 1
        return transaction

    def push(
        self,
        side: Side,
        pdu_ref: i64,
        parameters: Parameters,
        buf: bytes,
        at: i64,
        size: i64,
        frame: i64,
        time_ns: i64,
    ) -> Transaction:
        """An unsolicited indication: a transaction of its own, with an answering half only."""
        self.count += 1
        transaction = Transaction(self.count, side.connection, 1 - side.index, USERDATA, pdu_ref, parameters)
        transaction.response_frame = frame
        transaction.response_ns = time_ns
        transaction.response_buf = buf
        transaction.response_offset = at
        transaction.response_size = size
        transaction.response_rosctr = USERDATA
        transaction.response_parameters = parameters
        transaction.outcome = PUSH
        side.connection.unsolicited += 1
        return transaction

    def unanswered(self, transaction: Transaction, reason: str) -> Transaction:
        """Close a request that got no answer."""
        transaction.outcome = UNANSWERED
        transaction.reason = reason
        transaction.connection.unanswered += 1
        return transaction

    def expire(self, side: Side, time_ns: i64) -> None:
        """Give up held answers of ``side`` whose time is over; they go to ``also``."""
        requests = side.connection.open_requests[1 - side.index]
        for transaction in requests.expired_orphans(time_ns, side.tcp.packets):
            self._give_up_orphan(transaction, side)

    def end(self, side: Side, reason: str) -> None:
        """The connection of ``side`` ends: close everything open that ``side`` asked, and held answers to it."""
        connection = side.connection
        requests = connection.open_requests[side.index]
        answering = side.peer
        for transaction in requests.drain():
            lost = answering is not None and answering.hole_frame >= transaction.request_frame
            self.also.append(self.unanswered(transaction, HOLE if lost else reason))
            if reason != CAPTURE_ENDED:
                connection.open_at_end += 1
        if requests.orphans is not None and answering is not None:
            for orphan in requests.orphans:
                self._give_up_orphan(orphan.transaction, answering)
            requests.orphans = None

    def _orphan(
        self,
        side: Side,
        key: i64,
        rosctr: i64,
        pdu_ref: i64,
        parameters: Parameters,
        buf: bytes,
        at: i64,
        size: i64,
        data_at: i64,
        frame: i64,
        time_ns: i64,
    ) -> None:
        transaction = Transaction(0, side.connection, 1 - side.index, rosctr, pdu_ref, parameters)
        transaction.response_frame = frame
        transaction.response_ns = time_ns
        transaction.response_buf = buf
        transaction.response_offset = at
        transaction.response_size = size
        transaction.response_rosctr = rosctr
        transaction.response_parameters = parameters
        transaction.outcome = ORPHAN
        asking = side.peer
        if asking is not None and asking.requests == 0 and side.connection.mid_stream:
            transaction.flags |= EXPECTED_ORPHAN
        requests = side.connection.open_requests[1 - side.index]
        if not side.waiting:
            self.holding.append(side)
        pushed_out = requests.hold_orphan(key, transaction, side.last_ack, side.tcp.packets)
        if pushed_out is not None:
            self._give_up_orphan(pushed_out, side)

    def _give_up_orphan(self, transaction: Transaction, side: Side) -> None:
        """No request turned up: the answer becomes a transaction of its own."""
        self.count += 1
        transaction.number = self.count
        if transaction.rosctr != USERDATA:
            transaction.rosctr = JOB  # what was asked, though nobody saw it
        octets = transaction.response_octets
        transaction.error_code = _error_code(transaction.response_rosctr, octets, transaction.parameters)
        transaction.has_errors = parse_pdu(octets).refused
        asking = side.peer
        if asking is not None and asking.holes:
            transaction.flags |= EXPECTED_ORPHAN
            transaction.reason = HOLE
        side.connection.orphans += 1
        self.also.append(transaction)

    def _join(self, transaction: Transaction, answer: Transaction) -> None:
        """Give a request the answer that was captured before it."""
        parameters = answer.parameters
        if parameters.function >= 0 and not _same_function(transaction.parameters, parameters):
            transaction.flags |= FUNCTION_MISMATCH
        transaction.response_frame = answer.response_frame
        transaction.response_ns = answer.response_ns
        transaction.response_buf = answer.response_buf
        transaction.response_offset = answer.response_offset
        transaction.response_size = answer.response_size
        transaction.response_rosctr = answer.response_rosctr
        transaction.response_parameters = parameters
        transaction.outcome = ANSWERED
        head: i64 = 12 if answer.response_rosctr == ACK or answer.response_rosctr == ACK_DATA else 10
        self._check(transaction, parameters, answer.response_offset + head + len(parameters.octets))
        transaction.connection.answered += 1

    def _check(self, transaction: Transaction, parameters: Parameters, data_at: i64) -> None:
        """Look for errors and contradictions in an answer; ``data_at`` is where its data block begins."""
        buf = transaction.response_buf
        at: i64 = transaction.response_offset
        end: i64 = at + transaction.response_size
        if transaction.response_rosctr == USERDATA:
            head = parameters.userdata
            if head is not None and head.error_code:
                transaction.error_code = head.error_code
                transaction.has_errors = True
            return
        code: i64 = u16(buf, at + 10)
        if code:
            transaction.error_code = code
            transaction.has_errors = True
        function: i64 = transaction.parameters.function
        if function == READ_VAR:
            if parameters.item_count >= 0 and not (code and data_at == end):
                self._check_read(transaction, parameters.item_count, buf, data_at, end)
        elif function == WRITE_VAR:
            if parameters.item_count >= 0 and not (code and data_at == end):
                self._check_write(transaction, parameters.item_count, buf, data_at, end)
        elif function == SETUP_COMMUNICATION:
            setup = parameters.setup
            if setup is not None and code == 0:
                transaction.connection.grant(setup)

    def _check_read(self, transaction: Transaction, count: i64, buf: bytes, at: i64, end: i64) -> None:
        """Step through the data items of a read answer: return codes, sizes against the request, octets against the block."""
        items = transaction.parameters.items
        asked: i64 = transaction.parameters.item_count
        if count != asked:
            transaction.flags |= COUNT_MISMATCH
        known: i64 = len(items)
        index: i64 = 0
        size: i64 = 0
        while index < count:
            if at + 4 > end:
                transaction.flags |= BAD_DATA
                return
            return_code: i64
            transport_size: i64
            length: i64
            if COMPILED:
                return_code = buf[at]
                transport_size = buf[at + 1]
                length = u16(buf, at + 2)
            else:
                return_code, transport_size, length = _HEAD.unpack_from(buf, at)
            at += 4
            if return_code == SUCCESS:
                size = data_size(transport_size, length)
                if index < known:
                    wanted: i64 = items[index].size
                    if wanted != size and wanted >= 0:
                        transaction.flags |= SIZE_MISMATCH
            else:
                size = 0
                transaction.has_errors = True
            index += 1
            at += size
            if size & 1 and index < count:
                at += 1
        if at != end and not (at + 1 == end and size & 1):
            transaction.flags |= BAD_DATA

    def _check_write(self, transaction: Transaction, count: i64, buf: bytes, at: i64, end: i64) -> None:
        """Look at the return codes of a write answer: one octet for each item."""
        if count != transaction.parameters.item_count:
            transaction.flags |= COUNT_MISMATCH
        if end - at != count:
            transaction.flags |= BAD_DATA
        while at < end:
            if buf[at] != SUCCESS:
                transaction.has_errors = True
            at += 1


def _same_function(request: Parameters, answer: Parameters) -> bool:
    """Tell whether an answer's parameters fit the request's: the function, for userdata group and subfunction."""
    asked = request.userdata
    told = answer.userdata
    if asked is not None and told is not None:
        return asked.group == told.group and asked.subfunction == told.subfunction
    return request.function == answer.function


def _error_code(rosctr: i64, octets: bytes, parameters: Parameters) -> i64:
    """Return the error an answer carries: header class and code, or the userdata error code; 0 for none."""
    head = parameters.userdata
    if head is not None:
        return head.error_code
    if (rosctr == ACK or rosctr == ACK_DATA) and len(octets) >= 12:
        return u16(octets, 10)
    return 0


