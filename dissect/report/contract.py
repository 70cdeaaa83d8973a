"""The JSON contract of `analyze -T json`: plain values with a stable order of keys (docs/json.md, dissect/schema/)."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from typing import Final

from dissect.engine.pipeline import Pipeline
from dissect.findings.catalogue import CATALOGUE, SEVERITIES
from dissect.findings.reporter import Finding
from dissect.iso.tsap import Tsap
from dissect.report.analysis import Analysis, FunctionStatistics
from dissect.report.certainty import left_out
from dissect.report.endings import ending_as_dict
from dissect.report.facets import facet_of_row
from dissect.report.happened import facts_of
from dissect.report.stations import station_as_dict, stations_that_state
from dissect.report.tls import tls_as_dict
from dissect.report.words import Places
from dissect.report.writers.jsonl import TransactionLines
from dissect.source.packet import SourceFile
from dissect.tcp.link import vlan_ids
from dissect.transactions.accounts import CATEGORIES, FIRST_IGNORED
from dissect.transactions.connection import Connection
from dissect.transactions.transaction import Transaction
from dissect.wire.text import Clock, encodable

ANALYSIS_SCHEMA: Final = "s7dissect.analysis/1"


def analysis_as_dict(analysis: Analysis, interrupted: bool = False) -> dict[str, object]:
    """Return an analysis as the object `analyze -T json` writes. ValueError when it was not filled by a run.

    With several files every packet number counts within its file, and the file's name is given with it. ``interrupted`` says
    that reading was broken off.
    """
    return {
        name: list(value) if isinstance(value, Iterator) else value
        for name, value in analysis_sections(analysis, interrupted)
    }


def analysis_sections(analysis: Analysis, interrupted: bool = False) -> Iterator[tuple[str, object]]:
    """Yield the names and values of `analysis_as_dict`, long lists as iterators that make their objects one by one.

    Raises ValueError for an analysis that was not filled by a run.
    """
    pipeline = analysis.pipeline
    if pipeline is None:
        raise ValueError("this Analysis is empty: call take() first, or use dissect.analyze()")
    described = analysis.sections()
    described["scd"] = described.get("scd")
    clock = Clock()
    places = Places(analysis.files, len(analysis.files) > 1)
    lines = TransactionLines()
    if places.several:
        lines.locate = places.locate
    yield "schema", ANALYSIS_SCHEMA
    yield "interrupted", interrupted
    yield "files", [_file(file) for file in analysis.files]
    yield "selection", analysis.part.as_dict() if analysis.part is not None else None
    yield "first_time", clock.iso(pipeline.first_ns) if pipeline.frames else None
    yield "last_time", clock.iso(pipeline.now_ns) if pipeline.frames else None
    yield "packets", _packets(pipeline)
    connections = sorted(analysis.connections, key=_number)
    yield "connections", (connection_as_dict(connection, places, clock) for connection in connections)
    yield "connections_not_listed", analysis.connections_not_listed
    yield "connections_without_data", pipeline.counters.bare.found()[0]
    yield from described.items()
    yield "devices", [station_as_dict(station) for station in stations_that_state(analysis.stations)]
    yield "transactions", _transactions(analysis)
    yield "latency_ns", {**analysis.latencies.as_dict(), "exact": analysis.latencies.exact}
    yield "operations", {kind: dict(sorted(counts.items())) for kind, counts in sorted(analysis.operations.items())}
    yield "functions", [_function(code, statistics) for code, statistics in sorted(analysis.functions.items())]
    yield "failed", (json.loads(lines.line(transaction)) for transaction in analysis.failed)
    yield "slowest", (json.loads(lines.line(transaction)) for transaction in analysis.slowest())
    yield "findings", dict(sorted(analysis.finding_counts.items()))
    yield "findings_explained", analysis.by_cause()
    told = facts_of(analysis, clock)
    yield "finding_facts", {slug: told.as_dict(CATALOGUE[slug], places) for slug in sorted(analysis.ledger.rules)}
    details = by_weight(analysis.findings, analysis.explained)
    yield "finding_details", (finding_as_dict(finding, places, clock) for finding in details)
    yield "loss", _loss(pipeline)


def _transactions(analysis: Analysis) -> dict[str, object]:
    return {
        "total": analysis.total,
        "answered": analysis.answered,
        "unanswered": analysis.unanswered,
        "still_open": analysis.still_open,
        **_likely(analysis),
        "orphan_answers": analysis.orphans,
        "unsolicited": analysis.unsolicited,
        "one_way": analysis.one_way,
        **({"behind_malformed": analysis.behind} if analysis.behind else {}),
        "with_errors": analysis.with_errors,
        "unanswered_reasons": dict(sorted(analysis.unanswered_reasons.items())),
    }


def _likely(analysis: Analysis) -> dict[str, object]:
    """Return the keys for answers that were not captured, and for pairs that are only likely; none where there are none."""
    told: dict[str, object] = {}
    if analysis.not_captured:
        told["answers_not_captured"] = analysis.not_captured
    if analysis.likely:
        told["likely"] = sum(analysis.likely.values())
        told["likely_doubts"] = dict(sorted(analysis.likely.items()))
        told["likely_text"] = f"{left_out(analysis.likely)}."
    return told


def _number(connection: Connection) -> int:
    return connection.number


def _file(file: SourceFile) -> dict[str, object]:
    return {
        "name": encodable(file.name),
        "packets": file.packets,
        "octets": file.octets,
        "damage": encodable(file.damage) or None,
        "rejected_blocks": file.rejected,
        "notes": [encodable(note) for note in file.notes],
    }


def _packets(pipeline: Pipeline) -> dict[str, object]:
    counts = pipeline.counters.packet_counts()
    used = {name: counts[name] for name in CATEGORIES[:FIRST_IGNORED] if counts[name]}
    ignored = {name: counts[name] for name in CATEGORIES[FIRST_IGNORED:] if counts[name]}
    return {"read": pipeline.frames, "used": used, "ignored": ignored, "truncated": pipeline.counters.cut_frames}


def _loss(pipeline: Pipeline) -> dict[str, object]:
    octets = pipeline.counters.octets
    return {
        "gaps": octets.holes,
        "octets_missing": octets.missing,
        "octets_skipped": octets.skipped,
        "octets": octets.as_dict(),
        "connections_evicted": pipeline.table.evicted,
        "connections_forgotten": pipeline.connections.forgotten,
        "connections_perhaps_twice": pipeline.connections.twice,
        "half_open_evicted": pipeline.table.half_open_evicted,
        "datagrams_evicted": pipeline.counters.fragments.evicted,
        "datagrams_expired": pipeline.counters.fragments.expired,
        "operations_evicted": pipeline.exchange.watch.operations.evicted,
        "scan_pairs_forgotten": pipeline.connections.scans.forgotten,
    }


def _function(code: int, statistics: FunctionStatistics) -> dict[str, object]:
    values = facet_of_row(code).statistics(code)
    values["name"] = statistics.name
    values["total"] = statistics.total
    values["answered"] = statistics.answered
    values["unanswered"] = statistics.unanswered
    values["still_open"] = statistics.still_open
    if statistics.not_captured:
        values["answers_not_captured"] = statistics.not_captured
    if statistics.likely:
        values["likely"] = statistics.likely
    if statistics.behind:
        values["behind_malformed"] = statistics.behind
    values["with_errors"] = statistics.errors
    values["latency_ns"] = statistics.latencies.as_dict()
    return values


def tsap_as_dict(tsap: Tsap | None) -> dict[str, object] | None:
    """Return a TSAP, None when it was not captured."""
    return tsap.as_dict() if tsap is not None else None


def _place(key: str, frame: int, places: Places) -> dict[str, object]:
    """Return a packet's number under ``key``_frame, and with several files its file; None for packet 0, which means none."""
    if not places.several:
        return {f"{key}_frame": frame or None}
    if not frame:
        return {f"{key}_frame": None, f"{key}_file": None}
    name, number = places.locate(frame)
    return {f"{key}_frame": number, f"{key}_file": name}


