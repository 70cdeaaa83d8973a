"""HTML reports of a live run, one for each period."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from dissect.acts.act import Act
from dissect.engine.pipeline import Pipeline
from dissect.findings.reporter import Finding
from dissect.live.run import Companion
from dissect.page.gathered import Gathered, span_of
from dissect.page.rendering import Side, prepare, render
from dissect.page.rows import Rows, time_of
from dissect.report.analysis import Part
from dissect.source.live.reader import Drops
from dissect.transactions.connection import Connection
from dissect.transactions.operation import Operation
from dissect.transactions.transaction import Transaction
from dissect.wire.saving import save
from dissect.wire.text import Clock


class ReportCompanion(Companion):
    """Writes a page for each period of ``every_ns`` into ``directory``, and one for the last period at the end.

    Periods begin at multiples of their length since 1970, so that a period of an hour begins on the hour. A page is named by
    the beginning of its period in UTC; an existing page is kept, and the new one gets a number. ``name`` is the name of the
    source, ``version`` that of this package.
    """

    name = "writing reports"

    def __init__(
        self, directory: str, every_ns: int, name: str, version: str, clock: Clock, hosts: Mapping[str, str]
    ) -> None:
        super().__init__()
        prepare()
        self.written: list[Path] = []
        self._directory = Path(directory)
        self._every_ns = every_ns
        self._name = name
        self._version = version
        self._clock = clock
        self._hosts = hosts
        self._pipeline: Pipeline | None = None
        self._period = -1
        self._before: dict[str, int] = {}
        self._gathered = self._fresh()

    # ---- what is gathered -------------------------------------------------------------------------------------------

    def begin(self, pipeline: Pipeline) -> None:
        """Take the pipeline; its counters are not reset between periods."""
        self._pipeline = pipeline

    def connection_opened(self, connection: Connection) -> None:
        """Take a connection."""
        self._gathered.connection_opened(connection)

    def connection_closed(self, connection: Connection) -> None:
        """Take a connection that is over."""
        self._gathered.connection_closed(connection)

    def transaction(self, transaction: Transaction) -> None:
        """Take a transaction, which may begin a new period."""
        self._turn(time_of(transaction))
        self._gathered.transaction(transaction)

    def operation(self, operation: Operation) -> None:
        """Take an operation."""
        self._gathered.operation(operation)

    def act(self, act: Act) -> None:
        """Take an act."""
        self._gathered.act(act)

    def finding(self, finding: Finding) -> None:
        """Take a finding."""
        self._turn(int(finding.time_ns))
        self._gathered.finding(finding)

    # ---- when time passes -------------------------------------------------------------------------------------------

    def tick(self, now_ns: int, drops: Drops) -> None:
        """Write the page of a period that is over."""
        if self._pipeline is not None and self._pipeline.frames:
            self._turn(now_ns)

    def _turn(self, now_ns: int) -> None:
        period = now_ns // self._every_ns
        if self._period < 0:
            self._period = period
        elif period > self._period:
            self._write()
            self._period = period

    def close(self) -> None:
        """Write the page of the last period."""
        if self._pipeline is not None and self._pipeline.frames:
            if self._period < 0:
                self._period = int(self._pipeline.now_ns) // self._every_ns
            self._write()

    def _fresh(self) -> Gathered:
        # No files: there is none from which a command in the report could read packets.
        return Gathered(Rows([], self._clock, self._hosts))

    def _write(self) -> None:
        assert self._pipeline is not None
        gathered, self._gathered = self._gathered, self._fresh()
        begin_ns, end_ns = self._period * self._every_ns, (self._period + 1) * self._every_ns
        gathered.list_open()
        first_ns, now_ns = span_of(self._pipeline) or (begin_ns, begin_ns)
        gathered.take(self._pipeline, [], (max(begin_ns, first_ns), max(begin_ns, min(end_ns, now_ns))))
        counts = dict(self._pipeline.finding_counts)
        part = Part(f"time in {{{self._clock.iso(begin_ns)[:19]}..{self._clock.iso(end_ns)[:19]}}}")
        part.finding_counts = {
            slug: count - self._before.get(slug, 0)
            for slug, count in counts.items()
            if count > self._before.get(slug, 0)
        }
        self._before = counts
        gathered.analysis.part = part
        page = render([Side(gathered, [self._name])], self._version)
        target = self._free(self._clock.iso(begin_ns)[:19].replace("-", "").replace(":", ""))
        save(target, page.encode())
        self.written.append(target)
        del self.written[:-1]  # only the latest is needed, and a run may go on for months

    def _free(self, moment: str) -> Path:
        """Return a name that no file has."""
        target = self._directory / f"s7dissect-{moment}Z.html"
        number = 1
        while target.exists():
            number += 1
            target = self._directory / f"s7dissect-{moment}Z-{number}.html"
        return target
