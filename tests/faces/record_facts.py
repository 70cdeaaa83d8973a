"""The facts of items, operations, findings, values, devices and messages."""

from __future__ import annotations

import re
from typing import Any, Final

from dissect.protocols.s7.tables import AREA_LETTERS, AREAS, RETURN_CODES, SUCCESS, TRANSPORT_SIZES
from tests.faces import values
from tests.faces.cells import Cell, Fact, Rows, ecs_end, ends, sender, zero
from tests.faces.kinds import COUNT, COUNTS, DURATION, END, FLAG, OCTETS, TIME, UNTOLD, WORD, WORDS, iso_ns
from tests.faces.records import Record, end

# ---- items ----------------------------------------------------------------------------------------------------------

_BYTE: Final = 2


def _label(value: Any, record: Record) -> Any:
    """Return an address with the count unless that is 1, as text and CSV write it."""
    count = record.get("count")
    return f"{value} x{count}" if count is not None and count != 1 and value is not None else value


def _area(value: Any, _: Record) -> Any:
    return AREA_LETTERS.get(value, AREAS.name(value)) if value is not None else None


def _type(value: Any, record: Record) -> Any:
    """Return the name of a type: S7comm-plus has it in its line, S7comm a number."""
    return TRANSPORT_SIZES.name(value) if value is not None else record.get("type")


def _numbered(record: Record) -> bool:
    """Return whether the address of an item is the number of a timer or counter."""
    return record.get("area") in {0x1C, 0x1D, 0x1E, 0x1F}


def _start(divided: bool) -> Any:
    def made(value: Any, record: Record) -> Any:
        if value is None:
            return None
        if _numbered(record):
            return value if divided else None
        return value >> 3 if divided else value & 7

    return made


def _value(value: Any, record: Record) -> values.Value:
    """Return the value of an item with its origin; for SCD the physical value."""
    if "scd" in record:
        return record["physical"], None, False, record["text"]
    return value, record.get("data"), record.get("transport_size") == _BYTE, record.get("text")


#: In a push: the value is that of the push before.
_UNCHANGED: Final = 0xFE


def _refused(value: Any, record: Record) -> bool:
    """Return whether a code is a refusal: in S7comm-plus 0 is not, nor is an unchanged value in a push."""
    same = value == _UNCHANGED and record["of"]["outcome"] == "unsolicited"
    return value not in {None, SUCCESS} and not (value == 0 and "path" in record) and not same


def _refused_in_all(value: Any, record: Record) -> bool:
    """Return whether an item is refused, or has no code in an answer that refuses the whole request."""
    whole = [one for one in record["of"]["errors"] if not one["where"].startswith(("item", "alarm"))]
    return _refused(value, record) or (value is None and bool(whole) and "scd" not in record)


def _in_octets(value: str | None, told: str | None) -> bool:
    """A cell without octets cannot show whether there were any."""
    return (value or None) == told


def _csv_result(value: Any, record: Record) -> Any:
    """Return the name of a code; irregularities of an SCD value are there as well."""
    return value if record["return_code"] else UNTOLD


def _said_result(value: Any, _: Record) -> Any:
    return None if value == "no return code" else value


def _operation_of(value: Any, record: Record) -> str:
    """Return what a transaction does with its items."""
    if value == "unsolicited":
        return "notify"
    of = record["of"]
    names = {"Write Var", "SetMultiVariables", "SetVariable", "SetVarSubStreamed"}
    return "write" if of["function"]["name"] in names else "read"


def _unswapped(value: Any, _: Record) -> int | None:
    return int.from_bytes(int(value).to_bytes(2, "little"), "big") if value is not None else None


# A row for a fact, with as many cells on a line as fit.
# fmt: off
_item = Rows("item")
_item("label", WORD, jsonl=Cell("address", _label), tables=Cell("address", _label), csv="address",
      text=Cell("label", lambda value, _: None if value.startswith("item ") else value))
_item("transaction", COUNT, jsonl="of.number", tables="transaction", csv="number")
_item("number", COUNT, jsonl=Cell("number", lambda value, record: record["at"] if value is None else value), tables="item",
      csv="item")
_item("connection", COUNT, jsonl="of.connection", tables="connection")
_item("time", TIME, jsonl=Cell("of.request_time", lambda value, record: value or record["of"]["response_time"]),
      tables="ts_ns")
