"""The sums of `analyze` over a whole run.

Counters are exact; lists keep only the most important entries, so memory is limited.
"""

from __future__ import annotations

import heapq
from collections.abc import Sequence
from typing import Any, Final

from mypy_extensions import i64

from dissect.engine.findings.bounds import KEPT
from dissect.engine.findings.ledger import Ledger
from dissect.engine.findings.reporter import Finding
from dissect.engine.observer import Observer
from dissect.engine.pipeline import Pipeline
from dissect.engine.stations.facts import Book, Fact
from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.operation import RUNNING, Operation
from dissect.engine.transactions.results import DOUBTS
from dissect.engine.transactions.transaction import ANSWERED, CONNECTION_CLOSED, ORPHAN, PUSH, UNANSWERED, Transaction
from dissect.meaning.report.certainty import add_doubt
from dissect.meaning.report.kept import FIRST, Findings
from dissect.meaning.report.latencies import Latencies
from dissect.meaning.report.servers import Servers
from dissect.meaning.report.words import Places
from dissect.packets.source.packet import SourceFile
from dissect.packets.tcp.stream import Endpoint
from dissect.protocols.iso.tsap import Tsap
from dissect.protocols.s7.parameters import Parameters
from dissect.protocols.s7.tables import USERDATA
from dissect.protocols.s7plus.parameters import PlusParameters
from dissect.wire.copies import keep_out, leaves

#: Connections that are kept and described one by one: those with most errors, then the busiest; others are only counted.
MAX_CONNECTIONS: Final = 1000
#: Slowest and failed transactions kept for showing.
MAX_SLOWEST: Final = 10
MAX_FAILED: Final = 100


def add_counts(counts: dict[str, int], more: dict[str, int]) -> None:
    """Add the numbers of ``more`` to those of ``counts``."""
    for name, count in more.items():
        counts[name] = counts.get(name, 0) + count


class FunctionStatistics:
    """The transactions of one function (for userdata: of one group and subfunction)."""

    __slots__ = (
        "answered",
        "behind",
        "errors",
        "latencies",
        "likely",
        "name",
        "not_captured",
        "one_way",
        "orphans",
        "pushes",
        "still_open",
        "total",
        "unanswered",
    )

    def __init__(self, name: str) -> None:
        self.name: str = name
        self.total: i64 = 0
        self.answered: i64 = 0
        self.unanswered: i64 = 0
        self.still_open: i64 = 0  # unanswered because the capture ended before their answer was due
        self.not_captured: i64 = 0  # unanswered, but their answer may only be missing from the capture
        self.likely: i64 = 0  # answered, but only a likely pair; `latencies` does not include them
        self.orphans: i64 = 0
        self.pushes: i64 = 0
        self.one_way: i64 = 0
        self.behind: i64 = 0
        self.errors: i64 = 0
        self.latencies: Latencies = Latencies()

    def __repr__(self) -> str:
        counts = f"{self.total} transactions, {self.errors} with errors, {self.unanswered} unanswered"
        return f"FunctionStatistics({self.name!r}, {counts})"

    @property
    def missed(self) -> int:
        """Requests whose answer was due and did not come (`Transaction.missed`)."""
        return int(self.unanswered - self.still_open - self.not_captured)

    def merge(self, other: FunctionStatistics) -> None:
        """Add the transactions of ``other``."""
        self.total += other.total
        self.answered += other.answered
        self.unanswered += other.unanswered
        self.still_open += other.still_open
        self.not_captured += other.not_captured
        self.likely += other.likely
        self.orphans += other.orphans
        self.pushes += other.pushes
        self.one_way += other.one_way
        self.behind += other.behind
        self.errors += other.errors
        self.latencies.merge(other.latencies)


