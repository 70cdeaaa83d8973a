"""Tables of a live run, written during the run."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

from dissect.engine.acts.act import Act
from dissect.engine.findings.reporter import Finding
from dissect.engine.pipeline import Pipeline
from dissect.engine.stations.facts import Fact
from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.operation import Operation
from dissect.engine.transactions.payloads import ScdMessage
from dissect.engine.transactions.side import Side
from dissect.engine.transactions.transaction import Transaction
from dissect.online.alerts.problems import EXPORT
from dissect.online.live.writing import WritingCompanion
from dissect.output.export.feed import TableFeed
from dissect.output.export.parquet import metadata_of
from dissect.output.export.rotating import RotatingSink
from dissect.output.export.tables import TABLES
from dissect.packets.source.live.privileges import is_root
from dissect.packets.source.live.reader import Drops
from dissect.packets.source.packet import SourceFile


class ExportCompanion(WritingCompanion):
    """Writes all tables below ``folder`` as Parquet, new files every ``every_ns`` of the capture's clock.

    ``source`` is the name of the source in the column ``file``. Rows are passed on at every tick, so that few wait in memory.
    Files get their final names when they are complete.
    """

    name = "the export"
    kind = EXPORT
    label = "export"
    unit = "row"

    def __init__(
        self,
        folder: Path,
        every_ns: int,
        source: str,
        version: str,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        super().__init__(folder, clock)
        self._sink = RotatingSink(folder, TABLES.values(), metadata_of(version, [source]))
        if is_root():
            # Done now, because the user that root becomes may be unable to read the files of Python. The kernel takes the
            # rights of all threads then.
            self._sink.prepare()
        self._feed = TableFeed(TABLES.values(), self._sink)
        self._files = [SourceFile(source, 1)]
        self._feed.begin(self._files)
        self._pipeline: Pipeline | None = None
        self._every_ns = every_ns
        self._due_ns = 0
        self._now_ns = 0
        self.wants_pdus = self._feed.wants_pdus

    @property
    def lost(self) -> tuple[int, int]:
        """How many rows are in no file."""
        return self._sink.lost, 0

    @property
    def written(self) -> tuple[int, int]:
        """How many files were completed, and their octets."""
        return self._sink.files, self._sink.octets

    def begin(self, pipeline: Pipeline) -> None:
        """Keep the pipeline, for the rows that are known only at the end; prepare to write.

        Capabilities belong to each thread. A user who has some gives them up before pyarrow starts its threads.
        """
        self._pipeline = pipeline
        self._sink.prepare()

    def tick(self, now_ns: int, drops: Drops) -> None:
        """Pass on the rows, and begin new files when it is time."""
        self._now_ns = now_ns
        self._feed.flush()
        if not self._due_ns:
            self._due_ns = now_ns + self._every_ns
        elif now_ns >= self._due_ns:
            self._due_ns = now_ns + self._every_ns
            self._sink.rotate(now_ns)
        error, self._sink.error = self._sink.error, None
        if error is not None:
            self.recover(error)
        elif self.recovery.failing and self.recovery.due:
            self._sink.probe()
            self.resumed()

    def close(self) -> None:
        """Write the rest; if that fails, the unfinished files are deleted."""
        try:
            self._feed.flush()
            if self._pipeline is not None:
                self._feed.finish(self._pipeline, self._files)
            self._sink.rotate(self._now_ns)
        finally:
            self._sink.abandon()

    def connection_opened(self, connection: Connection) -> None:
        """Pass the event on; the other methods do the same."""
        self._feed.connection_opened(connection)

    def connection_closed(self, connection: Connection) -> None:
        """Pass the event on."""
        self._feed.connection_closed(connection)

    def transaction(self, transaction: Transaction) -> None:
        """Pass the event on."""
        self._feed.transaction(transaction)

    def operation(self, operation: Operation) -> None:
        """Pass the event on."""
        self._feed.operation(operation)

    def act(self, act: Act) -> None:
        """Pass the event on."""
        self._feed.act(act)

    def fact(self, fact: Fact) -> None:
        """Pass the event on."""
        self._feed.fact(fact)

    def finding(self, finding: Finding) -> None:
        """Pass the event on."""
        self._feed.finding(finding)

    def pdu(self, frame: int, time_ns: int, side: Side, octets: bytes, cut: bool) -> None:
        """Pass the event on."""
        self._feed.pdu(frame, time_ns, side, octets, cut)

    def plus_pdu(self, frame: int, time_ns: int, side: Side, octets: bytes, cut: bool) -> None:
        """Pass the event on."""
        self._feed.plus_pdu(frame, time_ns, side, octets, cut)

    def scd(self, frame: int, time_ns: int, side: Side, found: ScdMessage) -> None:
        """Pass the event on."""
        self._feed.scd(frame, time_ns, side, found)
