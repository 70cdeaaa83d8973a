"""The output of each face as records: by kind of record and face, each record under the key that all faces have for it."""

from __future__ import annotations

import csv
import io
import json
import re
from collections import Counter
from collections.abc import Callable, Hashable, Iterable
from typing import Any, Final, NamedTuple

from dissect.meaning.select.things import CONNECTION, FINDING, MESSAGE, OPERATION, TRANSACTION
from tests.faces import people
from tests.faces.reading import Told, names_of_fields

Record = dict[str, Any]
Records = dict[Hashable, Record]


class Face(NamedTuple):
    """A face of a kind of record: its name, the family by which its values are read, and how its records are cut.

    ``whole``: it has a record for each one of another face; a text report shows only some.
    """

    name: str
    family: str
    cut: Callable[[Told], Iterable[tuple[Hashable, Record]]]
    whole: bool = True


def _objects(told: Told, kind: str, form: str = "jsonl") -> list[Record]:
    return [json.loads(line) for line in told.lines[kind, form]]


def _cells(told: Told, kind: str) -> list[Record]:
    return list(csv.DictReader(io.StringIO("\n".join(told.lines[kind, "csv"]) + "\n", newline="")))


def _fields(told: Told, kind: str, thing: str) -> list[Record]:
    names = names_of_fields(thing)
    return [dict(zip(names, line.split("\t"), strict=True)) for line in told.lines[kind, "fields"]]


def _by(records: Iterable[Record], *names: str) -> Iterable[tuple[Hashable, Record]]:
    """Give records their keys: numbers, in any notation."""
    for record in records:
        key = tuple([_at(record, name) for name in names])
        yield tuple([int(part) if str(part).isdecimal() else part for part in key]), record


def _at(record: Record, path: str) -> Any:
    value: Any = record
    for name in path.split("."):
        value = value.get(name) if isinstance(value, dict) else None
    return value


def _in_order(records: Iterable[Record]) -> Iterable[tuple[Hashable, Record]]:
    return enumerate(records, 1)


def _analysis(told: Told) -> Record:
    found: Record = json.loads(told.lines["analysis", "json"][0])
    return found


def _report(told: Told) -> dict[str, list[str]]:
    return people.sections(told.lines["analysis", "text"])


def _links(
    told: Told, records: Iterable[tuple[Hashable, Record]], name: str = "connection"
) -> Iterable[tuple[Hashable, Record]]:
    """Give records the rows of their connections in the table of connections."""
    rows = {row["connection"]: row for row in told.rows["connections"]}
    for key, record in records:
        if record[name] in rows:
            yield key, rows[record[name]]


def _by_face(kind: str, name: str, told: Told) -> Iterable[tuple[Hashable, Record]]:
    return next(face.cut(told) for face in FACES[kind] if face.name == name)


# ---- items ----------------------------------------------------------------------------------------------------------


def _json_items(told: Told) -> Iterable[tuple[Hashable, Record]]:
    for one in _objects(told, "transactions"):
        scd = [{**row, "scd": half} for half in one.get("scd", []) for row in half["values"]]
        for at, item in enumerate([*one["items"], *scd], 1):
            yield (one["number"], at), {**item, "of": one, "at": at}


def _table_items(told: Told) -> Iterable[tuple[Hashable, Record]]:
    seen: Counter[int] = Counter()
    for row in told.rows["items"]:
        seen[row["transaction"]] += 1
        yield (row["transaction"], seen[row["transaction"]]), row


def _csv_items(told: Told) -> Iterable[tuple[Hashable, Record]]:
    seen: Counter[int] = Counter()
    for row in _cells(told, "transactions"):
        if row["item"]:
            number = int(row["number"])
            seen[number] += 1
            yield (number, seen[number]), row


def _said_items(told: Told) -> Iterable[tuple[Hashable, Record]]:
    for one in people.transactions(told.lines["transactions", "text"]):
        for at, item in enumerate(one["items"], 1):
            yield (int(one["number"]), at), item


