"""Documents in the Elastic Common Schema: transactions, findings and connections as NDJSON, with an index template.

Names and allowed values follow ECS 9.4.0. Values for which ECS has no field are below ``s7dissect``, so that they collide
neither with ``s7`` of Security Onion nor with ``zeek`` of Malcolm.
"""

from __future__ import annotations

import base64
import hashlib
import ipaddress
import json
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, Final, TextIO

from dissect.engine.findings.bounds import KEPT
from dissect.engine.findings.catalogue import CAPTURE, CATALOGUE
from dissect.engine.findings.reporter import Finding
from dissect.engine.observer import Observer
from dissect.engine.pipeline import Pipeline
from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.transaction import LIKELY, Transaction
from dissect.files.session import Run
from dissect.meaning.facts.keys import connection_community_id
from dissect.meaning.select.things import Context
from dissect.output.export.attack_tables import TACTICS, TECHNIQUES
from dissect.output.export.forms import ECS_PARTS, Export, ExportRequest
from dissect.output.export.mapping import mapped
from dissect.output.export.mapping import told as told_by
from dissect.output.export.rows import Rows
from dissect.output.export.tables import (
    BOOL,
    CONNECTIONS,
    FINDING_COUNTS,
    FINDINGS,
    INT,
    INTS,
    TEXT,
    TRANSACTIONS,
    WORD,
    WORDS,
    Table,
)
from dissect.packets.tcp.stream import Endpoint
from dissect.wire.text import Clock, encodable

ECS_VERSION: Final = "9.4.0"
#: Elasticsearch indexes texts up to this many characters; longer ones cannot be searched.
_LONGEST: Final = 1024
_TCP: Final = "6"
_UDP: Final = "17"
#: Severities as numbers; the highest is the most severe.
_SEVERITIES: Final = {"note": 3, "warning": 6, "error": 9}
#: Functions with a category of their own in ``event.category``; all others are only "network".
_TRANSFER: Final = frozenset(range(0x1A, 0x20))
_CONTROL: Final = frozenset((0x28, 0x29))
_SECURITY_GROUP: Final = 5


_KEYWORD: Final = {"type": "keyword", "ignore_above": _LONGEST}
#: The type of a field by the type of its column.
_TYPES: Final[Mapping[str, Mapping[str, Any]]] = {
    INT: {"type": "long"},
    INTS: {"type": "long"},
    BOOL: {"type": "boolean"},
    WORD: _KEYWORD,
    WORDS: _KEYWORD,
    TEXT: {"type": "match_only_text"},
}
#: The fields below ``s7dissect`` in the documents of a table.
_OWN: Final = {
    CONNECTIONS.name: mapped(CONNECTIONS, _TYPES, "uid pdus file"),
    TRANSACTIONS.name: mapped(
        TRANSACTIONS,
        _TYPES,
        "transaction frames= function.code=function function.name=function_name latency_ms= outcome reason certainty doubt "
        "errors about items=item_count pdu_reference=pdu_ref file",
    ),
    FINDINGS.name: mapped(FINDINGS, _TYPES, "frames advice severity file finding explained_by because_of"),
    FINDING_COUNTS.name: mapped(
        FINDING_COUNTS,
        _TYPES,
        "scope severity reported because_of events reports connections hosts connections_at_least in_last_tenth file "
        "first_frame last_file last_frame",
    ),
}
#: The types of fields that are made of several columns, or are not searched.
_MADE: Final[dict[str, Any]] = {
    "connection": {"type": "long"},
    "latency_ms": {"type": "double"},
    "advice": {"type": "text", "index": False},
}


def _own_types() -> dict[str, Any]:
    """Return the types of the fields below ``s7dissect``."""
    own: dict[str, Any] = {}
    for names in _OWN.values():
        for one in names:
            if one.kind is not None:
                _put(own, one.name.replace(".", ".properties."), one.kind)
    return {**own, **_MADE}


def _put(told: dict[str, Any], path: str, value: Any) -> None:
    *outer, name = path.split(".")
    for one in outer:
        told = told.setdefault(one, {})
    told[name] = value


def _own(table: Table, row: Mapping[str, Any], given: Mapping[str, Any] = MappingProxyType({})) -> dict[str, Any]:
    """Return the part of a document below ``s7dissect``, for a row."""
    own: dict[str, Any] = {}
    for name, value in told_by(_OWN[table.name], row, given):
        _put(own, name, value)
    return own


