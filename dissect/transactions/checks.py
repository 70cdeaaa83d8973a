"""What the octets of a request and its answer say: errors, and where they contradict each other (reference 5.1 and 7.3).

Facts only, kept as `Transaction.flags`; what they are worth is judged elsewhere. The data items are stepped over in place,
because this is done for every answer; nothing is decoded before somebody looks.
"""

from __future__ import annotations

import struct
from typing import Final

from mypy_extensions import i64

from dissect.s7.items import DataItem, Item, data_size_within, parse_data_items, walk_areas
from dissect.s7.message import HEADER_SIZE
from dissect.s7.parameters import Parameters
from dissect.s7.tables import (
    ACK,
    ACK_DATA,
    ANSWER_TRANSPORT_SIZE,
    READ_VAR,
    RECORD_AREA,
    S7ANY,
    SETUP_COMMUNICATION,
    SUCCESS,
    USERDATA,
    WRITE_VAR,
)
from dissect.s7plus.message import parse_plus
from dissect.s7plus.parameters import PlusParameters
from dissect.s7plus.refusals import refuses_items
from dissect.s7plus.tables import ERRORS, refuses
from dissect.transactions.payloads import ScdParameters
from dissect.transactions.transaction import UNCONFIRMED, Transaction
from dissect.wire.build import COMPILED
from dissect.wire.malformed import Malformed
from dissect.wire.octets import u16

# Facts about a transaction (`Transaction.flags`).
FUNCTION_MISMATCH: Final = 1
COUNT_MISMATCH: Final = 2
SIZE_MISMATCH: Final = 4
REORDERED: Final = 8
BAD_DATA: Final = 16
EXPECTED: Final = 32  # a half is missing, and no wonder: mid-stream start, one direction only, or a hole
BAD_REQUEST: Final = 64
WRITE_SIZE: Final = 128  # data of a write have another size than their item
NOT_LOADED: Final = 512  # a block is activated that was not loaded on this connection
STRAY_PUSH: Final = 1024  # a push that belongs to no subscription of this connection
ODD_DATA_CODE: Final = 256  # data of a read came with another transport size than CPUs answer with

_HEAD: Final = struct.Struct(">BBH")


def check_answer(transaction: Transaction, parameters: Parameters, data_at: i64) -> None:
    """Look for errors and contradictions in an answer; ``data_at`` is where its data block begins."""
    buf = transaction.response_buf
    at: i64 = transaction.response_offset
    end: i64 = at + transaction.response_size
    if transaction.response_rosctr >= USERDATA:
        head = parameters.userdata
        if head is not None and head.error_code:
            transaction.error_code = head.error_code
            transaction.has_errors = True
        elif transaction.response_rosctr > USERDATA:
            check_other_answer(transaction)
        return
    code: i64 = u16(buf, at + 10)
    if code:
        transaction.error_code = code
        transaction.has_errors = True
    function: i64 = transaction.parameters.function
    if parameters.function != function or transaction.response_rosctr != ACK_DATA:
        return  # an Ack, or an answer to something else
    if function == READ_VAR:
        if parameters.item_count >= 0 and not (code and data_at == end):
            _check_read(transaction, parameters.item_count, buf, data_at, end)
    elif function == WRITE_VAR:
        if parameters.item_count >= 0 and not (code and data_at == end):
            _check_write(transaction, parameters.item_count, buf, data_at, end)
    elif function == SETUP_COMMUNICATION:
        setup = parameters.setup
        if setup is not None and code == 0:
            transaction.connection.grant(setup, transaction.asked_by)


def check_other_answer(transaction: Transaction) -> None:
    """Look at the return value of an S7comm-plus answer, or what an SCD message says of itself.

    In S7comm-plus a negative value, or a partial error, is an error; in SCD an abort or a negative ``scd_err_t``.
    """
    told = transaction.response_parameters
    if isinstance(told, ScdParameters):
        transaction.error_code = told.err
        transaction.has_errors = told.refused
        return
    pdu = parse_plus(transaction.response_octets)
    code: i64 = pdu.return_code
    if refuses(code):
        transaction.error_code = code
        transaction.has_errors = True
    elif refuses_items(pdu):
        transaction.has_errors = True


def _check_read(transaction: Transaction, count: i64, buf: bytes, at: i64, end: i64) -> None:
    """Step through the data items of a read answer: return codes, sizes against the request, octets against the block."""
    items = transaction.parameters.items
    asked: i64 = transaction.parameters.item_count
    if count != asked and not transaction.parameters.malformed:  # what a broken request asks for nobody can say
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
            size = data_size_within(transport_size, length, end - at)
            if index < known:
                wanted: i64 = items[index].size
                if wanted != size and wanted >= 0:
                    transaction.flags |= SIZE_MISMATCH
                elif wanted < 0:
                    _check_areas(transaction, items[index], buf, at, min(at + size, end))
        else:
            size = 0
            transaction.has_errors = True
        index += 1
        at += size
        if size & 1 and index < count:
            at += 1
    if at != end and not (at + 1 == end and size & 1):
        transaction.flags |= BAD_DATA