class Shared:
    """Stores values that many kept connections have in common only once: parameters, addresses and TSAPs repeat a lot."""

    __slots__ = ("_asked", "_ends", "_macs", "_tsaps")

    def __init__(self) -> None:
        #: The latest requests, answers and refusals of connections: for each ROSCTR, parameters by their octets.
        self._asked: list[dict[bytes, Parameters]] = [{} for _ in range(USERDATA + 1)]
        self._ends: dict[bytes, Endpoint] = {}  # by address
        self._macs: dict[bytes, bytes] = {}
        self._tsaps: dict[bytes, Tsap] = {}

    def take(self, connection: Connection) -> None:
        """Let a finished connection share the values that are already known, and remember its new ones."""
        tcp = connection.tcp
        first, second = tcp.ends
        tcp.ends = [self._end(first), self._end(second)]  # not a comprehension: its list would have spare room
        tcp.macs = self._macs.setdefault(tcp.macs, tcp.macs)
        connection.tsap_calling = self._tsap(connection.tsap_calling)
        connection.tsap_called = self._tsap(connection.tsap_called)
        ending = connection.ending
        if ending is not None:
            connection.last_request = ending.last_request = self._once(ending.last_request)
            connection.last_answer = ending.last_answer = self._once(ending.last_answer)
            connection.last_error = ending.last_error = self._once(ending.last_error)

    def _end(self, end: Endpoint) -> Endpoint:
        known = self._ends.get(end.address)
        if known is None:
            self._ends[end.address] = end
            return end
        if known.port == end.port:
            return known
        end.share(known)
        return end

    def _tsap(self, tsap: Tsap | None) -> Tsap | None:
        return None if tsap is None else self._tsaps.setdefault(tsap.octets, tsap)

    def _once(self, asked: Parameters | None) -> Parameters | None:
        if asked is None or asked.rosctr > USERDATA:
            # parameters of other protocols contain more than their octets, so equal octets are not sufficient
            return asked
        return self._asked[asked.rosctr].setdefault(asked.octets, asked)


class Part:
    """The part of a capture in an analysis with a selection (option -Y): the expression, and how much it left out.

    ``passed`` counts all that was selected. ``transactions``, ``operations``, ``findings`` and ``connections`` count what was
    read but not selected. ``not_read`` counts connections that were not read at all, because their addresses or numbers ruled
    them out. ``findings_not_judged`` counts findings of which no detail was kept that the selection could check.
    ``finding_counts`` are the selected findings, by slug; ``explained_counts`` are those among them that others explain, as in
    `Reporter.explained`. ``ledger`` has the facts of the selected.
    """

    __slots__ = (
        "connections",
        "explained_counts",
        "finding_counts",
        "findings",
        "findings_not_judged",
        "ledger",
        "not_read",
        "operations",
        "passed",
        "transactions",
        "where",
    )

    def __init__(self, where: str) -> None:
        self.where: str = where
        self.passed: i64 = 0
        self.transactions: i64 = 0
        self.operations: i64 = 0
        self.findings: i64 = 0
        self.findings_not_judged: i64 = 0
        self.connections: i64 = 0
        self.not_read: i64 = 0
        self.finding_counts: dict[str, int] = {}
        self.explained_counts: dict[tuple[str, str], int] = {}
        self.ledger: Ledger = Ledger()

    def merge(self, other: Part) -> None:
        """Add what the same expression left out in another run."""
        self.transactions += other.transactions
        self.operations += other.operations
        self.findings += other.findings
        self.findings_not_judged += other.findings_not_judged
        self.passed += other.passed
        self.connections += other.connections
        self.not_read += other.not_read
        self.ledger.merge(other.ledger)
        add_counts(self.finding_counts, other.finding_counts)
        for pair, count in other.explained_counts.items():
            self.explained_counts[pair] = self.explained_counts.get(pair, 0) + count

    def as_dict(self) -> dict[str, object]:
        """Return the object ``selection`` of the JSON contract (docs/json.md)."""
        return {
            "where": self.where,
            "transactions_left_out": self.transactions,
            "operations_left_out": self.operations,
            "findings_left_out": self.findings,
            "findings_not_judged": self.findings_not_judged,
            "connections_left_out": self.connections,
            "connections_not_read": self.not_read,
        }


