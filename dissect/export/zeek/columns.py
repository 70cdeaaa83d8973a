"""The columns of each log: names and types; the first eleven are the same in all logs of connections."""

from __future__ import annotations

from typing import Final

Columns = tuple[tuple[str, str], ...]


def _columns(text: str) -> Columns:
    return tuple([(name, kind) for name, _, kind in [word.partition(":") for word in text.split()]])


#: Columns of every log of connections: `id` has the ends of the connection, that which opened it first; `source` and
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
    # Our own logs, named so that they are not taken for those of ICSNPP.
    "s7comm_transaction": _columns(
        "community_id:string transaction:count protocol:string function_code:string function_name:string outcome:string "
        "reason:string certainty:string doubt:string latency:interval failed:bool errors:vector[string] items:count "
        "request_bytes:count response_bytes:count request_frame:count response_frame:count"
    ),
    "s7comm_act": _columns(
        "community_id:string act:count kind:string subject:string blocks:vector[string] bytes:count outcome:string "
        "reason:string error_code:count error_name:string slug:string end:time first_frame:count last_frame:count "
        "transactions:vector[count]"
    ),
    "s7comm_finding_count": _columns(
        "ts:time end:time scope:string slug:string severity:string kind:string reported:string client_h:addr server_h:addr "
        "because_of:string events:count reports:count connections:count connections_at_least:bool hosts:count "
        "in_last_tenth:bool first_frame:count last_frame:count"
    ),
}
#: Logs whose rows belong to no connection.
_OF_ALL: Final = frozenset(("s7comm_finding_count",))


def columns_of(name: str) -> Columns:
    """Return all columns of a log."""
    return LOGS[name] if name in _OF_ALL else (*COMMON, *LOGS[name])
