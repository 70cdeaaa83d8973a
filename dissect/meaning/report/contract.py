"""The JSON contract of `analyze -T json`: plain values with a stable order of keys (docs/json.md, dissect/meaning/schema/)."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from typing import Final

from dissect.engine.findings.catalogue import SEVERITIES
from dissect.engine.findings.reporter import Finding
from dissect.engine.pipeline import Pipeline
from dissect.engine.transactions.accounts import CATEGORIES, FIRST_IGNORED
from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.transaction import Transaction
from dissect.meaning.facts.connection import CONNECTION
from dissect.meaning.facts.finding import FINDING
from dissect.meaning.facts.written import written
from dissect.meaning.report.analysis import Analysis, FunctionStatistics
from dissect.meaning.report.certainty import left_out
from dissect.meaning.report.endings import ending_as_dict
from dissect.meaning.report.facets import facet_of_row
from dissect.meaning.report.happened import by_gravity, facts_of
from dissect.meaning.report.stations import station_as_dict, stations_that_state
from dissect.meaning.report.tls import tls_as_dict
from dissect.meaning.report.words import Places
from dissect.meaning.report.writers.jsonl import TransactionLines
from dissect.packets.source.packet import SourceFile
from dissect.wire.text import Clock, encodable

ANALYSIS_SCHEMA: Final = "s7dissect.analysis/1"


def analysis_as_dict(analysis: Analysis, interrupted: bool = False) -> dict[str, object]:
    """Return an analysis as the object `analyze -T json` writes. ValueError when it was not filled by a run.

    With several files every packet number counts within its file, and the file's name is given, too. ``interrupted`` says that
    the user stopped the reading.
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
    rules = by_gravity(analysis.ledger.rules, analysis.ledger)
    yield "finding_facts", {rule.slug: told.as_dict(rule, places) for rule in rules}
    details = worst_first(analysis.findings, analysis.explained)
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
    """Return the keys for answers that were not captured, and for pairs that are only likely; none if there are none."""
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


def connection_as_dict(connection: Connection, places: Places, clock: Clock | None = None) -> dict[str, object]:
    """Return one connection: its ends, TSAPs, negotiated values, counts, and its ending. Many calls may share one ``clock``."""
    owned = {"tls": tls_as_dict(connection), "ending": ending_as_dict(connection, places)}
    return written(CONNECTION, connection, places, clock or Clock(), owned)


def worst_first(findings: Sequence[Finding], explained: Sequence[Finding] = ()) -> Iterator[Finding]:
    """Yield findings ordered by severity, the heaviest first, then in their original order."""
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
    return written(FINDING, finding, places, clock or Clock())


def transaction_as_dict(transaction: Transaction) -> dict[str, object]:
    """Return a transaction as its JSON line has it."""
    found: dict[str, object] = json.loads(TransactionLines().line(transaction))
    return found