class Analysis(Observer):
    """The complete result of `analyze` for a run. Fill it through a pipeline, then `take` the pipeline's own counters.

    ``findings`` are those without a cause; ``explained`` are those that one of them explains (`Finding.because`).
    """

    def __init__(self) -> None:
        super().__init__()
        self.total: i64 = 0
        self.answered: i64 = 0
        self.unanswered: i64 = 0
        self.still_open: i64 = 0  # unanswered because the capture ended before their answer was due, so nothing failed
        self.not_captured: i64 = 0  # unanswered, but their answer may only be missing from the capture
        self.likely: dict[str, int] = {}  # answered, but only likely pairs, by doubt; they are in no answer time
        self.orphans: i64 = 0
        self.unsolicited: i64 = 0
        self.one_way: i64 = 0  # unsolicited requests that need no answer
        self.behind: i64 = 0  # behind malformed TPDU headers, and without a partner
        self.with_errors: i64 = 0
        self.functions: dict[int, FunctionStatistics] = {}
        self._latest_key: i64 = -1  # key of `_latest` in `functions`; the next transaction often has the same
        self._latest: FunctionStatistics | None = None
        self._earlier_key: i64 = -1  # the same for the function before it: often two alternate
        self._earlier: FunctionStatistics | None = None
        self.unanswered_reasons: dict[str, int] = {}
        self.connections: list[Connection] = []
        self._shared: Shared = Shared()  # values that `connections` have in common
        self._least: list[tuple[int, int, int, int]] = []  # ranks of `connections` with their places, the least first
        self.servers: Servers = Servers()
        self.connections_not_listed: i64 = 0
        self._findings: Findings = Findings()
        self._first_findings: list[Finding] = self._findings.first
        self.findings: Sequence[Finding] = self._findings
        self._explained: Findings = Findings()
        self.explained: Sequence[Finding] = self._explained
        self.operations: dict[str, dict[str, int]] = {}  # by kind: how many had which result
        self.ended_operations: dict[str, int] = {}  # by kind: how many of the running ones ended with their connection
        self.stations: Book = Book()  # statements of stations about themselves
        self.own_book = self.stations
        self.wants_facts = type(self) is not Analysis  # a subclass may override `fact`
        self.failed: list[Transaction] = []
        self._slowest: list[tuple[int, int, Transaction]] = []
        self._slow_floor: i64 = -1
        self.pipeline: Pipeline | None = None
        self.files: list[SourceFile] = []
        self.part: Part | None = None  # with a selection (-Y): the selection, and how much it left out

    def __repr__(self) -> str:
        return (
            f"Analysis({len(self.connections)} connections, {self.total} transactions, {self.with_errors} with errors, "
            f"{self.unanswered} unanswered)"
        )

    def take(self, pipeline: Pipeline, files: list[SourceFile]) -> None:
        """Store the pipeline's counts and the files that were read."""
        self.pipeline = pipeline
        self.files = files
        self._shared = Shared()

    @property
    def missed(self) -> int:
        """Number of requests whose answer was due and did not come (`Transaction.missed`)."""
        return int(self.unanswered - self.still_open - self.not_captured)

    @property
    def finding_counts(self) -> dict[str, int]:
        """How often each finding was made, by slug; empty before `take`."""
        if self.part is not None:
            return self.part.finding_counts
        return self.pipeline.finding_counts if self.pipeline is not None else {}

    @property
    def explained_counts(self) -> dict[tuple[str, str], int]:
        """How many findings a cause explains, by the slugs of both; empty before `take`."""
        if self.part is not None:
            return self.part.explained_counts
        return self.pipeline.exchange.reporter.explained if self.pipeline is not None else {}

    @property
    def ledger(self) -> Ledger:
        """The facts of each rule; empty before `take`."""
        if self.part is not None:
            return self.part.ledger
        return self.pipeline.exchange.ledger if self.pipeline is not None else Ledger()

    @property
    def perhaps_twice(self) -> bool:
        """True when a connection may have been counted twice: an idle one was forgotten, and may have continued."""
        return self.pipeline is not None and self.pipeline.connections.twice > 0

    def by_cause(self) -> dict[str, dict[str, int]]:
        """Return how many findings each cause explains: by its slug, then by theirs."""
        found: dict[str, dict[str, int]] = {}
        for (cause, slug), count in sorted(self.explained_counts.items()):
            found.setdefault(cause, {})[slug] = count
        return found

    @property
    def latencies(self) -> Latencies:
        """Answer times of all functions together; computed anew at each access."""
        together = Latencies()
        for statistics in self.functions.values():
            together.merge(statistics.latencies)
        return together

    def sections(self) -> dict[str, Any]:
        """Return the counts of each protocol of the pipeline, in their order (`Protocol.describe`); empty before `take`."""
        found: dict[str, Any] = {}
        if self.pipeline is not None:
            for protocol in self.pipeline.protocols:
                found.update(protocol.describe())
        return found

    def as_dict(self) -> dict[str, object]:
        """Return the analysis as the JSON contract has it (docs/json.md)."""
        from dissect.meaning.report.contract import analysis_as_dict

        return analysis_as_dict(self)

    def locate(self, frame: int) -> tuple[str, int]:
        """Return (file name, number of the packet in that file) for a packet of the run; IndexError before `take`."""
        return Places(self.files, True).locate(frame)

    # ---- observer ---------------------------------------------------------------------------------------------------

    def transaction(self, transaction: Transaction) -> None:
        """Count a transaction."""
        self.total += 1
        parameters = transaction.parameters
        statistics = self._latest
        if statistics is None or parameters.function != self._latest_key or parameters.userdata is not None:
            statistics = self._statistics(parameters)
        statistics.total += 1
        outcome: i64 = transaction._outcome
        if outcome == ANSWERED:
            self.answered += 1
            statistics.answered += 1
            if transaction._flags & DOUBTS:
                statistics.likely += 1
                add_doubt(self.likely, transaction)
            else:
                latency: i64 = transaction.response_ns - transaction.request_ns
                statistics.latencies.add(latency)
                if latency > self._slow_floor:
                    self._keep_slow(latency, transaction)
        elif outcome == UNANSWERED:
            self.unanswered += 1
            statistics.unanswered += 1
            self.unanswered_reasons[transaction.reason] = self.unanswered_reasons.get(transaction.reason, 0) + 1
            if transaction.missed:
                self._keep_failed(transaction)
            elif transaction.unseen:
                self.not_captured += 1
                statistics.not_captured += 1
            else:
                self.still_open += 1
                statistics.still_open += 1
        elif outcome == ORPHAN:
            self.orphans += 1
            statistics.orphans += 1
        elif outcome == PUSH:
            self.unsolicited += 1
            if transaction.request_frame:
                self.one_way += 1
                statistics.one_way += 1
            else:
                statistics.pushes += 1
        else:
            self.behind += 1
            statistics.behind += 1
        if transaction.has_errors:
            self.with_errors += 1
            statistics.errors += 1
            self._keep_failed(transaction)

    def connection_closed(self, connection: Connection) -> None:
        """Count a connection, and keep it for the list if there is room, or one there matters less."""
        self.servers.take(connection)
        self._list(connection)

    def operation(self, operation: Operation) -> None:
        """Count an operation by its kind and result."""
        results = self.operations.get(operation.kind)
        if results is None:
            results = self.operations[operation.kind] = {}
        results[operation.result] = results.get(operation.result, 0) + 1
        if operation.result == RUNNING and operation.reason == CONNECTION_CLOSED:
            self.ended_operations[operation.kind] = self.ended_operations.get(operation.kind, 0) + 1

    def fact(self, fact: Fact) -> None:
        """Keep the statement of a station."""
        if not self.stations.filled:
            self.stations.note(fact)

    def finding(self, finding: Finding) -> None:
        """Keep a detailed finding, within the bounds."""
        if finding.room != KEPT:
            return
        if finding.because:
            self._explained.append(finding)
            return
        first = self._first_findings
        if len(first) < FIRST:
            first.append(finding)  # `Findings.append` does the same, but is not compiled
        else:
            self._findings.append(finding)

    # ---- of several runs --------------------------------------------------------------------------------------------

    def merge(self, later: Analysis) -> None:
        """Add the results of ``later`` for the packets after this run's; its numbers continue from the end of this one.

        ``pipeline``, ``files``, ``findings`` and ``explained`` are not changed: `dissect.files.jobs.analyses` merges them.
        """
        self.total += later.total
        self.answered += later.answered
        self.unanswered += later.unanswered
        self.still_open += later.still_open
        self.not_captured += later.not_captured
        add_counts(self.likely, later.likely)
        self.orphans += later.orphans
        self.unsolicited += later.unsolicited
        self.one_way += later.one_way
        self.behind += later.behind
        self.with_errors += later.with_errors
        for key, statistics in later.functions.items():
            if key not in self.functions:
                self.functions[key] = FunctionStatistics(statistics.name)
            self.functions[key].merge(statistics)
        add_counts(self.unanswered_reasons, later.unanswered_reasons)
        for connection in later.connections:
            self._list(connection)
        self.servers.merge(later.servers)
        self.connections_not_listed += later.connections_not_listed
        for kind, results in later.operations.items():
            add_counts(self.operations.setdefault(kind, {}), results)
        add_counts(self.ended_operations, later.ended_operations)
        self.stations.merge(later.stations)
        for transaction in later.failed:
            self._keep_failed(transaction)
        for latency, _, transaction in later._slowest:
            self._keep_slow(latency, transaction)
        if self.part is None:
            self.part = later.part
        elif later.part is not None:
            self.part.merge(later.part)

    # ---- what is kept -----------------------------------------------------------------------------------------------

    def _list(self, connection: Connection) -> None:
        """Keep a connection for the list; where that is full, in place of the one that matters least, or not at all."""
        if len(self.connections) < MAX_CONNECTIONS:
            self.connections.append(connection)
            self._shared.take(connection)
            return
        self.connections_not_listed += 1
        if not self._least:
            self._least = [_rank(one, place) for place, one in enumerate(self.connections)]
            heapq.heapify(self._least)
        place = self._least[0][3]
        if _is_worse(connection, self.connections[place]):
            self.connections[place] = connection
            self._shared.take(connection)
            heapq.heapreplace(self._least, _rank(connection, place))

    def _statistics(self, parameters: Parameters) -> FunctionStatistics:
        key: i64 = parameters.function
        userdata = parameters.userdata
        if userdata is not None:
            key = 0x10000 | (userdata.group << 8) | userdata.subfunction
        elif key > 0xFF and isinstance(parameters, PlusParameters):
            key = parameters.statistics_key
        latest = self._latest
        if latest is not None and key == self._latest_key:
            return latest
        found = self._earlier
        if found is None or key != self._earlier_key:
            found = self.functions.get(key)
        self._earlier = latest
        self._earlier_key = self._latest_key
        if found is None:
            name = parameters.function_name
            if isinstance(parameters, PlusParameters):
                name = parameters.statistics_name
            found = FunctionStatistics(name)
            self.functions[key] = found
        self._latest_key = key
        self._latest = found
        return found

    def _keep_slow(self, latency: i64, transaction: Transaction) -> None:
        entry = (int(latency), -int(transaction.number), transaction)
        if len(self._slowest) < MAX_SLOWEST:
            heapq.heappush(self._slowest, entry)
        else:
            heapq.heappushpop(self._slowest, entry)
        if len(self._slowest) == MAX_SLOWEST:
            self._slow_floor = self._slowest[0][0]

    def _keep_failed(self, transaction: Transaction) -> None:
        if len(self.failed) < MAX_FAILED and (not self.failed or self.failed[-1] is not transaction):
            self.failed.append(transaction)

    def worst_connections(self, most: i64) -> list[Connection]:
        """Return up to ``most`` connections: those with most errors first, then those with most PDUs."""
        worst: list[Connection] = []
        for connection in self.connections:
            place: i64 = len(worst)
            if place == most and not _is_worse(connection, worst[most - 1]):
                continue
            while place > 0 and _is_worse(connection, worst[place - 1]):
                place -= 1
            worst.insert(place, connection)
            if len(worst) > most:
                worst.pop()
        return worst

    def slowest(self) -> list[Transaction]:
        """Return the slowest answered transactions, slowest first."""
        return [transaction for _, _, transaction in sorted(self._slowest, reverse=True)]


def _is_worse(one: Connection, other: Connection) -> bool:
    """Return whether ``one`` had more trouble than ``other``, or as much and more PDUs; in a tie the lower number is worse."""
    mine: i64 = _trouble(one)
    theirs: i64 = _trouble(other)
    if mine != theirs:
        return mine > theirs
    if one.pdus != other.pdus:
        return one.pdus > other.pdus
    return one.number < other.number


def _rank(connection: Connection, place: int) -> tuple[int, int, int, int]:
    """Return what `_is_worse` compares, and the place of a connection in the list."""
    return int(_trouble(connection)), int(connection.pdus), -int(connection.number), place


def _trouble(connection: Connection) -> i64:
    trouble: i64 = connection.missed + connection.errors
    if connection.refused:
        trouble += 1
    return trouble


leaves(FunctionStatistics, Part)
keep_out(Analysis, "_shared")
