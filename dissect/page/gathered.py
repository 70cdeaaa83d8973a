"""`Gathered`: an observer that collects everything that a report shows, in one pass and in bounded memory.

It counts by time what `dissect.report.analysis` counts over the whole run, and has such an `analysis`, too. It counts what it
leaves out, so that the report can say so.
"""

from __future__ import annotations

import heapq
from typing import Any, Final

from dissect.acts.act import Act
from dissect.engine.observer import Observer
from dissect.engine.pipeline import Pipeline
from dissect.findings.reporter import Finding
from dissect.inventory.collector import Inventory
from dissect.page.bins import Bins, Spread, bucket
from dissect.page.numbers import counted
from dissect.page.polls import Requests
from dissect.page.rows import ERROR, MISSED, Rows, Station, outcome_of, station_of, time_of
from dissect.page.tag_steps import Tags
from dissect.page.talks import Talks
from dissect.program.carved import carve
from dissect.report.analysis import Analysis
from dissect.report.latencies import Latencies
from dissect.s7.tables import GROUP_MODE
from dissect.source.packet import CONTINUES_NS, SourceFile
from dissect.stations.facts import Fact
from dissect.transactions.connection import ISO_TSAP_PORT, Connection
from dissect.transactions.operation import CONNECT, Operation
from dissect.transactions.transaction import ORPHAN, PUSH, UNANSWERED, Transaction
from dissect.variables.wanted import WantedSet

#: Greatest number of rows of each table.
MAX_SLOWEST: Final = 300
MAX_FAILED: Final = 500
MAX_OPERATIONS: Final = 1000
MAX_BLOCKS: Final = 500
#: Greatest number of pairs of PLC and function whose answer times are kept separately.
MAX_SPREADS: Final = 200
#: Greatest number of further pairs that are counted.
MAX_FURTHER: Final = 10_000
#: Greatest number of gaps, and of changes of the operating mode.
MAX_GAPS: Final = 1000
MAX_MODES: Final = 1000
#: In answer times over time, each doubling is divided into so many bands.
BANDS: Final = 4
#: Findings after which packets of any connection may be missing. Missing bytes of one connection show in its streams.
_GAPS: Final = frozenset(("capture.dropped", "capture.damaged"))

#: Findings that show the operating mode of an S7comm-plus CPU: S7comm-plus has no message for it.
_MODES: Final = {"security.stopped": "STOP", "security.mode_changed": "RUN"}


class Gap:
    """A time in which packets are missing, of one connection or of all (0)."""

    __slots__ = ("begin_ns", "connection", "end_ns", "why")

    def __init__(self, begin_ns: int, end_ns: int, connection: int, why: str) -> None:
        self.begin_ns = begin_ns
        self.end_ns = end_ns
        self.connection = connection
        self.why = why