_item("request_frame", COUNT, jsonl="of.request_frame", tables="request_frame", csv="request_frame")
_item("response_frame", COUNT, jsonl="of.response_frame", tables="response_frame", csv="response_frame")
_item("client_host", WORD, link="client_host", tables="client_host")
_item("server_host", WORD, link="server_host", tables="server_host")
_item("operation", WORD, jsonl=Cell("of.outcome", _operation_of), tables="operation")
_item("db", COUNT, jsonl=Cell("db", lambda value, _: value or None), tables="db")
_item("area", WORD, jsonl=Cell("area", _area), tables="area")
_item("byte", COUNT, jsonl=Cell("start_bit", _start(True)), tables="byte")
_item("bit", COUNT, jsonl=Cell("start_bit", _start(False)), tables="bit")
_item("count", COUNT, jsonl="count", tables="count")
_item("type", WORD, jsonl=Cell("transport_size", _type), tables="type")
_item("return_code", COUNT, jsonl="return_code", tables="return_code", csv="return_code")
_item("return_name", WORD, tables="return_name", csv=Cell("result", _csv_result),
      text=Cell("result", _said_result, lambda value, told: told == (None if value == RETURN_CODES.name(SUCCESS) else value)))
_item("refused_in_all", FLAG, tables="refused", jsonl=Cell("return_code", _refused_in_all))
_item("value", WORD, jsonl=Cell("value", _value),
      tables=Cell("number", lambda value, record: (value, record["text"]), values.in_tables),
      csv=Cell("value", lambda value, _: value or None, values.in_cell),
      text=Cell("value", lambda value, _: value, values.in_line))
_item("value_text", WORD, jsonl=Cell("text", lambda value, record: value or record.get("note")), csv="value_text")
_item("spelled", WORD, jsonl=Cell("text", lambda value, record: value if "syntax_id" in record else None), tables="spelled")
_item("octets", OCTETS, jsonl="data", tables="data", csv=Cell("octets", None, _in_octets))
_item("name", WORD, jsonl=Cell("name", lambda value, record: value if "scd" in record else UNTOLD), tables="name", csv="name")
_item("unit", WORD, jsonl="unit", csv="unit")
_item("certainty", WORD, tables="certainty", jsonl=Cell("of", lambda value, _: value.get("certainty") or UNTOLD))

# ---- operations -----------------------------------------------------------------------------------------------------

_operation = Rows("operation")
_operation("number", COUNT, jsonl="number", tables="operation", fields="number", text="number")
_operation("kind", WORD, jsonl="kind", tables="kind", fields="kind", text="kind")
_operation("connection", COUNT, jsonl="connection", tables="connection", fields="connection")
_operation("asked_by", END, jsonl="asked_by", tables=Cell("from_client", sender("client", "server")), fields="asked_by",
           text="sender")
_operation("answered_by", END, jsonl="answered_by", tables=Cell("from_client", sender("server", "client")),
           fields="answered_by", text="receiver")
_operation("client", END, tables=ends("client_host", "client_port"), fields="client")
_operation("server", END, tables=ends("server_host", "server_port"), fields="server")
_operation("subject", WORD, jsonl=Cell("subject", lambda value, _: value or None),
           tables=Cell("subject", lambda value, _: value or None), fields="subject",
           text=Cell("subject", None, lambda value, told: (value or "").startswith(told[:40].split(" → ")[0].rstrip("…"))))
_operation("first_frame", COUNT, jsonl="first_frame", tables="first_frame", fields="first_frame", text="first")
_operation("last_frame", COUNT, jsonl="last_frame", tables="last_frame", fields="last_frame", text="last")
_operation("frames", COUNTS, jsonl=Cell("first_frame", lambda value, record: [value, record["last_frame"]]), fields="frame")
_operation("time", TIME, jsonl="begin_time", tables="ts_ns", fields="time", text="time")
_operation("duration", DURATION, jsonl="duration_ns", fields="duration_ns", text="took",
           tables=Cell("end_ns", lambda value, record: value - record["ts_ns"]))
