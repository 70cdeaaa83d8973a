"""Connection attempts on port 102 that got no answer.

That the answer is not in the capture proves nothing: it may show one direction only. But a client that sends its SYN again
had no answer either. So an attempt is reported once its SYN was repeated and nothing followed: with the second repetition, or
where there is only one, when another attempt takes its place or the capture ends. A single SYN is never reported.
"""

from __future__ import annotations

from dissect.engine.counters import Counters
from dissect.transactions.connection import ISO_TSAP_PORT
from dissect.transactions.table import Attempt, ConnectionTable, endpoints
from dissect.wire.text import duration_text


def note_unanswered(counters: Counters, key: bytes, attempt: Attempt) -> None:
    """Report an attempt whose packets carry ``key``; on other ports that is not our business."""
    client, server = endpoints(key)
    if server.port == ISO_TSAP_PORT:
        within = duration_text(int(attempt.last_ns - attempt.time_ns))
        frames = [int(attempt.frame), int(attempt.last_frame)]
        detail = f"{server} does not answer {client} within {within}"
        counters.note_of("stream.unanswered", frames, attempt.last_ns, detail)


def finish(counters: Counters, table: ConnectionTable) -> None:
    """The capture ends: report what was repeated and is still without an answer."""
    for key, attempt in table.unanswered():
        note_unanswered(counters, key, attempt)
