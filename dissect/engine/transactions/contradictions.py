"""Finds out whether an answer cannot belong to a request, if one of the two was probably not captured because of gaps."""

from __future__ import annotations

from mypy_extensions import i64

from dissect.engine.transactions.checks import check_answer
from dissect.engine.transactions.results import COUNT_MISMATCH, SIZE_MISMATCH, mismatch
from dissect.engine.transactions.transaction import Transaction
from dissect.protocols.s7.items import begin_alike
from dissect.protocols.s7.parameters import Parameters, header_size
from dissect.protocols.s7.tables import ACK_DATA, READ_VAR, WRITE_VAR


def is_strange(request: Transaction, answer: Transaction) -> bool:
    """Return whether a held answer cannot belong to ``request``."""
    rosctr: i64 = answer.response_rosctr
    at: i64 = answer._response_offset
    parameters = answer.parameters
    data_at: i64 = at + header_size(rosctr) + len(parameters.octets)
    return contradicts(request, rosctr, parameters, answer._response_buf, at, answer.response_size, data_at)


def contradicts(
    request: Transaction, rosctr: i64, parameters: Parameters, buf: bytes, at: i64, size: i64, data_at: i64
) -> bool:
    """Return whether an answer cannot belong to a request, judged by its function, its item count or the size of its items."""
    asked = request.parameters
    if (
        rosctr == ACK_DATA
        and parameters.function == READ_VAR == asked.function
        and parameters.item_count == asked.item_count
        and begin_alike(asked.good_answer, buf, data_at, at + size)
    ):
        return False  # `check_answer` would find nothing; this saves time when gaps make every answer come here
    if mismatch(asked, parameters):
        return True
    if parameters.function != READ_VAR and parameters.function != WRITE_VAR:
        return False
    # Put the answer into `request` to check it, then restore `request`: this is cheaper than a new transaction.
    flags: i64 = request._flags
    request._flags = 0
    request._response_buf = buf
    request._response_offset = at
    request.response_size = size
    request.response_rosctr = rosctr
    check_answer(request, parameters, data_at)
    found: i64 = request._flags
    request._flags = flags
    request.has_errors = False
    request.error_code = 0
    request._response_buf = b""
    request._response_offset = 0
    request.response_size = 0
    request.response_rosctr = 0
    return found & (COUNT_MISMATCH | SIZE_MISMATCH) != 0
