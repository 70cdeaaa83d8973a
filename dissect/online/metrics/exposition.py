"""The table of all metrics, with name, type, labels and help sentence, and the text that Prometheus fetches.

The exposition, the documentation and the dashboard are checked against this table. Names follow Prometheus: seconds and bytes
in base units, counters end in ``_total``, no label ever holds an address or text from the wire. The text (exposition format
0.0.4) is written by ``prometheus_client``.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Final, NamedTuple

from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, HistogramMetricFamily
from prometheus_client.exposition import generate_latest
from prometheus_client.metrics_core import Metric
from prometheus_client.process_collector import ProcessCollector
from prometheus_client.registry import Collector

from dissect import __version__
from dissect.engine.findings.catalogue import CATALOGUE, CONNECTION
from dissect.engine.pipeline import Pipeline
from dissect.engine.transactions import ending
from dissect.engine.transactions.accounts import CATEGORIES, FRAGMENT_WAITING
from dissect.engine.transactions.operation import KINDS as OPERATIONS
from dissect.engine.transactions.operation import RESULTS
from dissect.engine.transactions.transaction import (
    BEHIND_MALFORMED,
    CERTAINTIES,
    DOUBT_TEXTS,
    MALFORMED_HEADER,
    OPEN,
    OUTCOMES,
    REASON_TEXTS,
)
from dissect.online.alerts.problems import KINDS as PROBLEMS
from dissect.online.live.problems import WriterState
from dissect.online.metrics.clock import clock_offset
from dissect.online.metrics.counters import SEPARATOR, Metrics
from dissect.online.metrics.functions import BOUNDS_NS, OTHER
from dissect.protocols.ibh.tables import KINDS
from dissect.protocols.iso.tables import TPDU_TYPES
from dissect.protocols.iso.upper import UPPER_NAMES
from dissect.protocols.s7.tables import ROSCTR
from dissect.protocols.s7plus.tables import OPCODES
from dissect.wire.build import COMPILED

COUNTER: Final = "counter"
GAUGE: Final = "gauge"
HISTOGRAM: Final = "histogram"

#: The beginning of every name.
PREFIX: Final = "s7dissect_"

_ENDINGS: Final = (
    ending.FIN,
    ending.RESET,
    ending.DISCONNECT,
    ending.ERROR_TPDU,
    ending.REUSED,
    ending.REPLACED,
    ending.EVICTED,
    ending.OPEN,
)
_OPERATIONS: Final = [f"{kind}{SEPARATOR}{result}" for kind in OPERATIONS for result in RESULTS]


class Family(NamedTuple):
    """A metric: its name (a counter's without ``_total``), type, labels, and help sentence."""

    name: str
    type: str
    labels: tuple[str, ...]
    sentence: str


class Sample(NamedTuple):
    """One series of a counter or gauge: the values of its labels, and its value."""

    labels: tuple[str, ...]
    value: float


class Histogram(NamedTuple):
    """One series of a histogram: the values of its labels, the counts of its buckets (not cumulative), and the sum."""

    labels: tuple[str, ...]
    buckets: list[int]
    total: float


FAMILIES: Final[tuple[Family, ...]] = (
    Family("packets", COUNTER, ("category",), "Packets read, by result."),
    Family("fragments_waiting", GAUGE, (), "Packets with fragments of IP datagrams that are still incomplete."),
    Family("packets_cut", COUNTER, (), "Packets truncated by the capture (snaplen)."),
    Family("last_packet_timestamp_seconds", GAUGE, (), "Time of the latest packet, by the clock of the capture."),
    Family("capture_lag_seconds", GAUGE, (), "How far the clock of the capture is behind that of this machine."),
    Family("drops", COUNTER, ("where",), "Packets lost while capturing; absent if unknown."),
    Family("stream_holes", COUNTER, (), "Gaps in the streams of tracked connections."),
    Family("stream_missing_octets", COUNTER, (), "Bytes missing in these gaps."),
    Family("evicted", COUNTER, ("what",), "State dropped because too much was open at once."),
    Family("tpdus", COUNTER, ("type",), "COTP TPDUs by type."),
    Family("tsdus", COUNTER, ("protocol",), "TSDUs by protocol."),
    Family("s7_pdus", COUNTER, ("rosctr",), "S7 PDUs by ROSCTR."),
    Family("s7plus_pdus", COUNTER, ("opcode",), "S7comm-plus PDUs by opcode."),
    Family("ibh_packets", COUNTER, ("kind",), "IBH-NetLink packets by kind."),
    Family("transactions", COUNTER, ("protocol", "function", "outcome"), "Transactions by function and outcome."),
    Family("transactions_with_errors", COUNTER, ("protocol", "function"), "Transactions whose answer reports an error."),
    Family("likely_pairs", COUNTER, ("doubt",), "Requests and answers that are only likely a pair; in no answer time."),
    Family("unanswered", COUNTER, ("reason",), "Unanswered requests, by reason."),
    Family("answers_not_captured", COUNTER, ("certainty",), "Of these those with reason hole, by certainty."),
    Family("errors", COUNTER, ("where", "class"), "Errors in answers, by place and class of code."),
    Family("latency_seconds", HISTOGRAM, ("protocol", "function"), "Answer times, from request to answer."),
    Family("open_requests", GAUGE, (), "Requests waiting for an answer."),
    Family("operations", COUNTER, ("kind", "result"), "Completed operations of several transactions."),
    Family("connections_opened", COUNTER, (), "Recognised connections."),
    Family("connections_ended", COUNTER, ("how",), "Ended connections, by how they ended."),
    Family("connections_open", GAUGE, (), "Connections tracked now."),
    Family("findings", COUNTER, ("slug", "severity"), "Findings by slug."),
    Family("finding_events", COUNTER, ("slug", "severity"), "Events of what is reported once per connection."),
    Family("queue_events", GAUGE, (), "Events waiting to be shown or written."),
    Family("events_lost", COUNTER, (), "Events not shown or written because too many were waiting."),
    Family("writer_up", GAUGE, ("writer",), "1 while what a writer gets is written, 0 while that fails."),
    Family("writer_files", COUNTER, ("writer",), "Files completed by a writer."),
    Family("writer_octets", COUNTER, ("writer",), "Bytes of these files."),
    Family("writer_lost", COUNTER, ("writer",), "Packets, rows or pages that a writer could not write."),
    Family("writer_lost_octets", COUNTER, ("writer",), "Bytes of packets that a writer could not write."),
    Family("writer_lost_seconds", COUNTER, ("writer",), "Time for which a writer could not write."),
    Family("free_octets", GAUGE, ("writer",), "Free bytes on the disk that a writer writes to."),
    Family("evidence_head", GAUGE, ("name", "head"), "Always 1; the hash of the latest entry of a manifest."),
    Family("problems", COUNTER, ("kind",), "Problems of this program, by kind."),
    Family("interface_down_seconds", COUNTER, (), "Time for which the interface was down."),
    Family("clock_offset_seconds", GAUGE, (), "Offset of this machine's clock; absent if unsynchronized."),
    Family("build_info", GAUGE, ("version", "build"), "Always 1; the version of s7dissect, compiled or interpreted."),
)  # fmt: skip


class Reading(NamedTuple):
    """A metric and its series at one moment, in one of the two lists, according to its type."""

    family: Family
    samples: list[Sample]
    histograms: list[Histogram]


def readings(metrics: Metrics, version: str, build: str) -> Iterator[Reading]:
    """Yield every metric of the table, in its order, with its present values; unknown series are left out."""
    now: dict[str, list[Sample]] = {
        **_told(metrics),
        **_transactions(metrics),
        **_connections(metrics),
        "build_info": [Sample((version, build), 1)],
    }
    if metrics.pipeline is not None:
        now.update(_traffic(metrics.pipeline))
        now.update(_loss(metrics.pipeline))
    for family in FAMILIES:
        histograms = _latencies(metrics) if family.type == HISTOGRAM else []
        yield Reading(family, now.get(family.name, []), histograms)


def _one(value: float | None, scale: float = 1) -> list[Sample]:
    """Return the series of a metric without labels; empty if the value is not known."""
    return [] if value is None else [Sample((), value / scale if scale != 1 else value)]


def _told(metrics: Metrics) -> dict[str, list[Sample]]:
    """Return the metrics of the live source."""
    drops = metrics.drops._asdict()
    waiting, lost = metrics.queue or (None, None)
    return {
        "drops": [Sample((where,), number) for where, number in drops.items() if number is not None],
        "queue_events": _one(waiting),
        "events_lost": _one(lost),
        "capture_lag_seconds": _one(metrics.lag_ns, 1e9),
        "clock_offset_seconds": _one(clock_offset()),
        "evidence_head": [Sample(one, 1) for one in list(metrics.problems.heads.items())],
        "interface_down_seconds": _one(metrics.problems.down_seconds),
        "problems": _from_zero(PROBLEMS, metrics.problems.counts),
        **_writers(metrics),
    }


def _writers(metrics: Metrics) -> dict[str, list[Sample]]:
    """Return the metrics of file writers; those of one kind are added up, and are well only if all of them are."""
    states: dict[str, list[WriterState]] = {}
    for state in [writer() for writer in list(metrics.problems.writers)]:
        states.setdefault(state.label, []).append(state)
    found: dict[str, list[Sample]] = {}
    for label, some in states.items():
        free = [state.free for state in some if state.free is not None]
        values: dict[str, float | None] = {
            "writer_up": int(all([state.well for state in some])),
            "writer_files": sum([state.files for state in some]),
            "writer_octets": sum([state.octets for state in some]),
            "writer_lost": sum([state.lost for state in some]),
            "writer_lost_octets": sum([state.lost_octets for state in some]),
            "writer_lost_seconds": sum([state.lost_seconds for state in some]),
            "free_octets": min(free) if free else None,
        }
        for name, value in values.items():
            if value is not None:
                found.setdefault(name, []).append(Sample((label,), value))
    return found


def _transactions(metrics: Metrics) -> dict[str, list[Sample]]:
    rows = list(metrics.functions.rows.copy().values())
    return {
        "transactions": [
            Sample((row.protocol, row.name, OUTCOMES[outcome]), count)
            for row in rows
            for outcome, count in enumerate(row.outcomes.copy())
            if outcome != OPEN and (count or outcome != BEHIND_MALFORMED)
        ],
        "transactions_with_errors": [Sample((row.protocol, row.name), int(row.errors)) for row in rows],
        "likely_pairs": _from_zero(DOUBT_TEXTS, metrics.likely),
        "unanswered": _from_zero([reason for reason in REASON_TEXTS if reason != MALFORMED_HEADER], metrics.unanswered),
        "answers_not_captured": _from_zero(CERTAINTIES, metrics.not_captured),
        "errors": _from_zero((), metrics.errors),
        "operations": _from_zero(_OPERATIONS, metrics.operations),
    }


def _from_zero(expected: Iterable[str], counts: dict[str, int]) -> list[Sample]:
    """Return a series for each key. The ``expected`` keys begin with 0, so that alerts notice the first increase."""
    now = dict.fromkeys(expected, 0)
    now.update(counts.copy())
    return [Sample(tuple(key.split(SEPARATOR)), count) for key, count in now.items()]


def _latencies(metrics: Metrics) -> list[Histogram]:
    series = []
    for row in metrics.functions.rows.copy().values():
        buckets = row.buckets.copy()
        if any(buckets):
            series.append(Histogram((row.protocol, row.name), buckets, int(row.sum_ns) / 1e9))
    return series


def _connections(metrics: Metrics) -> dict[str, list[Sample]]:
    ended = metrics.ended.copy()
    opened = metrics.opened  # read after ``ended``, so that the number of open ones is never too low
    return {
        "connections_opened": [Sample((), opened)],
        "connections_ended": _from_zero(_ENDINGS, ended),
        "connections_open": [Sample((), opened - sum(ended.values()))],
    }


def _traffic(pipeline: Pipeline) -> dict[str, list[Sample]]:
    rosctrs = {row.number: row.name for row in ROSCTR}
    opcodes = {row.number: row.name for row in OPCODES}
    types = {row.number: row.name for row in TPDU_TYPES}
    findings = pipeline.finding_counts.copy()
    events = pipeline.exchange.reporter.ledger.rules.copy()
    return {
        "tpdus": _named(pipeline.iso.tpdus.counts(), types),
        "tsdus": [Sample((name,), count) for name, count in zip(UPPER_NAMES, pipeline.iso.tsdus.counts(), strict=True)],
        "s7_pdus": _named(pipeline.s7.rosctrs.counts(), rosctrs),
        "s7plus_pdus": _named(pipeline.plus.opcodes.counts(), opcodes),
        "ibh_packets": [Sample((kind,), count) for kind, count in zip(KINDS, pipeline.ibh.packets.copy(), strict=True)],
        "open_requests": [Sample((), int(pipeline.exchange.dialogue.open))],
        "findings": [Sample((slug, rule.severity), findings.get(slug, 0)) for slug, rule in CATALOGUE.items()],
        "finding_events": [
            Sample((slug, rule.severity), int(events[slug].events) if slug in events else 0)
            for slug, rule in CATALOGUE.items()
            if rule.reported == CONNECTION
        ],
    }


def _named(counts: list[int], names: dict[int, str]) -> list[Sample]:
    """Return a series for each name, and one for all numbers without a name."""
    now = counts.copy()
    named = [Sample((name,), now[number]) for number, name in names.items()]
    return [*named, Sample((OTHER,), sum(now) - sum([now[number] for number in names]))]


def _loss(pipeline: Pipeline) -> dict[str, list[Sample]]:
    counts = pipeline.counters.packet_counts()
    # Waiting fragments are counted again when they are used or dropped, so their number is not a counter.
    waiting = counts.pop(CATEGORIES[FRAGMENT_WAITING])
    evicted = {
        "connections": pipeline.table.evicted,
        "half_open_connections": pipeline.table.half_open_evicted,
        "datagrams": pipeline.counters.fragments.evicted + pipeline.counters.fragments.expired,
        "operations": pipeline.exchange.watch.operations.evicted,
        "scan_pairs": pipeline.connections.scans.forgotten,
    }
    return {
        "packets": [Sample((category,), count) for category, count in counts.items()],
        "fragments_waiting": [Sample((), waiting)],
        "packets_cut": [Sample((), int(pipeline.counters.cut_frames))],
        "last_packet_timestamp_seconds": _one(int(pipeline.now_ns), 1e9) if pipeline.frames else [],
        "stream_holes": [Sample((), int(pipeline.counters.octets.holes))],
        "stream_missing_octets": [Sample((), int(pipeline.counters.octets.missing))],
        "evicted": [Sample((what,), int(count)) for what, count in evicted.items()],
    }


CONTENT_TYPE: Final = "text/plain; version=0.0.4; charset=utf-8"

#: Upper bounds of the buckets as texts, in seconds.
BOUNDS: Final[list[str]] = [*[str(bound / 1e9) for bound in BOUNDS_NS], "+Inf"]


class Exposition(Collector):
    """Collects the values of a `Metrics`, and of this process: memory, CPU time, open files."""

    def __init__(self, metrics: Metrics) -> None:
        self._metrics = metrics
        self._process = ProcessCollector(registry=None)

    def collect(self) -> Iterator[Metric]:
        """Yield every metric with its present values."""
        build = "compiled" if COMPILED else "interpreted"
        for reading in readings(self._metrics, __version__, build):
            yield _as_metric(reading)
        process: Iterable[Metric] = self._process.collect()
        yield from process

    def text(self) -> bytes:
        """Return all metrics as text."""
        octets: bytes = generate_latest(self)
        return octets


def _as_metric(reading: Reading) -> Metric:
    family = reading.family
    name = PREFIX + family.name
    labels = list(family.labels)
    if family.type == HISTOGRAM:
        times = HistogramMetricFamily(name, family.sentence, labels=labels)
        for series in reading.histograms:
            upto = 0
            buckets: list[tuple[str, float]] = []
            for bound, count in zip(BOUNDS, series.buckets, strict=True):
                upto += count
                buckets.append((bound, upto))
            times.add_metric(list(series.labels), buckets, series.total)
        return times
    kind = CounterMetricFamily if family.type == COUNTER else GaugeMetricFamily
    numbers = kind(name, family.sentence, labels=labels)
    for sample in reading.samples:
        numbers.add_metric(list(sample.labels), sample.value)
    return numbers
