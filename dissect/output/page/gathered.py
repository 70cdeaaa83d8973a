"""`Gathered`: an observer that collects everything that a report shows, in one pass and in bounded memory.

It counts over time the same things that `dissect.meaning.report.analysis` counts over the whole run, and also has such an
`analysis`. It counts everything that it leaves out, so that the report can state it.
"""

from __future__ import annotations

import heapq
from typing import Any, Final

from dissect.engine.acts.act import Act
from dissect.engine.findings.catalogue import SEVERITIES
from dissect.engine.findings.reporter import Finding
from dissect.engine.observer import Observer
from dissect.engine.pipeline import Pipeline
from dissect.engine.program.carved import carve
from dissect.engine.stations.facts import Fact
from dissect.engine.transactions.connection import ISO_TSAP_PORT, Connection
from dissect.engine.transactions.operation import CONNECT, Operation
from dissect.engine.transactions.transaction import ORPHAN, PUSH, UNANSWERED, Transaction
from dissect.meaning.inventory.collector import Inventory
from dissect.meaning.report.analysis import Analysis
from dissect.meaning.report.latencies import Latencies
from dissect.output.page.bins import Bins, Spread, bucket
from dissect.output.page.gaps import Gap, Heard, between, idle
from dissect.output.page.numbers import counted
from dissect.output.page.plcs import Plc, Plcs
from dissect.output.page.polls import Requests
from dissect.output.page.rows import ERROR, MISSED, Rows, Station, octets_of, outcome_of, station_of, time_of
from dissect.output.page.samples import Ranked, Samples, mixed
from dissect.output.page.tag_steps import Tags
from dissect.output.page.talks import Talks, worse
from dissect.output.variables.wanted import WantedSet
from dissect.packets.source.packet import SourceFile
from dissect.protocols.s7.tables import GROUP_MODE

#: Greatest number of rows of each table. Maximum number of the slowest transactions of all, and of further ones spread over the
#: time.
MAX_SLOWEST: Final = 200
MAX_FAILED: Final = 500
MAX_CONNECTIONS: Final = 1000
MAX_OPERATIONS: Final = 1000
MAX_BLOCKS: Final = 500
#: Maximum number of pairs of PLC and function whose answer times are kept separately.
MAX_SPREADS: Final = 200
#: Maximum number of further pairs that are counted.
MAX_FURTHER: Final = 10_000
#: Greatest number of gaps, and of changes of the operating mode.
MAX_GAPS: Final = 1000
MAX_MODES: Final = 1000
#: In answer times over time, each doubling is divided into this many bands.
BANDS: Final = 4
#: Findings after which packets of any connection may be missing. Missing bytes of one connection show in its streams.
_GAPS: Final = frozenset(("capture.dropped", "capture.damaged"))

#: Findings that show the operating mode of an S7comm-plus CPU: S7comm-plus has no message for it.
_MODES: Final = {"security.stopped": "STOP", "security.mode_changed": "RUN"}


class Mode:
    """The operating mode that a PLC reported, and when."""

    __slots__ = ("frame", "host", "text", "time_ns")

    def __init__(self, time_ns: int, host: Station, text: str, frame: int) -> None:
        self.time_ns = time_ns
        self.host = host
        self.text = text
        self.frame = frame


class Span:
    """The time of an operation, and its PLC."""

    __slots__ = ("begin_ns", "end_ns", "host", "kind", "number", "result")

    def __init__(self, begin_ns: int, end_ns: int, host: Station, kind: str, number: int, result: str) -> None:
        self.begin_ns = begin_ns
        self.end_ns = end_ns
        self.host = host
        self.kind = kind
        self.number = number
        self.result = result


class SpreadOf:
    """All transactions of one function of one PLC: their answer times, and counts of the other outcomes.

    ``times`` is the distribution of answer times, ``latencies`` has the quantiles that `analyze` reports, too. ``still_open``
    are requests whose answer was not due yet when the capture ended, ``not_captured`` those whose answer may only be missing
    from the capture, ``likely`` pairs that are only likely, which are in no answer time, ``orphans`` answers without a request,
    ``alone`` pushes and requests that need no answer. ``plc`` has the answers of the PLC, None if there was no room.
    """

    __slots__ = (
        "alone", "errors", "latencies", "likely", "missed", "not_captured", "orphans", "plc", "still_open", "times", "total",
    )  # fmt: skip

    def __init__(self, plc: Plc | None) -> None:
        self.plc = plc
        self.times = Spread()
        self.latencies = Latencies()
        self.total = 0
        self.errors = 0
        self.missed = 0
        self.still_open = 0
        self.not_captured = 0
        self.likely = 0
        self.orphans = 0
        self.alone = 0


