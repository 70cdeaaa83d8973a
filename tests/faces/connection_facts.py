"""The facts of a capture as a whole, of functions, of slugs and of connections."""

from __future__ import annotations

from typing import Any, Final

from dissect.online.monitor.lists import _ENDED as ENDED
from tests.faces.cells import Cell, Fact, Rows, ecs_end, ends, mapped, none, told, zero
from tests.faces.kinds import COUNT, COUNTS, DURATION, END, FLAG, TIME, UNTOLD, WORD
from tests.faces.records import Record, end


def _role(value: Any, record: Record) -> Any:
    """Return the end that a role names."""
    return {"client": record["client"], "server": record["server"]}.get(value)


def _role_of_hosts(value: Any, record: Record) -> Any:
    return end(record[f"{value}_host"], record[f"{value}_port"]) if value else None


def _all_unanswered(value: Any, record: Record) -> int:
    """Return the number of requests without an answer, which the text table divides."""
    return int(value) + int(record.get("still open", 0)) + int(record.get("not captured", 0))


def _both_ports(value: Any, record: Record) -> str | None:
    return ",".join(sorted([str(one) for one in (value, record["server_port"]) if one is not None])) or None


def _number(value: Any, _: Record) -> int:
    return int(value)


def _missed(value: Any, record: Record) -> int:
    """Return the number of answers that were due and are missing."""
    return int(value - record["still_open"] - record.get("answers_not_captured", 0))


def _of_state(value: Any, _: Record) -> Any:
    """Return how a connection ended, in the word of the screens; a refusal replaces it."""
    return {"refused": UNTOLD, **{word: how for how, word in ENDED.items()}}.get(value, value)


# A row for a fact, with as many cells on a line as fit.
# fmt: off
_capture = Rows("capture")
_capture("total", COUNT, json="transactions.total", tables="total")
_capture("answered", COUNT, json="transactions.answered", tables="answered", text="answered")
_capture("likely", COUNT, json=zero("transactions.likely"), tables="likely", text="likely")
_capture("unanswered", COUNT, json="transactions.unanswered", tables="unanswered",
         text=Cell("unanswered", lambda value, record: value + record["open"] + record["not_captured"]))
_capture("still_open", COUNT, json="transactions.still_open", text="open")
_capture("not_captured", COUNT, json=zero("transactions.answers_not_captured"), tables="not_captured", text="not_captured")
_capture("orphans", COUNT, json="transactions.orphan_answers", tables="orphan_answer", text="orphans")
_capture("unsolicited", COUNT, json="transactions.unsolicited", tables="unsolicited", text="unsolicited")
_capture("one_way", COUNT, json="transactions.one_way", text="one_way")
_capture("with_errors", COUNT, json="transactions.with_errors", tables="with_errors", text="errors")
_capture("behind_malformed", COUNT, json=zero("transactions.behind_malformed"), tables="behind_malformed", text="behind")
_capture("packets", COUNT, json="packets.read", text="packets")
_capture("packets_used", COUNT, json=Cell("packets.used", lambda value, _: sum(value.values())), text="used")
_capture("first_time", TIME, json="first_time", text="begin")
_capture("gaps", COUNT, json="loss.gaps", text="gaps")
_capture("missing", COUNT, json="loss.octets_missing", tables="missing", text="missing")
_capture("connections", COUNT, json=Cell("connections", lambda value, record: len(value) + record["connections_not_listed"]),
         tables="connections")

_function = Rows("function")
_function("name", WORD, json="name", text="function", tables="name")
_function("protocol", WORD, json=Cell("protocol", lambda value, _: value or "s7comm"), tables="protocol")
_function("code", COUNT, json=Cell("code", lambda value, _: int(value, 16) if value is not None else None), tables="function")
_function("group", COUNT, json="group", tables="userdata_group")
_function("subfunction", COUNT, json="subfunction", tables="subfunction")
_function("total", COUNT, json="total", tables="total", text="count")
_function("answered", COUNT, json="answered", tables="answered")
_function("unanswered", COUNT, json="unanswered",
          text=Cell("no answer", _all_unanswered))
