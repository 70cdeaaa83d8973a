"""`analyze` as text: connections, transactions by function, findings, failed and slowest transactions, completeness.

Completeness says how many packets and bytes of a run were used, how many are missing, and how many had to be dropped.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Final

from dissect.engine.bare import BY_CLIENT, BY_SERVER
from dissect.engine.pipeline import Pipeline
from dissect.engine.stations.facts import KEYS
from dissect.engine.transactions.accounts import CATEGORIES, FIRST_IGNORED
from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.operation import CONNECT, RESULTS, RUNNING
from dissect.engine.transactions.operation import KINDS as KINDS_OF_OPERATIONS
from dissect.engine.transactions.transaction import Transaction
from dissect.meaning.report import endings, facets, words
from dissect.meaning.report.analysis import MAX_CONNECTIONS, Analysis, FunctionStatistics, Part
from dissect.meaning.report.certainty import left_out, mark, not_captured
from dissect.meaning.report.finding_lines import findings_lines
from dissect.meaning.report.happened import facts_of
from dissect.meaning.report.operations import ENDED, NAMES, shouted
from dissect.meaning.report.stations import TOLD, stations_that_state
from dissect.meaning.report.styled import DIM, HEADING, PLAIN, Line
from dissect.meaning.report.tls import tls_lines
from dissect.meaning.report.words import PROTOCOLS, Places, named
from dissect.packets.source.packet import SourceFile
from dissect.packets.tcp.link import vlan_text, within
from dissect.wire.text import Clock, printable, shortened

_PLAIN: Final = ""
_WARNING: Final = "warning"

#: Words for the kinds of packets that were not used.
_IGNORED: Final = {
    "not_ip": "not IP",
    "not_tcp": "IP but not TCP",
    "fragment_waiting": "fragments of incomplete datagrams",
    "fragment_dropped": "dropped fragments",
    "other_protocol": "TCP connections without ISO-on-TCP",
    "before_start": "before the first captured byte of their connection",
    "after_close": "after the end of their connection",
    "reset_ignored": "RST or FIN outside the receive window",
    "cut": "truncated inside their headers",
    "bad_header": "invalid headers",
    "bad_checksum": "wrong TCP or UDP checksum",
    "link_type": "unsupported link type",
    "failed": "packets the analyzer failed on",
    "left_out": "connections that are not selected",
}


def completeness(pipeline: Pipeline, places: Places | None = None) -> Iterator[tuple[str, str]]:
    """Yield sentences without a full stop, each with its style: plain or a warning.

    ``places`` name packets of several files.
    """
    counts = pipeline.counters.packet_counts()
    used = sum(counts[name] for name in CATEGORIES[:FIRST_IGNORED])
    repeated = counts["retransmission"] + counts["keep_alive"]
    how = "sent again or captured twice"
    if counts["keep_alive"]:
        how = "sent again, captured twice, or a keep-alive with a byte"
    of_these = f", {repeated} of them repeated: {how}" if repeated else ""
    yield f"{used} of {words.count(pipeline.frames, 'packet')} used{of_these}", _PLAIN
    for name in CATEGORIES[FIRST_IGNORED:]:
        if counts[name]:
            yield f"{counts[name]} ignored: {_IGNORED[name]}", _PLAIN
    bare, frame = pipeline.counters.bare.found()
    if bare:
        ports = "port 102" if not pipeline.counters.bare.spoken else "port 102 or others that are followed here"
        first = f"packet {places.mark(frame) if places is not None else frame}"
        begins = f"it begins with {first}" if bare == 1 else f"the first begins with {first}"
        yield (
            f"{words.count(bare, 'connection')} to {ports} opened and closed without data, as port scans do: {begins}",
            _PLAIN,
        )
    yield from _only_ends(pipeline, places)
    if pipeline.counters.cut_frames:
        yield f"{words.count(pipeline.counters.cut_frames, 'packet')} truncated by the capture (snaplen)", _WARNING
    octets = pipeline.counters.octets
    if octets.holes:
        holes = words.count(octets.holes, "gap")
        missing = words.count(octets.missing, "byte")
        yield f"{holes} in the TCP streams, {missing} missing from the capture", _WARNING
    else:
        yield "no gaps in the TCP streams", _PLAIN
    if octets.skipped:
        verb = "belongs" if octets.skipped == 1 else "belong"
        yield f"{words.count(octets.skipped, 'byte')} skipped that {verb} to no message", _WARNING
    if octets.buffered:
        yield f"{words.count(octets.buffered, 'byte')} of unfinished messages at the end", _PLAIN
    evicted = pipeline.exchange.watch.operations.evicted
    if evicted:
        yield f"{words.count(evicted, 'operation')} no longer tracked: too many at once", _WARNING
    forgotten = pipeline.connections.scans.forgotten
    if forgotten:
        pairs = words.count(forgotten, "pair")
        yield f"{pairs} of client and server no longer watched for TSAP scans: too many", _WARNING


def _only_ends(pipeline: Pipeline, places: Places | None) -> Iterator[tuple[str, str]]:
    """Yield the line on connections to port 102 of which only FINs were captured: which side closed them."""
    bare = pipeline.counters.bare
    if not bare.ends:
        return
    total = sum(bare.ends.values())
    names = {BY_SERVER: "the server", BY_CLIENT: "the client"}
    deeds = [f"{f'{number} ' if total > 1 else ''}by {names[who]}" for who, number in sorted(bare.ends.items())]
    frame = bare.first_end()
    where = f"packet {places.mark(frame) if places is not None else frame}"
    shown = where if total == 1 else f"the first at {where}"
    number = words.count(total, "connection")
    yield f"{number} to port 102 of which only the end was captured, closed {', '.join(deeds)} ({shown})", _PLAIN


#: Maximum number of each that are shown; the others are only counted. `_CELL` and `_DETAIL_SIZE` are characters.
_CONNECTIONS: Final = 20
_FAILED: Final = 10
_DEVICES: Final = 20
_CELL: Final = 40
_SLOWEST: Final = 5
_NOTES: Final = 10
_DETAIL_SIZE: Final = 400


def analysis_lines(
    analysis: Analysis, interrupted: bool = False, clock: Clock | None = None, hosts: Mapping[str, str] | None = None
) -> Iterator[Line]:
    """Yield the report line by line. ``interrupted`` says that the user stopped the reading; ``clock`` writes times.

    ``hosts`` are names of hosts by address.
    """
    places = Places(analysis.files, len(analysis.files) > 1, hosts)
    clock = clock or Clock()
    yield from _files(analysis, places, clock)
    if interrupted:
        yield Line("  INTERRUPTED: this report covers the packets read until then", "error")
    if analysis.part is not None:
        yield from _part(analysis, analysis.part)
    yield from _connections(analysis, places)
    yield from _devices(analysis, places)
    yield from _transactions(analysis)
    yield from _scd(analysis)
    yield from _operations(analysis)
    yield from findings_lines(analysis, places, facts_of(analysis, clock))
    yield from _failed(analysis, places)
    yield from _slowest(analysis, places)
    yield from _completeness(analysis, places)


def table(rows: Sequence[Sequence[str]], right: frozenset[int]) -> Iterator[Line]:
    """Yield rows as aligned columns; the columns in ``right`` are aligned to the right."""
    if not rows:
        return
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    hang = 2 + sum(widths[:-1]) + 2 * (len(widths) - 1)
    for row in rows:
        cells = [
            text.rjust(widths[column]) if column in right else text.ljust(widths[column])
            for column, text in enumerate(row)
        ]
        yield Line("  " + "  ".join(cells).rstrip(), PLAIN, hang)


# ---- what was read --------------------------------------------------------------------------------------------------


def _files(analysis: Analysis, places: Places, clock: Clock) -> Iterator[Line]:
    for file in analysis.files:
        yield from _file(file)
    pipeline = analysis.pipeline
    if pipeline is None or not pipeline.frames:
        return
    first, last = int(pipeline.first_ns), int(pipeline.now_ns)
    counters = pipeline.counters
    if counters.disordered and last >= first:
        span = words.span(clock, counters.earliest_ns, counters.latest_ns)
        yield Line(f"  from {span}, earliest to latest packet (packets are not in order of time)")
    elif places.several or last < first:
        yield Line(f"  from {words.span(clock, first, last)}, first to last packet")
    else:
        yield Line(f"  from {clock.moment(first)}, {words.duration(last - first)}")
    sections = analysis.sections()
    others = [
        f"{count} {PROTOCOLS[name]}"
        for name, count in sections["tsdus"].items()
        if count and name not in {"s7comm", "s7comm_plus", "scd", "empty"}
    ]
    if pipeline.tls.other:
        others.append(f"{pipeline.tls.other} decrypted")
    passed = [words.count(number, kind) for protocol in pipeline.protocols for number, kind in protocol.counted()]
    behind = int(pipeline.s7.behind_malformed + pipeline.plus.behind_malformed)
    if behind:
        passed.append(f"{behind} more behind malformed headers")
    said = f"  {', '.join(passed)}"
    yield Line(f"{said}; other messages: {', '.join(others)}" if others else said)
    packets = [f"{count} {kind.replace('_', ' ')}" for kind, count in sections["ibh"].items()]
    if packets:
        yield Line(f"  IBH-NetLink packets: {', '.join(packets)}", PLAIN, 4)


def _part(analysis: Analysis, part: Part) -> Iterator[Line]:
    """Yield lines that name the selection of this report, and what it left out."""
    yield Line(f"  SELECTION: {printable(part.where)}", "warning", 4)
    yield Line(f"  selected: {words.count(analysis.total, 'transaction')}, {_listed(analysis)}", PLAIN, 4)
    kinds = (
        (part.transactions, "transaction"),
        (part.connections, "connection"),
        (part.operations, "operation"),
        (part.findings, "finding"),
    )
    said = [words.count(number, kind) for number, kind in kinds if number]
    if part.not_read:
        said.append(f"{words.count(part.not_read, 'connection')} not read")
    if part.findings_not_judged:
        said.append(f"{words.count(part.findings_not_judged, 'finding')} without detail, not judged")
    yield Line(
        f"  left out: {', '.join(said) or 'nothing'}; counts of packets and messages are of all that was read", PLAIN, 4
    )


def _listed(analysis: Analysis) -> str:
    operations = sum([sum(results.values()) for results in analysis.operations.values()])
    connections = len(analysis.connections) + int(analysis.connections_not_listed)
    return ", ".join(
        [
            words.count(connections, "connection"),
            words.count(operations, "operation"),
            words.count(sum(analysis.finding_counts.values()), "finding"),
        ]
    )


def _file(file: SourceFile) -> Iterator[Line]:
    yield Line(f"{printable(file.name)}: {words.count(file.packets, 'packet')}, {words.size(file.octets)}", HEADING)
    if file.damage:
        yield Line(f"  {words.loss_of(file.octets).upper()}: {printable(file.damage)}", "error")
    for note in file.notes[:_NOTES]:
        yield Line(f"  {shortened(note, _DETAIL_SIZE)}", "warning")
    if len(file.notes) > _NOTES:
        yield Line(f"  and {len(file.notes) - _NOTES} more notes; -T json lists them", DIM)


# ---- connections ----------------------------------------------------------------------------------------------------


def _connections(analysis: Analysis, places: Places) -> Iterator[Line]:
    connections = analysis.connections
    yield Line("")
    if not connections:
        of = "the selection" if analysis.part is not None else "this capture"
        yield Line(f"No ISO-on-TCP connection in {of}.", HEADING)
        return
    total = len(connections) + int(analysis.connections_not_listed)
    least = "at least " if analysis.perhaps_twice else ""
    if total <= _CONNECTIONS:
        yield Line("Connections", HEADING)
    else:
        yield Line(
            f"Connections ({_CONNECTIONS} of {least}{total}: those with most errors, then the busiest, by number)",
            HEADING,
        )
        connections = analysis.worst_connections(_CONNECTIONS)
    for connection in sorted(connections, key=_number):
        yield from connection_lines(connection, places)
    if total > _CONNECTIONS:
        yield Line(f"  and {total - _CONNECTIONS} more; -T json lists up to {MAX_CONNECTIONS}", DIM)


def _number(connection: Connection) -> int:
    return int(connection.number)


def connection_lines(connection: Connection, places: Places) -> Iterator[Line]:
    """Yield the lines of a connection, which may still be open."""
    arrow = "→" if connection.client_known else "↔"
    vlan = f", VLAN {vlan_text(connection.tcp.vlan)}" if connection.tcp.vlan else ""
    also = [f"in VLAN {vlan_text(other)}" if other else "without a VLAN" for other in connection.tcp.also]
    if also:
        vlan += f", also {' and '.join(also)}"
    protocol = "" if connection.protocol == "s7comm" else f", {named(connection) or 'no data'}"
    over = " UDP" if connection.udp else ""
    yield Line(
        f"  {connection.number}  {places.end(connection.client)} {arrow} {places.end(connection.server)}"
        f"{over}{vlan}{protocol}",
        PLAIN,
        5,
    )
    calling, called = connection.tsap_calling, connection.tsap_called
    if calling is not None or called is not None:
        said = words.tsaps(calling, called, connection.protocol)
        size = f", TPDU size {connection.tpdu_size}" if connection.tpdu_size else ""
        yield Line(f"     {said}{size}", PLAIN, 5)
    for said in tls_lines(connection):
        yield Line(f"     {said}", PLAIN, 5)
    if connection.refused:
        yield Line(f"     REFUSED: {connection.refused}", "error", 5)
    granted, asked = connection.granted, connection.granted_for or connection.setup_asked
    if granted is not None:
        wish = (
            f" (requested {asked.pdu_length})" if asked is not None and asked.pdu_length != granted.pdu_length else ""
        )
        jobs = [connection.jobs_allowed(side) for side in (connection.client_side, 1 - connection.client_side)]
        yield Line(
            f"     PDU length {granted.pdu_length}{wish}, parallel jobs (AmQ): client {jobs[0]}, server {jobs[1]}",
            PLAIN,
            5,
        )
    ended = endings.phrase(connection, places) if connection.ending is not None else "open"
    yield Line(f"     {_counts(connection)}; {ended}", PLAIN, 5)


def _counts(connection: Connection) -> str:
    behind = [f"{connection.behind} more behind malformed headers"] if connection.behind else []
    if not connection.pdus:
        return ", ".join(["no S7 PDU", *behind])
    parts = [words.count(connection.pdus, "PDU"), f"{connection.answered} answered"]
    if connection.missed:
        parts.append(f"{connection.missed} unanswered")
    if connection.still_open:
        parts.append(f"{connection.still_open} still open")
    if connection.not_captured:
        parts.append(words.count(int(connection.not_captured), "answer not captured", "answers not captured"))
    parts += _unpaired(connection.orphans, connection.unsolicited, connection.one_way)
    if connection.system_events:
        parts.append(words.count(connection.system_events, "system event"))
    if connection.errors:
        parts.append(f"{connection.errors} with errors")
    return ", ".join(parts + behind)


def _unpaired(orphans: int, unsolicited: int, one_way: int) -> list[str]:
    """Return the number of messages of each kind without a partner; ``unsolicited`` includes ``one_way``."""
    kinds = (
        (orphans, "answer without request", "answers without request"),
        (unsolicited - one_way, "push", "pushes"),
        (one_way, "one-way request", ""),
    )
    return [words.count(number, one, many) for number, one, many in kinds if number]


# ---- devices --------------------------------------------------------------------------------------------------------


def _devices(analysis: Analysis, places: Places) -> Iterator[Line]:
    """Yield a table of the statements of stations about themselves; nothing if there are none."""
    found = stations_that_state(analysis.stations)
    if not found:
        return
    yield Line("")
    yield Line("Devices", HEADING)
    keys = [key for key in TOLD if any([station.latest(key) for station in found[:_DEVICES]])]
    rows = [
        [
            within(places.name(station.host), station.vlan),
            *[shortened(station.latest(key), _CELL) or "." for key in keys],
        ]
        for station in found[:_DEVICES]
    ]
    yield from table([["address", *[KEYS[key] for key in keys]], *rows], frozenset())
    if len(found) > _DEVICES:
        yield Line(f"  and {len(found) - _DEVICES} more; `s7dissect devices` lists them", DIM)


# ---- transactions ---------------------------------------------------------------------------------------------------


def _transactions(analysis: Analysis) -> Iterator[Line]:
    if not analysis.total:
        return
    yield Line("")
    likely = sum(analysis.likely.values())
    said = [f"{analysis.answered} answered{f' ({likely} only likely)' if likely else ''}"]
    if analysis.missed:
        said.append(f"{analysis.missed} unanswered")
    if analysis.still_open:
        said.append(f"{analysis.still_open} still open at the end")
    if analysis.not_captured:
        said.append(not_captured(int(analysis.not_captured), analysis.unanswered_reasons))
    said += _unpaired(analysis.orphans, analysis.unsolicited, analysis.one_way)
    if analysis.with_errors:
        said.append(f"{analysis.with_errors} with errors")
    if analysis.behind:
        said.append(f"{analysis.behind} more behind malformed headers")
    yield Line(f"Transactions: {', '.join(said)}", HEADING)
    yield from _function_rows(list(analysis.functions.values()))
    if likely:
        yield Line(f"  {left_out(analysis.likely)}", _WARNING, 4)


def _function_rows(functions: Sequence[FunctionStatistics]) -> Iterator[Line]:
    """Yield a row for each function; columns for messages without a partner only if there are any."""
    columns: list[tuple[str, Callable[[FunctionStatistics], int]]] = [
        ("still open", lambda one: int(one.still_open)),
        ("not captured", lambda one: int(one.not_captured)),
        ("only likely", lambda one: int(one.likely)),
        ("no request", lambda one: int(one.orphans)),
        ("pushes", lambda one: int(one.pushes)),
        ("one-way", lambda one: int(one.one_way)),
        ("malformed header", lambda one: int(one.behind)),
    ]
    shown = [(title, number_of) for title, number_of in columns if any([number_of(one) for one in functions])]
    head = ["function", "count", "errors", "no answer", *[title for title, _ in shown], "median", "95 %", "max"]
    rows = [head]
    for one in sorted(functions, key=lambda one: (-one.total, one.name)):
        times = one.latencies
        numbers = [int(one.errors), one.missed, *[number_of(one) for _, number_of in shown]]
        rows.append(
            [
                one.name,
                str(one.total),
                *[str(number) if number else "." for number in numbers],
                words.answer_time(times.quantile(0.5)),
                words.answer_time(times.quantile(0.95)),
                words.answer_time(int(times.largest) if times.count else None),
            ]
        )
    yield from table(rows, frozenset(range(1, len(head))))


def _scd(analysis: Analysis) -> Iterator[Line]:
    """Yield a table of the messages found by each SCD binding."""
    found = analysis.sections().get("scd")
    if not found:
        return
    yield Line("")
    version = f" {found['version']}" if found["version"] else ""
    yield Line(f"SCD by the dictionary {printable(found['dictionary'])}{printable(version)}", HEADING)
    rows = [["binding", "messages", "values", "not decoded"]]
    for row in found["bindings"]:
        wrong = str(row["not_decoded"]) if row["not_decoded"] else "."
        rows.append([printable(row["name"]), str(row["messages"]), str(row["values"]), wrong])
    yield from table(rows, frozenset((1, 2, 3)))
    cut = sum(row["cut"] for row in found["bindings"])
    losses = {
        "datagrams truncated by the capture": cut,
        "messages of a kind that cannot be paired": found["unpaired"],
        "stream bytes skipped because they belong to no complete message": found["octets_skipped"],
        "devices dropped, too many are known": found["devices_forgotten"],
        "constants not compared, a device has too many": found["constants_overlooked"],
        "PDO counters dropped, there are too many": found["counters_forgotten"],
        "connections whose BSENDs were not reassembled, there are too many": found["blocks_forgotten"],
    }
    for what, count in losses.items():
        if count:
            yield Line(f"  {what}: {count}", "warning")


def _operations(analysis: Analysis) -> Iterator[Line]:
    """Yield a table of operations; nothing if they only set up connections, which the report lists above."""
    if not set(analysis.operations) - {CONNECT}:
        return
    yield Line("")
    yield Line("Operations", HEADING)
    rows = []
    for kind in KINDS_OF_OPERATIONS:
        results = analysis.operations.get(kind, {})
        if results:
            told = [f"{number} {said}" for said, number in results_of(results, analysis.ended_operations.get(kind, 0))]
            rows.append([NAMES[kind], str(sum(results.values())), ", ".join(told)])
    yield from table(rows, frozenset((1,)))


def results_of(results: Mapping[str, int], ended: int) -> Iterator[tuple[str, int]]:
    """Yield results as text with their numbers of operations; ``ended`` of the running ones ended with their connection."""
    for result in RESULTS:
        number = results.get(result, 0) - (ended if result == RUNNING else 0)
        if number:
            yield shouted(result), number
        if result == RUNNING and ended:
            yield ENDED, ended


def _failed(analysis: Analysis, places: Places) -> Iterator[Line]:
    if not analysis.failed:
        return
    shown = analysis.failed[:_FAILED]
    total = int(analysis.with_errors + analysis.missed)
    yield Line("")
    yield Line("Failed transactions" + (f" (first {len(shown)} of {total})" if total > len(shown) else ""), HEADING)
    yield from _rows(shown, places)


def _slowest(analysis: Analysis, places: Places) -> Iterator[Line]:
    slowest = analysis.slowest()
    if len(slowest) < 2:
        return
    yield Line("")
    yield Line("Slowest answers", HEADING)
    yield from _rows(slowest[:_SLOWEST], places)


def _rows(transactions: Sequence[Transaction], places: Places) -> Iterator[Line]:
    rows = []
    for transaction in transactions:
        said = [part for part in (facets.outcome(transaction), facets.gist(transaction), mark(transaction)) if part]
        rows.append(
            [
                f"#{transaction.number}",
                places.pair(int(transaction.request_frame), int(transaction.response_frame)),
                words.answer_time(transaction.latency_ns),
                transaction.function_name,
                "  ".join(said),
            ]
        )
    yield from table([["number", "packets", "answer", "function", ""], *rows], frozenset({0, 2}))


# ---- completeness ---------------------------------------------------------------------------------------------------


def _completeness(analysis: Analysis, places: Places) -> Iterator[Line]:
    pipeline = analysis.pipeline
    if pipeline is None:
        return
    yield Line("")
    yield Line("Completeness", HEADING)
    for told, style in completeness(pipeline, places):
        yield Line(f"  {told}", style)
