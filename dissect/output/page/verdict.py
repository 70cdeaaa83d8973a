"""The first sentences of a report: the failure, its duration, and the hosts concerned, with the packets that show it."""

from __future__ import annotations

from typing import Final

from dissect.engine.findings.catalogue import (
    CAPTURE,
    ERROR,
    FUNCTION,
    NEGOTIATION,
    NOTE,
    OPERATION,
    PROTOCOL,
    SECURITY,
    SEVERITIES,
    Rule,
)
from dissect.engine.findings.ledger import Pair
from dissect.engine.findings.reporter import Finding
from dissect.meaning.report import words
from dissect.meaning.report.analysis import Analysis
from dissect.meaning.report.happened import FactWording, by_gravity, facts_of, times_of
from dissect.meaning.report.words import PROTOCOLS
from dissect.output.page.gathered import Gathered
from dissect.output.page.numbers import counted, how_often
from dissect.wire.text import cut_inside, duration_text

#: Kinds of findings in the order in which they are preferred among findings of equal severity.
_KINDS: Final = (FUNCTION, OPERATION, NEGOTIATION, PROTOCOL, SECURITY, CAPTURE)
#: Findings of every plant with a panel: they come last among those of their severity and kind.
_EVERYDAY: Final = frozenset(("security.write",))
#: Limits: characters of the detail, and pairs of hosts that are named.
_DETAIL: Final = 160
_PAIRS: Final = 3
#: The suffix of the name of a host in a VLAN (`dissect.packets.tcp.link.within`).
_IN_VLAN: Final = " in VLAN "


class Verdict:
    """Three sentences, and one about data that are missing from the capture.

    ``severity`` is that of the worst finding, empty for none; the sentences are about ``finding``.
    """

    def __init__(self, severity: str, sentences: list[str], finding: Finding | None = None) -> None:
        self.severity = severity
        self.sentences = sentences
        self.finding = finding


def heaviest_rules(analysis: Analysis) -> list[Rule]:
    """Return the rules that applied, the heaviest first: changes of a running plant, then failures, then by time."""
    rules = by_gravity(analysis.finding_counts, analysis.ledger)
    return sorted(rules, key=_weight)  # for equal weight, the order stays


def _weight(rule: Rule) -> tuple[int, int, int, bool]:
    return SEVERITIES.index(rule.severity), rule.gravity, _KINDS.index(rule.kind), rule.slug in _EVERYDAY


def verdict(gathered: Gathered) -> Verdict:
    """Return the verdict on a run."""
    said = _verdict(gathered)
    said.sentences += gaps_in(gathered)
    return said


def _verdict(gathered: Gathered) -> Verdict:
    analysis = gathered.analysis
    rules = [rule for rule in heaviest_rules(analysis) if rule.severity != NOTE]
    if not analysis.total and not any([rule.kind != CAPTURE for rule in rules]):
        return Verdict(rules[0].severity if rules else "", _nothing(gathered))
    if not rules:
        return Verdict("", _sound(gathered))
    rule = rules[0]
    found = sorted([finding for finding in analysis.findings if finding.slug == rule.slug], key=_time)
    told = facts_of(analysis, gathered.rows.clock)
    count = times_of(rule.slug, analysis.finding_counts[rule.slug], told.ledger)
    if not found:
        return Verdict(rule.severity, [f"{rule.sentence} This happened {how_often(count)}.", *_sound(gathered)[1:]])
    first = found[0]
    return Verdict(
        rule.severity,
        [_what(gathered, rule, first), _since(gathered, rule, first, told), _who(gathered, found, rules)],
        first,
    )


def _time(finding: Finding) -> tuple[int, int]:
    return int(finding.time_ns), finding.frames[0] if finding.frames else 0


def _what(gathered: Gathered, rule: Rule, first: Finding) -> str:
    """Return the sentence about the failure, with the packets that show it."""
    rows = gathered.rows
    detail = cut_inside(rows.short(rows.places.named(first.detail)), _DETAIL).rstrip(".")
    shown = rows.short(rows.places.phrase(first.frames))
    # The detail is appended to the sentence of the rule: it is not a sentence, and may begin with a name in lower case.
    broke = rule.sentence[:-1]
    joint = ";" if ": " in broke else ":"
    said = f"{broke}{joint} {detail} ({shown})." if detail else f"{broke} ({shown})."
    answered = int(gathered.analysis.answered)
    if rule.kind in {SECURITY, CAPTURE} and gathered.failed.total == gathered.failed_pushes and answered:
        return f"No request failed; {counted(answered, 'answer')} arrived. What stands out: {said}"
    return said


def _since(gathered: Gathered, rule: Rule, first: Finding, told: FactWording) -> str:
    """Return the sentence on since when and how often it happened, from the facts of all events."""
    found = told.ledger.rules.get(rule.slug)
    first_ns, last_ns, number = int(first.time_ns), int(first.time_ns), gathered.analysis.finding_counts[rule.slug]
    if found is not None and found.events:
        first_ns, last_ns = int(found.first_ns), int(found.last_ns)
        number = times_of(rule.slug, number, told.ledger)
    moment = gathered.rows.clock.moment(first_ns)
    after = ""
    if gathered.analysis.part is None:
        after = f", {duration_text(max(0, first_ns - gathered.start_ns))} after the capture began"
    if number == 1:
        return f"It happened once, at {moment}{after}."
    spread = last_ns - first_ns
    until = f", the last time {duration_text(spread)} later" if spread > 0 else ""
    return f"It happened {how_often(number)}: the first time at {moment}{after}{until}."