_function("still_open", COUNT, json="still_open", text=zero("still open"))
_function("not_captured", COUNT, json=zero("answers_not_captured"), text=zero("not captured"))
_function("with_errors", COUNT, json="with_errors", tables="with_errors", text="errors")
_function("likely", COUNT, json=zero("likely"), tables="likely", text=zero("only likely"))
_function("behind_malformed", COUNT, json=zero("behind_malformed"), text=zero("malformed header"))
_function("least", DURATION, json="latency_ns.min", tables="least")
_function("median", DURATION, json="latency_ns.median", text=none("median", "-"))
_function("p95", DURATION, json="latency_ns.p95", text=none("95 %", "-"))
_function("most", DURATION, json="latency_ns.max", tables="most", text=none("max", "-"))

_slug = Rows("slug")
_slug("count", COUNT, json="events", text="count", tables="events", ecs="events", zeek="events")
_slug("reports", COUNT, json="reports", tables="reports", ecs="reports", zeek="reports")
_slug("connections", COUNT, json="connections", tables="connections", ecs="connections", zeek="connections")
_slug("first_frame", COUNT, json="first_frame", tables="first_frame", ecs="first_frame", zeek="first_frame")
_slug("last_frame", COUNT, json="last_frame", tables="last_frame", ecs="last_frame", zeek="last_frame")

_kind = Rows("kind")
_kind("results", WORD, json="results", tables="results", text="results")

_detailed = Rows("detailed")
_detailed("count", COUNT, tables="count", json="count", ecs="count", stix="count")

# ---- connections ----------------------------------------------------------------------------------------------------

_connection = Rows("connection")
_connection("number", COUNT, pytest="number", screens=Cell("#", _number),
            json="number", tables="connection", where="connection", text="number",
            ecs="s7dissect.connection")
_connection("client", END, json="client", tables=ends("client_host", "client_port"), where="client", text="client",
            ecs=ecs_end("client"),
            pytest="client")
_connection("server", END, json="server", tables=ends("server_host", "server_port"), where="server", text="server",
            ecs=ecs_end("server"),
            pytest="server")
_connection("client_known", FLAG, json="client_known", tables="client_known", text="known")
_connection("transport", WORD, json="transport", tables="transport", text="transport", ecs="network.transport",
            pytest=mapped("carrier", {"ibh": "tcp"}))
_connection("vlan", COUNTS, json="vlan", tables="vlans", where=Cell("vlan", lambda value, _: value or []))
_connection("protocol", WORD, json="protocol", tables="protocol", where="protocol", ecs="network.protocol",
            pytest=none("protocol", ""))
_connection("start", WORD, json="start", tables="start")
_connection("first_frame", COUNT, json="first_frame", tables="first_frame",
            where=Cell("frame", lambda value, _: value.split(",")[0]),
            pytest="first_frame")
_connection("last_frame", COUNT, json="last_frame", tables="last_frame",
            where=Cell("frame", lambda value, _: value.split(",")[-1]))
_connection("first_time", TIME, pytest=Cell("first_ns", lambda value, _: value),
            json="first_time", tables="ts_ns", where="time", ecs="event.start")
_connection("last_time", TIME, json="last_time", tables="end_ns", ecs="event.end")
_connection("duration", DURATION, tables=Cell("end_ns", lambda value, record: value - record["ts_ns"]), where="duration_ns",
            ecs=told("event.duration"))
_connection("duration_without_unit", DURATION, tables=Cell("end_ns", lambda value, record: value - record["ts_ns"]),
            where="duration")
_connection("at", TIME, tables="end_ns", ecs="@timestamp")
_connection("ends", WORD, json=Cell("client", lambda value, record: ",".join(sorted([value, record["server"]]))),
            where=Cell("host", lambda value, _: ",".join(sorted(value.split(",")))))
_connection("ports", WORD,
            tables=Cell("client_port", _both_ports),
            where=Cell("port", lambda value, _: ",".join(sorted(value.split(",")))))