_operation("duration_without_unit", DURATION, jsonl="duration_ns", fields="duration")
_operation("result", WORD, jsonl="result", tables="result", fields="result", text="result")
_operation("reason", WORD, jsonl="reason", tables="reason", fields="reason")
_operation("failed", FLAG, jsonl=Cell("result", lambda value, _: value not in {"done", "running", "not_captured"}),
           fields="failed")
_operation("error_code", COUNT, jsonl="error.code", tables=Cell("error_code", lambda value, _: value or None), text="error")
_operation("error_name", WORD, jsonl="error.name", tables="error_name", fields="error")
_operation("parts", COUNT, jsonl="transaction_count", tables="transaction_count", fields="transaction_count", text="parts")
_operation("transactions", COUNTS, jsonl="transactions", tables="transactions")
_operation("pushes", COUNT, jsonl="pushes", tables="pushes", fields="pushes", text="pushes")
_operation("likely", COUNT, jsonl=zero("likely"), tables="likely")
_operation("octets", COUNT, jsonl="octets", tables="bytes", fields="octets", text=zero("octets"))
_operation("announced", COUNT, jsonl="announced", tables="announced_bytes")
_operation("oddities", WORDS, jsonl=Cell("oddities", lambda value, _: [one["detail"] for one in value]), tables="oddities")

# ---- findings -------------------------------------------------------------------------------------------------------

_SEVERITY: Final = {9: "error", 6: "warning", 3: "note"}


def _short(value: str, told: str) -> bool:
    """A report shortens long details."""
    return bool(value == told or value.startswith(told.rstrip("…")))


def _microseconds(value: int | None, told: int) -> bool:
    return (value or 0) // 1000 == told // 1000


def _frames_in_content(value: str, _: Record) -> list[int]:
    found = re.search(r" Packets ([\d, ]+) of ", value)
    return [int(one) for one in re.findall(r"\d+", found[1])] if found else []


def _in_content(value: Any, told: str) -> bool:
    """A note has sentence, detail and advice in one text."""
    return not value or value in told


def _techniques(version: str) -> Cell:
    return Cell("techniques", lambda value, _: [one[version] for one in value])


def _known_techniques(value: list[str], told: list[str]) -> bool:
    """STIX names the known ones, once each, for findings about a connection."""
    return told == [] or told == list(dict.fromkeys(value))


def _techniques_said(value: list[str], told: list[str]) -> bool:
    """A report also names those of other versions of ATT&CK."""
    return [one for one in told if one in value] == value


def _frames_said(value: Any, record: Record) -> Any:
    return [int(one) for one in value.split(", ")] if value else []


_finding = Rows("finding")
_finding("number", COUNT, tables="finding", json="number", ecs="s7dissect.finding")
_finding("slug", WORD, tables="slug", json="slug", ecs="rule.id", stix=Cell("labels", lambda value, _: value[0]),
         where="slug", text="slug")
_finding("action", WORD, tables="slug", ecs="event.action")
_finding("severity", WORD, tables="severity", json="severity", ecs="s7dissect.severity",
         stix=Cell("labels", lambda value, _: value[1]), where="severity", text="severity")
_finding("severity_as_number", WORD, tables="severity", ecs=Cell("event.severity", lambda value, _: _SEVERITY[int(value)]))
_finding("kind", WORD, tables="kind", json="kind", ecs="rule.category", stix=Cell("labels", lambda value, _: value[2]),
         where="kind")
_finding("connection", COUNT, tables="connection", json="connection", ecs="s7dissect.connection", where="connection",
         text="connection")
_finding("client_host", WORD, tables="client_host", ecs="client.ip", where=Cell("client", lambda value, _: _host(value)))
_finding("server_host", WORD, tables="server_host", ecs="server.ip", where=Cell("server", lambda value, _: _host(value)))
_finding("client", END, where="client", ecs=ecs_end("client"), stix=Cell("src", lambda value, _: value or UNTOLD))
_finding("server", END, where="server", ecs=ecs_end("server"), stix=Cell("dst", lambda value, _: value or UNTOLD))
_finding("source", END, where="client", ecs=ecs_end("source"))
_finding("destination", END, where="server", ecs=ecs_end("destination"))
_finding("frames", COUNTS, tables="frames", json="frames", ecs=Cell("s7dissect.frames", lambda value, _: value or []),
         where=Cell("frame", lambda value, _: [int(one) for one in value.split(",")] if value else []),
         text=Cell("frames", _frames_said),
         stix=Cell("content", _frames_in_content))