def index_template() -> dict[str, Any]:
    """Return the index template: PUT it as ``_index_template/s7dissect`` before the first document."""
    keyword = _KEYWORD
    fields: dict[str, Any] = {
        "@timestamp": {"type": "date_nanos"},
        "message": {"type": "match_only_text"},
        "ecs": {"properties": {"version": keyword}},
        "event": {
            "properties": {
                "start": {"type": "date_nanos"},
                "end": {"type": "date_nanos"},
                "duration": {"type": "long"},
                "severity": {"type": "long"},
            }
        },
        **{
            side: {
                "properties": {
                    "ip": {"type": "ip"},
                    "port": {"type": "long"},
                    "bytes": {"type": "long"},
                    "address": keyword,
                }
            }
            for side in ("source", "destination", "client", "server")
        },
        "related": {"properties": {"ip": {"type": "ip"}}},
        "network": {"properties": {"bytes": {"type": "long"}, "packets": {"type": "long"}}},
        "s7dissect": {"properties": _own_types()},
    }
    return {
        "index_patterns": ["logs-s7dissect.*"],
        "priority": 200,
        "data_stream": {},
        "template": {
            "settings": {"index": {"codec": "best_compression", "mapping": {"total_fields": {"limit": 3000}}}},
            "mappings": {
                "date_detection": False,
                "dynamic_templates": [{"strings": {"match_mapping_type": "string", "mapping": keyword}}],
                "properties": fields,
            },
        },
        "_meta": {"ecs_version": ECS_VERSION, "description": "S7 transactions, findings and connections of s7dissect"},
    }


