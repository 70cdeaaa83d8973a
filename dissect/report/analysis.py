"""What `analyze` adds up over a whole run. Bounded: counters are exact, lists keep the entries that matter most.

Answer times are exact for the first 16,384, then within one part in 128 (docs/decisions/0007).
"""

from __future__ import annotations

import heapq
from typing import Any, Final

from librt.strings import BytesWriter, read_i64_le, write_i64_le
from mypy_extensions import i64

from dissect.engine.observer import Observer
from dissect.engine.pipeline import Pipeline
from dissect.findings.reporter import Finding
from dissect.iso.tsap import Tsap
from dissect.report.words import Places
from dissect.s7.parameters import Parameters
from dissect.s7.tables import USERDATA
from dissect.s7plus.parameters import PlusParameters
from dissect.source.packet import SourceFile
from dissect.stations.facts import Book, Fact
from dissect.tcp.stream import Endpoint
from dissect.transactions.connection import Connection
from dissect.transactions.operation import Operation
from dissect.transactions.transaction import ANSWERED, ORPHAN, PUSH, UNANSWERED, Transaction

#: Answer times kept as they are; from then on they are counted in buckets.
EXACT: Final = 16384
#: How many of these are counted there with each one that comes then: no packet waits for all of them.
_AT_ONCE: Final = 32
#: Buckets to each doubling.
_STEPS: Final = 128
#: Buckets for every answer time that 63 bits can hold.
_BUCKETS: Final = 57 * _STEPS
#: Of more than so many that are kept as they are, only those near a rank are put in order to find the one that has it.
_FEW: Final = 256
#: So many buckets beside each other are counted together for that.
_COARSE: Final = 16


