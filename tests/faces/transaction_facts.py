"""The facts of transactions."""

from __future__ import annotations

import json
import re
from typing import Any, Final

from dissect.protocols.s7.tables import ROSCTR
from tests.faces.cells import Cell, Fact, Rows, ecs_end, ends, mapped, none, sender, told, zeek_end, zero
from tests.faces.kinds import COUNT, COUNTS, DURATION, END, FLAG, TIME, UNTOLD, WORD, WORDS
from tests.faces.records import Record

_ROSCTR: Final = {name: number for number, name in ROSCTR.names().items()}


def _json_time(value: Any, record: Record) -> Any:
    """Return the time of the request, or of the answer if there is no request."""
    return value if value is not None else record["response_time"]


def _csv_time(value: Any, record: Record) -> Any:
    return value or record["response_time"]


def _errors(value: Any, _: Record) -> list[str]:
    """Return errors as the tables write them."""
    return [f"{one['where']}: {one['name']}" for one in value]


def _without_addresses(value: list[str], told: list[str]) -> bool:
    """The tables name the address of an S7comm-plus item after its number, which other faces give with the item."""
    return [re.sub(r"^(item \d+|alarm \S+) [^:]+(?=: )", r"\1", one) for one in value] == [*told]


def _coded(value: list[str], told: Any) -> bool:
    """CSV has the code in front of the name, and each error in the row of its item."""
    return bool(sorted([re.sub(r"^(item \d+) [^:]+(?=: )", r"\1", one) for one in value]) == told)


def _csv_errors(value: Any, record: Record) -> list[str]:
    found: list[str] = []
    for row in value:
        for one in row["errors"].split("; ") if row["errors"] else []:
            plain = re.sub(r": 0x[0-9a-f]+ (?!\(unknown code\))", ": ", one, count=1).removesuffix(" (unknown code)")
            plain = re.sub(r"^(message: abort) .*", r"\1", plain)
            if plain not in found:
                found.append(plain)
    return sorted(found)


def _function_code(value: Any, record: Record) -> Any:
    return int(value, 16) if value is not None else None


def _function_name(value: Any, record: Record) -> Any:
    """Return the name of a function as tables have it: of userdata group and subfunction, of other protocols with theirs."""
    head = record.get("userdata")
    if head is not None:
        return f"{head['group_name']}: {head['subfunction_name']}"
    before = {"s7comm_plus": "S7comm-plus ", "scd": "SCD "}.get(record.get("protocol", ""), "")
    return f"{before}{value}" if value is not None else None


def _full_name(value: Any, record: Record) -> Any:
    """Return the name of a function after that of its protocol."""
    before = {"s7comm_plus": "S7comm-plus "}.get(record["protocol"], "")
    return f"{before}{value}" if value else value


def _json_protocol(value: Any, record: Record) -> str:
    """A line does not name S7comm."""
    return str(value or "s7comm")


def _both_frames(value: Any, record: Record) -> list[int]:
    return [one for one in (value, record["response_frame"]) if one is not None]


def _failed(value: Any, record: Record) -> Any:
    """Return whether a document is about a failure; for a pair that is only likely it does not say so."""
    return UNTOLD if record["s7dissect"].get("doubt") else value == "failure"


# A row for a fact, with as many cells on a line as fit.
# fmt: off
_transaction = Rows("transaction")
_transaction("number", COUNT, tables="transaction", jsonl="number", csv="number", fields="number", zeek="transaction",
             ecs="s7dissect.transaction", text="number", report="number", listed="number")
_transaction("connection", COUNT, tables="connection", jsonl="connection", csv="connection", fields="connection",
             ecs="s7dissect.connection")
_transaction("asked_by", END, tables=Cell("from_client", sender("client", "server")), jsonl="asked_by", csv="asked_by",
             fields="asked_by")
_transaction("answered_by", END, tables=Cell("from_client", sender("server", "client")),
             jsonl="answered_by", csv="answered_by", fields="answered_by")
_transaction("client", END, tables=ends("client_host", "client_port"), fields="client", zeek=ends("id.orig_h", "id.orig_p"),
             ecs=ecs_end("client"))