class EcsExport(Export, Observer):
    """Writes a file of documents for each of `ECS_PARTS`, and the index template, into a folder."""

    def __init__(self, request: ExportRequest) -> None:
        Observer.__init__(self)
        self.observer = self
        self._version = request.version
        self._files: dict[str, TextIO] = {}
        for name in ECS_PARTS:
            if not request.parts or name in request.parts:
                self._files[name] = (request.path / f"{name}.ndjson").open("w", encoding="ascii", newline="\n")
        template = json.dumps(index_template(), indent=1)
        (request.path / "index-template.json").write_text(f"{template}\n", encoding="ascii")
        self._counts = dict.fromkeys(self._files, 0)
        self._run: Run | None = None
        self._context = Context()
        self._rows = Rows([])
        self._clock = Clock()

    @property
    def counts(self) -> Mapping[str, int]:
        """The number of documents in each file."""
        return self._counts

    def begin(self, run: Run) -> None:
        """Set the files of the run, by which packets are named."""
        self._rows = Rows(run.files)
        self._run = run

    def flush(self) -> None:
        """Do nothing: documents are written as they come."""

    def close(self) -> None:
        """Write the facts of rules, and close the files."""
        if self._run is not None:
            self._write_counts(self._run.pipeline)
        for file in self._files.values():
            file.close()

    def abandon(self) -> None:
        """Close the files, which will be deleted."""
        for file in self._files.values():
            try:
                file.close()
            except OSError:  # there may be no room for data that are still buffered
                continue

    # ---- as an observer ---------------------------------------------------------------------------------------------

    def connection_opened(self, connection: Connection) -> None:
        """Remember a connection for its findings."""
        self._context.opened(connection)

    def connection_closed(self, connection: Connection) -> None:
        """Write a finished connection."""
        self._context.closed(connection)
        row = CONNECTIONS.named(self._rows.connection(connection))
        told = self._document("connection", row["end_ns"], connection, None)
        told["event"] |= {
            "kind": "event",
            "category": ["network"],
            "type": ["connection", "end"],
            "action": "connection-ended",
            "reason": row["ended"],
            "start": self._clock.iso(row["ts_ns"]),
            "end": self._clock.iso(row["end_ns"]),
            "duration": _duration(row["end_ns"] - row["ts_ns"]),
        }
        told["network"] |= {"bytes": row["client_bytes"] + row["server_bytes"], "packets": row["packets"]}
        for side in ("client", "server"):
            told[side]["bytes"] = row[f"{side}_bytes"]
        told["s7dissect"] |= _own(CONNECTIONS, row)
        self._write("connections", told)

    def transaction(self, transaction: Transaction) -> None:
        """Write a transaction."""
        if "transactions" not in self._files:
            return
        row = self._rows.transactions.row(transaction, self._rows.item_count(transaction))
        connection = transaction.connection
        asked = row["request_frame"] is not None
        sender = connection.tcp.ends[int(transaction.asked_by) if asked else 1 - int(transaction.asked_by)]
        told = self._document("transaction", row["ts_ns"], connection, sender)
        categories = ["network", *_categories(row)]
        told["event"] |= {
            "kind": "event",
            "category": categories,
            "type": ["protocol"] if len(categories) == 1 else ["info"],
            "action": _action(row["function_name"]),
            "outcome": _outcome(row),
            "start": self._clock.iso(row["ts_ns"]),
        }
        likely = row["certainty"] == LIKELY
        if row["response_ns"] is not None and asked and not likely:
            told["event"] |= {"end": self._clock.iso(row["response_ns"]), "duration": _duration(row["latency_ns"])}
        if row["errors"]:
            told["error"] = {"message": encodable("; ".join(row["errors"]))}
        given = {
            "frames": [frame for frame in (row["request_frame"], row["response_frame"]) if frame is not None],
            "latency_ms": row["latency_ns"] / 1e6 if row["latency_ns"] is not None else None,
            "certainty": LIKELY if likely else None,  # without it, it is sure
        }
        told["s7dissect"] |= _own(TRANSACTIONS, row, given)
        self._write("transactions", told)

    def finding(self, finding: Finding) -> None:
        """Write a finding."""
        if "findings" not in self._files or finding.room != KEPT:
            return
        connection = self._context.connection(int(finding.connection))
        row = FINDINGS.named(self._rows.finding(finding, connection))
        rule = finding.rule
        of_capture = rule.kind == CAPTURE  # describes the quality of the capture, not the network
        kind = "capture_quality" if of_capture else "finding"
        told = self._document(kind, row["ts_ns"] or 0, connection, None)
        told["event"] |= {
            "kind": "event" if finding.because or of_capture else "alert",
            "category": ["network"] if of_capture else ["network", "intrusion_detection"],
            "type": ["info"],
            "action": rule.slug,
            "severity": _SEVERITIES[rule.severity],
            "reason": rule.sentence,
        }
        told["message"] = f"{rule.sentence} {row['detail']}".rstrip()
        if connection is None:
            _name_hosts(told, row)
        told["rule"] = {"id": rule.slug, "name": rule.sentence, "category": rule.kind, "ruleset": "s7dissect"}
        if rule.techniques:
            told["rule"]["version"] = "MITRE ATT&CK for ICS v18"
            tactics = [TACTICS[id_] for id_ in dict.fromkeys(_tactics(row["techniques"]))]
            told["threat"] = {
                "framework": "MITRE ATT&CK for ICS",
                "tactic": {
                    "id": [tactic.id for tactic in tactics],
                    "name": [tactic.name for tactic in tactics],
                    "reference": [f"https://attack.mitre.org/tactics/{tactic.id}" for tactic in tactics],
                },
                "technique": {
                    "id": row["techniques"],
                    "name": row["technique_names"],
                    "reference": [f"https://attack.mitre.org/techniques/{id_}" for id_ in row["techniques"]],
                },
            }
        told["s7dissect"] |= _own(FINDINGS, row)
        self._write("findings", told)

    def _write_counts(self, pipeline: Pipeline) -> None:
        """Write the facts of each rule, of all its events."""
        counters = pipeline.counters
        for row in self._rows.finding_counts(pipeline.exchange.ledger, counters.earliest_ns, counters.latest_ns):
            named = FINDING_COUNTS.named(row)
            told = self._document("finding_counts", named["end_ns"] or 0, None, None)
            rule = CATALOGUE[named["slug"]]
            told["event"] |= {
                "kind": "metric",
                "category": ["network"],
                "type": ["info"],
                "action": rule.slug,
                "severity": _SEVERITIES[rule.severity],
                "start": self._clock.iso(named["ts_ns"]) if named["ts_ns"] else None,
                "end": self._clock.iso(named["end_ns"]) if named["end_ns"] else None,
            }
            told["rule"] = {"id": rule.slug, "name": rule.sentence, "category": rule.kind, "ruleset": "s7dissect"}
            _name_hosts(told, named)
            told["s7dissect"] |= _own(FINDING_COUNTS, named)
            self._write("finding_counts", told)

    # ---- documents --------------------------------------------------------------------------------------------------

    def _document(
        self, kind: str, time_ns: int, connection: Connection | None, sender: Endpoint | None
    ) -> dict[str, Any]:
        """Return the keys that all documents have. The source is ``sender``, or the client if that is None."""
        told: dict[str, Any] = {
            "@timestamp": self._clock.iso(time_ns),
            "ecs": {"version": ECS_VERSION},
            "event": {"dataset": f"s7dissect.{kind}", "module": "s7dissect", "provider": "s7dissect"},
            "observer": {"product": "s7dissect", "type": "sensor", "version": self._version},
            "data_stream": {"type": "logs", "dataset": f"s7dissect.{kind}", "namespace": "default"},
            "s7dissect": {},
        }
        if connection is None:
            return told
        client, server = connection.client, connection.server
        source = sender if sender is not None else client
        target = server if source is client else client
        told |= {
            "client": _end(client),
            "server": _end(server),
            "source": _end(source),
            "destination": _end(target),
            "related": {"ip": sorted({_ip(client), _ip(server)})},
            "network": {
                "transport": "udp" if connection.udp else "tcp",
                "iana_number": _UDP if connection.udp else _TCP,
                "type": "ipv6" if len(client.address) == 16 else "ipv4",
                "community_id": connection_community_id(connection),
                "protocol": connection.protocol or None,
            },
        }
        told["s7dissect"]["connection"] = int(connection.number)
        return told

    def _write(self, name: str, told: dict[str, Any]) -> None:
        file = self._files.get(name)
        if file is None:
            return
        told = _without_nothing(told)
        content = json.dumps(told, separators=(",", ":"))
        digest = hashlib.sha256(content.encode("ascii")).digest()[:15]
        told["event"]["id"] = base64.urlsafe_b64encode(digest).decode("ascii")  # the same in each run
        file.write(json.dumps(told, separators=(",", ":")).replace("\x7f", "\\u007f") + "\n")
        self._counts[name] += 1


