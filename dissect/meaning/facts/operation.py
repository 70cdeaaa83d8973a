"""The facts of an operation, and those of an act."""

from __future__ import annotations

from typing import Any, Final

from dissect.engine.acts.act import Act
from dissect.engine.transactions.operation import KINDS, NO_FAILURES, RESULTS, Operation
from dissect.meaning.facts.fact import (
    CODE,
    COUNT,
    COUNTS,
    DURATION,
    END,
    FILE,
    FLAG,
    FRAME,
    JSON,
    TEXT,
    TIME,
    WORD,
    WORDS,
    Fact,
    by_name,
)
from dissect.wire.text import encodable


def _error(of: Operation) -> dict[str, Any] | None:
    error = of.error
    return {"code": error.code, "name": error.name, "text": error.text} if error is not None else None


_ROWS: Final[tuple[Fact[Operation], ...]] = (
    Fact("number", COUNT, "Number of the operation, in the order in which they end.", lambda of: of.number, column="operation",
         least=1),
    Fact("kind", CODE, "`connect` a connection set up, `download` a block loaded into the PLC, `upload` one read from it,"
         " `long_answer` an answer in several parts, `bsend` a BSEND in several segments, `cyclic` a subscription to values,"
         " `messages` one to messages of the PLC, `test_job` a test function of the programming device, `password` a password"
         " sent, `session` a session of S7comm-plus, `delete` a block deleted, `control` the PLC stopped, started or reset,"
         " `polling` the same variables of S7comm-plus read again and again, `transfer` data streamed into an object by"
         " S7comm-plus, of a kind that is not known.", lambda of: of.kind, codes=tuple(KINDS)),
    Fact("connection", COUNT, "Number of the connection, that of `connections` in the analysis.",
         lambda of: int(of.connection.number), least=1),
    Fact("asked_by", END, "Who began it.", lambda of: of.connection.tcp.ends[of.asked_by]),
    Fact("answered_by", END, "The other end.", lambda of: of.connection.tcp.ends[1 - of.asked_by]),
    Fact("subject", TEXT, "Its subject, in a few words for a person; not a stable text.", lambda of: of.subject),
    Fact("first_frame", FRAME, "Number of its first packet; that of the connection for `connect`.",
         lambda of: int(of.first_frame)),
    Fact("last_frame", FRAME, "Number of its last packet.", lambda of: int(of.last_frame)),
    Fact("beginning_captured", FLAG, "False for a transfer whose first steps are not in the capture: it begins with the first"
         " piece that is.", lambda of: of.begun),
    Fact("begin_time", TIME, "Time of the first packet.", lambda of: int(of.begin_ns), column="ts"),
    Fact("duration_ns", DURATION, "Nanoseconds from the first packet to the last; negative where the clock of the capture ran"
         " backwards.", lambda of: of.duration_ns),
    Fact("result", CODE, "`done` it came to its end, `refused` its first request was refused, `failed` a later step was refused"
         " or reported an error, `unfinished` its end is missing, `running` a subscription or test job that went on to the end"
         " of the connection or the capture, `not_captured` what tells how it ended is not in the capture, mostly because only"
         " one direction was captured.", lambda of: of.result, codes=tuple(RESULTS)),
    Fact("reason", TEXT, "Why the end is missing: a `reason` of a transaction, `restarted`, `too many at once`, or `number"
         " reused`: the PLC assigned the number of this job to a later one, so that this one is over; null otherwise.",
         lambda of: of.reason or None, null=True),
    Fact("error", JSON, "The error of the refused step, null if none was refused.", _error,
         shape={"oneOf": [{"$ref": "#/$defs/error"}, {"type": "null"}]}),
    Fact("transaction_count", COUNT, "Transactions that belong to it.", lambda of: int(of.parts)),
    Fact("transactions", COUNTS, "Their numbers, of the first thousand.", lambda of: list(of.transactions), least=1),
    Fact("pushes", COUNT, "Number of them that the PLC sent unasked.", lambda of: int(of.pushes)),
    Fact("likely", COUNT, "Only where there are any: pairs of request and answer among them that are only likely (`certainty`"
         " of a transaction), so that the result and what was carried are only likely, too.",
         lambda of: int(of.likely) or None, rare=True, least=1),
    Fact("octets", COUNT, "The data: block content, the joined answer, what a BSEND sent, values and messages.",
         lambda of: int(of.octets), column="bytes", unit="bytes"),
    Fact("blocks", WORDS, "Only for a `download` or `upload` of S7comm-plus: the blocks and types that it carried, in the order"
         " in which they came (`s7dissect blocks` says more of each): type and number, `FB1084`.", None, rare=True),
    Fact("announced", COUNT, "The size stated beforehand, null when none was.",
         lambda of: int(of.announced) if of.announced >= 0 else None, column="announced_bytes", unit="bytes", null=True),
    Fact("tells", WORDS, "`long_answer` and `bsend`: the content, in a few words for a person; not stable texts. Empty for"
         " other kinds.", lambda of: [part.note for part in of.content_parts() if part.note]),
    Fact("content", TEXT, "`long_answer` and `bsend` (R_ID, length, what was sent): the joined payload in hexadecimal, null if"
         " incomplete, and for other kinds.", lambda of: of.content.hex() if of.content_head is not None else None, null=True,
         shape={"type": ["string", "null"], "pattern": "^([0-9a-f]{2})*$"}),
    Fact("oddities", JSON, "Its contradictions.", None, shape={"type": "array", "items": {"$ref": "#/$defs/oddity"}}),
    # ---- what JSON has inside of an object, or not at all
    Fact("file", FILE, "Capture file of the first packet.", lambda of: int(of.first_frame), key=""),
    Fact("end_time", TIME, "Time of the last packet.", lambda of: int(of.end_ns), key="", column="end"),
    Fact("client", END, "The client of the connection.", lambda of: of.connection.client, key=""),
    Fact("server", END, "The server, usually the PLC.", lambda of: of.connection.server, key=""),
    Fact("from_client", FLAG, "The client began it.", lambda of: of.asked_by == of.connection.client_side, key=""),
    Fact("error_code", COUNT, "Code of the refusal, 0 for none.",
         lambda of: of.error.code if of.error is not None else 0, key=""),
    Fact("error_name", WORD, "Its name.", lambda of: of.error.name if of.error is not None else None, key="", null=True),
    Fact("likely_count", COUNT, "Pairs of request and answer in the operation that are only likely.", lambda of: int(of.likely),
         key="", column="likely"),
    Fact("failed", FLAG, "A part was refused, or its end is missing.", lambda of: of.result not in NO_FAILURES, key=""),
    Fact("odd", WORDS, "Contradictions in the operation.", lambda of: [odd.detail for odd in of.oddities], key="",
         column="oddities"),
)  # fmt: skip