class Latencies:
    """Answer times in nanoseconds: count, minimum, maximum and quantiles.

    Quantiles are exact up to `EXACT` answers (the value at rank ⌈q·n⌉; the median of an even count is the mean of the two in
    the middle), and after that the lower end of a bucket whose width is at most 1/128 of it. Negative times (reordered
    captures) count as they are for the minimum and as 0 in buckets.
    """

    __slots__ = ("_asked_at", "_buckets", "_counted", "_kept", "_spread", "_waiting", "count", "largest", "smallest")

    def __init__(self) -> None:
        self.count: i64 = 0
        self.smallest: i64 = 0
        self.largest: i64 = 0
        self._kept: BytesWriter = BytesWriter()  # those that are kept as they are, in eight octets each
        self._asked_at: i64 = 0  # of how many answers a quantile was asked last: a few are in order since then
        self._spread: list[int] = []  # of more, how many are in each `_COARSE` buckets
        self._buckets: list[int] | None = None
        self._waiting: bytes = b""  # those that were kept, while buckets do not count them all
        self._counted: i64 = 0  # octets of these that they do

    def add(self, latency_ns: i64) -> None:
        """Take one answer time."""
        if self.count == 0:
            self.smallest = latency_ns
            self.largest = latency_ns
        elif latency_ns < self.smallest:
            self.smallest = latency_ns
        elif latency_ns > self.largest:
            self.largest = latency_ns
        self.count += 1
        buckets = self._buckets
        if buckets is None:
            write_i64_le(self._kept, latency_ns)
            if self.count > EXACT:
                self._begin_buckets()
            return
        bucket: i64 = _bucket(latency_ns)
        buckets[bucket] = buckets[bucket] + 1  # `+=` on an element of a list is slower (mypyc)
        if self._waiting:
            self._fold(_AT_ONCE)

    def _begin_buckets(self) -> None:
        self._buckets = [0] * _BUCKETS
        self._waiting = self._kept.getvalue()
        self._kept = BytesWriter()

    @property
    def exact(self) -> bool:
        """True while every answer time is kept as it is."""
        return self._buckets is None

    def quantile(self, q: float) -> int | None:
        """Return the answer time that a share ``q`` (0 to 1) of all does not exceed, None when there is none."""
        if self.count == 0:
            return None
        rank: int = max(1, int(-(-(q * int(self.count)) // 1)))
        buckets = self._buckets
        if buckets is None:
            if q == 0.5 and self.count % 2 == 0:
                return (self._at(rank) + self._at(rank + 1)) // 2
            return self._at(rank)
        self._fold(len(self._waiting))
        seen = 0
        for bucket, count in enumerate(buckets):
            seen += count
            if seen >= rank:
                return min(max(_lower_end(bucket), int(self.smallest)), int(self.largest))
        return self.largest

    def _at(self, rank: int) -> int:
        """Return the answer time at a rank from 1 on, while all are kept as they are."""
        few: bool = self.count <= _FEW
        packed = self._kept.getvalue()
        if self._asked_at != self.count:
            self._asked_at = self.count
            if few:
                packed = _in_order(packed)
                self._kept = BytesWriter()
                self._kept.write(packed)
            else:
                self._spread = _spread(packed)
        if few:
            return read_i64_le(packed, 8 * (rank - 1))
        before = 0
        coarse = 0
        while before + self._spread[coarse] < rank:
            before += self._spread[coarse]
            coarse += 1
        first: i64 = _lower_end(coarse * _COARSE) if coarse else self.smallest
        last: i64 = _lower_end((coarse + 1) * _COARSE) - 1
        near: list[int] = []
        for at in range(0, len(packed), 8):
            latency: i64 = read_i64_le(packed, at)
            if first <= latency <= last:
                near.append(latency)
        return sorted(near)[rank - before - 1]

    def as_dict(self) -> dict[str, int | None]:
        """Return minimum, median, 95 %, 99 % and maximum in nanoseconds; all None when there is no answer."""
        if self.count == 0:
            return {"min": None, "median": None, "p95": None, "p99": None, "max": None}
        return {
            "min": self.smallest,
            "median": self.quantile(0.5),
            "p95": self.quantile(0.95),
            "p99": self.quantile(0.99),
            "max": self.largest,
        }

    def _fold(self, most: i64) -> None:
        """Count up to ``most`` of those kept as they are in buckets instead."""
        if self._buckets is None:
            self._begin_buckets()
        buckets = self._buckets
        assert buckets is not None
        waiting = self._waiting
        at: i64 = self._counted
        end: i64 = min(at + 8 * most, len(waiting))
        while at < end:
            bucket: i64 = _bucket(read_i64_le(waiting, at))
            buckets[bucket] = buckets[bucket] + 1
            at += 8
        if at == len(waiting):
            self._waiting = b""
            at = 0
        self._counted = at

    def merge(self, other: Latencies) -> None:
        """Take all answer times of ``other``, which keeps them."""
        if not other.count:
            return
        if not self.count or other.smallest < self.smallest:
            self.smallest = other.smallest
        if not self.count or other.largest > self.largest:
            self.largest = other.largest
        self.count += other.count
        if self._buckets is None and other._buckets is None and self.count <= EXACT:
            self._kept.write(other._kept.getvalue())
            return
        self._fold(self.count)
        self._waiting = other._waiting[other._counted :] + other._kept.getvalue()
        self._fold(self.count)
        if self._buckets is not None and other._buckets is not None:
            for bucket, count in enumerate(other._buckets):
                self._buckets[bucket] += count


def _in_order(packed: bytes) -> bytes:
    """Return the numbers in memory in their order."""
    writer = BytesWriter()
    for number in sorted([read_i64_le(packed, at) for at in range(0, len(packed), 8)]):
        write_i64_le(writer, number)
    return writer.getvalue()


def _spread(packed: bytes) -> list[int]:
    """Return how many of the numbers in memory are in each `_COARSE` buckets."""
    spread = [0] * (_BUCKETS // _COARSE)
    for at in range(0, len(packed), 8):
        coarse: i64 = _bucket(read_i64_le(packed, at)) // _COARSE
        spread[coarse] = spread[coarse] + 1  # as in `add`
    return spread


def _bucket(latency_ns: i64) -> i64:
    """Return the bucket number: the doubling times `_STEPS`, plus the step within it."""
    if latency_ns < _STEPS:
        return max(0, latency_ns)
    doubling: i64 = 0
    value: i64 = latency_ns
    while value >= _STEPS << 16:  # answer times of milliseconds would be halved a dozen times
        value >>= 16
        doubling += 16
    while value >= _STEPS << 4:
        value >>= 4
        doubling += 4
    while value >= 2 * _STEPS:
        value >>= 1
        doubling += 1
    return (doubling + 1) * _STEPS + (value - _STEPS)


def _lower_end(bucket: int) -> int:
    doubling, step = divmod(bucket, _STEPS)
    if doubling == 0:
        return step
    return (_STEPS + step) << (doubling - 1)


#: Connections described one by one; the others are only counted.
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

    __slots__ = ("answered", "errors", "latencies", "name", "total", "unanswered")

    def __init__(self, name: str) -> None:
        self.name: str = name
        self.total: i64 = 0
        self.answered: i64 = 0
        self.unanswered: i64 = 0
        self.errors: i64 = 0
        self.latencies: Latencies = Latencies()

    def merge(self, other: FunctionStatistics) -> None:
        """Add the transactions of ``other``."""
        self.total += other.total
        self.answered += other.answered
        self.unanswered += other.unanswered
        self.errors += other.errors
        self.latencies.merge(other.latencies)


#: Words of findings that are compared with the next ones.
_WORDINGS: Final = 512


class Shared:
    """What connections and findings that are kept have in common, each of it kept once: thousands of them are much alike."""

    __slots__ = ("_asked", "_details", "_ends", "_macs", "_tsaps")

    def __init__(self) -> None:
        #: What connections asked last by its octets, for each ROSCTR.
        self._asked: list[dict[bytes, Parameters]] = [{} for _ in range(USERDATA + 1)]
        self._ends: dict[bytes, Endpoint] = {}  # by address
        self._macs: dict[bytes, bytes] = {}
        self._tsaps: dict[bytes, Tsap] = {}
        self._details: dict[str, str] = {}

    def take(self, connection: Connection) -> None:
        """Take a connection that is over."""
        tcp = connection.tcp
        tcp.ends = [self._end(end) for end in tcp.ends]
        tcp.macs = self._macs.setdefault(tcp.macs, tcp.macs)
        connection.tsap_calling = self._tsap(connection.tsap_calling)
        connection.tsap_called = self._tsap(connection.tsap_called)
        ending = connection.ending
        if ending is not None:
            connection.last_request = ending.last_request = self._once(ending.last_request)
            connection.last_answer = ending.last_answer = self._once(ending.last_answer)
            connection.last_error = ending.last_error = self._once(ending.last_error)

    def word(self, finding: Finding) -> None:
        """Take a finding: what is polled is refused in the same words each time."""
        known = self._details.get(finding.detail)
        if known is not None:
            finding.detail = known
            return
        if len(self._details) >= _WORDINGS:
            self._details = {}
        self._details[finding.detail] = finding.detail

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
            return asked  # others are more than their octets say
        return self._asked[asked.rosctr].setdefault(asked.octets, asked)


class Part:
    """What an analysis is of, where it is not of everything: the expression ``where``, and how much it left out.

    ``transactions``, ``operations``, ``findings`` and ``connections`` count what was read and is not part of it, ``not_read``
    connections of which nothing was read because their ends or numbers ruled them out. ``findings_not_judged`` had no detail
    that could be looked at. ``finding_counts`` are the findings of the part, by slug.
    """

    __slots__ = (
        "connections",
        "finding_counts",
        "findings",
        "findings_not_judged",
        "not_read",
        "operations",
        "transactions",
        "where",
    )

    def __init__(self, where: str) -> None:
        self.where: str = where
        self.transactions: i64 = 0
        self.operations: i64 = 0
        self.findings: i64 = 0
        self.findings_not_judged: i64 = 0
        self.connections: i64 = 0
        self.not_read: i64 = 0
        self.finding_counts: dict[str, int] = {}

    def merge(self, other: Part) -> None:
        """Add what the same expression left out elsewhere."""
        self.transactions += other.transactions
        self.operations += other.operations
        self.findings += other.findings
        self.findings_not_judged += other.findings_not_judged
        self.connections += other.connections
        self.not_read += other.not_read
        add_counts(self.finding_counts, other.finding_counts)

    def as_dict(self) -> dict[str, object]:
        """Return it as the JSON contract has it."""
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
    """Everything `analyze` says about a run. Fill it through a pipeline, then `take` the pipeline's own counters."""

    def __init__(self) -> None:
        super().__init__()
        self.total: i64 = 0
        self.answered: i64 = 0
        self.unanswered: i64 = 0
        self.still_open: i64 = 0  # of those: the capture ended before their answer was due, so nothing failed
        self.orphans: i64 = 0
        self.unsolicited: i64 = 0
        self.with_errors: i64 = 0
        self.functions: dict[int, FunctionStatistics] = {}
        self._latest_key: i64 = -1  # of `functions`, as one is followed by another of the same most often
        self._latest: FunctionStatistics | None = None
        self.unanswered_reasons: dict[str, int] = {}
        self.connections: list[Connection] = []
        self._shared: Shared = Shared()  # what these and the findings have in common
        self.connections_not_listed: i64 = 0
        self.findings: list[Finding] = []
        self.operations: dict[str, dict[str, int]] = {}  # by kind: how many ended with which result
        self.stations: Book = Book()  # what stations state of themselves
        self.own_book = self.stations
        self.failed: list[Transaction] = []
        self._slowest: list[tuple[int, int, Transaction]] = []
        self._slow_floor: i64 = -1
        self.pipeline: Pipeline | None = None
        self.files: list[SourceFile] = []
        self.part: Part | None = None  # of a selection: what that is, and what it left out

    def __repr__(self) -> str:
        return (
            f"Analysis({len(self.connections)} connections, {self.total} transactions, {self.with_errors} with errors, "
            f"{self.unanswered} unanswered)"
        )

    def take(self, pipeline: Pipeline, files: list[SourceFile]) -> None:
        """Take over what the pipeline counted and the files that were read."""
        self.pipeline = pipeline
        self.files = files
        self._shared = Shared()

    @property
    def finding_counts(self) -> dict[str, int]:
        """How often each finding was made, by slug; empty before `take`."""
        if self.part is not None:
            return self.part.finding_counts
        return self.pipeline.finding_counts if self.pipeline is not None else {}

    @property
    def latencies(self) -> Latencies:
        """Answer times of all functions together, put together anew at each access."""
        together = Latencies()
        for statistics in self.functions.values():
            together.merge(statistics.latencies)
        return together

    def sections(self) -> dict[str, Any]:
        """Return what each protocol says that it counted (`Protocol.describe`), in their order; empty before `take`."""
        found: dict[str, Any] = {}
        if self.pipeline is not None:
            for protocol in self.pipeline.protocols:
                found.update(protocol.describe())
        return found

    def as_dict(self) -> dict[str, object]:
        """Return the analysis as the JSON contract has it (docs/json.md)."""
        from dissect.report.contract import analysis_as_dict

        return analysis_as_dict(self)

    def locate(self, frame: int) -> tuple[str, int]:
        """Return (file name, number of the packet within it) of a packet of the run; IndexError before `take`."""
        return Places(self.files, True).locate(frame)

    # ---- observer ---------------------------------------------------------------------------------------------------

    def transaction(self, transaction: Transaction) -> None:
        """Count a transaction."""
        self.total += 1
        statistics = self._statistics(transaction.parameters)
        statistics.total += 1
        outcome: i64 = transaction.outcome
        if outcome == ANSWERED:
            self.answered += 1
            statistics.answered += 1
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
            else:
                self.still_open += 1
        elif outcome == ORPHAN:
            self.orphans += 1
        elif outcome == PUSH:
            self.unsolicited += 1
        if transaction.has_errors:
            self.with_errors += 1
            statistics.errors += 1
            self._keep_failed(transaction)

    def connection_closed(self, connection: Connection) -> None:
        """Keep a connection for the list."""
        if len(self.connections) < MAX_CONNECTIONS:
            self.connections.append(connection)
            self._shared.take(connection)
        else:
            self.connections_not_listed += 1

    def operation(self, operation: Operation) -> None:
        """Count an operation by its kind and result."""
        results = self.operations.get(operation.kind)
        if results is None:
            results = self.operations[operation.kind] = {}
        results[operation.result] = results.get(operation.result, 0) + 1

    def fact(self, fact: Fact) -> None:
        """Keep what a station stated."""
        if not self.stations.filled:
            self.stations.note(fact)

    def finding(self, finding: Finding) -> None:
        """Keep a detailed finding."""
        self._shared.word(finding)
        self.findings.append(finding)

    # ---- of several runs --------------------------------------------------------------------------------------------

    def merge(self, later: Analysis) -> None:
        """Take what ``later`` found in packets behind these; its numbers go on where those of this one end.

        All but ``pipeline``, ``files`` and ``findings``, whose bounds the reporter has (`dissect.jobs.analyses`).
        """
        self.total += later.total
        self.answered += later.answered
        self.unanswered += later.unanswered
        self.still_open += later.still_open
        self.orphans += later.orphans
        self.unsolicited += later.unsolicited
        self.with_errors += later.with_errors
        for key, statistics in later.functions.items():
            if key not in self.functions:
                self.functions[key] = FunctionStatistics(statistics.name)
            self.functions[key].merge(statistics)
        add_counts(self.unanswered_reasons, later.unanswered_reasons)
        for connection in later.connections:
            self.connection_closed(connection)
        self.connections_not_listed += later.connections_not_listed
        for kind, results in later.operations.items():
            add_counts(self.operations.setdefault(kind, {}), results)
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

    def _statistics(self, parameters: Parameters) -> FunctionStatistics:
        key: i64 = parameters.function
        userdata = parameters.userdata
        if userdata is not None:
            key = 0x10000 | (userdata.group << 8) | userdata.subfunction
        elif key > 0xFF and isinstance(parameters, PlusParameters):
            key = parameters.statistics_key
        if key == self._latest_key and self._latest is not None:
            return self._latest
        found = self.functions.get(key)
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
        """Return those of the connections with most errors, then those with most PDUs, in this order."""
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
    """Return whether ``one`` had more trouble than ``other``, or as much and more PDUs; the lower number breaks a tie."""
    mine: i64 = _trouble(one)
    theirs: i64 = _trouble(other)
    if mine != theirs:
        return mine > theirs
    if one.pdus != other.pdus:
        return one.pdus > other.pdus
    return one.number < other.number


def _trouble(connection: Connection) -> i64:
    trouble: i64 = connection.missed + connection.errors
    if connection.refused:
        trouble += 1
    return trouble
