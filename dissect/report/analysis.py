"""The fold of a whole run: what `analyze` tells. Bounded: counters are exact, lists hold what weighs most."""

from __future__ import annotations

import heapq
from typing import Any, Final

from mypy_extensions import i64

from dissect.engine.observer import Observer
from dissect.engine.pipeline import Pipeline
from dissect.findings.finding import Finding
from dissect.report.latency import Latencies
from dissect.report.places import Places
from dissect.s7.parameters import Parameters
from dissect.s7plus.parameters import PlusParameters
from dissect.source.packet import SourceFile
from dissect.transactions.connection import Connection
from dissect.transactions.operation import Operation
from dissect.transactions.transaction import ANSWERED, ORPHAN, PUSH, UNANSWERED, Transaction

#: Connections described one by one; the others are only counted.
MAX_CONNECTIONS: Final = 1000
#: Slowest and failed transactions kept for showing.
MAX_SLOWEST: Final = 10
MAX_FAILED: Final = 100


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
        self.unanswered_reasons: dict[str, int] = {}
        self.connections: list[Connection] = []
        self.connections_not_listed: i64 = 0
        self.findings: list[Finding] = []
        self.operations: dict[str, dict[str, int]] = {}  # by kind: how many ended with which result
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
        else:
            self.connections_not_listed += 1

    def operation(self, operation: Operation) -> None:
        """Count an operation by its kind and result."""
        results = self.operations.setdefault(operation.kind, {})
        results[operation.result] = results.get(operation.result, 0) + 1

    def finding(self, finding: Finding) -> None:
        """Keep a detailed finding."""
        self.findings.append(finding)

    # ---- what is kept -----------------------------------------------------------------------------------------------

    def _statistics(self, parameters: Parameters) -> FunctionStatistics:
        key: i64 = parameters.function
        userdata = parameters.userdata
        if userdata is not None:
            key = 0x10000 | (userdata.group << 8) | userdata.subfunction
        elif key > 0xFF and isinstance(parameters, PlusParameters):
            key = parameters.statistics_key
        found = self.functions.get(key)
        if found is None:
            name = parameters.function_name
            if isinstance(parameters, PlusParameters):
                name = parameters.statistics_name
            found = FunctionStatistics(name)
            self.functions[key] = found
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

    def slowest(self) -> list[Transaction]:
        """Return the slowest answered transactions, slowest first."""
        return [transaction for _, _, transaction in sorted(self._slowest, reverse=True)]
