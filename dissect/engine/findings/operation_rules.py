"""Findings about operations: those that failed or stopped early, and those with contradictions (reference 7.3)."""

from __future__ import annotations

from typing import Final

from dissect.engine.findings.reporter import Reporter
from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.operation import (
    BEYOND_END,
    BSEND,
    CUT_SHORT,
    DOWNLOAD,
    FAILED,
    LONG_ANSWER,
    UNFINISHED,
    UPLOAD,
    WRONG_ID,
    WRONG_SIZE,
    Operation,
)
from dissect.engine.transactions.results import NOT_LOADED, STRAY_PUSH
from dissect.engine.transactions.transaction import CAPTURE_ENDED, HOLE, Transaction

_TRANSFERS: Final = frozenset((DOWNLOAD, UPLOAD, BSEND, LONG_ANSWER))
#: An answer in parts that is longer than this is called endless: no device has a list this long.
_ENDLESS_OCTETS: Final = 1 << 20
#: At the end of the capture, a transfer counts as stopped if its last step is older than this.
_STOPPED_NS: Final = 1_000_000_000
#: At the end of the capture, a block loaded longer ago than this should have been activated.
_FORGOTTEN_NS: Final = 30_000_000_000
_SYSTEM_DATA: Final = "SDB "
_ODDITIES: Final = {
    BEYOND_END: "operation.beyond_end",
    CUT_SHORT: "operation.cut_short",
    WRONG_ID: "operation.wrong_id",
    WRONG_SIZE: "operation.wrong_size",
}


def judge_operation(reporter: Reporter, operation: Operation) -> None:
    """Note what is odd about a finished operation.

    A single request that was refused or not answered is reported with its transaction. These findings are only about operations
    that had begun.
    """
    for oddity in operation.oddities:
        _note(reporter, _ODDITIES[oddity.name], operation, oddity.detail, oddity.frame)
    if operation.result == FAILED:
        why = operation.error.coded if operation.error is not None else operation.reason
        _note(reporter, "operation.failed", operation, why, operation.last_frame)
    elif operation.result == UNFINISHED and operation.kind in _TRANSFERS and _ought_to_end(operation):
        size = f"{operation.octets} of {operation.announced}" if operation.announced >= 0 else str(operation.octets)
        slug = "operation.upload_unfinished" if operation.kind == UPLOAD else "operation.unfinished"
        _note(reporter, slug, operation, f"after {size} bytes", operation.last_frame)


def _ought_to_end(operation: Operation) -> bool:
    """Return whether the operation should have ended within the captured time."""
    tcp = operation.connection.tcp
    if operation.reason == HOLE or tcp.has_holes:
        return False
    if operation.reason != CAPTURE_ENDED:
        return True
    endless = operation.kind == LONG_ANSWER and operation.octets > _ENDLESS_OCTETS
    return endless or tcp.last_ns - operation.end_ns > _STOPPED_NS


def judge_loaded(reporter: Reporter, connection: Connection, reason: str) -> None:
    """Note loaded blocks that were neither activated nor deleted before their connection was over.

    Note nothing if a gap may hide the activation, or if the capture may have ended before it. System data blocks are left out:
    they take effect with a restart.
    """
    if connection.tcp.has_holes:
        return
    for loaded in connection.traits.loaded.values():
        if not loaded.due or loaded.name.startswith(_SYSTEM_DATA):
            continue
        if reason == CAPTURE_ENDED and connection.tcp.last_ns - loaded.time_ns <= _FORGOTTEN_NS:
            continue
        reporter.note("block.not_activated", connection.number, loaded.frames, loaded.time_ns, loaded.name)


def judge_strays(reporter: Reporter, transaction: Transaction) -> None:
    """Note a push whose subscription was not captured, and the activation of a block that was not loaded."""
    connection = transaction.connection
    time_ns = max(int(transaction.request_ns), int(transaction.response_ns))
    frames = [int(transaction.response_frame)]
    if transaction._flags & STRAY_PUSH and reporter.first(connection, "operation.stray_push", frames[0], time_ns):
        reporter.note("operation.stray_push", connection.number, frames, time_ns, transaction.function_name)
    if transaction._flags & NOT_LOADED:
        asked = transaction.request
        notes = ", ".join(asked.body.notes) if asked is not None else ""
        reporter.note("operation.not_loaded", connection.number, [int(transaction.request_frame)], time_ns, notes)


def _note(reporter: Reporter, slug: str, operation: Operation, what: str, frame: int) -> None:
    number = operation.connection.number
    if reporter.wants(slug, number, operation.first_frame, frame, operation.end_ns):
        detail = f"{operation.kind.replace('_', ' ')} {operation.subject}: {what}"
        reporter.detail(slug, number, sorted({operation.first_frame, frame}), operation.end_ns, detail)
