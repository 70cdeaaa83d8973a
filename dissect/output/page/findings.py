"""The findings of a report, for the part of the page that works without a script."""

from __future__ import annotations

from typing import Any, Final

from dissect.engine.findings.catalogue import CATALOGUE
from dissect.engine.findings.reporter import Finding
from dissect.meaning.report import words
from dissect.meaning.report.examples import examples_of
from dissect.meaning.report.happened import by_gravity, facts_of, times_of
from dissect.output.page.gathered import Gathered
from dissect.output.page.numbers import how_often
from dissect.wire.text import cut_inside

#: Maximum number of findings of a kind that are shown one by one, and of characters of each.
_DETAILS: Final = 25
_DETAIL: Final = 400


def findings_of(gathered: Gathered) -> list[dict[str, Any]]:
    """Return the findings, in the order of all faces, for the part of the page that works without a script."""
    counts = gathered.analysis.finding_counts
    explained = gathered.analysis.by_cause()
    details: dict[str, list[Any]] = {}
    for finding in gathered.analysis.findings:
        details.setdefault(finding.slug, []).append(finding)
    told = []
    listed = {row["cells"][0] for row, _ in gathered.connections.rows()}
    facts = facts_of(gathered.analysis, gathered.rows.clock)
    for rule in by_gravity(counts, gathered.analysis.ledger):
        times = times_of(rule.slug, counts[rule.slug], facts.ledger)
        found = sorted(details.get(rule.slug, []), key=lambda one: int(one.time_ns))
        shown = examples_of(found, _DETAILS)
        rows = [_occurrence(gathered, one, listed) for one in shown]
        told.append(
            {
                "rule": CATALOGUE[rule.slug],
                "count": times,
                "times": how_often(times),
                "facts": facts.phrase(rule) if times > 1 else "",
                "rows": rows,
                "earliest": shown == found[:_DETAILS],
                "explains": words.explained(explained.get(rule.slug, {})),
                "techniques": ", ".join([str(technique) for technique in rule.techniques]),
            }
        )
    return told


def _occurrence(gathered: Gathered, one: Finding, listed: set[int]) -> dict[str, Any]:
    """Return an occurrence of a finding; ``listed`` are the connections that have a row in the page."""
    rows = gathered.rows
    return {
        "time": rows.clock.moment(int(one.time_ns)),
        "connection": int(one.connection),
        "listed": int(one.connection) in listed,
        "packets": rows.short(rows.places.phrase(one.frames)),
        "detail": cut_inside(rows.short(rows.places.named(one.detail)), _DETAIL),
        **rows.packets(list(one.frames)),
    }