_finding("time", TIME, tables="ts_ns", json="time",
         ecs=Cell("@timestamp", lambda value, _: None if value.startswith("1970") else value), where="time",
         stix=Cell("created", None, _microseconds))
_finding("observed", TIME, tables="ts_ns",
         stix=Cell("observed", lambda value, _: iso_ns(value["first_observed"]) if value else UNTOLD, _microseconds))
_finding("observed_last", TIME, tables="ts_ns",
         stix=Cell("observed", lambda value, _: iso_ns(value["last_observed"]) if value else UNTOLD, _microseconds))
_finding("link_begin", TIME, link="ts_ns",
         stix=Cell("traffic", lambda value, _: iso_ns(value["start"]) if value else UNTOLD, _microseconds))
_finding("link_protocols", WORD, link="transport",
         stix=Cell("traffic", lambda value, _: value["protocols"] if value else UNTOLD, lambda value, told: value in told))
_finding("sentence", WORD, tables="sentence", json="sentence", ecs="rule.name", stix="abstract", text="sentence")
_finding("reason", WORD, tables="sentence", ecs="event.reason")
_finding("detail", WORD, tables=Cell("detail", lambda value, _: value or None),
         json=Cell("detail", lambda value, _: value or None), where="detail",
         text=Cell("detail", None, lambda value, told: _short(value or "", told or "")),
         ecs=Cell("message", lambda value, record: value.removeprefix(record["rule"]["name"]).strip() or None),
         stix=Cell("content", None, _in_content))
_finding("advice", WORD, tables="advice", json="advice", ecs="s7dissect.advice", text="advice",
         stix=Cell("content", None, lambda value, told: told.endswith(value)))
_finding("techniques", WORDS, tables="techniques", json=_techniques("v18"),
         ecs=Cell("threat.technique.id", lambda value, _: value or []), stix=Cell("techniques", None, _known_techniques),
         text=Cell("techniques", lambda value, _: value or [], _techniques_said))
_finding("techniques_v19", WORDS, tables="techniques_v19", json=_techniques("v19"))
_finding("technique_names", WORDS, tables="technique_names", json=_techniques("name"),
         ecs=Cell("threat.technique.name", lambda value, _: value or []))
_finding("techniques_in_-Y", WORDS, tables="techniques",
         where=Cell("technique", lambda value, _: value or "", lambda value, told: all([f"{one}" in told for one in value])))
_finding("explained_by", COUNT, tables="explained_by", json="explained_by", ecs="s7dissect.explained_by")
_finding("because_of", WORD, tables="because_of", json="because_of", ecs="s7dissect.because_of", where="because_of")
_finding("file", WORD, tables="file", ecs="s7dissect.file")


def _host(value: str) -> str | None:
    """Return the host of an end, which may be the only known part of it."""
    if value and not value.startswith("[") and value.count(":") != 1:
        return value
    return value.rpartition(":")[0].strip("[]") if value else None


# ---- values ---------------------------------------------------------------------------------------------------------

_WITH_TYPE: Final = re.compile(r"(?:(?P<tag>.*) \()?(?P<address>[^ ()]+(?: [^ ()]+)*?)\)?(?: (?P<type>\d+ x \S+|\S+))?")


def _variable(value: Any, record: Record) -> tuple[Any, ...]:
    """Return the value of a variable with its origin; a row gives its type in words."""
    kind = record.get("type") or ""
    return record["value"], record["octets"], kind.endswith("BYTE"), record.get("text")


def _before(value: Any, record: Record) -> values.Value:
    """Return the value before, with its octets if it is bytes."""
    is_bytes = (record["type"] or "").endswith("BYTE")
    octets = bytes(value).hex() if is_bytes and isinstance(value, list) else None
    return value, octets, is_bytes, None


def _written(value: Any, record: Record) -> Any:
    """Return whether the client gave a value; for SCD the way does not show this."""
    return UNTOLD if value == "pdo" or record["address"].startswith("0x") else value in {"write", "modify", "force"}


