"""Which finding explains which: the table of causes, and the findings that need no separate cause.

For example, a malformed request is refused, and this refusal is not probing; a message that does not fit is not answered. If
cause and consequence appear together, the consequence counts as explained: in JSON it keeps its place and names the number of
its cause, and it counts neither for ``--fail-on`` nor for alerts. Only `dissect.engine.findings.explaining` finds causes, and
only `dissect.engine.findings.reporter` applies the table.

Acts are never explained: a client that stopped a PLC remains a finding, whatever else was wrong with its request. A cause is
never less severe than what it explains, so a limit by severity still fails.
"""

from __future__ import annotations

from typing import Final

#: Cause and consequence concern the same request: something is wrong with that request.
REQUEST: Final = "request"
#: The cause explains how its connection ended: requests that stayed unanswered, and the end itself.
CONNECTION: Final = "connection"

#: The consequences of a request that was refused as a whole, and of one that was ignored.
_REFUSAL: Final = ("transaction.refused", "security.protected")
_SILENCE: Final = ("transaction.unanswered", "session.cut")


#: Error classes that do not concern the requested object: relationship, object definition, resources, service, frame. A refusal
#: because of size or a missing setup always has one of these classes; size is irrelevant for a block that does not exist.
VAGUE: Final = frozenset((0x81, 0x82, 0x83, 0x84, 0x85))
#: Causes that explain a refusal with any error code.
OUTRIGHT: Final = frozenset(("s7.malformed", "transaction.write_size", "transaction.bit_count"))


class Cause:
    """A row of the table: ``slug`` explains ``consequences``, ``when`` is the condition.

    ``scope`` is one of the words above.
    """

    __slots__ = ("consequences", "scope", "slug", "when")

    def __init__(self, slug: str, scope: str, when: str, consequences: tuple[str, ...]) -> None:
        self.slug = slug
        self.scope = scope
        self.when = when
        self.consequences = consequences

    def __repr__(self) -> str:
        return f"Cause({self.slug!r}, {len(self.consequences)} consequences)"


CAUSES: Final[tuple[Cause, ...]] = (
    Cause(
        "s7.malformed",
        REQUEST,
        "the request is malformed; items of a write only from the fault on",
        (*_REFUSAL, "transaction.item_error", "security.write_refused", *_SILENCE),
    ),
    Cause(
        "transaction.write_size",
        REQUEST,
        "the data of a write do not have the size of their item; items only with return code 0x07",
        (*_REFUSAL, "transaction.item_error", "security.write_refused", *_SILENCE),
    ),
    Cause(
        "transaction.bit_count",
        REQUEST,
        "the item that was refused is of type BIT with a count other than 1",
        ("transaction.item_error", "security.write_refused"),
    ),
    Cause(
        "session.read_too_long",
        REQUEST,
        "the answer to the read does not fit the PDU length; refusals only with an error class from 0x81 to 0x85",
        (*_REFUSAL, *_SILENCE),
    ),
    Cause(
        "session.pdu_too_long",
        REQUEST,
        "the request is longer than the PDU length; refusals only with an error class from 0x81 to 0x85",
        (*_REFUSAL, "security.write_refused", *_SILENCE),
    ),
    Cause(
        "cotp.size_exceeded",
        REQUEST,
        "the request is longer than the TPDU size; refusals only with an error class from 0x81 to 0x85",
        ("transaction.refused", *_SILENCE),
    ),
    Cause(
        "session.data_before_setup",
        REQUEST,
        "the request came before communication was set up; refusals only with an error class from 0x81 to 0x85",
        ("transaction.refused", *_SILENCE),
    ),
    Cause(
        "session.tpdu_too_small",
        CONNECTION,
        "the answer to a request fits the PDU length, but not the TPDU size, and did not come",
        _SILENCE,
    ),
    Cause(
        "cotp.fragments_unanswered",
        CONNECTION,
        "only requests in several TPDUs stay unanswered",
        (*_SILENCE, "session.too_many_jobs"),
    ),
    Cause(
        "cotp.number_unanswered",
        CONNECTION,
        "only requests in numbered TPDUs stay unanswered",
        (*_SILENCE, "session.too_many_jobs"),
    ),
)

#: The findings that each cause explains, by the slug of the cause.
EXPLAINS: Final[dict[str, frozenset[str]]] = {cause.slug: frozenset(cause.consequences) for cause in CAUSES}

#: Findings that may be explained by a cause that appears only later: they wait while there are signs of it.
WAITS: Final[frozenset[str]] = frozenset(
    slug for cause in CAUSES if cause.scope == CONNECTION for slug in cause.consequences
)