_transaction("server", END, tables=ends("server_host", "server_port"), fields="server", zeek=ends("id.resp_h", "id.resp_p"),
             ecs=ecs_end("server"))


def _sent(value: Any, record: Record) -> Any:
    """Return the sender of the first message of a transaction: the asking side, or the other side if there is no request."""
    return sender("client", "server")(bool(value) == (record["request_frame"] is not None), record)


_transaction("sender", END, tables=Cell("from_client", _sent), zeek=zeek_end("source"), ecs=ecs_end("source"),
             text="sender")
_transaction("receiver", END, tables=Cell("from_client", lambda value, record: _sent(not value, record)),
             zeek=zeek_end("destination"), ecs=ecs_end("destination"), text="receiver")
_transaction("is_orig", FLAG,
             tables=Cell("from_client", lambda value, record: bool(value) == (record["request_frame"] is not None)),
             zeek="is_orig")
_transaction("protocol", WORD, tables="protocol", jsonl=Cell("protocol", _json_protocol), fields="protocol", zeek="protocol")
_transaction("rosctr", COUNT, tables=mapped("rosctr", _ROSCTR), jsonl="rosctr", csv="rosctr",
             fields=Cell("rosctr", lambda value, _: str(_ROSCTR.get(value, value))))
_transaction("pdu_ref", COUNT, tables="pdu_ref", jsonl="pdu_ref", csv="pdu_ref", fields="pdu_ref",
             ecs="s7dissect.pdu_reference")
_transaction("function", COUNT, tables="function", jsonl="function.code", csv="function", ecs="s7dissect.function.code",
             zeek=Cell("function_code", _function_code))
_transaction("function_name", WORD, tables="function_name", jsonl=Cell("function.name", _function_name), csv="function_name",
             zeek="function_name", ecs="s7dissect.function.name",
             text=none("function", "no function"), report=none("function", "no function"),
             fields=Cell("function", _full_name))
_transaction("group", COUNT, tables="userdata_group", jsonl="userdata.group")
_transaction("subfunction", COUNT, tables="subfunction", jsonl="userdata.subfunction")
_transaction("group_name", WORD, jsonl="userdata.group_name", fields="userdata.group")
_transaction("subfunction_name", WORD, jsonl="userdata.subfunction_name", fields="userdata.subfunction")
_transaction("userdata_type", WORD, jsonl="userdata.type_name", fields="userdata.type")
_transaction("request_frame", COUNT, tables="request_frame", jsonl="request_frame", csv="request_frame",
             fields="request_frame", zeek="request_frame", text="first", report="first")
_transaction("response_frame", COUNT, tables="response_frame", jsonl="response_frame", csv="response_frame",
             fields="response_frame", zeek="response_frame", text="last", report="last")
_transaction("frames", COUNTS,
             tables=Cell("request_frame", _both_frames),
             ecs="s7dissect.frames", fields="frame")
_transaction("time", TIME, tables="ts_ns", jsonl=Cell("request_time", _json_time), csv=Cell("request_time", _csv_time),
             fields="time", zeek="ts", ecs="event.start", text="time")
_transaction("at", TIME, tables="ts_ns", ecs="@timestamp")
_transaction("request_time", TIME, jsonl="request_time", csv="request_time", fields="request_time")
_transaction("response_time", TIME, tables="response_ns", csv="response_time", fields="response_time",
             jsonl=told("response_time"), ecs=told("event.end"))
_transaction("latency", DURATION, tables="latency_ns", jsonl="latency_ns", csv="latency_ns", fields="latency_ns",
             zeek="latency", text="took", report="took",
             ecs=Cell("s7dissect.latency_ms", lambda value, _: round(value * 10**6) if value is not None else None))
_transaction("latency_without_unit", DURATION, tables="latency_ns", fields="latency", ecs=told("event.duration"))
_transaction("outcome", WORD, tables="outcome", jsonl="outcome", csv="outcome", fields="outcome", zeek="outcome",
             ecs="s7dissect.outcome", text="outcome")
_transaction("reason", WORD, tables="reason", jsonl="reason", csv="reason", fields="reason", zeek="reason",
             ecs="s7dissect.reason", text="reason")