def _previous_number(value: values.Value, told: float | None) -> bool:
    """Tables have the value before only if it is a number."""
    number = value[0]
    return not isinstance(number, (bool, int, float)) or (told is not None and float(number) == told)


def _what(value: Any, record: Record) -> str:
    """Return a variable as a line names it: tag, address, type."""
    tag, kind = record["tag"], record["type"]
    named = f"{tag} ({value})" if tag else str(value)
    return f"{named} {kind}" if kind else named


def _value_in_line(value: Any, told: str) -> bool:
    content, octets, is_bytes, text = value
    said = told.removesuffix(f" ({text})") if text else told
    return values.in_line((content, octets, is_bytes, text), said)


_of_value = Rows("value")
_of_value("time", TIME, jsonl="time", tables="ts_ns", csv="time", text="time")
_of_value("frame", COUNT, jsonl="frame", tables="frame", csv="frame", text="frame")
_of_value("connection", COUNT, jsonl="connection", tables="connection", csv="connection")
_of_value("client", WORD, jsonl="client", tables="client_host", csv="client", text="client")
_of_value("plc", END, jsonl="plc", csv="plc", text="plc")
_of_value("plc_host", WORD, jsonl=Cell("plc", lambda value, _: _host(value)), tables="server_host")
_of_value("how", WORD, jsonl="how", tables="operation", csv="how", text="how")
_of_value("address", WORD, jsonl="address", tables="address", csv="address")
_of_value("tag", WORD, jsonl="tag", tables="name", csv="tag")
_of_value("type", WORD, jsonl="type", tables="type", csv="type")
_of_value("variable", WORD, jsonl=Cell("address", _what), text="what")
_of_value("unit", WORD, jsonl="unit", tables="unit", csv="unit")
_of_value("value", WORD, jsonl=Cell("value", _variable),
          tables=Cell("number", lambda value, record: (value, record["text"]), values.in_tables),
          csv=Cell("value", lambda value, _: value or None, values.in_cell),
          text=Cell("value", lambda value, _: value, _value_in_line))
_of_value("value_text", WORD, jsonl="text", csv="value_text")
_of_value("octets", OCTETS, jsonl="octets", tables="data", csv=Cell("octets", None, _in_octets))
_of_value("changed", FLAG, jsonl="changed", tables="changed",
          csv=Cell("changed", lambda value, _: value == "true" if value else None),
          text=Cell("was", None, lambda value, told: told == bool(value)))
_of_value("previous", WORD, jsonl=Cell("previous", _before),
          csv=Cell("previous", lambda value, _: value or None, values.in_cell),
          tables=Cell("previous_number", lambda value, _: value, _previous_number))
_of_value("remark", WORD, jsonl="remark", tables="remark", csv="remark")
_of_value("doubt", WORD, jsonl="doubt", csv="doubt", text="doubt")
_of_value("certainty", WORD, jsonl=Cell("certainty", lambda value, _: value or "sure"), csv="certainty")
_of_value("written", FLAG,
          jsonl=Cell("how", _written),
          tables="written")

# ---- devices --------------------------------------------------------------------------------------------------------


def _joined(value: Any, _: Record) -> Any:
    return " ".join([str(one) for one in value]) or None


def _sorted(value: Any, _: Record) -> Any:
    return " ".join(sorted(value.split(), key=int)) if value else None


def _mac(value: Any, _: Record) -> Any:
    return value[-1]["value"] if value else None


def _fact(key: str) -> Cell:
    """Return the latest value of a fact, of any module, from the JSON: the first module that has it."""

    def made(value: Any, record: Record) -> Any:
        for module in record["modules"]:
            if key in module["facts"]:
                return module["facts"][key][-1]["value"]
        return None

    return Cell("modules", made)


def _card(title: str, pattern: str) -> Cell:
    """Return the content of a row of a card, by a pattern."""

    def made(value: Any, record: Record) -> Any:
        for row in record["rows"].get(title, []):
            if found := re.search(pattern, row):
                return found[1]
        return UNTOLD

    return Cell("rows", made)


_device = Rows("device")
_device("address", WORD, json="address", csv="address", tables="address", analysis="address")
_device("vlan", COUNTS, json="vlan", tables="vlans", analysis="vlan",
        csv=Cell("vlan", lambda value, _: [int(one) for one in re.findall(r"\d+", value)]))
