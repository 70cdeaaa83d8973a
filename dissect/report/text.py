"""`analyze` for a person: connections, transactions by function, findings, slowest and failed transactions, loss."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from dissect.findings.catalogue import CATALOGUE
from dissect.findings.finding import SEVERITIES, Finding, Rule
from dissect.report import words
from dissect.report.analysis import Analysis
from dissect.transactions.accounts import CATEGORIES, FIRST_IGNORED
from dissect.transactions.connection import Connection
from dissect.transactions.transaction import Transaction
from dissect.wire.clock import Clock
from dissect.wire.text import printable

#: Frames and details shown of one finding; the rest is counted.
_FRAMES = 8
_DETAILS = 3
_CONNECTIONS = 20
_FAILED = 10

#: Marks a piece of text with a style ("heading", "error", "warning", "note", "dim"); the default leaves it plain.
Styler = Callable[[str, str], str]

#: How packets that were not used are called.
_IGNORED = {
    "not_ip": "not IP",
    "not_tcp": "IP but not TCP",
    "fragment_waiting": "fragments of datagrams that never became whole",
    "fragment_dropped": "dropped fragments",
    "other_protocol": "of TCP connections that do not speak ISO-on-TCP",
    "before_start": "from before the first octet seen of their connection",
    "after_close": "after a reset",
    "reset_ignored": "resets that were not believed",
    "cut": "cut before the end of their headers",
    "bad_header": "with impossible headers",
    "link_type": "of a link type that is not supported",
    "failed": "the analyzer failed on",
}


def plain(text: str, _style: str) -> str:
    """Leave text without style."""
    return text


def analysis_lines(analysis: Analysis, style: Styler = plain) -> Iterator[str]:
    """Yield the report line by line. ``style`` may colour pieces of it; the text is the same without."""
    yield from _files(analysis, style)
    yield from _connections(analysis, style)
    yield from _transactions(analysis, style)
    yield from _findings(analysis, style)
    yield from _failed(analysis, style)
    yield from _slowest(analysis, style)
    yield from _loss(analysis, style)


def table(rows: list[list[str]], right: frozenset[int]) -> Iterator[str]:
    """Yield rows as aligned columns; the columns in ``right`` are aligned to the right."""
    if not rows:
        return
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    for row in rows:
        cells = [
            text.rjust(widths[column]) if column in right else text.ljust(widths[column])
            for column, text in enumerate(row)
        ]
        yield "  " + "  ".join(cells).rstrip()


def _files(analysis: Analysis, style: Styler) -> Iterator[str]:
    pipeline = analysis.pipeline
    for file in analysis.files:
        yield style(
            f"{printable(file.name)}: {words.count(file.packets, 'packet')}, {words.size(file.octets)}", "heading"
        )
        if file.damage:
            yield style(f"  DAMAGED: {printable(file.damage)}", "error")
        for note in file.notes:
            yield style(f"  {printable(note)}", "warning")
    if pipeline is not None and pipeline.frames:
        clock = Clock()
        lasted = words.duration(pipeline.now_ns - pipeline.first_ns)
        yield f"  from {_moment(clock.iso(pipeline.first_ns))}, {lasted}"
        talk = pipeline.conversation
        other = {name: count for name, count in _other_protocols(analysis).items() if count}
        said = f"  {words.count(talk.pdus, 'S7 PDU')}"
        if other:
            said += "; not S7comm: " + ", ".join([f"{count} {name}" for name, count in other.items()])
        yield said


def _moment(iso: str) -> str:
    """Return a time for a person: microseconds do, and a blank between date and time."""
    return f"{iso[:10]} {iso[11:26]} UTC"


def _other_protocols(analysis: Analysis) -> dict[str, int]:
    pipeline = analysis.pipeline
    if pipeline is None:
        return {}
    names = ("", "S7comm-plus", "MMS", "TLS", "RDP", "unknown", "")
    return {f"{name} messages": count for name, count in zip(names, pipeline.conversation.tsdus, strict=True) if name}


def _connections(analysis: Analysis, style: Styler) -> Iterator[str]:
    connections = analysis.connections
    if not connections:
        yield ""
        yield style("No ISO-on-TCP connection in this capture.", "heading")
        return
    yield ""
    yield style("Connections", "heading")
    for connection in connections[:_CONNECTIONS]:
        yield from _connection(connection, style)
    more = len(connections) - _CONNECTIONS + analysis.connections_not_listed
    if more > 0:
        yield style(f"  and {more} more; -T json lists up to 1000", "dim")


def _connection(connection: Connection, style: Styler) -> Iterator[str]:
    arrow = "→" if connection.client_known else "↔"
    protocol = {"s7comm": "", "": ", no data"}.get(connection.protocol, f", {connection.protocol}")
    vlan = " (VLAN)" if connection.tcp.vlan else ""
    yield f"  {connection.number}  {connection.client} {arrow} {connection.server}{vlan}{protocol}"
    calling, called = connection.tsap_calling, connection.tsap_called
    if calling is not None or called is not None:
        one = printable(calling.describe(False)) if calling is not None else "?"
        other = printable(called.describe()) if called is not None else "?"
        yield f"     TSAP {one} → {other}" + (f", TPDU size {connection.tpdu_size}" if connection.tpdu_size else "")
    if connection.refused:
        yield style(f"     refused: {connection.refused}", "warning")
    granted, asked = connection.granted, connection.setup_asked
    if granted is not None:
        wish = f" (asked {asked.pdu_length})" if asked is not None and asked.pdu_length != granted.pdu_length else ""
        yield (
            f"     PDU length {granted.pdu_length}{wish},"
            f" jobs open at once {granted.max_amq_called} from the client, {granted.max_amq_calling} from the server"
        )
    yield f"     {_counts(connection)}; {_ending(connection)}"


def _counts(connection: Connection) -> str:
    if not connection.pdus:
        return "no S7 PDU"
    parts = [words.count(connection.pdus, "PDU"), f"{connection.answered} answered"]
    if connection.unanswered:
        parts.append(f"{connection.unanswered} unanswered")
    if connection.orphans:
        parts.append(words.count(connection.orphans, "answer without request", "answers without request"))
    if connection.unsolicited:
        parts.append(words.count(connection.unsolicited, "push", "pushes"))
    if connection.errors:
        parts.append(f"{connection.errors} with errors")
    return ", ".join(parts)


def _ending(connection: Connection) -> str:
    tcp = connection.tcp
    open_then = f" with {words.count(connection.open_at_end, 'request')} open" if connection.open_at_end else ""
    if connection.closed_reason == "replaced":
        return f"replaced by a new connection on the same addresses{open_then}"
    if connection.iso_ended:
        return f"ended by {connection.iso_ended}{open_then}"
    begun = "already open at the start, " if connection.mid_stream and not tcp.known_start else ""
    if not tcp.ended:
        return f"{begun}still open at the end of the capture"
    if tcp.ended in {"reused", "evicted"}:
        return f"{begun}dropped ({tcp.ended}){open_then}"
    role = "client" if tcp.ended_by == connection.client_side else "server"
    how = "closed by" if tcp.ended == "fin" else "reset by"
    return f"{begun}{how} the {role} at packet {tcp.ended_frame}{open_then}"


def _transactions(analysis: Analysis, style: Styler) -> Iterator[str]:
    if not analysis.total:
        return
    yield ""
    said = [f"{analysis.answered} answered"]
    if analysis.unanswered:
        said.append(f"{analysis.unanswered} unanswered")
    if analysis.orphans:
        said.append(words.count(analysis.orphans, "answer without request", "answers without request"))
    if analysis.unsolicited:
        said.append(words.count(analysis.unsolicited, "push", "pushes"))
    if analysis.with_errors:
        said.append(f"{analysis.with_errors} with errors")
    yield style(f"Transactions: {', '.join(said)}", "heading")
    rows = [["function", "count", "errors", "no answer", "median", "95 %", "max"]]
    for _, statistics in sorted(analysis.functions.items(), key=lambda entry: -entry[1].total):
        times = statistics.latencies
        rows.append(
            [
                statistics.name,
                str(statistics.total),
                str(statistics.errors) if statistics.errors else ".",
                str(statistics.unanswered) if statistics.unanswered else ".",
                words.duration(times.quantile(0.5)),
                words.duration(times.quantile(0.95)),
                words.duration(int(times.largest) if times.count else None),
            ]
        )
    yield from table(rows, frozenset(range(1, 7)))


def _findings(analysis: Analysis, style: Styler) -> Iterator[str]:
    pipeline = analysis.pipeline
    counts = pipeline.conversation.judge.counts if pipeline is not None else {}
    if not counts:
        if analysis.total:
            yield ""
            yield style("Findings: none", "heading")
        return
    yield ""
    yield style("Findings", "heading")
    details: dict[str, list[Finding]] = {}
    for finding in analysis.findings:
        details.setdefault(finding.slug, []).append(finding)
    rules = [CATALOGUE[slug] for slug in counts]
    for rule in sorted(rules, key=lambda rule: (SEVERITIES.index(rule.severity), -counts[rule.slug], rule.slug)):
        yield from _finding(rule, counts[rule.slug], details.get(rule.slug, []), analysis, style)


def _finding(rule: Rule, count: int, details: list[Finding], analysis: Analysis, style: Styler) -> Iterator[str]:
    times = f" ({count} times)" if count > 1 else ""
    yield f"  {style(rule.severity, rule.severity)}  {rule.slug}{times}: {rule.sentence}"
    for finding in details[:_DETAILS]:
        where = f"connection {finding.connection}, " if finding.connection else ""
        at = f"{where}{_packets(finding.frames, analysis)}"
        yield f"      {at}: {printable(finding.detail)}" if finding.detail else f"      {at}"
    if count > _DETAILS and details:
        rest = dict.fromkeys(finding.frames[-1] for finding in details[_DETAILS:] if finding.frames)
        shown = list(rest)[:_FRAMES]
        more = ", …" if len(rest) > _FRAMES or count > len(details) else ""
        yield f"      and {count - _DETAILS} more: {_packets(shown, analysis)}{more}"
    yield style(f"      → {rule.advice}", "dim")


def _packets(frames: list[int], analysis: Analysis) -> str:
    """Name packets the way the user finds them: by number, and by file where there are several."""
    if not frames:
        return "the capture"
    if len(analysis.files) == 1:
        return f"packet{'s' if len(frames) > 1 else ''} {', '.join([str(frame) for frame in frames])}"
    located = [analysis.locate(frame) for frame in frames]
    return ", ".join([f"packet {number} of {printable(name)}" for name, number in located])


def _failed(analysis: Analysis, style: Styler) -> Iterator[str]:
    if not analysis.failed:
        return
    total = analysis.with_errors + analysis.unanswered
    yield ""
    yield style("Failed transactions" + (f" (first {_FAILED} of {total})" if total > _FAILED else ""), "heading")
    yield from table([_row(transaction, analysis) for transaction in analysis.failed[:_FAILED]], frozenset({0, 3}))


def _slowest(analysis: Analysis, style: Styler) -> Iterator[str]:
    slowest = analysis.slowest()
    if not slowest or analysis.answered < 2:
        return
    yield ""
    yield style("Slowest answers", "heading")
    yield from table([_row(transaction, analysis) for transaction in slowest[:5]], frozenset({0, 3}))


def _row(transaction: Transaction, analysis: Analysis) -> list[str]:
    frames = [frame for frame in (transaction.request_frame, transaction.response_frame) if frame]
    said = words.outcome(transaction)
    what = words.subject(transaction)
    return [
        f"#{transaction.number}",
        _packets(frames, analysis),
        transaction.function_name,
        words.duration(transaction.latency_ns),
        _shorten(", ".join([part for part in (said, what) if part])),
    ]


def _shorten(text: str) -> str:
    return text if len(text) <= 100 else text[:99] + "…"


def _loss(analysis: Analysis, style: Styler) -> Iterator[str]:
    pipeline = analysis.pipeline
    if pipeline is None:
        return
    yield ""
    yield style("Completeness", "heading")
    counts = pipeline.packet_counts()
    used = sum(counts[name] for name in CATEGORIES[:FIRST_IGNORED])
    repeated = counts["retransmission"] + counts["keep_alive"]
    again = f", {words.count(repeated, 'of them a repetition', 'of them repetitions')} on TCP level" if repeated else ""
    yield f"  {used} of {words.count(pipeline.frames, 'packet')} used{again}"
    for name in CATEGORIES[FIRST_IGNORED:]:
        if counts[name]:
            yield f"  {counts[name]} not used: {_IGNORED[name]}"
    if pipeline.cut_frames:
        yield style(f"  {words.count(pipeline.cut_frames, 'packet')} cut by the capture (snaplen)", "warning")
    octets = pipeline.octets
    if octets.holes:
        holes = words.count(octets.holes, "hole")
        yield style(
            f"  {holes} in the TCP streams, {words.count(octets.missing, 'octet')} missing from the capture", "warning"
        )
    else:
        yield "  no octet missing from the TCP streams"
    if octets.skipped:
        yield style(f"  {words.count(octets.skipped, 'octet')} skipped that belong to no message", "warning")
    if octets.buffered:
        yield f"  {words.count(octets.buffered, 'octet')} of unfinished messages at the end"