# ---- transactions ---------------------------------------------------------------------------------------------------


def _csv_transactions(told: Told) -> Iterable[tuple[Hashable, Record]]:
    """Return the first row of each transaction; ``rows`` has all of them."""
    found: dict[Hashable, Record] = {}
    for row in _cells(told, "transactions"):
        own = found.setdefault((int(row["number"]),), {**row, "rows": []})
        own["rows"].append(row)
    return found.items()


# ---- messages -------------------------------------------------------------------------------------------------------


def _messages(records: Iterable[Record], protocol: str = "protocol") -> Iterable[tuple[Hashable, Record]]:
    """Give messages their keys: protocol, packet, and position in the packet; those without a PDU are left out.

    SCD inside an item of S7 is a message only in `show`: it has no key here.
    """
    seen: Counter[tuple[str, int]] = Counter()
    for record in records:
        key = str(record[protocol]), int(record["frame"])
        if key[0] not in {"s7comm", "s7comm_plus"}:
            continue
        seen[key] += 1
        yield (*key, seen[key]), record


def _zeek_messages(told: Told) -> Iterable[tuple[Hashable, Record]]:
    """Give rows of s7comm.log the keys of the messages of the table, which are in the same order."""
    rows = [(key, row) for key, row in _messages(told.rows["pdus"]) if row["protocol"] == "s7comm"]
    for (key, _), record in zip(rows, told.documents.get("zeek-json.s7comm", []), strict=False):
        yield key, record


# ---- findings -------------------------------------------------------------------------------------------------------


def _stix(told: Told) -> Iterable[tuple[Hashable, Record]]:
    """Give the notes their numbers: one for each finding, in the order of reports; with the observations and techniques."""
    objects = {one["id"]: one for one in told.documents["stix"]}
    sightings: dict[str, list[str]] = {}
    for one in objects.values():
        if one["type"] == "sighting":
            technique = objects[one["sighting_of_ref"]]["external_references"][0]["external_id"]
            sightings.setdefault(one["observed_data_refs"][0], []).append(technique)
    number = 0
    for one in objects.values():
        if one["type"] != "note" or "have no object of their own" in one["content"]:
            continue
        number += 1
        seen = objects[one["object_refs"][0]]
        traffic = objects[seen["object_refs"][0]] if seen["type"] == "observed-data" else {}
        ends = {side: _stix_end(traffic, side, objects) for side in ("src", "dst")} if traffic else {}
        record = {**one, "traffic": traffic, **ends, "observed": seen if traffic else None}
        yield (number,), {**record, "techniques": sightings.get(seen["id"], [])}


def _stix_end(traffic: Record, side: str, objects: dict[str, Record]) -> str | None:
    host = objects[traffic[f"{side}_ref"]]["value"]
    return end(host, traffic[f"{side}_port"])


def _said_findings(told: Told) -> Iterable[tuple[Hashable, Record]]:
    """Give the details of the report the numbers of the findings of the table.

    Those shown are the first of as many pairs of hosts as there is room for, then the first of all.
    """
    rows: dict[str, list[Record]] = {}
    for row in told.rows["findings"]:
        if row["explained_by"] is None:
            rows.setdefault(row["slug"], []).append(row)
    for rule in people.findings(_report(told)):
        pairs: dict[Hashable, int] = {}
        for row in (found := rows.get(rule["slug"], [])):
            pairs.setdefault((row["client_host"], row["server_host"]), row["finding"])
        wanted = [*pairs.values(), *[row["finding"] for row in found]]
        shown = sorted(list(dict.fromkeys(wanted))[: len(rule["details"])])
        for number, detail in zip(shown, rule["details"], strict=False):
            yield (number,), {**rule, **detail}


def _facts(found: dict[str, Record]) -> Iterable[tuple[Hashable, Record]]:
    for slug, facts in found.items():
        yield (slug,), {name: facts[name] for name in ("events", "reports", "connections", "first_frame", "last_frame")}


