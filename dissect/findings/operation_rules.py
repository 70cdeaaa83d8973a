"""What is worth saying about an operation: that it failed or stopped, and where it contradicts itself (reference 7.3)."""

from __future__ import annotations

from typing import Final

from dissect.findings.reporter import Reporter
from dissect.s7.errors import ERROR_CODES
from dissect.transactions.checks import NOT_LOADED, STRAY_PUSH
from dissect.transactions.operation import (
    BEYOND_END,
    BSEND,
    CUT_SHORT,
    DOWNLOAD,
    FAILED,
    UNFINISHED,
    UPLOAD,
    WRONG_ID,
    WRONG_SIZE,
    Operation,
)
from dissect.transactions.transaction import CAPTURE_ENDED, HOLE, Transaction

_TRANSFERS: Final = frozenset((DOWNLOAD, UPLOAD, BSEND))
_ODDITIES: Final = {
    BEYOND_END: "operation.beyond_end",
    CUT_SHORT: "operation.cut_short",
    WRONG_ID: "operation.wrong_id",
    WRONG_SIZE: "operation.wrong_size",
}


def judge_operation(judge: Reporter, operation: Operation) -> None:
    """Note what is odd about an operation that is over.

    That a single request was refused or not answered is said of its transaction; here it counts what had begun before.
    """
    for oddity in operation.oddities:
        _note(judge, _ODDITIES[oddity.name], operation, oddity.detail, oddity.frame)
    if operation.result == FAILED:
        code = operation.error_code
        why = f"0x{code:04x} {ERROR_CODES.name(code)}" if code else operation.reason
        _note(judge, "operation.failed", operation, why, operation.last_frame)
    elif operation.result == UNFINISHED and operation.kind in _TRANSFERS and _ought_to_end(operation):
        size = f"{operation.octets} of {operation.announced}" if operation.announced >= 0 else str(operation.octets)
        _note(judge, "operation.unfinished", operation, f"after {size} octets", operation.last_frame)


def _ought_to_end(operation: Operation) -> bool:
    """Tell whether the end is missing for another reason than the capture's."""
    return operation.reason not in {CAPTURE_ENDED, HOLE} and not operation.connection.tcp.has_holes


def judge_strays(judge: Reporter, transaction: Transaction) -> None:
    """Note a push without a subscription, and the activation of a block that was not loaded."""
    connection = transaction.connection
    time_ns = max(int(transaction.request_ns), int(transaction.response_ns))
    if transaction.flags & STRAY_PUSH and connection.traits.first("operation.stray_push"):
        frames = [int(transaction.response_frame)]
        judge.note("operation.stray_push", connection.number, frames, time_ns, transaction.function_name)
    if transaction.flags & NOT_LOADED:
        asked = transaction.request
        notes = ", ".join(asked.body.notes) if asked is not None else ""
        judge.note("operation.not_loaded", connection.number, [int(transaction.request_frame)], time_ns, notes)


def _note(judge: Reporter, slug: str, operation: Operation, what: str, frame: int) -> None:
    number = operation.connection.number
    if judge.wants(slug, number):
        detail = f"{operation.kind.replace('_', ' ')} {operation.subject}: {what}"
        judge.detail(slug, number, sorted({operation.first_frame, frame}), operation.end_ns, detail)
