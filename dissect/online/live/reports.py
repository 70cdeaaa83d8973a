"""HTML reports of a live run, one for each period."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from dissect.engine.acts.act import Act
from dissect.engine.findings.ledger import Ledger
from dissect.engine.findings.reporter import Finding
from dissect.engine.pipeline import Pipeline
from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.operation import Operation
from dissect.engine.transactions.transaction import Transaction
from dissect.meaning.report.analysis import Part
from dissect.online.alerts.problems import REPORT
from dissect.online.live.writing import WritingCompanion
from dissect.output.page.gathered import Gathered, span_of
from dissect.output.page.rendering import Side, prepare, render
from dissect.output.page.rows import Rows, time_of
from dissect.packets.source.live.reader import Drops
from dissect.wire.config.saving import save
from dissect.wire.text import Clock

#: At most this many pages wait because they cannot be written.
_MAX_WAITING: Final = 8


class ReportCompanion(WritingCompanion):
    """Writes a page for each period of ``every_ns`` into ``directory``, and one for the last period at the end.

    Periods begin at multiples of their length since 1970, so that a period of an hour begins on the hour. A page is named by
    the beginning of its period in UTC; an existing page is kept, and the new one gets a number. ``name`` is the name of the
    source, ``version`` that of this package. Pages that cannot be written wait, `_MAX_WAITING` of them; the oldest are lost.
    """

    name = "the report"
    kind = REPORT
    label = "report"
    unit = "page"

    def __init__(
        self, directory: str, every_ns: int, name: str, version: str, clock: Clock, hosts: Mapping[str, str]
    ) -> None:
        super().__init__(Path(directory))
        prepare()
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
        self._waiting: deque[tuple[str, bytes]] = (
            deque()
        )  # pages that could not be written, by the name of their period
        self._lost = 0
        self._pages = 0
        self._octets = 0

    @property
    def lost(self) -> tuple[int, int]:
        """How many pages were not written."""
        return self._lost, 0

    @property
    def written(self) -> tuple[int, int]:
        """How many pages were written, and their octets."""
        return self._pages, self._octets

    # ---- what is gathered -------------------------------------------------------------------------------------------

    def begin(self, pipeline: Pipeline) -> None:
        """Take the pipeline; its counters are not reset between periods."""
        self._pipeline = pipeline
        pipeline.exchange.reporter.period = Ledger()

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
        if self._waiting and self.recovery.due:
            self._save()
        if self.recovery.failing and not self._waiting:
            self.resumed()

    def _turn(self, now_ns: int) -> None:
        period = now_ns // self._every_ns
        if self._period < 0:
            self._period = period
        elif period > self._period:
            self._write()
            self._period = period

    def name_hosts(self, hosts: Mapping[str, str]) -> None:
        """Call hosts by these names, from the next page on."""
        self._hosts = hosts

    def close(self) -> None:
        """Write the page of the last period."""
        if self._pipeline is not None and self._pipeline.frames:
            if self._period < 0:
                self._period = int(self._pipeline.now_ns) // self._every_ns
            self._write(at_end=True)

    def _fresh(self) -> Gathered:
        # No files, because a live run has none from which a command in the report could read packets.
        return Gathered(Rows([], self._clock, self._hosts))

    def _write(self, at_end: bool = False) -> None:
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
        reporter = self._pipeline.exchange.reporter
        part.ledger, reporter.period = reporter.period or Ledger(), Ledger()
        self._before = counts
        gathered.analysis.part = part
        page = render([Side(gathered, [self._name])], self._version)
        moment = self._clock.iso(begin_ns)[:19].replace("-", "").replace(":", "")
        self._waiting.append((moment, page.encode()))
        if len(self._waiting) > _MAX_WAITING:
            self._waiting.popleft()
            self._lost += 1
        if at_end or self.recovery.due:
            self._save(at_end)

    def _save(self, at_end: bool = False) -> None:
        """Write the waiting pages, the oldest first; at the end pages that cannot be written are lost."""
        while self._waiting:
            moment, page = self._waiting[0]
            target = self._free(moment)
            try:
                save(target, page)
            except OSError as error:
                if at_end:
                    self._lost += len(self._waiting)
                    self._waiting.clear()
                self.recover(error)
                return
            self._waiting.popleft()
            self._pages += 1
            self._octets += len(page)

    def _free(self, moment: str) -> Path:
        """Return a name that is not yet used by a file."""
        target = self._directory / f"s7dissect-{moment}Z.html"
        number = 1
        while target.exists():
            number += 1
            target = self._directory / f"s7dissect-{moment}Z-{number}.html"
        return target
