"""`analyze --brief`: the findings, then a row for each PLC and each connection; never more than `MOST` lines."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from typing import Final

from dissect.engine.stations import facts
from dissect.engine.transactions.connection import Connection
from dissect.meaning.report import endings, words
from dissect.meaning.report.analysis import Analysis
from dissect.meaning.report.happened import FactWording, by_gravity, facts_of, times_of
from dissect.meaning.report.styled import DIM, HEADING, PLAIN, Line
from dissect.meaning.report.text import completeness, table
from dissect.meaning.report.words import Places, named
from dissect.packets.tcp.link import within
from dissect.wire.text import Clock, cut_inside, printable, shortened

#: Maximum number of lines in all, and in each part; a last line of the part states how many were left out.
MOST: Final = 40
_FILES: Final = 3
_FINDINGS: Final = 11
_PLCS: Final = 6
_CONNECTIONS: Final = 8
_TEXT: Final = 120


def brief_lines(
    analysis: Analysis, interrupted: bool = False, clock: Clock | None = None, hosts: Mapping[str, str] | None = None
) -> Iterator[Line]:
    """Yield the report in at most `MOST` lines. ``hosts`` are names of hosts by address."""
    places = Places(analysis.files, len(analysis.files) > 1, hosts)
    clock = clock or Clock()
    yield from _files(analysis, interrupted, clock)
    yield from _findings(analysis, places, facts_of(analysis, clock))
    yield from _plcs(analysis, places)
    yield from _connections(analysis, places)
    if analysis.pipeline is not None:
        said = [sentence for sentence, style in completeness(analysis.pipeline) if style]
        used = next(sentence for sentence, _ in completeness(analysis.pipeline))
        yield Line(shortened("; ".join([used, *said]), 400), "warning" if said else DIM, 2)


def _files(analysis: Analysis, interrupted: bool, clock: Clock) -> Iterator[Line]:
    files = analysis.files
    for file in files[:_FILES]:
        damage = f"  {words.loss_of(file.octets).upper()}: {shortened(file.damage, _TEXT)}" if file.damage else ""
        size = f"{words.count(file.packets, 'packet')}, {words.size(file.octets)}"
        yield Line(f"{printable(file.name)}: {size}{damage}", "error" if damage else HEADING, 2)
    rest = files[_FILES:]
    if rest:
        losses = Counter([words.loss_of(file.octets) for file in rest if file.damage])
        told = [words.count(sum([file.packets for file in rest]), "packet")]
        told += [f"{count} {loss}" for loss, count in sorted(losses.items())]
        yield Line(f"and {len(rest)} more files: {', '.join(told)}", DIM, 2)
    pipeline = analysis.pipeline
    said = []
    if interrupted:
        said.append("INTERRUPTED")
    if analysis.part is not None:
        said.append(f"SELECTION: {shortened(analysis.part.where, _TEXT)}")
    if pipeline is not None and pipeline.frames:
        first, last, counters = int(pipeline.first_ns), int(pipeline.now_ns), pipeline.counters
        if counters.disordered and last >= first:
            span = words.span(clock, counters.earliest_ns, counters.latest_ns)
            said.append(f"from {span} (packets are not in order of time)")
        else:
            said.append(f"from {words.span(clock, first, last)}")
    counts = [
        (analysis.total, "transactions"),
        (analysis.with_errors, "with errors"),
        (analysis.missed, "unanswered"),
        (analysis.still_open, "still open"),
        (analysis.not_captured, "without a captured answer"),
        (sum(analysis.likely.values()), "pairs only likely"),
        (analysis.behind, "behind malformed headers"),
    ]
    said.append(", ".join([f"{number} {what}" for number, what in counts if number or what == "transactions"]))
    yield Line(f"  {'; '.join(said)}", "warning" if interrupted or analysis.part is not None else PLAIN, 4)


def _findings(analysis: Analysis, places: Places, told: FactWording) -> Iterator[Line]:
    counts = analysis.finding_counts
    yield Line("Findings" if counts else "Findings: none", HEADING)
    details: dict[str, str] = {}
    for finding in analysis.findings:
        details.setdefault(
            finding.slug, f"{places.phrase(finding.frames[:2])}: {places.named(finding.detail)}".rstrip(": ")
        )
    rules = by_gravity(counts, told.ledger)
    explained = analysis.by_cause()
    for rule in rules[:_FINDINGS]:
        detail = cut_inside(details.get(rule.slug, ""), _TEXT)
        events = times_of(rule.slug, counts[rule.slug], told.ledger)
        times = f" ({told.phrase(rule) or events})" if events > 1 else ""
        if rule.slug in explained:
            detail += f"; because of it {words.explained(explained[rule.slug])}"
        yield Line(f"  {rule.severity:<7}  {rule.slug}{times}: {detail or rule.sentence}", rule.severity, 11)
    if len(rules) > _FINDINGS:
        yield Line(f"  and {len(rules) - _FINDINGS} more kinds of findings", DIM)


def _plcs(analysis: Analysis, places: Places) -> Iterator[Line]:
    found = analysis.servers.found
    if not found:
        return
    yield Line("PLCs", HEADING)
    stations = analysis.stations.stations
    some_open = any([plc.still_open for plc in found.values()])
    some_lost = any([plc.not_captured for plc in found.values()])
    head = ["", "", "", "", "connections", "PDUs", "answered", "errors", "no answer"]
    rows = [[*head, *(["still open"] if some_open else []), *(["not captured"] if some_lost else [])]]
    order = sorted(found, key=lambda host: (-found[host].missed - found[host].errors, -found[host].pdus, host))
    for host in order[:_PLCS]:
        plc, station = found[host], stations.get(host)
        told = [
            shortened(station.latest(key), 30) if station is not None else ""
            for key in (facts.ORDER_NUMBER, facts.FIRMWARE, facts.OPERATING_MODE)
        ]
        numbers = [plc.connections, plc.pdus, plc.answered, plc.errors, plc.missed]
        if some_open:
            numbers.append(plc.still_open)
        if some_lost:
            numbers.append(plc.not_captured)
        rows.append(
            [within(places.name(plc.host), plc.vlan), *told, *[str(number) if number else "." for number in numbers]]
        )
    yield from table(rows, frozenset(range(4, 11)))
    if len(order) > _PLCS:
        least = "at least " if analysis.servers.further else ""
        yield Line(f"  and {least}{len(order) - _PLCS} more; `s7dissect devices` lists them", DIM)


def _connections(analysis: Analysis, places: Places) -> Iterator[Line]:
    total = len(analysis.connections) + int(analysis.connections_not_listed)
    least = "at least " if analysis.perhaps_twice else ""
    yield Line(f"Connections: {least}{total}", HEADING)
    chosen = analysis.worst_connections(_CONNECTIONS)
    rows = [_row(connection, places) for connection in sorted(chosen, key=_number)]
    yield from table(rows, frozenset((0,)))
    if total > len(chosen):
        yield Line(f"  and {total - len(chosen)} more", DIM)


def _number(connection: Connection) -> int:
    return int(connection.number)


def _row(connection: Connection, places: Places) -> list[str]:
    said = [words.count(int(connection.pdus), "PDU")]
    if connection.errors:
        said.append(f"{connection.errors} with errors")
    if connection.missed:
        said.append(f"{connection.missed} unanswered")
    if connection.still_open:
        said.append(f"{connection.still_open} still open")
    if connection.not_captured:
        said.append(words.count(int(connection.not_captured), "answer not captured", "answers not captured"))
    if connection.refused:
        said.append(f"REFUSED: {connection.refused}")
    elif ended := endings.short(connection):
        said.append(ended)
    arrow = "→" if connection.client_known else "↔"
    ends = f"{places.end(connection.client)} {arrow} {places.end(connection.server)}"
    return [str(connection.number), ends, shortened(named(connection) or "no data", 40), ", ".join(said)]