_connection("source", END, json="client", ecs=ecs_end("source"))
_connection("destination", END, json="server", ecs=ecs_end("destination"))
_connection("calling_tsap", WORD, json="calling_tsap.text", tables="tsap_calling", where="calling_tsap", text="calling")
_connection("called_tsap", WORD, json="called_tsap.text", tables="tsap_called", where="called_tsap", text="called")
_connection("rack", COUNT, json="called_tsap.rack", tables="rack", where="rack", text=told("rack"))
_connection("slot", COUNT, json="called_tsap.slot", tables="slot", where="slot", text=told("slot"))
_connection("tpdu_size", COUNT, json="tpdu_size", tables="tpdu_size", text=told("tpdu_size"),
            pytest=none("tpdu_size", 0))
_connection("pdu_length", COUNT, json="setup_granted.pdu_length", tables="pdu_length", where="pdu_length", text="pdu_length")
_connection("amq_calling", COUNT, json="setup_granted.max_amq_calling", tables="max_amq_calling")
_connection("amq_called", COUNT, json="setup_granted.max_amq_called", tables="max_amq_called")
_connection("asked_pdu_length", COUNT, json="setup_asked.pdu_length",
            text=Cell("asked", lambda value, _: value or UNTOLD))
_connection("pdus", COUNT, json="pdus", tables="pdus", where="pdus", text="pdus", ecs="s7dissect.pdus")
_connection("answered", COUNT, json="answered", tables="answered", text="answered",
            pytest="answered", screens=Cell("answered", _number))
_connection("unanswered", COUNT, json="unanswered", tables="unanswered",
            text=Cell("missed", lambda value, record: value + record["still_open"] + record["not_captured"]),
            pytest="unanswered")
_connection("missed", COUNT, json=Cell("unanswered", _missed), text="missed", screens=Cell("no answer", _number))
_connection("still_open", COUNT, json="still_open", text="still_open")
_connection("not_captured", COUNT, json=zero("answers_not_captured"), text="not_captured")
_connection("orphans", COUNT, json="orphan_answers", tables="orphans", text="orphans",
            pytest="orphan_answer")
_connection("unsolicited", COUNT, pytest="unsolicited", json="unsolicited", tables="unsolicited", text="unsolicited")
_connection("one_way", COUNT, json="one_way", text="one_way")
_connection("behind_malformed", COUNT, json=zero("behind_malformed"), text="behind")
_connection("with_errors", COUNT, json="with_errors", tables="with_errors", text="errors",
            screens=Cell("errors", _number))
_connection("refused", WORD, json="refused", text="refused")
_connection("ended", WORD, ending="ending.how", json="ended", tables="ended", where="ended", ecs="event.reason",
            text=Cell("how", None, lambda value, told: told == ("replaced" if value == "reused" else value)),
            pytest=Cell("ended", lambda value, _: value or "open"), screens=Cell("state", _of_state))
_connection("ended_by", END, ending="ending.by", json="ended_by", tables=Cell("ended_by", _role_of_hosts),
            text=Cell("role", _role))
_connection("ended_by_role", WORD, ending="ending.role", tables="ended_by", text="role",
            pytest=none("ended_by", ""))
_connection("ended_frame", COUNT, ending="ending.frame", json="ended_frame",
            text=Cell("end_frame", lambda value, record: value if record["how"] in {"fin", "reset"} else UNTOLD))
_connection("open_at_end", COUNT, json="open_at_end", tables="open_at_end")
_connection("open_requests", COUNT, ending="ending.open_requests", text="pending")
_connection("uid", WORD, tables="uid", ecs="s7dissect.uid")
_connection("community_id", WORD, tables="community_id", ecs="network.community_id")
_connection("packets", COUNT, tables="packets", ecs="network.packets")
_connection("client_bytes", COUNT, tables="client_bytes", ecs=zero("client.bytes"))
_connection("server_bytes", COUNT, tables="server_bytes", ecs=zero("server.bytes"))
_connection("bytes", COUNT, tables=Cell("client_bytes", lambda value, record: value + record["server_bytes"]),
            ecs=zero("network.bytes"))
_connection("file", WORD, tables="file", ecs="s7dissect.file")

ROWS: Final[list[Fact]] = [
    *_capture.rows,
    *_function.rows,
    *_slug.rows,
    *_detailed.rows,
    *_kind.rows,
    *_connection.rows,
]