class Heard:
    """When the latest message of a connection came, and how many of its bytes were missing by then."""

    __slots__ = ("connection", "missing", "time_ns")

    def __init__(self, connection: Connection) -> None:
        self.connection = connection
        self.time_ns = int(connection.tcp.first_ns)
        self.missing = 0


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
    are requests whose answer was not due yet when the capture ended, ``not_captured`` those whose answer may be what the
    capture lacks, ``likely`` pairs that are only likely, which are in no answer time, ``orphans`` answers without a request,
    ``alone`` pushes and requests that want no answer.
    """

    __slots__ = (
        "alone", "errors", "latencies", "likely", "missed", "not_captured", "orphans", "still_open", "times", "total",
    )  # fmt: skip

    def __init__(self) -> None:
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


def _apart(files: list[SourceFile]) -> list[tuple[int, int]]:
    """Return the times between files that do not continue the file before: (end of one, beginning of the next)."""
    found = []
    known_to = 0
    for begin, end in sorted([(int(file.first_ns), int(file.last_ns)) for file in files if file.first_ns]):
        if known_to and begin - known_to > CONTINUES_NS:
            found.append((known_to, begin))
        known_to = max(known_to, begin, end)
    return found


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
        #: Further pairs of PLC and function that are not told apart, at most `MAX_FURTHER`.
        self.further: set[tuple[Station, str]] = set()
        self.requests = Requests()
        self.talks = Talks()
        #: Machines that speak on another port than that of ISO-on-TCP, or in IBH-NetLink: Wireshark does not look for S7 there.
        self.unusual: set[Station] = set()
        self.tags = Tags(tags)
        self.gaps: list[Gap] = []
        self.gaps_not_drawn = 0
        self.modes: list[Mode] = []
        self.modes_not_drawn = 0
        self.operations: list[dict[str, Any]] = []
        self.blocks: list[dict[str, Any]] = []
        self.blocks_in_all = 0
        self.spans: list[Span] = []
        self.operations_not_listed = 0
        self.connections: list[dict[str, Any]] = []
        self.failed: list[dict[str, Any]] = []
        self.failed_in_all = 0
        self.failed_pushes = 0  # how many of these are pushes with an item that the PLC could not read
        #: When the first request failed, 0 for never.
        self.first_failure_ns = 0
        self._slowest: list[tuple[int, int, dict[str, Any]]] = []
        self._slow_floor = -1
        self.files: list[SourceFile] = []
        self._file = 0  # index in `files` of the one that is being read
        self._begin_ns = 0
        self._end_ns = 0
        self._span: tuple[int, int] | None = None
        self._last_ns = 0
        self._heard: dict[int, Heard] = {}

    # ---- observer ---------------------------------------------------------------------------------------------------

    def connection_opened(self, connection: Connection) -> None:
        """Remember a connection, for the gaps that are found on it."""
        self._at(int(connection.tcp.first_ns))
        self._heard[int(connection.number)] = Heard(connection)

    def connection_closed(self, connection: Connection) -> None:
        """Take a connection for the tables of connections and of who talked to whom."""
        analysis = self.analysis
        listed = len(analysis.connections)
        analysis.connection_closed(connection)
        if len(analysis.connections) > listed:
            self.connections.append(self.rows.connection(connection))
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
        if latency is not None:
            self.answer_times.add(now, bucket(latency) // (32 // BANDS))
            if latency > self._slow_floor:
                self._keep_slow(latency, transaction)
        self._spread(transaction, latency)
        if outcome in {ERROR, MISSED}:
            self._failure(transaction, now)
        userdata = transaction.parameters.userdata
        if userdata is not None and userdata.group == GROUP_MODE:
            host = station_of(transaction.connection, 1 - transaction.asked_by)
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
        for block in carve(operation):
            self.blocks_in_all += 1
            if len(self.blocks) < MAX_BLOCKS:
                self.blocks.append(self.rows.block(block, operation, self.blocks_in_all))
        if operation.kind == CONNECT:
            return
        if len(self.operations) >= MAX_OPERATIONS:
            self.operations_not_listed += 1
            return
        self.operations.append(self.rows.operation(operation))
        host = station_of(operation.connection)
        self.spans.append(
            Span(operation.begin_ns, operation.end_ns, host, operation.kind, operation.number, operation.result)
        )

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
        if finding.slug in _MODES and heard is not None and heard.connection.plus is not None:
            host = station_of(heard.connection)
            self._mode(int(finding.time_ns), host, _MODES[finding.slug], finding.frames[-1] if finding.frames else 0)
        if finding.slug in _GAPS:
            self._gap(Gap(self._last_ns, max(self._last_ns, int(finding.time_ns)), 0, finding.rule.sentence))

    def list_open(self) -> None:
        """Take the connections that are still open, in their present state, for a report on a part of the time."""
        for heard in list(self._heard.values()):
            self.connection_closed(heard.connection)

    def take(self, pipeline: Pipeline, files: list[SourceFile], span: tuple[int, int] | None = None) -> None:
        """Take over what the pipeline counted, when the run or the period is over.

        ``span`` is the time that the report covers, in nanoseconds since 1970; None for the time of what was seen.
        """
        self.analysis.take(pipeline, files)
        self.inventory.take(pipeline, files)
        self._span = span

    # ---- what is kept -----------------------------------------------------------------------------------------------

    def slowest(self) -> list[dict[str, Any]]:
        """Return the rows of the slowest transactions, slowest first."""
        return [row for _, _, row in sorted(self._slowest, key=lambda entry: (-entry[0], -entry[1]))]

    def _at(self, time_ns: int) -> None:
        """Take a time at which something happened."""
        self._begin_ns = min(self._begin_ns, time_ns) if self._begin_ns else time_ns
        self._end_ns = max(self._end_ns, time_ns)
        if len(self.files) - 1 > self._file:
            if _apart(self.files[self._file :]):
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
            for begin, end in _apart(self.files)
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
            begin_ns = max(heard.time_ns, asked_ns) if asked_ns <= shown_ns else heard.time_ns
            self._gap(
                Gap(
                    min(begin_ns, shown_ns),
                    shown_ns,
                    int(connection.number),
                    f"{counted(missing - heard.missing, 'byte is', 'bytes are')} missing",
                )
            )
            heard.missing = missing
        heard.time_ns = now

    def _gap(self, gap: Gap) -> None:
        self.requests.gap(gap.connection)
        self.tags.gap(gap.connection)
        if len(self.gaps) < MAX_GAPS:
            self.gaps.append(gap)
        else:
            self.gaps_not_drawn += 1

    def _spread(self, transaction: Transaction, latency: int | None) -> None:
        key = (station_of(transaction.connection, 1 - transaction.asked_by), transaction.function_name)
        spread = self.spreads.get(key)
        if spread is None:
            if len(self.spreads) >= MAX_SPREADS:
                self.spreads_not_told_apart += 1
                if len(self.further) < MAX_FURTHER:
                    self.further.add(key)
                return
            spread = self.spreads.setdefault(key, SpreadOf())
        spread.total += 1
        if latency is not None:
            spread.times.add(latency)
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

    def _failure(self, transaction: Transaction, now: int) -> None:
        self.failed_in_all += 1
        if transaction._outcome == PUSH:
            self.failed_pushes += 1
        self.first_failure_ns = min(self.first_failure_ns or now, now)
        if len(self.failed) < MAX_FAILED:
            self.failed.append(self.rows.transaction(transaction))

    def _mode(self, now: int, host: Station, text: str, frame: int) -> None:
        if len(self.modes) >= MAX_MODES:
            self.modes_not_drawn += 1
        else:
            self.modes.append(Mode(now, host, text, frame))

    def _keep_slow(self, latency: int, transaction: Transaction) -> None:
        if len(self._slowest) < MAX_SLOWEST:
            entry = (latency, -int(transaction.number), self.rows.transaction(transaction))
            heapq.heappush(self._slowest, entry)
        elif latency > self._slowest[0][0]:
            entry = (latency, -int(transaction.number), self.rows.transaction(transaction))
            heapq.heapreplace(self._slowest, entry)
        if len(self._slowest) == MAX_SLOWEST:
            self._slow_floor = self._slowest[0][0]
