"""Rows that a command writes while captures are read, and their totals, however the captures are read."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from dissect.engine.observer import Observer
    from dissect.engine.pipeline import Pipeline
    from dissect.files.session import Run
    from dissect.meaning.report.styled import Written
    from dissect.meaning.report.words import Places
    from dissect.meaning.report.writer import Writer


class Left(NamedTuple):
    """Facts that rows do not show: connections by protocol, requested variables that were seen, and omitted pairs, by doubt."""

    protocols: Mapping[str, int] = {}
    seen: Iterable[str] = ()
    doubts: Mapping[str, int] = {}


class Rows:
    """The rows of a command: ``observer`` passes results to ``writer``.

    ``sieved``: of a selection, only its findings count for --fail-on. ``at_once``: rows are written while captures are read,
    otherwise at the end.
    """

    sieved = True

    def __init__(self, writer: Writer, observer: Observer, at_once: bool = True) -> None:
        self.writer = writer
        self.observer = observer
        self.at_once = at_once

    def begin(self, places: Places) -> None:
        """Write the beginning of the output."""
        self.writer.begin(places)

    def take(self, run: Run) -> Sequence[Written]:
        """Return the rows that are ready, once."""
        return self.writer.take()

    def left(self) -> Left:
        """Return the facts that rows do not show, after everything was read."""
        return Left()


class Counts(NamedTuple):
    """The counters of a run over one file or several.

    Connections (all, and omitted ones), transactions, packets, packets without S7 by kind, packets in unopened wrappings,
    findings by slug as they count for --fail-on, what the rows do not show, and the number of rows.
    """

    connections: int
    left_out: int
    transactions: int
    packets: int
    ignored: Mapping[str, int]
    sealed: int
    findings: Mapping[str, int]
    left: Left
    rows: int = 0


def counts_of(
    pipeline: Pipeline, selected: Mapping[str, int] | None, left: Left, began: tuple[int, int] = (0, 0)
) -> Counts:
    """Return the counters of a run that ``began`` with these numbers of connections and transactions.

    For a selection only ``selected`` findings count.
    """
    counted = dict(pipeline.finding_counts)
    return Counts(
        int(pipeline.connections.count) - began[0],
        int(pipeline.connections.left_out),
        int(pipeline.exchange.dialogue.count) - began[1],
        pipeline.frames,
        dict(pipeline.counters.packet_counts()),
        counted.get("capture.not_opened", 0),
        dict(selected) if selected is not None else counted,
        Left(dict(left.protocols), frozenset(left.seen), dict(left.doubts)),
    )


class Total:
    """`Counts`, added up."""

    def __init__(self) -> None:
        self.rows = 0
        self.packets = 0
        self.connections = 0
        self.transactions = 0
        self.left_out = 0
        self.sealed = 0
        self.ignored: Counter[str] = Counter()
        self.protocols: Counter[str] = Counter()
        self.findings: Counter[str] = Counter()
        self.seen: set[str] = set()
        self.doubts: Counter[str] = Counter()

    def add(self, part: Counts) -> None:
        """Add the counters of a run."""
        self.rows += part.rows
        self.packets += part.packets
        self.connections += part.connections
        self.transactions += part.transactions
        self.left_out += part.left_out
        self.sealed += part.sealed
        self.ignored.update(part.ignored)
        self.protocols.update(part.left.protocols)
        self.findings.update(part.findings)
        self.seen.update(part.left.seen)
        self.doubts.update(part.left.doubts)