def connection_as_dict(connection: Connection, places: Places, clock: Clock | None = None) -> dict[str, object]:
    """Return one connection: its ends, TSAPs, negotiated values, counts, how it ended. Many calls may share one ``clock``."""
    tcp = connection.tcp
    clock = clock or Clock()
    ending = connection.ending
    side = int(ending.side) if ending is not None else -1
    return {
        "number": connection.number,
        "client": str(connection.client),
        "server": str(connection.server),
        "client_known": connection.client_known,
        "transport": "udp" if connection.udp else "tcp",
        "vlan": vlan_ids(tcp.vlan),
        **({"also_vlans": [vlan_ids(vlan) for vlan in tcp.also]} if tcp.also else {}),
        "protocol": connection.protocol or None,
        "identified_by": connection.identified_by or None,
        "tls": tls_as_dict(connection),
        "start": "syn" if tcp.known_start else ("cr" if connection.cr_seen else "mid_stream"),
        **_place("first", tcp.first_frame, places),
        "first_time": clock.iso(tcp.first_ns),
        **_place("last", connection.last_frame, places),
        "last_time": clock.iso(connection.last_ns),
        "calling_tsap": tsap_as_dict(connection.tsap_calling),
        "called_tsap": tsap_as_dict(connection.tsap_called),
        "tpdu_size": connection.tpdu_size or None,
        "setup_asked": connection.setup_asked.as_dict() if connection.setup_asked is not None else None,
        "setup_granted": connection.granted.as_dict() if connection.granted is not None else None,
        "pdus": connection.pdus,
        **({"behind_malformed": connection.behind} if connection.behind else {}),
        "answered": connection.answered,
        "unanswered": connection.unanswered,
        "still_open": connection.still_open,
        **({"answers_not_captured": connection.not_captured} if connection.not_captured else {}),
        "orphan_answers": connection.orphans,
        "unsolicited": connection.unsolicited,
        "one_way": connection.one_way,
        "with_errors": connection.errors,
        "refused": connection.refused or None,
        "disconnected": connection.iso_ended or None,
        "ended": connection.ended,
        "ended_by": str(tcp.ends[side]) if side >= 0 else None,
        **_place("ended", ending.frame if ending is not None else 0, places),
        "open_at_end": connection.open_at_end,
        "ending": ending_as_dict(connection, places),
    }


