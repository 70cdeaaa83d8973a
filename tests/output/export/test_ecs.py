"""Documents of the Elastic Common Schema: names, allowed values, and what a template maps."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any, Final

import pytest

from dissect import analyze
from dissect.engine.findings.catalogue import CATALOGUE
from dissect.files.session import Run
from dissect.output.export.attack_tables import TACTICS, TECHNIQUES
from dissect.output.export.ecs import ecs_export, index_template
from dissect.output.export.forms import ExportRequest
from tests.cli.support import run
from tests.meaning.report.support import OWN, ROOT, begun, saved
from tests.promises import hostile

TRANSFER: Final = ROOT / "captures" / "transfer.pcapng"
#: What `event.type` may be beside each category (ECS, "Using the categorization fields").
EXPECTED: Final = {
    "network": {"access", "allowed", "connection", "denied", "end", "info", "protocol", "start"},
    "intrusion_detection": {"allowed", "denied", "info"},
    "authentication": {"start", "end", "info"},
    "file": {"access", "change", "creation", "deletion", "info"},
    "configuration": {"access", "change", "creation", "deletion", "info"},
}
#: The fields of ECS that are used, each with its type.
TYPES: Final = {
    "@timestamp": str, "message": str, "ecs.version": str, "event.dataset": str, "event.module": str, "event.provider": str,
    "event.kind": str, "event.category": list, "event.type": list, "event.action": str, "event.outcome": str,
    "event.start": str, "event.end": str, "event.duration": int, "event.id": str, "event.severity": int,
    "event.reason": str, "observer.product": str, "observer.type": str, "observer.version": str,
    "data_stream.type": str, "data_stream.dataset": str, "data_stream.namespace": str, "related.ip": list,
    "network.transport": str, "network.iana_number": str, "network.type": str, "network.community_id": str,
    "network.protocol": str, "network.bytes": int, "network.packets": int, "rule.id": str, "rule.name": str,
    "rule.category": str, "rule.ruleset": str, "rule.version": str, "threat.framework": str, "error.message": str,
    "threat.tactic.id": list, "threat.tactic.name": list, "threat.tactic.reference": list,
    "threat.technique.id": list, "threat.technique.name": list, "threat.technique.reference": list,
    **{f"{side}.{name}": kind for side in ("client", "server", "source", "destination")
       for name, kind in (("ip", str), ("address", str), ("port", int), ("bytes", int))},
}  # fmt: skip


#: By the type of a field in the index template: the types of its values.
OWN_TYPES: Final = {
    "long": (int,), "double": (int, float), "boolean": (bool,), "keyword": (str,), "match_only_text": (str,), "text": (str,),
}  # fmt: skip


def documents(path: Path, folder: Path) -> dict[str, list[dict[str, Any]]]:
    folder.mkdir(exist_ok=True)
    export = ecs_export(ExportRequest(folder, True, [], [str(path)], "0"))
    reading = Run([path], export.observer)
    export.begin(reading)
    while reading.step():
        pass
    export.close()
    found = {}
    for file in folder.glob("*.ndjson"):
        text = file.read_text(encoding="ascii")
        assert "\x7f" not in text
        found[file.stem] = [json.loads(line) for line in text.split("\n")[:-1]]
    return found


def flat(told: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    found: dict[str, Any] = {}
    for key, value in told.items():
        found |= flat(value, f"{prefix}{key}.") if isinstance(value, dict) else {f"{prefix}{key}": value}
    return found


def test_every_document_keeps_to_the_schema(tmp_path: Path) -> None:
    mapped = index_template()["template"]["mappings"]["properties"]
    for number, path in enumerate(OWN[::4]):
        for told in [one for some in documents(path, tmp_path / str(number)).values() for one in some]:
            for name, value in flat(told).items():
                if not name.startswith("s7dissect."):
                    assert type(value) is TYPES[name], name
                    continue
                found: Any = mapped
                for step in name.split("."):
                    found = found[step]
                    found = found.get("properties", found)
                one = value[0] if isinstance(value, list) else value
                assert type(one) in OWN_TYPES[found["type"]], name
            event = told["event"]
            for category in event["category"]:
                assert set(event["type"]) <= EXPECTED[category], event
            assert event["kind"] in {"event", "alert", "metric"}
            assert event.get("outcome", "unknown") in {"success", "failure", "unknown"}
            assert re.fullmatch(r"[a-z0-9._-]+", event["action"]), event
            assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{9}Z", told["@timestamp"])
            assert told["data_stream"]["dataset"] == event["dataset"]
            assert {"@timestamp", "event", "s7dissect"} <= mapped.keys()


def test_a_clock_that_ran_backwards_makes_no_duration(tmp_path: Path) -> None:
    packets = begun().close().packets()
    late = [packet._replace(time_ns=packet.time_ns - 10**12) for packet in packets[7:]]
    path = saved(tmp_path / "backwards.pcapng", packets[:7] + late)
    (connection,) = documents(path, tmp_path / "ecs")["connections"]
    assert connection["event"]["end"] < connection["event"]["start"]
    assert "duration" not in connection["event"]


def test_counts_roles_and_results(tmp_path: Path) -> None:
    found, analysis = documents(TRANSFER, tmp_path / "ecs"), analyze(TRANSFER)
    assert {name: len(some) for name, some in found.items()} == {
        "transactions": analysis.total,
        "findings": len(analysis.findings),
        "finding_counts": len(found["finding_counts"]),
        "connections": len(analysis.connections),
    }
    rules = [told for told in found["finding_counts"] if told["s7dissect"]["scope"] == "rule"]
    assert {told["rule"]["id"] for told in rules} == set(analysis.finding_counts)
    downloads = [told for told in found["transactions"] if told["event"]["action"] == "request-download"]
    assert {told["event"]["outcome"] for told in downloads} == {"success", "failure"}
    assert {tuple(told["event"]["category"]) for told in downloads} == {("network", "file")}
    for told in found["transactions"]:
        assert told["server"]["port"] == 102
        assert (told["source"] == told["client"]) != (told["source"] == told["server"])
        assert told["event"].get("duration", 1) > 0
    # In a download the PLC asks.
    pulled = [told for told in found["transactions"] if told["event"]["action"] == "download-block"]
    assert {told["source"]["port"] for told in pulled} == {102}
    assert len({told["event"]["id"] for some in found.values() for told in some}) == sum(map(len, found.values()))
    again = documents(TRANSFER, tmp_path / "again")
    assert again == found


def test_findings_name_techniques_and_tactics(tmp_path: Path) -> None:
    found = documents(TRANSFER, tmp_path / "ecs")["findings"]
    threats = [told["threat"] for told in found if "threat" in told]
    assert threats
    for threat in threats:
        assert threat["framework"] == "MITRE ATT&CK for ICS"
        assert (
            len(threat["technique"]["id"]) == len(threat["technique"]["name"]) == len(threat["technique"]["reference"])
        )
        assert set(threat["tactic"]["id"]) <= set(TACTICS)
    known = {technique.v18 for rule in CATALOGUE.values() for technique in rule.techniques}
    assert known <= set(TECHNIQUES)
    assert {tactic for tactics, _ in TECHNIQUES.values() for tactic in tactics} <= set(TACTICS)


def test_naughty_strings_do_no_harm(tmp_path: Path) -> None:
    found = documents(hostile.write(tmp_path / "hostile.pcapng"), tmp_path / "ecs")
    assert len(found["transactions"]) > 1000
    assert len({told["s7dissect"].get("about") for told in found["transactions"]}) > 180


def test_the_command_writes_a_folder(capfdbinary: pytest.CaptureFixture[bytes], tmp_path: Path) -> None:
    out = tmp_path / "ecs"
    ran = run(capfdbinary, "export", TRANSFER, "-o", f"ecs:{out}", "--only", "findings")
    assert ran.code == 0, ran.err
    assert sorted(path.name for path in out.iterdir()) == ["findings.ndjson", "index-template.json", "s7dissect.json"]
    template = json.loads((out / "index-template.json").read_text(encoding="ascii"))
    assert template == index_template()
    assert template["template"]["mappings"]["properties"]["@timestamp"] == {"type": "date_nanos"}


def test_a_finding_about_no_connection_names_its_hosts(tmp_path: Path) -> None:
    (one,) = documents(ROOT / "captures" / "refused-port.pcapng", tmp_path / "ecs")["findings"]
    assert (one["client"]["ip"], one["server"]["ip"]) == ("127.0.0.1", "127.0.0.1")