def _rules(rows: Iterable[Record]) -> list[Record]:
    return [row for row in rows if row["scope"] == "rule"]


def _rule_documents(told: Told) -> list[Record]:
    """Return what the documents say of rules, each with its slug."""
    return [
        {"slug": one["rule"]["id"], **one["s7dissect"]}
        for one in told.documents["ecs.finding_counts"]
        if one["s7dissect"]["scope"] == "rule"
    ]


def _slugs(rows: Iterable[str]) -> Iterable[tuple[Hashable, Record]]:
    for slug, count in Counter(rows).items():
        yield (slug,), {"count": count}


# ---- what all of it adds up to --------------------------------------------------------------------------------------


def _added(told: Told) -> Iterable[tuple[Hashable, Record]]:
    """Add up what the tables have for a capture."""
    rows, links = told.rows["transactions"], told.rows["connections"]
    outcomes = Counter([row["outcome"] for row in rows])
    found: Record = {"total": len(rows), "with_errors": sum([bool(row["errors"]) for row in rows])}
    found |= {name: outcomes[name] for name in ("answered", "orphan_answer", "unsolicited", "behind_malformed")}
    found["likely"] = sum([row["doubt"] is not None for row in rows])
    found["not_captured"] = sum(
        [row["outcome"] == "unanswered" and row["reason"] in {"hole", "one_sided"} for row in rows]
    )
    found["unanswered"] = outcomes["unanswered"]
    found["connections"] = len(links)
    found["missing"] = sum([row["missing_bytes"] for row in links])
    yield (), found


def _functions_of_tables(told: Told) -> Iterable[tuple[Hashable, Record]]:
    """Add up the table of transactions by function; no face has pushes of userdata as a separate function."""
    groups: dict[str, list[Record]] = {}
    for row in told.rows["transactions"]:
        groups.setdefault(row["function_name"] or "no function", []).append(row)
    for name, rows in groups.items():
        times = [row["latency_ns"] for row in rows if row["latency_ns"] is not None]
        yield (
            (name,),
            {
                **rows[0],
                "name": name,
                "total": len(rows),
                "answered": sum([row["outcome"] == "answered" for row in rows]),
                "with_errors": sum([bool(row["errors"]) for row in rows]),
                "likely": sum([row["doubt"] is not None for row in rows]),
                "most": max(times, default=None),
                "least": min(times, default=None),
            },
        )


def _listed(analysis: Record) -> Iterable[Record]:
    """Return the transactions that the report lists, each once."""
    return {one["number"]: one for one in [*analysis["failed"], *analysis["slowest"]]}.values()


def _counted(rows: Iterable[Record]) -> dict[str, Counter[str]]:
    """Count the rows of operations by kind and result."""
    found: dict[str, Counter[str]] = {}
    for row in rows:
        found.setdefault(row["kind"], Counter())[row["result"]] += 1
    return found


def _kinds(counts: Any) -> Iterable[tuple[Hashable, Record]]:
    for kind, results in counts.items():
        yield (kind,), {"results": dict(sorted(results.items()))}


def _totals(told: Told) -> Iterable[tuple[Hashable, Record]]:
    report = _report(told)
    yield (), people.totals(report)


# ---- devices --------------------------------------------------------------------------------------------------------


def _devices(records: Iterable[Record], name: str = "vlan") -> Iterable[tuple[Hashable, Record]]:
    for record in records:
        vlan = record[name]
        ids = [int(one) for one in re.findall(r"\d+", vlan)] if isinstance(vlan, str) else vlan
        yield (record["address"], tuple(ids)), record


def _cards(told: Told) -> Iterable[tuple[Hashable, Record]]:
    """Cut the cards of `devices`: the head, and its rows by their titles."""
    record: Record = {}
    for line in told.lines["devices", "text"]:
        if line.startswith(("Who talks", "No device", "and ")):
            break
        if line and not line.startswith(" "):
            host, _, rest = line.partition("  ")
            place = re.fullmatch(r"(\S+?)(?: \(?(?:in )?VLAN ([\d ./]+)\)?)?", host)
            ids = tuple([int(one) for one in re.findall(r"\d+", place[2])]) if place is not None and place[2] else ()
            record = {"role": re.sub(r" \(by its TSAP alone\)", "", rest.split("  ")[0]), "said": rest, "rows": {}}
            yield ((place[1] if place is not None else host), ids), record
        elif line:
            record["rows"].setdefault(line[2:14].strip(), []).append(line[14:])