def _name_hosts(told: dict[str, Any], row: dict[str, Any]) -> None:
    """Write client and server of a record that concerns no single connection."""
    for side, also in (("client", "source"), ("server", "destination")):
        host = row[f"{side}_host"]
        if host is not None:
            told[side] = told[also] = {"ip": host.partition(" ")[0], "address": host}


def _ip(end: Endpoint) -> str:
    return str(ipaddress.ip_address(end.address))


def _end(end: Endpoint) -> dict[str, Any]:
    address = _ip(end)
    return {"ip": address, "address": address, "port": end.port if end.port >= 0 else None}


def _categories(row: Mapping[str, Any]) -> list[str]:
    """Return the categories of a transaction besides "network"."""
    function = row["function"]
    if row["userdata_group"] == _SECURITY_GROUP:
        return ["authentication"]
    if row["protocol"] != "s7comm" or row["userdata_group"] is not None:
        return []
    if function in _TRANSFER:
        return ["file"]
    return ["configuration"] if function in _CONTROL else []


def _tactics(techniques: list[str]) -> list[str]:
    return [tactic for id_ in techniques if id_ in TECHNIQUES for tactic in TECHNIQUES[id_][0]]


def _action(name: str | None) -> str:
    """Return the name of a function in lower-case words joined by hyphens."""
    words = "".join([one if one.isalnum() else " " for one in (name or "unknown").lower()]).split()
    return "-".join(words)


def _outcome(row: Mapping[str, Any]) -> str:
    if row["certainty"] == LIKELY:
        return "unknown"
    if row["failed"]:
        return "failure"
    return "success" if row["outcome"] in {"answered", "unsolicited"} else "unknown"


def _duration(ns: int | None) -> int | None:
    """Return a duration; None if it is negative (the clock of the capture ran backwards), which ECS does not allow."""
    return ns if ns is None or ns >= 0 else None


def _without_nothing(told: dict[str, Any]) -> dict[str, Any]:
    """Return an object without keys whose values are None or empty; texts are made encodable."""
    kept: dict[str, Any] = {}
    for key, value in told.items():
        if isinstance(value, dict):
            inner = _without_nothing(value)
            if inner:
                kept[key] = inner
        elif isinstance(value, str):
            kept[key] = encodable(value)
        elif value is not None and value != []:
            kept[key] = value
    return kept


def ecs_export(request: ExportRequest) -> Export:
    """Return an export to documents of the Elastic Common Schema."""
    return EcsExport(request)