def _check_areas(transaction: Transaction, item: Item, buf: bytes, at: i64, end: i64) -> None:
    """Look at the return codes of the areas in the answer to a DBREAD item."""
    areas = item.areas
    if areas is None or not areas:
        return
    told = walk_areas(areas, buf[at:end])
    if not told:
        transaction.flags |= SIZE_MISMATCH
    for area in told:
        if area.return_code != SUCCESS:
            transaction.has_errors = True


def _check_write(transaction: Transaction, count: i64, buf: bytes, at: i64, end: i64) -> None:
    """Look at the return codes of a write answer: one octet for each item."""
    if end - at < transaction.parameters.item_count and transaction.error_code == 0:
        transaction.flags |= UNCONFIRMED
        transaction.has_errors = True
    if count != transaction.parameters.item_count and not transaction.parameters.malformed:
        transaction.flags |= COUNT_MISMATCH
    if end - at != count:
        transaction.flags |= BAD_DATA
    while at < end:
        if buf[at] != SUCCESS:
            transaction.has_errors = True
        at += 1


def mismatch(request: Parameters, answer: Parameters) -> bool:
    """Tell whether an answer names something else than its request: the function, for userdata group and subfunction.

    For SCD it is the service and the object it is about.
    """
    if answer.function < 0:
        return False  # an Ack without parameters
    asked = request.userdata
    told = answer.userdata
    if isinstance(answer, ScdParameters):
        return request.function != answer.function or not (
            isinstance(request, ScdParameters) and request.index == answer.index and request.sub == answer.sub
        )
    if isinstance(answer, PlusParameters):
        return request.function != answer.function and answer.code not in ERRORS
    if asked is not None and told is not None:
        return asked.group != told.group or asked.subfunction != told.subfunction
    return request.function != answer.function


def contradicts(
    request: Transaction, rosctr: i64, parameters: Parameters, buf: bytes, at: i64, size: i64, data_at: i64
) -> bool:
    """Tell whether an answer cannot be that of ``request``: by its function, its item count or the size of its items.

    Asked where holes make it likely that an answer belongs to a request that was not seen.
    """
    if mismatch(request.parameters, parameters):
        return True
    if parameters.function != READ_VAR and parameters.function != WRITE_VAR:
        return False
    trial = Transaction(0, request.connection, request.asked_by, request.rosctr, request.pdu_ref, request.parameters)
    trial.response_buf = buf
    trial.response_offset = at
    trial.response_size = size
    trial.response_rosctr = rosctr
    check_answer(trial, parameters, data_at)
    return trial.flags & (COUNT_MISMATCH | SIZE_MISMATCH) != 0


def check_written(parameters: Parameters, buf: bytes, at: i64, size: i64) -> i64:
    """Hold the data block of a write request to its items; return flags. What was told of its lengths is not told again."""
    data_at: i64 = at + HEADER_SIZE + len(parameters.octets)
    if parameters.malformed or data_at + u16(buf, at + 8) != at + size:
        return 0
    told: list[Malformed] = []
    written = parse_data_items(buf, data_at, at + size, parameters.item_count, False, told)
    if told:
        return BAD_REQUEST
    items = parameters.items
    for index in range(len(written)):
        wanted: i64 = items[index].size
        if wanted >= 0 and wanted != len(written[index].data):
            return WRITE_SIZE
    return 0


def check_data_codes(transaction: Transaction) -> None:
    """Compare the transport sizes of a read answer with those CPUs answer with, for each distinct request once.

    A request of which every item was refused is looked at again with its next answer.
    """
    if transaction.response_rosctr != ACK_DATA or transaction.flags & (COUNT_MISMATCH | BAD_DATA | FUNCTION_MISMATCH):
        return
    items = transaction.parameters.items
    for item, answer in zip(items, transaction.answered_items(), strict=False):
        if answer.return_code == SUCCESS:
            transaction.parameters.answer_unjudged = False
            if odd_data_code(item, answer):
                transaction.flags |= ODD_DATA_CODE


def odd_data_code(item: Item, answer: DataItem) -> bool:
    """Tell whether a good data item has another transport size than CPUs answer its request item with (reference 3.5)."""
    if item.syntax_id != S7ANY or item.area == RECORD_AREA:
        return False
    expected: int = ANSWER_TRANSPORT_SIZE.get(item.transport_size, -1)
    return expected >= 0 and expected != answer.transport_size


def error_code(rosctr: i64, octets: bytes, parameters: Parameters) -> i64:
    """Return the error an answer carries: header class and code, or the userdata error code; 0 for none."""
    head = parameters.userdata
    if head is not None:
        return head.error_code
    if (rosctr == ACK or rosctr == ACK_DATA) and len(octets) >= 12:
        return u16(octets, 10)
    return 0