def _json_certainty(value: Any, record: Record) -> Any:
    """Return the certainty in a line, which names only uncertain ones."""
    certain = record["outcome"] == "answered" or (record["outcome"] == "unanswered" and record["reason"] == "hole")
    return value or ("sure" if certain else None)


def _ecs_certainty(value: Any, record: Record) -> Any:
    return _json_certainty(value, {"reason": None, **record["s7dissect"]})


_transaction("certainty", WORD, tables="certainty", jsonl=Cell("certainty", _json_certainty), csv="certainty",
             fields="certainty", zeek="certainty", ecs=Cell("s7dissect.certainty", _ecs_certainty), text="certainty")
_transaction("doubt", WORD, tables="doubt", jsonl="doubt", csv="doubt", fields="doubt", zeek="doubt", ecs="s7dissect.doubt",
             text="doubt")
_transaction("behind_malformed", FLAG, jsonl=Cell("reason", lambda value, _: value == "malformed_header"),
             fields="behind_malformed", text="behind")
_transaction("failed", FLAG, tables="failed", fields="failed", zeek="failed",
             ecs=Cell("event.outcome", _failed))
_transaction("errors", WORDS, tables="errors", jsonl=Cell("errors", _errors, _without_addresses),
             csv=Cell("rows", _csv_errors, _coded), zeek=Cell("errors", None, _without_addresses),
             ecs=Cell("s7dissect.errors", lambda value, _: value or []))
_transaction("error_message", WORD, tables=Cell("errors", lambda value, _: "; ".join(value) or None), ecs="error.message")
_transaction("error_where", WORDS, jsonl=Cell("errors", lambda value, _: [one["where"] for one in value]),
             fields=Cell("error.where", lambda value, _: value.split(",") if value else []))
_transaction("error_names", WORD, jsonl=Cell("errors", lambda value, _: ",".join([one["name"] for one in value]) or None),
             fields="error")
_transaction("error_texts", WORD, jsonl=Cell("errors", lambda value, _: ",".join([one["text"] for one in value]) or None),
             fields="error.text")


def _whole_error(value: Any, _: Record) -> Any:
    """Return the code of an answer that refuses the whole request."""
    whole = [one["code"] for one in value if not one["where"].startswith(("item", "alarm", "data"))]
    return whole[0] if whole else 0


def _refusal(value: Any, _: Record) -> Any:
    """Return the same, or the code of the data."""
    whole = [one["code"] for one in value if not one["where"].startswith(("item", "alarm"))]
    return whole[0] if whole else None


_transaction("error_code", COUNT, tables="error_code", jsonl=Cell("errors", _whole_error))
_transaction("refused_whole", COUNT, jsonl=Cell("errors", _refusal), text="error")


def _item_count(value: Any, record: Record) -> int:
    return len(value) + sum([len(half["values"]) for half in record.get("scd", [])])


_transaction("item_count", COUNT, tables="item_count", zeek="items", ecs=zero("s7dissect.items"), fields="items",
             jsonl=Cell("items", _item_count))


def _csv_subject(value: Any, record: Record) -> Any:
    """Return the subject of a transaction without items; only here a setup has one."""
    return UNTOLD if value[0]["item"] or record["function"] == "240" else value[0]["subject"]


_transaction("about", WORD, tables="about", ecs="s7dissect.about")
_transaction("subject", WORD, tables="about", csv=Cell("rows", _csv_subject))
_transaction("request_bytes", COUNT, tables="request_bytes", zeek="request_bytes")
_transaction("response_bytes", COUNT, tables="response_bytes", zeek="response_bytes")
_transaction("sent_again", COUNT, jsonl=Cell("sent_again", lambda value, _: (value or {}).get("times", 0)),
             fields="sent_again")
_transaction("file", WORD, tables="file", ecs="s7dissect.file")


def _all_of_it(value: Any, record: Record) -> str:
    return json.dumps(record, sort_keys=True)


_transaction("object", WORD, jsonl=Cell("number", _all_of_it), listed=Cell("number", _all_of_it))
ROWS: Final[list[Fact]] = _transaction.rows
