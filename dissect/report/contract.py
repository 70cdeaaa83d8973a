"""The JSON contract: what `-T json` and `-T jsonl` write, as plain values with stable key order (docs/json.md)."""

from __future__ import annotations

from typing import Final

from dissect.findings.finding import SEVERITIES, Finding
from dissect.iso.tables import TPDU_TYPES
from dissect.iso.tsap import Tsap
from dissect.iso.upper import UPPER_NAMES
from dissect.pipeline import Pipeline
from dissect.report.analysis import Analysis, FunctionStatistics
from dissect.source.packet import SourceFile
from dissect.transactions.accounts import CATEGORIES, FIRST_IGNORED
from dissect.transactions.connection import Connection
from dissect.wire.clock import Clock

ANALYSIS_SCHEMA: Final = "s7dissect.analysis/1"


def analysis_as_dict(analysis: Analysis) -> dict[str, object]:
    """Return an analysis as the object `analyze -T json` writes. ValueError when it was not filled by a run."""
    pipeline = analysis.pipeline
    if pipeline is None:
        raise ValueError("this Analysis has not been filled by a run: call take() first, or use dissect.analyze()")
    talk = pipeline.conversation
    clock = Clock()
    first = clock.iso(pipeline.first_ns) if pipeline.frames else None
    return {
        "schema": ANALYSIS_SCHEMA,
        "files": [_file(file) for file in analysis.files],
        "first_time": first,
        "last_time": clock.iso(pipeline.now_ns) if pipeline.frames else None,
        "packets": _packets(pipeline),
        "connections": [connection_as_dict(connection) for connection in analysis.connections],
        "connections_not_listed": analysis.connections_not_listed,
        "tsdus": {name: count for name, count in zip(UPPER_NAMES, talk.tsdus, strict=True) if count or name in _ALWAYS},
        "tpdus": _tpdus(talk.tpdus),
        "s7": {
            "pdus": talk.pdus,
            "cut": talk.cut_pdus,
            "unpaired": talk.unpaired,
            "rosctr": {str(code): count for code, count in enumerate(talk.rosctrs) if count},
            "functions": {f"0x{code:02x}": count for code, count in enumerate(talk.functions) if count},
        },
        "transactions": {
            "total": analysis.total,
            "answered": analysis.answered,
            "unanswered": analysis.unanswered,
            "orphan_answers": analysis.orphans,
            "unsolicited": analysis.unsolicited,
            "with_errors": analysis.with_errors,
            "unanswered_reasons": dict(sorted(analysis.unanswered_reasons.items())),
        },
        "latency_ns": {**analysis.latencies.as_dict(), "exact": analysis.latencies.exact},
        "functions": [_function(code, statistics) for code, statistics in sorted(analysis.functions.items())],
        "findings": dict(sorted(talk.judge.counts.items())),
        "finding_details": [finding_as_dict(finding) for finding in by_weight(analysis.findings)],
        "loss": _loss(pipeline),
    }


#: TSDU counts that are there even when zero.
_ALWAYS: Final = frozenset(("s7comm", "s7comm_plus", "mms", "tls", "unknown"))


def _file(file: SourceFile) -> dict[str, object]:
    return {
        "name": file.name,
        "packets": file.packets,
        "octets": file.octets,
        "damage": file.damage or None,
        "rejected_blocks": file.rejected,
        "notes": file.notes,
    }


def _packets(pipeline: Pipeline) -> dict[str, object]:
    counts = pipeline.packet_counts()
    used = {name: counts[name] for name in CATEGORIES[:FIRST_IGNORED] if counts[name]}
    ignored = {name: counts[name] for name in CATEGORIES[FIRST_IGNORED:] if counts[name]}
    return {"read": pipeline.frames, "used": used, "ignored": ignored, "truncated": pipeline.cut_frames}


def _tpdus(counts: list[int]) -> dict[str, int]:
    named = {TPDU_TYPES.name(code): count for code, count in enumerate(counts[:16]) if count}
    if counts[16]:
        named["too_short"] = counts[16]
    return named


