"""The findings of a report as text: a rule, how often and when it applied, some of its findings, and the advice."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Final

from dissect.engine.findings.catalogue import Rule
from dissect.engine.findings.reporter import Finding
from dissect.meaning.report import words
from dissect.meaning.report.analysis import Analysis
from dissect.meaning.report.examples import Examples
from dissect.meaning.report.happened import FactWording, by_gravity, times_of
from dissect.meaning.report.styled import DIM, HEADING, PLAIN, Line
from dissect.meaning.report.words import Places
from dissect.wire.text import cut_inside

#: Limits: findings of a rule that are shown one by one, characters of each, and packets of the others.
_DETAILS: Final = 3
_MORE_FRAMES: Final = 8
_DETAIL_SIZE: Final = 400


def findings_lines(analysis: Analysis, places: Places, told: FactWording) -> Iterator[Line]:
    """Yield the section on findings."""
    counts = analysis.finding_counts
    if not counts:
        if analysis.total:
            yield Line("")
            yield Line("Findings: none", HEADING)
        return
    yield Line("")
    yield Line("Findings", HEADING)
    details = _shown(analysis.findings)
    explained = analysis.by_cause()
    for rule in by_gravity(counts, told.ledger):
        explains = words.explained(explained.get(rule.slug, {}))
        events = times_of(rule.slug, counts[rule.slug], told.ledger)
        yield from finding_lines(
            rule, events, details.get(rule.slug, []), places, explains=explains, facts=told.phrase(rule)
        )


def _shown(findings: Iterable[Finding]) -> dict[str, list[Finding]]:
    """Return, by slug, those that are shown one by one, then some of the others: there may be thousands."""
    shown: dict[str, Examples] = {}
    early: dict[str, list[Finding]] = {}
    more: dict[str, set[int]] = {}
    for finding in findings:
        slug = finding.slug
        here = early.get(slug)
        if here is None:
            here = early[slug] = []
            shown[slug] = Examples(_DETAILS)
            more[slug] = set()
        shown[slug].take(finding)
        frames = more[slug]
        if len(frames) > _MORE_FRAMES:
            continue
        if len(here) >= _DETAILS:
            frames.update(finding.frames[-1:])
        here.append(finding)
    found: dict[str, list[Finding]] = {}
    for slug, examples in shown.items():
        chosen = examples.chosen()
        found[slug] = [*chosen, *[one for one in early[slug] if one not in chosen]]
    return found


def finding_lines(
    rule: Rule,
    count: int,
    details: Sequence[Finding],
    places: Places,
    most: int = _DETAILS,
    explains: str = "",
    facts: str = "",
) -> Iterator[Line]:
    """Yield the lines of a rule that applied ``count`` times, with up to ``most`` of its findings in detail.

    ``explains`` are the findings that it explains, as text; ``facts`` say when it applied, and between which hosts.
    """
    times = f" ({count} times)" if count > 1 else ""
    yield Line(f"  {rule.severity}  {rule.slug}{times}: {rule.sentence}", rule.severity, 6)
    if facts and count > 1:
        yield Line(f"      {facts}", PLAIN, 8)
    for finding in details[:most]:
        where = f"connection {finding.connection}, " if finding.connection else ""
        said = f": {cut_inside(places.named(finding.detail), _DETAIL_SIZE)}" if finding.detail else ""
        yield Line(f"      {where}{places.phrase(finding.frames)}{said}", PLAIN, 8)
    shown = min(most, len(details))  # some rules have details only for the first time
    if details and count > shown:
        rest = _last_packets(details[shown:], _MORE_FRAMES + 1)
        more = ", …" if len(rest) > _MORE_FRAMES or count > len(details) else ""
        at = f": {places.phrase(sorted(rest[:_MORE_FRAMES]))}{more}" if rest else ""
        yield Line(f"      and {count - shown} more{at}", PLAIN, 8)
    if explains:
        yield Line(f"      because of it: {explains}", PLAIN, 8)
    yield Line(f"      → {rule.advice}", DIM, 8)
    if rule.techniques:
        yield Line(f"      MITRE ATT&CK: {', '.join([str(technique) for technique in rule.techniques])}", DIM, 8)


def _last_packets(details: Sequence[Finding], most: int) -> list[int]:
    """Return the last packet of each finding, up to ``most`` different ones."""
    found: dict[int, None] = {}
    for finding in details:
        frames = finding.frames
        if frames:
            found[frames[-1]] = None
            if len(found) == most:
                break
    return list(found)
