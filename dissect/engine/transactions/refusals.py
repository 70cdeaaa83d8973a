"""The return codes of items, read without making objects, for requests with plain items.

See `dissect.protocols.s7.plain_items`.
"""

from __future__ import annotations

from mypy_extensions import i64

from dissect.engine.transactions.transaction import ANSWERED, Transaction
from dissect.protocols.s7.items import DATA_HEAD, data_size_within
from dissect.protocols.s7.parameters import ACK_HEADER_SIZE
from dissect.protocols.s7.tables import ACK_DATA, JOB, READ_VAR, SUCCESS
from dissect.wire.octets import u32


def read_codes(transaction: Transaction) -> list[int] | None:
    """Return the return codes of the data items that answer a plain read; they equal those in `Transaction.s7_results`.

    Return None for any other transaction, and for a read that was refused as a whole.
    """
    answer = transaction.response_parameters
    if answer is None or not transaction.parameters.plain or transaction.parameters.function != READ_VAR:
        return None
    if answer.function != READ_VAR or transaction.response_rosctr != ACK_DATA or transaction.error_code:
        return None
    if transaction._outcome != ANSWERED or transaction.rosctr != JOB:
        return None
    codes: list[int] = []
    buf = transaction._response_buf
    at: i64 = transaction._response_offset + ACK_HEADER_SIZE + len(answer.octets)
    end: i64 = transaction._response_offset + transaction.response_size
    left: i64 = answer.item_count
    while left > 0 and at + DATA_HEAD <= end:
        head: i64 = u32(buf, at)
        at += DATA_HEAD
        codes.append(head >> 24)
        if head >> 24 == SUCCESS:
            size: i64 = data_size_within(head >> 16 & 0xFF, head & 0xFFFF, end - at)
            at += size + (size & 1)  # no item follows the last one, which may lack its fill octet
        left -= 1
    return codes
