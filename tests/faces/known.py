"""Differences between faces that exist, each with its reason; and places that only one face has.

A known difference must still exist: when it is mended, the test asks to remove its row.
"""

from __future__ import annotations

from typing import Final, NamedTuple

from tests.faces.comparing import Difference
from tests.test_house import WINGS


class Known(NamedTuple):
    """A known difference: what is wrong, or why it is necessary; ``shared``: only captures of the shared corpus show it."""

    why: str
    shared: bool = False


_CONTENTS: Final = "`show` decodes the contents of S7comm-plus and userdata as well, and counts their faults"

#: By kind of record, fact and face.
KNOWN: Final[dict[tuple[str, str, str], Known]] = {
    ("pdu", "malformed", "fields"): Known(_CONTENTS),
    ("pdu", "malformed", "tables"): Known(_CONTENTS),
    ("pdu", "malformed_count", "tables"): Known(_CONTENTS),
}  # fmt: skip


def is_known(difference: Difference) -> bool:
    """Return whether a difference is in the table."""
    return (difference.record, difference.fact, difference.face) in KNOWN


#: Places that only one face has, as patterns, by kind of record and face. A fact that two faces have needs a row.
_FRAME: Final = (
    # the parts of an ECS document, and its ends in other words
    "*.address", "data_stream.*", "ecs.version", "event.action", "event.category", "event.dataset", "event.id", "event.kind",
    "event.module", "event.provider", "event.type", "network.iana_number", "network.type", "observer.*", "related.ip",
)  # fmt: skip
ALONE: Final[dict[tuple[str, str], tuple[str, ...]]] = {
    ("capture", "json"): (
        "schema", "interrupted", "selection", "files", "last_time", "packets.*", "tsdus.*", "tpdus.*", "scd*",
        *[f"{room}.*" for room in WINGS["protocols"]],
        "connections_without_data", "loss.*", "transactions.unanswered_reasons.*", "transactions.likely_*",
        "latency_ns.*",
        # separate records
        "devices", "failed", "slowest", "finding_details", "functions", "findings.*", "finding_facts.*",
        "findings_explained.*", "operations.*",
    ),
    ("connection", "ecs"): _FRAME,
    ("connection", "json"): (
        "*_tsap.connection_type", "*_tsap.octets", "calling_tsap.rack", "calling_tsap.slot", "disconnected", "identified_by",
        "ending.connecting", "ending.last_*", "ending.oldest_*", "ending.reset*", "ending.silence_ns", "ending.time",
        "setup_asked.max_amq_*", "tls*", "also_vlans",
    ),
    ("connection", "tables"): ("missing_bytes",),
    ("connection", "pytest"): ("behind_malformed",),  # transactions, where others count PDUs
    # rates, the latest answer and the current open requests: they depend on the moment of the screen
    ("connection", "screens"): ("", "open", "per s", "10 s", "answer", "worst of each second"),
    ("act", "tables"): ("file",),
    ("device", "json"): (
        "answer_time_ns.*", "blocks.*", "evidence", "names_not_listed", "sessions", "tsaps",
    ),
    ("device", "tables"): ("file",),
    ("finding", "-Y"): ("pdu_length",),
    ("finding", "ecs"): (*_FRAME, "rule.ruleset", "rule.version", "threat.framework", "threat.tactic.*", "threat.*.reference"),
    ("finding", "stix"): (
        "created_by_ref", "id", "modified", "object_refs", "observed.*", "spec_version", "type", "traffic.*",
    ),
    ("function", "json"): ("latency_ns.p99",),
    ("item", "jsonl"): ("crc", "flags", "path", "syntax_id", "of.*", "scd.*", "value.*", "tags", "untagged"),
    # the columns of its transaction
    ("item", "csv"): (
        "answered_by", "asked_by", "certainty", "connection", "doubt", "errors", "function", "function_name", "latency_ns",
        "outcome", "pdu_ref", "reason", "request_frame", "request_time", "response_frame", "response_time", "rosctr", "subject",
    ),
    ("operation", "fields"): ("pdu_length",),
    ("operation", "jsonl"): ("schema", "beginning_captured", "content", "error.text", "tells", "blocks"),
    ("operation", "tables"): ("file",),
    ("pdu", "fields"): ("error", "pdu_length", "scd.*", "tag"),
    ("pdu", "jsonl"): (
        "schema", "data", "data_length", "octets", "param_length", "parameters", "parts", "redundancy_id", "s7plus.*",
        "setup.*",
        "userdata.data_unit_ref", "userdata.last_data_unit", "userdata.sequence", "userdata.type", "tpdu.malformed",
    ),
    ("pdu", "tables"): ("bytes", "file", "pdu"),
    ("pdu", "zeek"): ("error_class", "function_name", "rosctr_name", "subfunction_*"),
    # the columns of its items
    ("transaction", "csv"): (
        "address", "errors", "item", "name", "octets", "result", "return_code", "subject", "unit", "value", "value_text",
    ),
    ("transaction", "ecs"): _FRAME,
    ("transaction", "fields"): ("pdu_length", "tag"),
    ("transaction", "jsonl"): (
        "schema", "asks", "tells", "s7plus.*", "setup.*", "sent_again.*",
        "userdata.data_unit_ref", "userdata.error_code", "userdata.last_data_unit", "userdata.sequence", "userdata.type",
    ),
    ("transaction", "tables"): ("response_file",),
    ("value", "jsonl"): ("schema", "value.*", "previous.*"),
    ("value", "tables"): ("file",),
}  # fmt: skip
#: Faces whose records are those of another one, in another view: their facts are checked there.
VIEWS: Final = frozenset(("text", "report", "link", "listed", "ending"))
#: Kinds of records that are sums: each of their places is made for a row.
SUMS: Final = frozenset(("slug", "detailed", "kind"))