_device("host_name", WORD, tables="host_name", csv="host_name")
_device("modules", WORD,
        json=Cell("modules", lambda value, _: ", ".join([one["module"] for one in value if one["module"]]) or None),
        csv="modules")
_device("blocks", WORD,
        json=Cell("blocks.counts", lambda value, _: ", ".join([f"{n} {kind}" for kind, n in value.items()]) or None),
        csv="blocks")
_device("role", WORD, json="role", csv="role", tables="role", text="role")
_device("certainty", WORD, json="certainty", csv="certainty", tables="certainty")
for _name in (
    "order_number",
    "hardware",
    "firmware",
    "serial_number",
    "station_name",
    "module_name",
    "plant",
    "operating_mode",
):
    _device(_name, WORD, json=_name, csv=_name, tables=_name, **({} if _name == "plant" else {"analysis": _name}))
_device("protection_level", WORD, json="protection_level", csv="protection_level", tables="protection_level",
        analysis="protection_level")
for _name in ("max_connections", "max_pdu_length"):
    _device(_name, WORD, json=_fact(_name), csv=_name)
for _name in ("module_type", "location"):
    _device(_name, WORD, json=_fact(_name), csv=_name, tables=_name)
_device("mac", WORD, json=Cell("macs", _mac), csv="mac", tables="mac")
_device("vendor", WORD, json=Cell("macs", lambda value, _: value[-1]["vendor"] if value else None), csv="vendor",
        tables="vendor")
_device("pdu_lengths", WORD, json=Cell("pdu_lengths", _joined), csv=Cell("pdu_lengths", _sorted),
        tables=Cell("pdu_lengths", _sorted))
_device("parallel_jobs", WORD, json=Cell("parallel_jobs", _joined), csv=Cell("parallel_jobs", _sorted))
_device("clock_offset", COUNT, json="clock_offset_ns", csv="clock_offset_ns")
_device("clock_set_offset", COUNT, json="clock_set_offset_ns", csv="clock_set_offset_ns")
_device("connections", COUNT, json="connections", csv="connections", tables="connections")
_device("transactions", COUNT, json="transactions", csv="transactions", tables="transactions")
_device("answered", COUNT, json="answered", csv="answered", tables="answered", text=_card("answers", r"^(\d+) answered"))
_device("unanswered", COUNT, json="unanswered", csv="unanswered", tables="unanswered",
        text=_card("answers", r", (\d+) unanswered"))
_device("with_errors", COUNT, json="with_errors", csv="with_errors", tables="with_errors",
        text=_card("answers", r", (\d+) with errors"))
_device("likely", COUNT, json=zero("likely"), csv="likely", tables="likely")
_device("median", DURATION, json="answer_time_ns.median", csv="median_ns", tables="median_ns",
        text=_card("answers", r"median ([\d.]+ \S+?)(?:,|$)"))
_device("p95", DURATION, json="answer_time_ns.p95", csv="p95_ns", tables="p95_ns",
        text=_card("answers", r"95 % ([\d.]+ \S+)$"))
_device("asked_by", WORD, json=Cell("asked_by", _joined), csv="asked_by", tables="asked_by")
_device("asks", WORD, json=Cell("asks", _joined), csv="asks", tables="asks")
_device("first_frame", COUNT, json="first_frame", csv="first_frame", tables="first_frame",
        text=_card("seen", r"packets (\d+) to"))
_device("last_frame", COUNT, json="last_frame", csv="last_frame", tables="last_frame", text=_card("seen", r"to (\d+)$"))
_device("first_time", TIME, json="first_time", csv="first_time", tables="ts_ns", text=_card("seen", r"^(\S+ \S+ UTC)"))
_device("last_time", TIME, json="last_time", csv="last_time", tables="end_ns")

# ---- messages -------------------------------------------------------------------------------------------------------


def _kind(value: Any, record: Record) -> Any:
    """Return the kind of a message of either protocol, in the words of S7comm-plus in small letters."""
    if record["protocol"] == "s7comm":
        return record["rosctr_name"]
    return record["s7plus"]["kind"].lower()


def _same_kind(value: Any, told: Any) -> bool:
    return (value or "").lower() == (told or "").lower()