def span_of(pipeline: Pipeline) -> tuple[int, int] | None:
    """Return the earliest and the latest time of a packet, nanoseconds since 1970; None before the first.

    They differ from those of the first and the last packet if captures are read in another order, or a clock was set back.
    """
    counters = pipeline.counters
    return (counters.earliest_ns, counters.latest_ns) if counters.frames else None


class Gathered(Observer):
    """Collects what a report shows. ``rows`` makes the rows of its tables; ``tags`` are the tags to plot, None for none.

    Set ``files``, the files of the run, before the first packet; more may be added later.
    """

    def __init__(self, rows: Rows, tags: WantedSet | None = None) -> None:
        super().__init__()
        self.analysis = Analysis()
        self.inventory = Inventory()
        self.rows = rows
        self.rates = Bins()
        self.answer_times = Bins()
        self.spreads: dict[tuple[Station, str], SpreadOf] = {}
        self.spreads_not_told_apart = 0
        #: Further pairs of PLC and function, counted as one, at most `MAX_FURTHER`.
        self.further: set[tuple[Station, str]] = set()
        self.requests = Requests()
        self.talks = Talks()
        self.plcs = Plcs()
        #: Machines that use another port than that of ISO-on-TCP, or IBH-NetLink: Wireshark does not look for S7 there.
        self.unusual: set[Station] = set()
        self.tags = Tags(tags)
        self._gaps = Samples(MAX_GAPS, counted=False)
        self.modes: list[Mode] = []
        self.modes_not_drawn = 0
        #: Rows of operations, each with its `Span`; those of blocks and of failed transactions; those of connections, each with
        #: client, server and VLAN.
        self.operations = Samples(MAX_OPERATIONS)
        self.blocks = Samples(MAX_BLOCKS)
        self.failed = Samples(MAX_FAILED)
        self.connections = Ranked(MAX_CONNECTIONS)
        #: Numbers of connections that began, and that ended, by time.
        self.opened = Bins()
        self.ended = Bins()
        self.failed_pushes = 0  # how many failed transactions are pushes with an item that the PLC could not read
        #: When the first request failed, 0 for never.
        self.first_failure_ns = 0
        self._slowest: list[tuple[int, int, dict[str, Any]]] = []
        self._slow_floor = -1
        self._slow_then = Samples(MAX_SLOWEST, counted=False)
        self.files: list[SourceFile] = []
        self._file = 0  # index in `files` of the file that is being read
        self._begin_ns = 0
        self._end_ns = 0
        self._span: tuple[int, int] | None = None
        self._last_ns = 0
        self._heard: dict[int, Heard] = {}

    # ---- observer ---------------------------------------------------------------------------------------------------

    def connection_opened(self, connection: Connection) -> None:
        """Remember a connection, for gaps that are found on it."""
        self._at(int(connection.tcp.first_ns))
        self._heard[int(connection.number)] = Heard(connection)

    def connection_closed(self, connection: Connection) -> None:
        """Take a connection for the tables of connections and of who talked to whom."""
        self.analysis.connection_closed(connection)
        self._list(connection)
        self.talks.over(connection)
        if ISO_TSAP_PORT not in {connection.client.port, connection.server.port}:
            self.unusual.update((station_of(connection, 0), station_of(connection, 1)))
        self.tags.closed(connection)
        self.inventory.connection_closed(connection)
        self._look_for_gap(connection, int(connection.last_ns), 0)
        self._heard.pop(int(connection.number), None)

    def transaction(self, transaction: Transaction) -> None:
        """Take a transaction for all plots and tables to which it belongs."""
        self.analysis.transaction(transaction)
        self.inventory.transaction(transaction)
        now = time_of(transaction)
        self._at(now)
        self._look_for_gap(transaction.connection, now, int(transaction.request_ns) if transaction.missed else 0)
        self._last_ns = now
        outcome = outcome_of(transaction)
        self.rates.add(now, outcome)
        latency = transaction.latency_ns
        host = station_of(transaction.connection, 1 - transaction.asked_by)
        number = bucket(latency) if latency is not None else 0
        spread = self._spread(transaction, latency, number, host)
        if latency is not None:
            self.answer_times.add(now, number // (32 // BANDS))
            self._keep_slow(latency, number, now, transaction, spread.plc if spread is not None else self.plcs.of(host))
        if outcome in {ERROR, MISSED}:
            self._failure(transaction, now)
        userdata = transaction.parameters.userdata
        if userdata is not None and userdata.group == GROUP_MODE:
            text = transaction.function_name.rpartition(": ")[2]
            self._mode(now, host, text, int(transaction.response_frame or transaction.request_frame))
        self.requests.take(transaction)
        self.tags.take(transaction)

    def act(self, act: Act) -> None:
        """Take an act: the inventory reads it."""
        self.inventory.act(act)

    def operation(self, operation: Operation) -> None:
        """Take an operation; connection setups are only counted, as connections have a table of their own."""
        self.analysis.operation(operation)
        self.inventory.operation(operation)
        begin = int(operation.begin_ns)
        for block in carve(operation):
            number = self.blocks.total + 1
            if self.blocks.wants(begin, mixed(number)):
                self.blocks.add(begin, mixed(number), self.rows.block(block, operation, number))
        if operation.kind == CONNECT:
            return
        rank = mixed(operation.number)
        if not self.operations.wants(begin, rank):
            return
        span = Span(
            begin,
            operation.end_ns,
            station_of(operation.connection),
            operation.kind,
            operation.number,
            operation.result,
        )
        self.operations.add(begin, rank, (self.rows.operation(operation), span))

    def fact(self, fact: Fact) -> None:
        """Take a fact that a station stated."""
        self.inventory.fact(fact)

    def finding(self, finding: Finding) -> None:
        """Take a finding; if it says that packets are missing, also the time in which they are."""
        self.analysis.finding(finding)
        if finding.because:
            return
        number = int(finding.connection)
        self._at(int(finding.time_ns))
        if number:
            self.talks.finding(number, finding.severity)
        heard = self._heard.get(number)
        if heard is not None:
            heard.worst = worse(heard.worst, finding.severity)
        if finding.slug in _MODES and heard is not None and heard.connection.plus is not None:
            host = station_of(heard.connection)
            self._mode(int(finding.time_ns), host, _MODES[finding.slug], finding.frames[-1] if finding.frames else 0)
        if finding.slug in _GAPS:
            self._gap(Gap(self._last_ns, max(self._last_ns, int(finding.time_ns)), 0, finding.rule.sentence))

    def list_open(self) -> None:
        """Take the connections that are still open, in their current state, for a report on a part of the time."""
        for heard in list(self._heard.values()):
            self.connection_closed(heard.connection)

    def take(self, pipeline: Pipeline, files: list[SourceFile], span: tuple[int, int] | None = None) -> None:
        """Take the pipeline's counts, when the run or the period is over.

        ``span`` is the time that the report covers, in nanoseconds since 1970; None for the time of what was seen.
        """
        self.analysis.take(pipeline, files)
        self.inventory.take(pipeline, files)
        self._span = span

    # ---- what is kept -----------------------------------------------------------------------------------------------

    def slowest(self) -> list[dict[str, Any]]:
        """Return the rows of the slowest transactions of all, followed by those of the slowest of each part of the time."""
        first = [row for _, _, row in sorted(self._slowest, key=lambda entry: (-entry[0], -entry[1]))]
        known = {row["key"] for row in first}
        further = [row for row in self._slow_then.rows() if row["key"] not in known]
        return first + sorted(further, key=lambda row: (-row["cells"][4], row["cells"][0]))

    @property
    def gaps(self) -> list[Gap]:
        """The gaps that are drawn, in order of time; if there are too many, the longest of each part of the time."""
        found: list[Gap] = self._gaps.rows()
        return found

    @property
    def gaps_not_drawn(self) -> int:
        """The number of gaps besides `gaps`."""
        return self._gaps.total - len(self._gaps)

    @property
    def listed_pairs(self) -> set[tuple[str, str, int]]:
        """The pairs of client and server, and their VLAN, that have a row in the table of connections."""
        return {key for _, key in self.connections.rows()}

    @property
    def spans(self) -> list[Span]:
        """The times of the kept operations."""
        return [span for _, span in self.operations.rows()]

    def _at(self, time_ns: int) -> None:
        """Take a time at which something happened."""
        self._begin_ns = min(self._begin_ns, time_ns) if self._begin_ns else time_ns
        self._end_ns = max(self._end_ns, time_ns)
        if len(self.files) - 1 > self._file:
            if between(self.files[self._file :]):
                self.tags.gap(0)
            self._file = len(self.files) - 1

    @property
    def start_ns(self) -> int:
        """The beginning of the report's time: that of ``span``, else of the first event; 0 without events."""
        return self._span[0] if self._span is not None else self._begin_ns

    @property
    def end_ns(self) -> int:
        """The end of the report's time: that of ``span``, else of the last event."""
        return self._span[1] if self._span is not None else self._end_ns

    def between_files(self) -> list[Gap]:
        """Return the times between files that are within the report's time."""
        return [
            Gap(begin, end, 0, "Nothing was captured between two of the files.")
            for begin, end in between(self.files)
            if begin < self.end_ns and end > self.start_ns
        ]

    def _look_for_gap(self, connection: Connection, now: int, asked_ns: int) -> None:
        """Note a gap if bytes of a connection went missing since its latest message, or since an unanswered request (0: none).

        The gap ends with the packet that shows it: the connection may be idle until its next message.
        """
        heard = self._heard.get(int(connection.number))
        one, other = connection.tcp.streams
        missing = int(one.position - one.octets + other.position - other.octets)
        if heard is None:  # the connection was open before this period of a live run began
            heard = self._heard.setdefault(int(connection.number), Heard(connection))
            heard.missing = missing
        if missing != heard.missing:
            shown_ns = max(int(one.gap_ns), int(other.gap_ns)) or now
            begin_ns = min(max(heard.time_ns, asked_ns) if asked_ns <= shown_ns else heard.time_ns, shown_ns)
            lost = missing - heard.missing
            why = f"{counted(lost, 'byte is', 'bytes are')} missing"
            self._gap(Gap(begin_ns, shown_ns, int(connection.number), why, idle(heard, lost, shown_ns - begin_ns)))
            heard.missing = missing
        heard.time_ns = now
        heard.octets = int(one.octets + other.octets)

    def _gap(self, gap: Gap) -> None:
        self.requests.gap(gap.connection)
        self.tags.gap(gap.connection)
        rank = gap.begin_ns - gap.end_ns
        if self._gaps.wants(gap.end_ns, rank):
            self._gaps.add(gap.end_ns, rank, gap)

    def _spread(self, transaction: Transaction, latency: int | None, number: int, host: Station) -> SpreadOf | None:
        """Count a transaction with its answer time, which is in bucket ``number``; return its record, None if it has none."""
        key = (host, transaction.function_name)
        spread = self.spreads.get(key)
        if spread is None:
            if len(self.spreads) >= MAX_SPREADS:
                self.spreads_not_told_apart += 1
                if len(self.further) < MAX_FURTHER:
                    self.further.add(key)
                return None
            spread = self.spreads.setdefault(key, SpreadOf(self.plcs.of(host)))
        spread.total += 1
        if latency is not None:
            spread.times.add(latency, number)
            spread.latencies.add(latency)
        elif transaction.is_likely:
            spread.likely += 1
        if transaction.has_errors:
            spread.errors += 1
        outcome = transaction._outcome
        if outcome == UNANSWERED:
            if transaction.missed:
                spread.missed += 1
            elif transaction.unseen:
                spread.not_captured += 1
            else:
                spread.still_open += 1
        elif outcome == ORPHAN:
            spread.orphans += 1
        elif outcome == PUSH:
            spread.alone += 1
        return spread

    def _failure(self, transaction: Transaction, now: int) -> None:
        if transaction._outcome == PUSH:
            self.failed_pushes += 1
        self.first_failure_ns = min(self.first_failure_ns or now, now)
        rank = mixed(int(transaction.number)) if self.failed.total else -1  # the first one stays
        if self.failed.wants(now, rank):
            self.failed.add(now, rank, self.rows.transaction(transaction))

    def _mode(self, now: int, host: Station, text: str, frame: int) -> None:
        if len(self.modes) >= MAX_MODES:
            self.modes_not_drawn += 1
        else:
            self.modes.append(Mode(now, host, text, frame))

    def _keep_slow(self, latency: int, bucket_: int, now: int, transaction: Transaction, plc: Plc | None) -> None:
        """Keep one of the slowest transactions: of all, of its part of the time, of its PLC."""
        then = self._slow_then.wants(now, -latency)
        there = plc is not None and plc.answered(now, latency, bucket_)
        if not then and not there and latency <= self._slow_floor:
            return
        row = self.rows.transaction(transaction)
        number = -int(transaction.number)
        if then:
            self._slow_then.add(now, -latency, row)
        if there and plc is not None:
            plc.slow(latency, number, row)
        if len(self._slowest) < MAX_SLOWEST:
            heapq.heappush(self._slowest, (latency, number, row))
        elif latency > self._slowest[0][0]:
            heapq.heapreplace(self._slowest, (latency, number, row))
        if len(self._slowest) == MAX_SLOWEST:
            self._slow_floor = self._slowest[0][0]

    def _list(self, connection: Connection) -> None:
        """Keep the row of a connection if it is among those with the gravest findings, then most errors, then most traffic."""
        heard = self._heard.get(int(connection.number))
        worst = heard.worst if heard is not None else ""
        self.opened.add(int(connection.tcp.first_ns), 0)
        self.ended.add(int(connection.last_ns), 0)
        rank = (
            SEVERITIES.index(worst) if worst else len(SEVERITIES),
            -int(connection.errors + connection.missed),
            -octets_of(connection),
            int(connection.number),
        )
        if self.connections.wants(rank):
            key = (str(connection.client.host), str(connection.server.host), int(connection.tcp.vlan))
            self.connections.add(rank, (self.rows.connection(connection, worst), key))