def _loss(pipeline: Pipeline) -> dict[str, object]:
    octets = pipeline.octets
    return {
        "gaps": octets.holes,
        "octets_missing": octets.missing,
        "octets_skipped": octets.skipped,
        "octets": octets.as_dict(),
        "connections_evicted": pipeline.table.evicted,
        "half_open_evicted": pipeline.table.half_open_evicted,
        "datagrams_evicted": pipeline.fragments.evicted,
        "datagrams_expired": pipeline.fragments.expired,
    }


def _function(code: int, statistics: FunctionStatistics) -> dict[str, object]:
    values: dict[str, object] = {"code": f"0x{code & 0xFF:02x}" if 0 <= code < 0x10000 else None}
    if code >= 0x10000:
        values = {"code": "0x00", "group": (code >> 8) & 0xFF, "subfunction": code & 0xFF}
    values["name"] = statistics.name
    values["total"] = statistics.total
    values["answered"] = statistics.answered
    values["unanswered"] = statistics.unanswered
    values["with_errors"] = statistics.errors
    values["latency_ns"] = statistics.latencies.as_dict()
    return values


def tsap_as_dict(tsap: Tsap | None) -> dict[str, object] | None:
    """Return a TSAP, None when it was not captured."""
    return tsap.as_dict() if tsap is not None else None


def connection_as_dict(connection: Connection) -> dict[str, object]:
    """Return one connection: who, TSAPs, negotiated values, counts, how it ended."""
    tcp = connection.tcp
    clock = Clock()
    ended_by = str(tcp.ends[tcp.ended_by]) if tcp.ended_by >= 0 else None
    return {
        "number": connection.number,
        "client": str(connection.client),
        "server": str(connection.server),
        "client_known": connection.client_known,
        "vlan": [int(vid) for vid in _vlans(int(tcp.vlan))],
        "protocol": connection.protocol or None,
        "start": "syn" if tcp.known_start else ("cr" if connection.cr_seen else "mid_stream"),
        "first_frame": tcp.first_frame,
        "first_time": clock.iso(tcp.first_ns),
        "last_frame": tcp.last_frame,
        "last_time": clock.iso(tcp.last_ns),
        "calling_tsap": tsap_as_dict(connection.tsap_calling),
        "called_tsap": tsap_as_dict(connection.tsap_called),
        "tpdu_size": connection.tpdu_size or None,
        "setup_asked": connection.setup_asked.as_dict() if connection.setup_asked is not None else None,
        "setup_granted": connection.granted.as_dict() if connection.granted is not None else None,
        "pdus": connection.pdus,
        "answered": connection.answered,
        "unanswered": connection.unanswered,
        "orphan_answers": connection.orphans,
        "unsolicited": connection.unsolicited,
        "with_errors": connection.errors,
        "refused": connection.refused or None,
        "ended": connection.closed_reason or tcp.ended or "open",
        "ended_by": ended_by,
        "ended_frame": tcp.ended_frame or None,
        "open_at_end": connection.open_at_end,
    }


def _vlans(key: int) -> list[int]:
    vids: list[int] = []
    while key:
        key, vid = divmod(key, 4096)
        vids.append(vid)
    vids.reverse()
    return vids


def by_weight(findings: list[Finding]) -> list[Finding]:
    """Return findings ordered by severity, the heaviest first, then as they came."""
    return sorted(findings, key=lambda finding: SEVERITIES.index(finding.severity))


def finding_as_dict(finding: Finding) -> dict[str, object]:
    """Return one detailed finding."""
    return {
        "slug": finding.slug,
        "severity": finding.severity,
        "connection": finding.connection or None,
        "frames": finding.frames,
        "time": Clock().iso(finding.time_ns) if finding.time_ns else None,
        "sentence": finding.rule.sentence,
        "detail": finding.detail,
        "advice": finding.rule.advice,
    }