#: The facts of an operation by their names, in the order of their keys in JSON.
OPERATION: Final[dict[str, Fact[Operation]]] = by_name(_ROWS)


def _blocks(of: Act) -> list[str]:
    return [encodable(f"{block.label}{f' {block.name!r}' if block.name else ''}") for block in of.blocks()]


_ACT: Final[tuple[Fact[Act], ...]] = (
    Fact("number", COUNT, "Number of the act in the run.", lambda of: of.number, column="act", least=1),
    Fact("connection", COUNT, "Number of the connection.", lambda of: int(of.connection.number), least=1),
    Fact("file", FILE, "Capture file of the first packet.", lambda of: of.first_frame),
    Fact("first_frame", FRAME, "First packet.", lambda of: of.first_frame),
    Fact("last_frame", FRAME, "Last packet.", lambda of: of.last_frame),
    Fact("begin_time", TIME, "Time of the first packet.", lambda of: of.begin_ns, column="ts"),
    Fact("end_time", TIME, "Time of the last packet.", lambda of: of.end_ns, column="end"),
    Fact("client", END, "The client of the connection.", lambda of: of.connection.client),
    Fact("server", END, "The server, usually the PLC.", lambda of: of.connection.server),
    Fact("from_client", FLAG, "The client of the connection did it.", lambda of: of.asked_by == of.connection.client_side),
    Fact("kind", WORD, "stop, start, download, force … (docs/export.md).", lambda of: of.kind),
    Fact("subject", TEXT, "Subject of the act.", lambda of: of.subject),
    Fact("blocks", WORDS, "The blocks that it carried.", _blocks),
    Fact("octets", COUNT, "Size of the data that it carried, or of its request.", lambda of: of.octets, column="bytes",
         unit="bytes"),
    Fact("outcome", WORD, "accepted, refused, unanswered … (docs/export.md).", lambda of: of.outcome),
    Fact("reason", TEXT, "Why there is no answer.", lambda of: of.reason or None, null=True),
    Fact("error_code", COUNT, "Code of the refusal, 0 for none.", lambda of: of.error_code),
    Fact("error_name", WORD, "Its name.", lambda of: of.error.name if of.error is not None else None, null=True),
    Fact("slug", WORD, "Slug of the finding for it, null for none.", lambda of: of.slug or None, null=True),
    Fact("transactions", COUNTS, "Numbers of its transactions, the first thousand.", lambda of: list(of.transactions)),
)  # fmt: skip

#: The facts of an act by their names, in the order of its columns.
ACT: Final[dict[str, Fact[Act]]] = by_name(_ACT)