def _who(gathered: Gathered, found: list[Finding], rules: list[Rule]) -> str:
    """Return the sentence about the hosts concerned, and other findings."""
    ledger = gathered.analysis.ledger
    named: dict[str, None] = {}
    ends = {int(connection.number): connection for connection in gathered.analysis.connections}
    for finding in found:
        connection = ends.get(int(finding.connection))
        if connection is not None:
            named[gathered.rows.talk(connection, int(connection.client_side))] = None
    pairs = ledger.pairs_of(found[0].slug)
    if pairs and len(pairs) > len(named):
        named = dict.fromkeys([_talk(gathered, pair) for pair in pairs[:_PAIRS]])
    count = max(len(pairs), len(named))
    if named:
        shown = list(named)[:_PAIRS]
        least = "at least " if ledger.further(found[0].slug) else ""
        more = f" and {least}{counted(count - len(shown), 'more pair')}" if count > len(shown) else ""
        said = f"It concerns {', '.join(shown)}{more}"
    else:
        said = "It concerns the capture as a whole"
    others = len(rules) - 1
    errors = sum([1 for rule in rules[1:] if rule.severity == ERROR])
    if not others:
        return f"{said}; there is no other error or warning."
    # Notes are listed below, too, but they are not faults, so they are not counted here.
    weights = [(errors, "error"), (others - errors, "warning")]
    kinds = " and ".join(
        [words.count(number, f"more kind of {what}", f"more kinds of {what}s") for number, what in weights if number]
    )
    return f"{said}; there {'are' if others > 1 else 'is'} {kinds} below."


def _talk(gathered: Gathered, pair: Pair) -> str:
    """Return two hosts by their names, and their VLAN, as `Rows.talk` does."""
    client, inside, vlan = pair.client.partition(_IN_VLAN)
    server = pair.server.partition(_IN_VLAN)[0]
    return f"{gathered.rows.host(client)} → {gathered.rows.host(server)}{inside}{vlan}"


def _sound(gathered: Gathered) -> list[str]:
    """Return sentences for a run without faults: the amount of traffic, the answer times, and the hosts."""
    analysis = gathered.analysis
    times = analysis.latencies
    pairs = list(gathered.talks.pairs)
    fast = (
        f"Half of the answers came within {words.answer_time(times.quantile(0.5))}, the slowest after "
        f"{words.duration(int(times.largest))}."
        if times.count
        else "No answer time could be measured."
    )
    host = gathered.rows.host
    between = (
        f"{host(pairs[0][0])} talked to {gathered.rows.station(pairs[0][1:])}."
        if len(pairs) == 1
        else f"{counted(len(pairs), 'pair')} of hosts talked to each other."
    )
    return [
        f"Nothing broke: {counted(int(analysis.answered), 'request')} answered, no errors, no warnings.",
        fast,
        between,
    ]


def _nothing(gathered: Gathered) -> list[str]:
    """Return sentences for a capture without S7: the traffic that it has instead."""
    pipeline = gathered.analysis.pipeline
    if pipeline is None or not pipeline.frames:
        return [
            "The capture holds no packets.",
            "There is nothing to report.",
            "Check the capture filter and the interface.",
        ]
    counts = pipeline.counters.packet_counts()
    instead = [
        counted(counts[name], f"packet {said}", f"packets {said}")
        for name, said in (
            ("other_protocol", "of TCP connections without ISO-on-TCP"),
            ("not_tcp", "of IP without TCP"),
            ("not_ip", "without IP"),
            ("no_payload", "of TCP without data"),
            ("link_type", "of an unsupported link type"),
        )
        if counts[name]
    ]
    others = [
        counted(count, f"{PROTOCOLS[name]} message")
        for name, count in carried(gathered).items()
        if count and name not in {"s7comm", "s7comm_plus", "scd", "empty"}
    ]
    advice = "S7 is recognised on any TCP port: capture at a mirror port that carries the PLC's traffic."
    sealed = pipeline.finding_counts.get("capture.not_opened", 0)
    if sealed:
        wrapped = counted(sealed, "packet is wrapped", "packets are wrapped")
        advice = f"{wrapped} in something that is not opened, where S7 may be: capture.not_opened names it."
    return [
        f"There is no S7 communication in this capture of {counted(int(pipeline.frames), 'packet')}.",
        f"It holds instead: {', '.join(instead + others) or 'nothing that could be read'}.",
        advice,
    ]


def carried(gathered: Gathered) -> dict[str, int]:
    """Return the number of messages that ISO-on-TCP carried, by protocol."""
    counted: dict[str, int] = gathered.analysis.sections().get("tsdus", {})
    return counted


#: This many gaps that are all between messages cannot be an accident: packet loss does not depend on content.
_FILTERED: Final = 8


def gaps_in(gathered: Gathered) -> list[str]:
    """Return the sentence about the gaps of the whole capture; empty if it has none, or if the report covers a part of it."""
    analysis = gathered.analysis
    if analysis.pipeline is None or analysis.part is not None:
        return []
    octets = analysis.pipeline.counters.octets
    gaps, missing, inside = int(octets.holes), int(octets.missing), int(octets.inside)
    if not gaps:
        return []
    share = words.percent(missing, missing + int(octets.delivered))
    return [f"{counted(gaps, 'gap')}, {words.size(missing)}, {share}, {_where(gaps, inside, int(octets.skipped))}."]


def _where(gaps: int, inside: int, skipped: int) -> str:
    """Return where the gaps are; ``skipped``: captured bytes that belong to no message, as after a gap that ends inside one."""
    if inside:
        return f"{'inside a message' if gaps == 1 else f'{inside} of them inside messages'}: packets were lost"
    if skipped:
        return "begins between messages" if gaps == 1 else "all begin between messages"
    if gaps >= _FILTERED:
        return "all between messages: a filtered capture"
    return "between messages" if gaps == 1 else "all between messages"
