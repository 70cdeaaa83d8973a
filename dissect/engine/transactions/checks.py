"""The first check of an answer: whether it refuses something, and whether it matches its request (reference 5.1 and 7.3).

`check_answer` checks every answer. It steps over the items without making objects of them; objects are made only when
`Transaction.s7_results` is read.
"""

from __future__ import annotations

from mypy_extensions import i64

from dissect.engine.transactions.results import (
    BAD_DATA,
    COUNT_MISMATCH,
    FUNCTION_MISMATCH,
    ODD_DATA_CODE,
    SIZE_MISMATCH,
    UNCONFIRMED,
    check_other_answer,
)
from dissect.engine.transactions.transaction import Transaction
from dissect.protocols.s7.items import (
    DATA_HEAD,
    Item,
    begin_alike,
    data_size_within,
    item_heads,
    odd_data_code,
    walk_areas,
)
from dissect.protocols.s7.parameters import ACK_HEADER_SIZE, Parameters
from dissect.protocols.s7.plain_items import plain_answered_as, plainly_answered
from dissect.protocols.s7.tables import ACK_DATA, READ_VAR, SETUP_COMMUNICATION, SUCCESS, USERDATA, WRITE_VAR
from dissect.wire.build import COMPILED
from dissect.wire.octets import u16, u32


def check_answer(transaction: Transaction, parameters: Parameters, data_at: i64) -> None:
    """Find errors and contradictions in an answer; ``data_at`` is where its data block begins in `response_buf`."""
    buf = transaction._response_buf
    at: i64 = transaction._response_offset
    end: i64 = at + transaction.response_size
    if transaction.response_rosctr >= USERDATA:
        head = parameters.userdata
        if head is not None and head.error_code:
            transaction.error_code = head.error_code
            transaction.has_errors = True
        else:
            check_other_answer(transaction)
        return
    code: i64 = 0
    if buf[at + 10] or buf[at + 11]:
        transaction.error_code = code = u16(buf, at + 10)
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
            transaction.connection._grant(setup, transaction.asked_by)


def _check_read(transaction: Transaction, count: i64, buf: bytes, at: i64, end: i64) -> None:
    """Step through the data items of a read answer: check return codes, sizes against the request, and the block's length."""
    parameters = transaction.parameters
    expected = count == parameters.item_count
    if expected and begin_alike(parameters.good_answer, buf, at, end):
        return
    if expected and parameters.plain and plainly_answered(parameters.octets, buf, at, end):
        if parameters.answer_unjudged:
            parameters.answer_unjudged = False
        else:  # many reads occur only once, so the data for comparison with later answers are stored at the second
            _keep_good(transaction, count, buf, at, end)
        return
    if not expected and not parameters.malformed:
        transaction._flags |= COUNT_MISMATCH  # not for a malformed request, whose item count is unreliable
    known: i64 = parameters.known_items
    good = expected and known == count
    begin: i64 = at
    index: i64 = 0
    size: i64 = 0
    while index < count:
        room: i64 = end - at - 4
        if room < 0:
            transaction._flags |= BAD_DATA
            return
        head = u32(buf, at)
        at += 4
        if head >> 24 == SUCCESS:
            size = data_size_within(head >> 16 & 0xFF, head & 0xFFFF, room)
            if index < known and not _check_size(transaction, index, buf, at, size, end):
                good = False
        else:
            size = 0
            transaction.has_errors = True
            good = False
        index += 1
        at += size
        if size & 1 and index < count:
            at += 1
    if at != end and not (at + 1 == end and size & 1):
        transaction._flags |= BAD_DATA
    elif good:
        _keep_good(transaction, count, buf, begin, end)


def _keep_good(transaction: Transaction, count: i64, buf: bytes, at: i64, end: i64) -> None:
    """Store the data for the comparison with later answers: ``buf[at:end]`` are the data items of a good answer."""
    parameters = transaction.parameters
    parameters.good_answer = item_heads(count, buf, at, end)
    if not COMPILED:
        parameters.keep_layout(buf, transaction._response_offset, at)


def _check_size(transaction: Transaction, index: i64, buf: bytes, at: i64, size: i64, end: i64) -> bool:
    """Compare the size of a data item with the requested size; return whether they agree and nothing else may vary."""
    wanted: i64 = transaction.parameters.size_of(index)
    if wanted < 0:
        _check_areas(transaction, transaction.parameters.items[index], buf, at, min(at + size, end))
        return False
    if wanted != size:
        transaction._flags |= SIZE_MISMATCH
        return False
    return True


def _check_areas(transaction: Transaction, item: Item, buf: bytes, at: i64, end: i64) -> None:
    """Check the return codes of the areas in the answer to a DBREAD item."""
    areas = item.areas
    if areas is None or not areas:
        return
    told = walk_areas(areas, buf[at:end])
    if not told:
        transaction._flags |= SIZE_MISMATCH
    for area in told:
        if area.return_code != SUCCESS:
            transaction.has_errors = True


def _check_write(transaction: Transaction, count: i64, buf: bytes, at: i64, end: i64) -> None:
    """Check the return codes of a write answer, one octet for each item."""
    if end - at < transaction.parameters.item_count and transaction.error_code == 0:
        transaction._flags |= UNCONFIRMED
        transaction.has_errors = True
    if count != transaction.parameters.item_count and not transaction.parameters.malformed:
        transaction._flags |= COUNT_MISMATCH
    if end - at != count:
        transaction._flags |= BAD_DATA
    while at < end:
        if buf[at] != SUCCESS:
            transaction.has_errors = True
        at += 1


def check_data_codes(transaction: Transaction) -> None:
    """Compare the transport sizes of a read answer with those that CPUs use; done once for each distinct request.

    A request whose items were all refused is checked again with its next answer.
    """
    if transaction.response_rosctr != ACK_DATA or transaction._flags & (COUNT_MISMATCH | BAD_DATA | FUNCTION_MISMATCH):
        return
    if transaction.parameters.plain:
        _check_plain_codes(transaction, transaction.parameters)
        return
    for result in transaction.s7_results:
        item = result.item
        answer = result.answer
        if item is not None and answer is not None and answer.return_code == SUCCESS:
            transaction.parameters.answer_unjudged = False
            if odd_data_code(item, answer):
                transaction._flags |= ODD_DATA_CODE


def _check_plain_codes(transaction: Transaction, asked: Parameters) -> None:
    """Do the same for a plain block, without results; `check_answer` found that the data items of the answer are whole."""
    answer = transaction.response_parameters
    if answer is None or answer.function != READ_VAR:
        return
    buf = transaction._response_buf
    at: i64 = transaction._response_offset + ACK_HEADER_SIZE + len(answer.octets)
    end: i64 = transaction._response_offset + transaction.response_size
    index: i64 = 0
    while index < answer.item_count and at + DATA_HEAD <= end:
        head: i64 = u32(buf, at)
        transport_size: i64 = head >> 16 & 0xFF
        at += DATA_HEAD
        if head >> 24 == SUCCESS:
            asked.answer_unjudged = False
            expected: i64 = plain_answered_as(asked.octets, index)
            if expected and expected != transport_size:
                transaction._flags |= ODD_DATA_CODE
            size: i64 = data_size_within(transport_size, head & 0xFFFF, end - at)
            at += size + (size & 1)  # no item follows the last one, which may lack its fill octet
        index += 1