def _pdu_error(value: Any, record: Record) -> Any:
    """Return the error of a message: class and code of the header, or the code of userdata."""
    head = record.get("userdata")
    if head is not None:
        return head.get("error_code", 0)
    return value << 8 | (record["error_code"] or 0) if value is not None else None


def _function_name(value: Any, record: Record) -> Any:
    head = record.get("userdata")
    return f"{head['group_name']}: {head['subfunction_name']}" if head is not None else value


_pdu = Rows("pdu")
_pdu("frame", COUNT, jsonl="frame", tables="frame", fields="frame", text="frame")
_pdu("time", TIME, jsonl="time", tables="ts_ns", fields="time", text="time", zeek="ts")
_pdu("connection", COUNT, jsonl="connection", tables="connection", fields="connection")
_pdu("src", END, jsonl="src", tables=Cell("from_client", sender("client", "server")), fields="src", text="sender",
     zeek=Cell("source_h", lambda value, record: end(value, record["source_p"])))
_pdu("dst", END, jsonl="dst", tables=Cell("from_client", sender("server", "client")), fields="dst", text="receiver",
     zeek=Cell("destination_h", lambda value, record: end(value, record["destination_p"])))
_pdu("from_client", FLAG, tables="from_client", zeek="is_orig")
_pdu("protocol", WORD, jsonl="protocol", tables="protocol", fields="protocol", text="protocol")
_pdu("kind", WORD, jsonl=Cell("rosctr_name", _kind), tables=Cell("kind", None, _same_kind),
     text=Cell("kind", None, _same_kind))
_pdu("rosctr", WORD, jsonl="rosctr_name", fields="rosctr")
_pdu("rosctr_code", COUNT, jsonl="rosctr", zeek="rosctr_code")
_pdu("pdu_ref", COUNT, jsonl="pdu_ref", tables="pdu_ref", fields="pdu_ref", text="ref",
     zeek=Cell("pdu_reference", _unswapped))
_pdu("function", COUNT, jsonl="function.code", tables="function")
_pdu("group", COUNT, jsonl="userdata.group", tables="userdata_group")
_pdu("subfunction", COUNT, jsonl="userdata.subfunction", tables="subfunction")
_pdu("group_name", WORD, jsonl="userdata.group_name", fields="userdata.group")
_pdu("subfunction_name", WORD, jsonl="userdata.subfunction_name", fields="userdata.subfunction")
_pdu("userdata_type", WORD, jsonl="userdata.type_name", fields="userdata.type")
_pdu("function_name", WORD, tables="function_name",
     fields=Cell("function", lambda value, _: value.removeprefix("S7comm-plus ")),
     text=Cell("function", None, lambda value, told: value is None or value == told))
_pdu("json_function_name", WORD, tables="function_name", jsonl=Cell("function.name", _function_name))
_pdu("zeek_function", COUNT, jsonl=Cell("function.code", lambda value, record: UNTOLD if "userdata" in record else value),
     zeek=Cell("function_code", lambda value, _: int(value, 16) if value is not None else None))
_pdu("zeek_error", COUNT, jsonl=Cell("error_code", lambda value, record: value if record["rosctr"] in {2, 3} else UNTOLD),
     zeek=Cell("error_code", lambda value, _: int(value, 16) if value is not None else None))
_pdu("error_code", COUNT, jsonl=Cell("error_class", _pdu_error), tables="error_code")
_pdu("item_count", COUNT, jsonl="item_count", tables="item_count")
_pdu("cut", FLAG, jsonl="cut", tables="cut", fields="cut", text="cut")
_pdu("behind_malformed", FLAG, jsonl=Cell("tpdu.behind_malformed", lambda value, _: bool(value)), fields="behind_malformed",
     text="behind")
_pdu("malformed", FLAG, jsonl=Cell("malformed", lambda value, _: bool(value)), fields="malformed",
     tables=Cell("malformed", lambda value, _: bool(value)))
_pdu("malformed_count", COUNT, jsonl=Cell("malformed", lambda value, _: len(value)),
     tables=Cell("malformed", lambda value, _: len(value)))

ROWS: Final[list[Fact]] = [
    *_item.rows, *_operation.rows, *_finding.rows, *_of_value.rows, *_device.rows, *_pdu.rows,
]  # fmt: skip
