"""How often, when and between which hosts a rule applied: its facts as text and as JSON, the same for all outputs."""

from __future__ import annotations

from collections.abc import Iterable
from operator import itemgetter
from typing import Final, NamedTuple

from dissect.engine.findings.catalogue import CATALOGUE, SEVERITIES, Rule
from dissect.engine.findings.ledger import Ledger, Occurrences
from dissect.meaning.report.analysis import Analysis
from dissect.meaning.report.words import Places
from dissect.wire.text import Clock, count

#: Maximum number of pairs of hosts that JSON names for a rule; the events of further pairs are added up.
PAIRS: Final = 100
#: From this duration on, times are written to the second.
_SECONDS_NS: Final = 10_000_000_000


class FactWording(NamedTuple):
    """Describes the facts of rules; it has the facts, the clock, and the time that the capture covers."""

    ledger: Ledger
    clock: Clock
    begin_ns: int
    end_ns: int

    def phrase(self, rule: Rule, others: bool = True) -> str:
        """Return the facts of a rule as text; empty for a rule without any.

        ``27 writes on 1 connection, 17:50:20 to 19:58:01``. Without ``others`` pairs of hosts are left out.
        """
        found = self.ledger.rules.get(rule.slug)
        if found is None or not found.events:
            return ""
        said = times(rule, int(found.events))
        if found.connections:
            said += f" on {'at least ' if found.at_least else ''}{count(int(found.connections), 'connection')}"
        pairs = len(self.ledger.pairs_with(rule.slug)) if others else 0
        if pairs > 1 or (pairs and not found.connections):
            more = "more than " if self.ledger.further(rule.slug) else ""
            said += f"{' of' if found.connections else ' between'} {more}{count(pairs, 'pair')} of hosts"
        return f"{said}, {self.span(found)}"

    def span(self, found: Occurrences) -> str:
        """Return when events happened: ``17:50:20 to 19:58:01``, with dates if these differ."""
        return span(self.clock, int(found.first_ns), int(found.last_ns))

    def lasts(self, rule: Rule) -> bool:
        """Return whether a rule still applied in the last tenth of the capture."""
        found = self.ledger.rules.get(rule.slug)
        return found is not None and found.lasts(self.begin_ns, self.end_ns)

    def as_dict(self, rule: Rule, places: Places) -> dict[str, object]:
        """Return the facts of a rule in the form of the JSON contract (docs/json.md)."""
        from dissect.meaning.facts.counted import OCCURRENCES  # imported late, because text does not need them
        from dissect.meaning.facts.written import written

        found = self.ledger.rules[rule.slug]
        pairs = self.ledger.pairs_of(rule.slug)
        named = pairs[:PAIRS]
        return {
            **written(OCCURRENCES, found, places, self.clock),
            "reported": rule.reported,
            "hosts": self.ledger.hosts_of(rule.slug),
            "in_last_tenth": self.lasts(rule),
            "pairs": [
                {
                    "client": pair.client,
                    "server": pair.server,
                    **written(OCCURRENCES, pair.records[rule.slug], places, self.clock),
                }
                for pair in named
            ],
            "pairs_not_listed": len(pairs) - len(named),
            "events_of_pairs_not_listed": sum([int(pair.records[rule.slug].events) for pair in pairs[PAIRS:]])
            + self.ledger.further(rule.slug),
        }


def times(rule: Rule, number: int) -> str:
    """Return the number of events of a rule: ``1 write``, ``300 refused requests``, ``3 times``."""
    return count(number, rule.noun)


def span(clock: Clock, first_ns: int, last_ns: int) -> str:
    """Return the time of the first and the last event, to the millisecond if they are close together."""
    first_day, first = clock.moment(first_ns).split(" ")[:2]
    last_day, last = clock.moment(last_ns).split(" ")[:2]
    size = len("17:50:20" if last_ns - first_ns >= _SECONDS_NS else "17:50:20.123")
    if first_ns == last_ns:
        return f"at {first[:size]}"
    if first_day == last_day:
        return f"{first[:size]} to {last[:size]}"
    return f"{first_day} {first[:size]} to {last_day} {last[:size]}"


def facts_of(analysis: Analysis, clock: Clock) -> FactWording:
    """Return the facts of the rules of an analysis."""
    counters = analysis.pipeline.counters if analysis.pipeline is not None else None
    if counters is None:
        return FactWording(analysis.ledger, clock, 0, 0)
    return FactWording(analysis.ledger, clock, counters.earliest_ns, counters.latest_ns)


def by_gravity(slugs: Iterable[str], ledger: Ledger) -> list[Rule]:
    """Return rules in the order of display: by severity, those that change a running plant first, then by time."""
    rules = [CATALOGUE[slug] for slug in slugs]
    found = [
        (SEVERITIES.index(rule.severity), rule.gravity, _first_ns(rule, ledger), rule.slug, rule) for rule in rules
    ]
    return [rule for *_, rule in sorted(found, key=itemgetter(0, 1, 2, 3))]


def _first_ns(rule: Rule, ledger: Ledger) -> int:
    found = ledger.rules.get(rule.slug)
    return int(found.first_ns) if found is not None else 0


def findings_in(ledger: Ledger) -> int:
    """Return the number of findings, with or without details, including those that others explain."""
    return sum([int(found.reports) for found in [*ledger.rules.values(), *ledger.explained.values()]])


def times_of(slug: str, findings: int, ledger: Ledger) -> int:
    """Return the number of events of a rule: at least as many as ``findings``."""
    found = ledger.rules.get(slug)
    return max(findings, int(found.events)) if found is not None else findings
