"""Findings as a STIX 2.1 bundle: a sighting of an ATT&CK technique for each finding that points to one, a note for others.

Ids are the same in each run. Those of addresses and traffic are made as the standard prescribes: UUIDv5 over the properties
that identify the object. All others are UUIDv5 in a namespace of our own.
"""

from __future__ import annotations

import ipaddress
import json
import uuid
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from dissect.engine.findings.bounds import KEPT
from dissect.engine.findings.catalogue import CATALOGUE, Rule
from dissect.engine.findings.ledger import Ledger, Occurrences, Pair
from dissect.engine.findings.mitre import Technique
from dissect.engine.findings.reporter import Finding
from dissect.engine.observer import Observer
from dissect.engine.transactions.connection import Connection
from dissect.files.session import Run
from dissect.meaning.facts.keys import connection_community_id
from dissect.meaning.report.happened import times
from dissect.meaning.select.things import Context
from dissect.output.export.attack_tables import TACTICS, TECHNIQUES
from dissect.output.export.forms import Export, ExportRequest
from dissect.output.export.rows import Rows
from dissect.packets.tcp.stream import Endpoint
from dissect.wire.text import Clock, encodable

#: Namespace of the ids of observables (STIX 2.1, 2.9).
_OBSERVABLES: Final = uuid.UUID("00abedb4-aa42-466c-9c01-fed23315a9b7")
#: Namespace of our other ids: UUIDv5 of "s7dissect" in the namespace of OIDs.
_OURS: Final = uuid.uuid5(uuid.NAMESPACE_OID, "s7dissect")
_SPEC: Final = "2.1"
_FRAMEWORK: Final = "mitre-attack"


