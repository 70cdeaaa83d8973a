"""What runs over one file each found, on its way to whoever adds it up, and what their pipelines counted, added up.

A part is made of an observer that `dissect.jobs.sending` can send, after the run that filled it (`part_of`). A `Sum` takes the
parts in the order of the files.
"""

from __future__ import annotations

from operator import attrgetter
from typing import Any, Final, NamedTuple

from dissect.engine.observer import Observer
from dissect.engine.options import Options
from dissect.engine.pipeline import Pipeline
from dissect.findings.ledger import Ledger
from dissect.jobs.numbers import Offsets
from dissect.jobs.sending import Sent, receive, send
from dissect.jobs.tasks import About
from dissect.source.packet import SourceFile
from dissect.wire.octets import Tally

#: What of a pipeline is added up: numbers, tallies, lists and dictionaries of numbers.
_COUNTERS: Final = (
    *[f"counters.{name}" for name in ("frames", "cut_frames", "packets", "bare.counts", "bare.spoken", "bare.ends")],
    *[
        f"counters.octets.{name}"
        for name in ("delivered", "framed", "skipped", "buffered", "missing", "holes", "inside")
    ],
    *[f"counters.fragments.{name}" for name in ("used", "dropped", "invalid", "conflicts", "evicted", "expired")],
    *[f"table.{name}" for name in ("evicted", "half_open_evicted")],
    *[f"connections.{name}" for name in ("count", "left_out", "scans.forgotten")],
    *[f"exchange.{name}" for name in ("dialogue.count", "watch.operations.evicted")],
    *[f"exchange.reporter.{name}" for name in ("counts", "explained", "number")],
    *[f"iso.{name}" for name in ("tpdus", "tsdus")],
    "ibh.packets",
    *[f"s7.{name}" for name in ("pdus", "behind_malformed", "cut_pdus", "unpaired", "rosctrs", "functions")],
    *[
        f"plus.{name}"
        for name in ("pdus", "behind_malformed", "cut_pdus", "unpaired", "versions", "opcodes", "functions")
    ],
    *[f"tls.{name}" for name in ("sessions", "decrypted", "opened", "shut", "other")],
)


class FilePart(NamedTuple):
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
    span: tuple[int, int]
    keys: int
    ledger: Ledger
    bare: dict[int, int]


def part_of(found: Observer, pipeline: Pipeline, files: list[SourceFile]) -> FilePart:
    """Return what a run over one file found, after it has finished."""
    counted = _Counted(
        [_sendable(attrgetter(path)(pipeline)) for path in _COUNTERS],
        int(pipeline.counters.fragments.waiting),
        pipeline.first_ns,
        pipeline.now_ns,
        (pipeline.counters.earliest_ns, pipeline.counters.latest_ns),
        len(pipeline.tls.keys) + int(pipeline.tls.more_keys),
        pipeline.exchange.reporter.ledger,
        pipeline.counters.bare.first,
    )
    file = files[0]
    return FilePart(
        file.name, file.loss, int(file.octets), pipeline.first_ns, pipeline.now_ns, send((found, counted, files))
    )


def _sendable(counted: Any) -> Any:
    return counted.counts() if isinstance(counted, Tally) else counted


def unread(name: str, why: str, found: Observer) -> FilePart:
    """Return the part of a file that could not be read; ``found`` is an observer of its kind that has found nothing."""
    file = SourceFile(name, 1)
    file.damage = why
    pipeline = Pipeline(found)
    pipeline.note_damage(f"{name}: {why}")
    pipeline.finish()
    return part_of(found, pipeline, [file])


class Sum:
    """What the pipelines of all parts so far counted, as one ``pipeline``, and the ``files`` they read.

    ``options`` are those of the run that the parts are parts of.
    """

    def __init__(self, options: Options) -> None:
        self.pipeline = Pipeline(Observer(), options)
        self.files: list[SourceFile] = []
        self._given_keys = len(self.pipeline.tls.keys)

    def take(self, part: FilePart) -> Any:
        """Add the part of the file that comes next; return what was found there, with its numbers in the whole."""
        pipeline = self.pipeline
        packets, connections = pipeline.frames, int(pipeline.connections.count)
        received: tuple[Any, _Counted, list[SourceFile]] = receive(
            part.sent, Offsets(packets, connections, int(pipeline.exchange.dialogue.count))
        )
        found, counted, files = received
        self._count(counted, packets)
        self.files += files
        return found

    def _count(self, counted: _Counted, packets: int) -> None:
        """Add what was counted in packets behind the first ``packets``."""
        pipeline = self.pipeline
        begun = packets > 0
        pipeline.counters.bare.add_first(counted.bare, packets)
        pipeline.exchange.reporter.ledger.merge(counted.ledger)
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
            if begun:
                counters.widen(counters.earliest_ns, counters.latest_ns)
            counters.widen(*counted.span)
            counters.first_ns = counters.first_ns if begun else counted.first_ns
            counters.now_ns = counted.now_ns
        pipeline.tls.more_keys += counted.keys - self._given_keys