def by_weight(findings: Sequence[Finding], explained: Sequence[Finding] = ()) -> Iterator[Finding]:
    """Yield findings ordered by severity, the heaviest first, then as they came."""
    sorted_out: dict[str, list[Finding]] = {severity: [] for severity in SEVERITIES}
    for some in (findings, explained):
        for finding in some:
            sorted_out[finding.rule.severity].append(finding)
    for found in sorted_out.values():
        if explained:
            found.sort(key=_number_of)
        yield from found


def _number_of(finding: Finding) -> int:
    return int(finding.number)


def finding_as_dict(finding: Finding, places: Places, clock: Clock | None = None) -> dict[str, object]:
    """Return one detailed finding. Many calls may share one ``clock``."""
    rule = finding.rule
    values: dict[str, object] = {
        "number": finding.number or None,
        "slug": rule.slug,
        "severity": rule.severity,
        "kind": rule.kind,
        "connection": finding.connection or None,
        "frames": [places.number(frame) for frame in finding.frames] if places.several else list(finding.frames),
    }
    if places.several:
        values["files"] = [places.locate(frame)[0] for frame in finding.frames]
    values["time"] = (clock or Clock()).iso(finding.time_ns) if finding.time_ns else None
    values["sentence"] = rule.sentence
    values["detail"] = encodable(finding.detail)
    values["advice"] = rule.advice
    values["techniques"] = [technique.as_dict() for technique in rule.techniques]
    values["explained_by"] = finding.explained_by or None
    values["because_of"] = finding.because or None
    return values


def transaction_as_dict(transaction: Transaction) -> dict[str, object]:
    """Return a transaction as its JSON line has it."""
    found: dict[str, object] = json.loads(TransactionLines().line(transaction))
    return found
