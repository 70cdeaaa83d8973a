"""The columns of each log: names and types; the first eleven are the same in all logs of connections."""

from __future__ import annotations

from typing import Final

from dissect.output.export.mapping import Mapped, mapped
from dissect.output.export.tables import ACTS, BOOL, FINDING_COUNTS, INT, INTS, TEXT, TRANSACTIONS, WORD, WORDS

Columns = tuple[tuple[str, str], ...]


def _columns(text: str) -> Columns:
    return tuple([(name, kind) for name, _, kind in [word.partition(":") for word in text.split()]])


#: Columns of every log of connections: `id` has the ends of the connection, the end that opened it first; `source` and
#: `destination` are those of the message.
COMMON: Final = _columns(
    "ts:time uid:string id.orig_h:addr id.orig_p:port id.resp_h:addr id.resp_p:port is_orig:bool "
    "source_h:addr source_p:port destination_h:addr destination_p:port"
)
#: The further columns, by the name of the log.
LOGS: Final[dict[str, Columns]] = {
    "cotp": _columns("pdu_code:string pdu_name:string"),
    "s7comm": _columns(
        "rosctr_code:count rosctr_name:string pdu_reference:count function_code:string function_name:string "
        "subfunction_code:string subfunction_name:string error_class:string error_code:string"
    ),
    "s7comm_read_szl": _columns(
        "pdu_reference:count method:string szl_id:string szl_id_name:string szl_index:string return_code:string "
        "return_code_name:string"
    ),
    "s7comm_upload_download": _columns(
        "rosctr:string pdu_reference:count function_name:string function_status:string session_id:count blocklength:count "
        "filename:string block_type:string block_number:string destination_filesystem:string"
    ),
    "s7comm_plus": _columns("version:count opcode:string opcode_name:string function_code:string function_name:string"),
    "s7comm_known_devices": _columns(
        "automation_system_name:string module_name:string plant_name:string module_serial:string"
    ),
}


#: The kind of a column of a log, by the type of the column of a table.
_KINDS: Final = {
    INT: "count",
    BOOL: "bool",
    TEXT: "string",
    WORD: "string",
    WORDS: "vector[string]",
    INTS: "vector[count]",
}
#: Our own logs, whose names differ from those of ICSNPP: the facts of records, as in the tables.
OWN: Final[dict[str, tuple[Mapped, ...]]] = {
    "s7comm_transaction": mapped(
        TRANSACTIONS,
        _KINDS,
        "community_id=:string transaction protocol function_code=function:string function_name outcome reason certainty doubt "
        "latency=latency_ns:interval failed errors=:vector[string] items=item_count request_bytes response_bytes request_frame "
        "response_frame",
    ),
    "s7comm_act": mapped(
        ACTS,
        _KINDS,
        "community_id=:string act kind subject blocks bytes outcome reason error_code error_name slug end=end_ns:time "
        "first_frame last_frame transactions",
    ),
    "s7comm_finding_count": mapped(
        FINDING_COUNTS,
        _KINDS,
        "ts=ts_ns:time end=end_ns:time scope slug severity kind reported client_h=client_host:addr server_h=server_host:addr "
        "because_of events reports connections connections_at_least hosts in_last_tenth first_frame last_frame",
    ),
}
LOGS.update({name: tuple([(one.name, one.kind) for one in columns]) for name, columns in OWN.items()})
#: Logs whose rows belong to no connection.
_OF_ALL: Final = frozenset(("s7comm_finding_count",))


def columns_of(name: str) -> Columns:
    """Return all columns of a log."""
    return LOGS[name] if name in _OF_ALL else (*COMMON, *LOGS[name])