class StixExport(Export, Observer):
    """Collects objects and writes the bundle to a file at the end. Findings are limited, so the objects are, too."""

    def __init__(self, request: ExportRequest) -> None:
        Observer.__init__(self)
        self.observer = self
        self._path: Path = request.path
        self._version = request.version
        self._objects: dict[str, dict[str, Any]] = {}
        self._run: Run | None = None
        self._told: dict[tuple[str, str, str], int] = {}  # findings in detail, by slug and hosts
        self._findings = 0
        self._context = Context()
        self._rows = Rows([])
        self._clock = Clock()

    @property
    def counts(self) -> Mapping[str, int]:
        """The numbers of findings, and of objects in the bundle."""
        return {"findings": self._findings, "objects": len(self._objects)}

    def begin(self, run: Run) -> None:
        """Set the files of the run, by which packets are named."""
        self._rows = Rows(run.files)
        self._run = run

    def flush(self) -> None:
        """Do nothing: the bundle is written at the end."""

    def close(self) -> None:
        """Write the bundle."""
        if self._run is not None:
            self._add_counts(self._run.pipeline.exchange.ledger)
        objects = list(self._objects.values())
        key = json.dumps(objects, sort_keys=True)
        bundle: dict[str, Any] = {"type": "bundle", "id": f"bundle--{uuid.uuid5(_OURS, key)}"}
        if objects:  # the standard does not allow an empty list
            bundle["objects"] = objects
        text = json.dumps(bundle, indent=1).replace("\x7f", "\\u007f")
        self._path.write_text(f"{text}\n", encoding="ascii")

    def abandon(self) -> None:
        """Do nothing: no file is open before the end."""

    def connection_opened(self, connection: Connection) -> None:
        """Remember a connection for its findings."""
        self._context.opened(connection)

    def connection_closed(self, connection: Connection) -> None:
        """Remember a finished connection, for findings that come later."""
        self._context.closed(connection)

    def finding(self, finding: Finding) -> None:
        """Add the objects of a finding."""
        if finding.room != KEPT:
            return  # it is one of those that `_add_counts` adds up
        self._findings += 1
        connection = self._context.connection(int(finding.connection))
        time = self._time(int(finding.time_ns))
        tool = self._identity(time)
        # A finding that another one explains gets its own note, but no observation: nothing else was seen there.
        seen = [self._traffic(connection)] if connection is not None and not finding.because else []
        if not finding.because:
            place = (finding.slug, finding.client, finding.server)
            self._told[place] = self._told.get(place, 0) + 1
        text = self._text(finding, connection)
        if not seen:
            self._note(finding, tool, time, text, [tool])
            return
        key = f"{finding.slug} {self._findings} {seen[0]}"
        observed = self._add(
            "observed-data",
            key,
            time,
            tool,
            first_observed=time,
            last_observed=time,
            number_observed=1,
            object_refs=seen,
        )
        self._note(finding, tool, time, text, [observed])
        for technique in finding.rule.techniques:
            if technique.v18 in TECHNIQUES:
                self._sighting(key, technique, tool, observed, time, time, 1)

    def _add_counts(self, ledger: Ledger) -> None:
        """Add the events without a detailed finding: one observation for each rule between each two hosts."""
        for pair in ledger.pairs.values():
            for slug, found in pair.records.items():
                more = int(found.events) - self._told.get((slug, pair.client, pair.server), 0)
                if more > 0:
                    self._add_more(CATALOGUE[slug], pair, found, more)

    def _add_more(self, rule: Rule, pair: Pair, found: Occurrences, more: int) -> None:
        first, last = self._time(int(found.first_ns)), self._time(int(found.last_ns))
        tool = self._identity(last)
        ends = [self._host(pair.client), self._host(pair.server)]
        traffic = self._observable(
            "network-traffic", {"start": first, "src_ref": ends[0], "dst_ref": ends[1], "protocols": ["tcp"]}
        )
        key = f"{rule.slug} more {pair.client} {pair.server}"
        observed = self._add(
            "observed-data",
            key,
            last,
            tool,
            first_observed=first,
            last_observed=last,
            number_observed=more,
            object_refs=[traffic],
        )
        said = (
            f"{rule.sentence} {times(rule, int(found.events))} between {pair.client} and {pair.server};"
            f" {more} of them have no object of their own."
        )
        labels = [rule.slug, rule.severity, rule.kind]
        self._add(
            "note",
            key,
            last,
            tool,
            abstract=rule.sentence,
            content=said,
            object_refs=[observed],
            labels=labels,
        )
        for technique in rule.techniques:
            if technique.v18 in TECHNIQUES:
                self._sighting(key, technique, tool, observed, first, last, more)

    # ---- objects ----------------------------------------------------------------------------------------------------

    def _sighting(
        self, key: str, technique: Technique, tool: str, observed: str, first: str, last: str, number: int
    ) -> None:
        self._add(
            "sighting",
            f"{key} {technique.v18}",
            last,
            tool,
            sighting_of_ref=self._technique(technique, last),
            observed_data_refs=[observed],
            where_sighted_refs=[tool],
            first_seen=first,
            last_seen=last,
            count=number,
        )

    def _note(self, finding: Finding, tool: str, time: str, text: str, about: list[str]) -> None:
        rule = finding.rule
        self._add(
            "note",
            f"{rule.slug} {self._findings}",
            time,
            tool,
            abstract=rule.sentence,
            content=text,
            object_refs=about,
            labels=[rule.slug, rule.severity, rule.kind],
        )

    def _text(self, finding: Finding, connection: Connection | None) -> str:
        row = self._rows.finding(finding, connection)
        frames = ", ".join([str(frame) for frame in row[6]])
        said = [finding.rule.sentence, encodable(finding.detail), f"Packets {frames} of {row[5]}." if frames else ""]
        if connection is not None:
            said.append(f"Community ID {connection_community_id(connection)}.")
        return " ".join([text for text in (*said, finding.rule.advice) if text])

    def _identity(self, time: str) -> str:
        return self._add("identity", "tool", time, None, name=f"s7dissect {self._version}", identity_class="system")

    def _technique(self, technique: Technique, time: str) -> str:
        """Add the object of a technique, with MITRE's id for it, so that it can be joined with their data."""
        tactics, number = TECHNIQUES[technique.v18]
        id_ = f"attack-pattern--{number}"
        if id_ not in self._objects:
            url = f"https://attack.mitre.org/techniques/{technique.v18}"
            self._objects[id_] = {
                "type": "attack-pattern",
                "spec_version": _SPEC,
                "id": id_,
                "created": time,
                "modified": time,
                "name": technique.name,
                "kill_chain_phases": [
                    {"kill_chain_name": "mitre-ics-attack", "phase_name": TACTICS[tactic].phase} for tactic in tactics
                ],
                "external_references": [
                    {"source_name": _FRAMEWORK, "external_id": technique.v18, "url": url},
                ],
            }
        return id_

    def _traffic(self, connection: Connection) -> str:
        """Add the objects of a connection and its ends."""
        client, server = connection.client, connection.server
        inner = [connection.protocol] if connection.protocol else []
        protocols = [
            "ipv6" if len(client.address) == 16 else "ipv4",
            "udp" if connection.udp else "tcp",
            *[name.lower() for name in inner],
        ]
        known = {
            "start": self._time(int(connection.tcp.first_ns)),
            "src_ref": self._address(client),
            "dst_ref": self._address(server),
            "src_port": client.port,
            "dst_port": server.port,
            "protocols": protocols,
        }
        return self._observable("network-traffic", known)

    def _address(self, end: Endpoint) -> str:
        address = ipaddress.ip_address(end.address)
        return self._observable(f"ipv{address.version}-addr", {"value": str(address)})

    def _host(self, host: str) -> str:
        """Add the object of a host by its name in facts, which may include a VLAN."""
        address = ipaddress.ip_address(host.partition(" ")[0])
        return self._observable(f"ipv{address.version}-addr", {"value": str(address)})

    def _observable(self, type_: str, known: dict[str, Any]) -> str:
        canonical = json.dumps(known, sort_keys=True, separators=(",", ":"), ensure_ascii=False)
        id_ = f"{type_}--{uuid.uuid5(_OBSERVABLES, canonical)}"
        self._objects[id_] = {"type": type_, "spec_version": _SPEC, "id": id_, **known}
        return id_

    def _add(self, type_: str, key: str, time: str, tool: str | None, **properties: Any) -> str:
        id_ = f"{type_}--{uuid.uuid5(_OURS, f'{type_} {key} {time if tool else self._version}')}"
        if id_ not in self._objects:
            by = {"created_by_ref": tool} if tool is not None else {}
            head = {"type": type_, "spec_version": _SPEC, "id": id_, **by, "created": time, "modified": time}
            self._objects[id_] = {**head, **properties}
        return id_

    def _time(self, time_ns: int) -> str:
        """Return a time in UTC with microseconds; most readers do not keep more digits."""
        return f"{self._clock.iso(time_ns)[:26]}Z"


def stix_export(request: ExportRequest) -> Export:
    """Return an export of findings to a STIX bundle."""
    return StixExport(request)
