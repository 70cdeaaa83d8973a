"""Analyses of captures that stand for themselves, added up to the one that a run over all of them would make.

Parts may be made anywhere and in any order; they are added in the order of the files, which gives connections, transactions and
packets the numbers they have in one run, and lets every bound keep what comes first.
"""

from __future__ import annotations

from operator import attrgetter
from typing import Any, Final, NamedTuple

from dissect.engine.options import Options
from dissect.engine.pipeline import Pipeline
from dissect.findings.reporter import MAX_DETAILED, MAX_DETAILED_ALL
from dissect.jobs.numbers import Offsets
from dissect.jobs.sending import Sent, receive, send
from dissect.jobs.tasks import About
from dissect.report.analysis import Analysis
from dissect.source.packet import SourceFile
from dissect.transactions.naming import Naming
from dissect.wire.octets import Tally

#: What of a pipeline is added up: numbers, tallies, lists and dictionaries of numbers.
_COUNTERS: Final = (
    *[f"counters.{name}" for name in ("frames", "cut_frames", "packets")],
    *[f"counters.octets.{name}" for name in ("delivered", "framed", "skipped", "buffered", "missing", "holes")],
    *[f"counters.fragments.{name}" for name in ("used", "dropped", "invalid", "conflicts", "evicted", "expired")],
    *[f"table.{name}" for name in ("evicted", "half_open_evicted")],
    *[f"connections.{name}" for name in ("count", "left_out", "scans.forgotten")],
    *[f"exchange.{name}" for name in ("dialogue.count", "reporter.counts", "watch.operations.evicted")],
    *[f"iso.{name}" for name in ("tpdus", "tsdus")],
    "ibh.packets",
    *[f"s7.{name}" for name in ("pdus", "cut_pdus", "unpaired", "rosctrs", "functions")],
    *[f"plus.{name}" for name in ("pdus", "cut_pdus", "unpaired", "versions", "opcodes", "functions")],
    *[f"tls.{name}" for name in ("sessions", "decrypted", "opened", "shut", "other")],
)


class AnalysisPart(NamedTuple):
    """What was found in the file ``name``; ``loss`` is what is wrong with it, ``first_ns`` 0 where it has no packet."""

    name: str
    loss: str
    octets: int
    first_ns: int
    last_ns: int
    sent: Sent

    @property
    def about(self) -> About:
        """The file, for whoever takes results of all kinds."""
        return About(*self[:5])


class _Counted(NamedTuple):
    counters: list[Any]
    waiting: int
    first_ns: int
    now_ns: int
    keys: int


def part_of(analysis: Analysis, pipeline: Pipeline, files: list[SourceFile]) -> AnalysisPart:
    """Return what a run over one file found, after it has finished."""
    counted = _Counted(
        [_sendable(attrgetter(path)(pipeline)) for path in _COUNTERS],
        int(pipeline.counters.fragments.waiting),
        pipeline.first_ns,
        pipeline.now_ns,
        len(pipeline.tls.keys) + int(pipeline.tls.more_keys),
    )
    file = files[0]
    return AnalysisPart(
        file.name, file.loss, int(file.octets), pipeline.first_ns, pipeline.now_ns, send((analysis, counted, files))
    )


def _sendable(counted: Any) -> Any:
    return counted.counts() if isinstance(counted, Tally) else counted


def unread(name: str, why: str) -> AnalysisPart:
    """Return the part of a file that could not be read."""
    file = SourceFile(name, 1)
    file.damage = why
    analysis = Analysis()
    pipeline = Pipeline(analysis)
    pipeline.note_damage(f"{name}: {why}")
    pipeline.finish()
    return part_of(analysis, pipeline, [file])


class Analyses:
    """Adds parts up. ``analysis`` is that of all parts so far; ``options`` are those of the run that they are parts of."""

    def __init__(self, options: Options) -> None:
        self.analysis = Analysis()
        self._pipeline = Pipeline(Analysis(), options)
        self._naming: Naming | None = options.naming
        self._given_keys = len(self._pipeline.tls.keys)
        self._detailed: dict[str, int] = {}
        self._detailed_of: dict[tuple[str, int], int] = {}
        self.analysis.take(self._pipeline, [])

    def add(self, part: AnalysisPart) -> None:
        """Add the part of the file that comes next."""
        pipeline = self._pipeline
        packets, connections = pipeline.frames, int(pipeline.connections.count)
        found: tuple[Analysis, _Counted, list[SourceFile]] = receive(
            part.sent, Offsets(packets, connections, int(pipeline.exchange.dialogue.count))
        )
        later, counted, files = found
        self._count(counted, packets > 0)
        if self._naming is not None:
            for connection in {
                id(each): each
                for each in (
                    *later.connections,
                    *[transaction.connection for transaction in (*later.failed, *later.slowest())],
                )
            }.values():
                connection.naming = self._naming.of(connection)
        self.analysis.merge(later)
        self.analysis.findings += [
            finding for finding in later.findings if self._keeps(finding.slug, int(finding.connection))
        ]
        self.analysis.files += files

    def _keeps(self, slug: str, connection: int) -> bool:
        """Return whether a finding is one of those that a run keeps in detail (`dissect.findings.reporter`)."""
        in_all, here = self._detailed.get(slug, 0), self._detailed_of.get((slug, connection), 0)
        if in_all >= MAX_DETAILED_ALL or here >= MAX_DETAILED:
            return False
        self._detailed[slug] = in_all + 1
        self._detailed_of[slug, connection] = here + 1
        return True

    def _count(self, counted: _Counted, begun: bool) -> None:
        pipeline = self._pipeline
        for path, more in zip(_COUNTERS, counted.counters, strict=True):
            owner, _, name = path.rpartition(".")
            holder = attrgetter(owner)(pipeline)
            known = getattr(holder, name)
            if isinstance(known, dict):  # by code; not `add_counts`, which takes names
                for code, count in more.items():
                    known[code] = known.get(code, 0) + count
            elif isinstance(known, Tally):
                known.add_counts(more)
            elif isinstance(known, list):
                known[:] = [one + other for one, other in zip(known, more, strict=True)]
            else:
                setattr(holder, name, known + more)
        counters = pipeline.counters
        counters.fragments.dropped += counters.fragments.waiting  # a file ended: they will not be whole any more
        counters.fragments.waiting = counted.waiting
        if counted.first_ns or counted.now_ns:
            counters.first_ns = counters.first_ns if begun else counted.first_ns
            counters.now_ns = counted.now_ns
        pipeline.tls.more_keys += counted.keys - self._given_keys