def end(host: str | None, port: int | None) -> str | None:
    """Return an end of a connection as all faces write it."""
    if host is None:
        return None
    if port is None:
        return host
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"


def _listed_connections(told: Told) -> Iterable[tuple[Hashable, Record]]:
    """Yield the connections of the screens; a number without a value is a full stop there."""
    for row in told.screens:
        yield (int(row["#"]),), {name: "0" if text == "." else text for name, text in row.items()}


_COUNTS: Final = "zeek-json.s7comm_finding_count"
#: By kind of record its faces; if several have a fact, the others are compared with the first.
FACES: Final[dict[str, tuple[Face, ...]]] = {
    "capture": (
        Face("json", "json", lambda told: [((), _analysis(told))]),
        Face("text", "people", _totals),
        Face("tables", "tables", _added),
    ),
    "function": (
        Face("json", "json", lambda told: _by(_analysis(told)["functions"], "name")),
        Face("text", "people", lambda told: _by(people.functions(_report(told)), "function")),
        Face("tables", "tables", _functions_of_tables),
    ),
    "slug": (
        Face("json", "json", lambda told: _facts(_analysis(told)["finding_facts"])),
        Face("tables", "tables", lambda told: _by(_rules(told.rows["finding_counts"]), "slug")),
        Face("ecs", "json", lambda told: _by(_rule_documents(told), "slug")),
        Face("text", "people", lambda told: _by(people.findings(_report(told)), "slug")),
        Face("zeek", "zeek", lambda told: _by(_rules(told.documents.get(_COUNTS, [])), "slug")),
    ),
    "act": (
        Face("link", "tables", lambda told: _links(told, _by_face("act", "tables", told)), False),
        Face("tables", "tables", lambda told: _by(told.rows["acts"], "act")),
        Face("zeek", "zeek", lambda told: _by(told.documents.get("zeek-json.s7comm_act", []), "act")),
    ),
    "detailed": (
        Face("tables", "tables", lambda told: _slugs([row["slug"] for row in told.rows["findings"]])),
        Face("json", "json", lambda told: _slugs([one["slug"] for one in _analysis(told)["finding_details"]])),
        Face("ecs", "json", lambda told: _slugs([one["rule"]["id"] for one in told.documents["ecs.findings"]])),
        Face("stix", "json", lambda told: _slugs([one["labels"][0] for _, one in _stix(told)])),
    ),
    "connection": (
        Face("ending", "json", lambda told: _by(_analysis(told)["connections"], "number")),
        Face("json", "json", lambda told: _by(_analysis(told)["connections"], "number")),
        Face("tables", "tables", lambda told: _by(told.rows["connections"], "connection")),
        Face("-Y", "fields", lambda told: _by(told.things[CONNECTION], "connection")),
        Face("text", "people", lambda told: _by(people.connections(_report(told)), "number"), False),
        Face("ecs", "json", lambda told: _by(told.documents["ecs.connections"], "s7dissect.connection")),
        Face("pytest", "json", lambda told: _by(told.goldens, "number"), False),
        Face("screens", "people", _listed_connections, False),
    ),
    "transaction": (
        Face("link", "tables", lambda told: _links(told, _by_face("transaction", "tables", told)), False),
        Face("tables", "tables", lambda told: _by(told.rows["transactions"], "transaction")),
        Face("jsonl", "json", lambda told: _by(_objects(told, "transactions"), "number")),
        Face("csv", "cells", _csv_transactions),
        Face("fields", "fields", lambda told: _by(_fields(told, "transactions", TRANSACTION), "number")),
        Face("zeek", "zeek", lambda told: _by(told.documents.get("zeek-json.s7comm_transaction", []), "transaction")),
        Face("ecs", "json", lambda told: _by(told.documents["ecs.transactions"], "s7dissect.transaction")),
        Face("text", "people", lambda told: _by(people.transactions(told.lines["transactions", "text"]), "number")),
        Face("listed", "json", lambda told: _by(_listed(_analysis(told)), "number"), False),
        Face("report", "people", lambda told: _by(people.listed(_report(told)), "number"), False),
    ),
    "item": (
        Face("link", "tables", lambda told: _links(told, _table_items(told)), False),
        Face("jsonl", "json", _json_items),
        Face("tables", "tables", _table_items),
        Face("csv", "cells", _csv_items),
        Face("text", "people", _said_items, False),
    ),
    "operation": (
        Face("link", "tables", lambda told: _links(told, _by_face("operation", "tables", told)), False),
        Face("jsonl", "json", lambda told: _by(_objects(told, "operations"), "number")),
        Face("tables", "tables", lambda told: _by(told.rows["operations"], "operation")),
        Face("fields", "fields", lambda told: _by(_fields(told, "operations", OPERATION), "number")),
        Face("text", "people", lambda told: _by(people.operations(told.lines["operations", "text"]), "number")),
    ),
    "kind": (
        Face("json", "json", lambda told: _kinds(_analysis(told)["operations"])),
        Face("text", "people", lambda told: _kinds(people.kinds(_report(told))), False),
        Face("tables", "tables", lambda told: _kinds(_counted(told.rows["operations"]))),
    ),
    "finding": (
        Face("link", "tables", lambda told: _links(told, _by_face("finding", "tables", told)), False),
        Face("tables", "tables", lambda told: _by(told.rows["findings"], "finding")),
        Face("json", "json", lambda told: _by(_analysis(told)["finding_details"], "number")),
        Face("ecs", "json", lambda told: _by(told.documents["ecs.findings"], "s7dissect.finding")),
        Face("stix", "json", _stix),
        Face("-Y", "fields", lambda told: _in_ones(told.things[FINDING])),
        Face("text", "people", _said_findings, False),
    ),
    "value": (
        Face("jsonl", "json", lambda told: _in_order(_objects(told, "values"))),
        Face("tables", "tables", lambda told: _in_order(told.rows["values"])),
        Face("csv", "cells", lambda told: _in_order(_cells(told, "values"))),
        Face("text", "people", lambda told: _in_order(people.values(told.lines["values", "text"]))),
    ),
    "device": (
        Face("json", "json", lambda told: _devices(json.loads(told.lines["devices", "json"][0])["devices"])),
        Face("csv", "cells", lambda told: _devices(_cells(told, "devices"))),
        Face("tables", "tables", lambda told: _devices(told.rows["devices"], "vlans")),
        Face("text", "people", _cards),
        Face("analysis", "json", lambda told: _devices(_analysis(told)["devices"]), False),
    ),
    "pdu": (
        Face("link", "tables", lambda told: _links(told, _by_face("pdu", "tables", told)), False),
        Face("jsonl", "json", lambda told: _messages(_objects(told, "PDUs"))),
        Face("tables", "tables", lambda told: _messages(told.rows["pdus"])),
        Face("fields", "fields", lambda told: _messages(_fields(told, "PDUs", MESSAGE))),
        Face("text", "people", lambda told: _messages(people.messages(told.lines["PDUs", "text"]))),
        Face("zeek", "zeek", _zeek_messages, False),
    ),
}


def _in_ones(records: Iterable[Record]) -> Iterable[tuple[Hashable, Record]]:
    for number, record in enumerate(records, 1):
        yield (number,), record


def cut(told: Told) -> dict[tuple[str, str], Records]:
    """Return the records of a capture, by kind of record and name of face."""
    return {(kind, face.name): dict(face.cut(told)) for kind, faces in FACES.items() for face in faces}
