"""Operations as lines for a person and as lines of JSON, one for each operation."""

from __future__ import annotations

from typing import Final

from dissect.engine.transactions.operation import (
    LONG_ANSWER,
    NO_FAILURES,
    NOT_CAPTURED,
    POLLING,
    RUNNING,
    TRANSFERS,
    Operation,
)
from dissect.engine.transactions.transaction import CONNECTION_CLOSED
from dissect.meaning.report import facets, words
from dissect.meaning.report.styled import FAILED, HANG, PLAIN, Line
from dissect.meaning.report.words import FRAMES_WIDTH, LATENCY_WIDTH, NUMBER_WIDTH, Places
from dissect.protocols.s7.szl import SZL_HEAD
from dissect.wire.text import Clock, shortened

OPERATION_SCHEMA: Final = "s7dissect.operation/1"

#: The kinds of operations in the words of the output.
NAMES: Final = {
    "connect": "connect",
    "download": "download",
    "upload": "upload",
    "long_answer": "long answer",
    "bsend": "BSEND",
    "cyclic": "cyclic reading",
    "messages": "messages",
    "test_job": "test job",
    "password": "password",
    "session": "session",
    "delete": "delete",
    "control": "control",
    "polling": "polling",
    "transfer": "data transfer",
}
#: The result of an operation that was running when its connection closed.
ENDED: Final = "ended with the connection"
_SUBJECT: Final = 120


def operation_line(operation: Operation, clock: Clock, places: Places) -> str:
    """Return one operation on one line: the time, who asked whom, the duration, kind, amount, and result."""
    ends = operation.connection.tcp.ends
    frames = places.pair(operation.first_frame, operation.last_frame)
    what = shortened(operation.subject, _SUBJECT)
    told = ""
    if operation.kind == LONG_ANSWER:
        # The head of an SZL repeats the subject.
        parts = [part for part in operation.content_parts() if part.layout is not SZL_HEAD]
        told = words.some_notes([part.note for part in parts if part.note])
    what = f"{what} → {told}" if told else what
    said = "  ".join([text for text in (what, _carried(operation), result(operation)) if text])
    return (
        f"{clock.moment(operation.begin_ns)}  #{operation.number:<{NUMBER_WIDTH}} {frames:<{FRAMES_WIDTH}}"
        f" {places.end(ends[operation.asked_by])} → {places.end(ends[1 - operation.asked_by])}"
        f"  {words.answer_time(operation.duration_ns):>{LATENCY_WIDTH}}  {NAMES[operation.kind]}  {said}"
    )


def styled_operation(operation: Operation, clock: Clock, places: Places) -> Line:
    """Return `operation_line` with its style: a failed operation stands out."""
    style = PLAIN if operation.result in NO_FAILURES else FAILED
    return Line(operation_line(operation, clock, places), style, HANG)


def _carried(operation: Operation) -> str:
    """Return the number of transactions and pushes of an operation, their frequency, and the number of bytes carried."""
    pushes = words.count(operation.pushes, "push", "pushes")
    if operation.pushes and operation.pushes == operation.parts:
        parts = [pushes]
    else:
        parts = [words.count(operation.parts, "transaction")] if operation.parts != 1 else []
        if operation.pushes:
            parts.append(f"{pushes} of them")
    each = operation.push_interval_ns
    if operation.kind == POLLING and operation.parts > 1:
        each = operation.duration_ns // int(operation.parts - 1)
    # An average below zero means that the clock of the capture ran backwards.
    if each >= 0 and (operation.pushes > 1 or (operation.kind == POLLING and operation.parts > 1)):
        parts.append(f"one in {words.duration(each)} on average")
    if operation.octets:
        announced = f" of {operation.announced}" if operation.announced not in {-1, operation.octets} else ""
        parts.append(f"{operation.octets}{announced} bytes")
    return ", ".join(parts)


def shouted(text: str) -> str:
    """Return a result for a line: in capitals if the operation failed."""
    if text == NOT_CAPTURED:
        return "outcome not captured"
    return text if text in NO_FAILURES else text.upper()


def result(operation: Operation) -> str:
    """Return the result of an operation, and the reason for it."""
    shout = shouted(operation.result)
    if operation.result == RUNNING and operation.reason == CONNECTION_CLOSED:
        return ENDED
    likely = f"{words.count(operation.likely, 'pair')} only likely" if operation.likely else ""
    if operation.error is not None:
        return f"{shout} {operation.error.coded}{f' ({likely})' if likely else ''}"
    why = facets.REASONS.get(operation.reason, operation.reason)
    odd = "; ".join([shortened(oddity.detail, _SUBJECT) for oddity in operation.oddities])
    late = "" if operation.begun else "beginning not captured"
    told = ", ".join([text for text in (why, late, likely, odd) if text])
    return f"{shout} ({told})" if told else shout


def _blocks(operation: Operation) -> list[str] | None:
    """Return the blocks of a transfer of S7comm-plus, which may carry many; None for other operations."""
    if operation.connection.plus is None or operation.kind not in TRANSFERS or not operation.content:
        return None
    from dissect.engine.program.carved import carve  # imported late: few captures have transfers

    return [block.label for block in carve(operation)]


def operation_json(operation: Operation, clock: Clock, places: Places) -> str:
    """Return one operation as a line of JSON."""
    import json  # imported late, like the facts: text does not need them

    from dissect.meaning.facts.operation import OPERATION
    from dissect.meaning.facts.written import files_of, written

    owned: dict[str, object] = {
        "blocks": _blocks(operation),
        "oddities": [
            {"name": odd.name, "detail": odd.detail, "frame": places.number(odd.frame)} for odd in operation.oddities
        ],
    }
    told = {"schema": OPERATION_SCHEMA, **written(OPERATION, operation, places, clock, owned)}
    if places.several:
        for key in files_of(OPERATION):
            told[key] = told.pop(key)  # these come last
    return json.dumps(told, separators=(",", ":"), ensure_ascii=True).replace("\x7f", "\\u007f")
