"""Lists the statements that blame a device or a client, and checks whether a statement itself mentions a loss of the capture.

A capture with lost packets may contain less than a complete one, but it must not blame a device or a client for a loss of the
capture only. `BLAMES` and `BLAMELESS` together name every finding of the kinds transaction, session, s7, s7plus and security,
and those of COTP that blame a side for silence; `REASONS` and `BLAMELESS_REASONS` every reason why a request stayed without
answer.
"""

from __future__ import annotations

import re
from typing import Final

from dissect.engine.transactions.transaction import (
    CAPTURE_ENDED,
    CONNECTION_CLOSED,
    CONNECTION_EVICTED,
    HOLE,
    MALFORMED_HEADER,
    ONE_SIDED,
    REFERENCE_REUSED,
    TABLE_FULL,
)

#: The beginnings of slugs of findings that may blame.
PREFIXES: Final = (
    "transaction.", "session.", "s7.", "s7plus.", "security.",
    "cotp.number_unanswered", "cotp.fragments_unanswered", "cotp.bare_confirm",
)  # fmt: skip

#: A connection whose octets came in two versions: the truth about it depends on which of them were captured.
CONFLICT: Final = "stream.conflict"

#: About one request and its answer: compared with the complete capture's statement about that request.
OF_A_REQUEST: Final = frozenset((
    "transaction.refused", "transaction.item_error", "transaction.alarm_refused", "transaction.overdue",
    "transaction.slow", "transaction.function_mismatch", "transaction.count_mismatch", "transaction.size_mismatch",
    "transaction.write_size", "transaction.table_full", "transaction.bit_count",
))  # fmt: skip
#: About a pair, but reported for only one of several pairs: for the first answer to each distinct request, for the first write
#: to an area. Which one that is depends on the captured packets: it is true if its packets are a pair of the complete capture.
OF_A_PAIR: Final = frozenset(("transaction.odd_data_code", "security.write_refused"))
#: Reported once, for the first request of its kind in the whole capture: true if the complete capture has the same report
#: anywhere.
OF_A_CAPTURE: Final = frozenset(("s7.unknown_code", "s7.odd_address"))
#: About two hosts, on the connection where it shows first: true if the complete capture reports it of them anywhere.
OF_HOSTS: Final = frozenset((
    "security.new_writer", "security.password_guessing", "security.tsap_scan", "security.stopped",
    "security.mode_changed",
))  # fmt: skip
#: About a connection, mostly reported once: true if the complete capture reports it of that connection.
OF_A_CONNECTION: Final = frozenset((
    "s7.malformed", "s7.plus_too_long", "s7.unknown_rosctr", "s7.redundancy_id", "s7.client_push", "s7.ack_content",
    "s7plus.malformed",
    "session.data_before_setup", "session.pdu_too_long", "session.repeated_setup", "session.read_too_long",
    "session.too_many_jobs", "session.shared_reference", "session.bad_grant", "session.unusual_port",
    "session.foreign_on_102", "session.cut", "session.tpdu_too_small",
    "cotp.number_unanswered", "cotp.fragments_unanswered", "cotp.bare_confirm",
    "security.tls_weak", "security.certificate_expired", "security.certificate_weak", "security.plc_stop",
    "security.plc_start", "security.program_change", "security.program_read", "security.memory", "security.force",
    "security.debug", "security.write", "security.write_outputs", "security.password", "security.password_failed",
    "security.protected", "security.unauthenticated", "security.clear_text", "security.session_reused",
    "security.replay", "security.clock_set", "security.reconnaissance", "security.flash_led", "security.alarm_change",
    "security.nc_command", "security.unknown_service", "security.flood", "security.protection", "security.firmware",
))  # fmt: skip
#: The findings that blame.
BLAMES: Final = OF_A_REQUEST | OF_A_PAIR | OF_A_CAPTURE | OF_HOSTS | OF_A_CONNECTION

#: Findings of the same kinds that do not blame, each with the reason.
BLAMELESS: Final[dict[str, str]] = {
    "transaction.unanswered": "counted once, as the reason of its request",
    "transaction.orphan": "its sentence says that the request was not captured",
    "transaction.reordered": "its sentence says that the capture changed the order",
    "s7plus.notifications_lost": "its advice names the capture first; numbers that skip are a gap of their own",
    "s7plus.unknown_kind": "says that something is not known, not that it is wrong",
    "session.idle": "its advice says that what the connection was used for was not captured",
    "session.encrypted": "states what the connection is, and is nobody's fault",
    "session.tls_closed": "is about keys and the capture: its kind is capture",
}

#: The reasons of unanswered requests that blame a side: it did not answer, or did not wait, or sent too much.
REASONS: Final = frozenset((CONNECTION_CLOSED, CAPTURE_ENDED, REFERENCE_REUSED, TABLE_FULL))
#: Reasons that do not blame, each with the reason.
BLAMELESS_REASONS: Final[dict[str, str]] = {
    HOLE: "says that the answer was not captured",
    ONE_SIDED: "says that the direction of the answers was not captured",
    MALFORMED_HEADER: "says what stands before the request, and that nobody misses an answer",
    CONNECTION_EVICTED: "is about the memory of the analysis",
}

#: The end of the detail of a security finding whose request got no answer: this is true or false regardless of the rest of the
#: finding.
NOT_ANSWERED: Final = ", not answered"

_LOSS: Final = re.compile(r"\bgaps?\b|not captured|missing from the capture|packets were lost|perhaps answered")


def names_loss(detail: str) -> bool:
    """Return whether a sentence itself mentions that something was not captured."""
    return _LOSS.search(detail) is not None
