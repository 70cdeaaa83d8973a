"""The counts of a pipeline as plain values: to add them up over several runs, and to copy or pickle a pipeline."""

from __future__ import annotations

from operator import attrgetter
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from dissect.engine.findings.ledger import Ledger
from dissect.engine.observer import Observer
from dissect.engine.transactions.protocol import Protocol
from dissect.wire.octets import Tally

if TYPE_CHECKING:
    from dissect.engine.pipeline import Pipeline

#: The counters of a pipeline that are added up: numbers, tallies, lists and dictionaries of numbers.
_COUNTERS: Final = (
    *[f"counters.{name}" for name in ("frames", "cut_frames", "packets", "bare.counts", "bare.spoken", "bare.ends")],
    *[
        f"counters.octets.{name}"
        for name in ("delivered", "framed", "skipped", "buffered", "missing", "holes", "inside")
    ],
    *[f"counters.fragments.{name}" for name in ("used", "dropped", "invalid", "conflicts", "evicted", "expired")],
    *[f"table.{name}" for name in ("evicted", "half_open_evicted")],
    *[f"connections.{name}" for name in ("count", "left_out", "forgotten", "twice", "scans.forgotten")],
    *[f"exchange.{name}" for name in ("dialogue.count", "watch.operations.evicted")],
    *[f"exchange.reporter.{name}" for name in ("counts", "explained", "number")],
    *[f"iso.{name}" for name in ("tpdus", "tsdus")],
    *[f"ibh.{name}" for name in ("packets",)],
    *[f"s7.{name}" for name in ("pdus", "behind_malformed", "cut_pdus", "unpaired", "rosctrs", "functions")],
    *[
        f"plus.{name}"
        for name in ("pdus", "behind_malformed", "cut_pdus", "unpaired", "versions", "opcodes", "_functions", "_others")
    ],
    *[f"tls.{name}" for name in ("sessions", "decrypted", "opened", "shut", "other")],
)


class Counted(NamedTuple):
    """The counts of a pipeline; ``keys`` is its number of TLS session keys, ``bare`` has the first packet of each kind."""

    counters: list[Any]
    waiting: int
    first_ns: int
    now_ns: int
    span: tuple[int, int]
    keys: int
    ledger: Ledger
    bare: dict[int, int]


def counted_by(pipeline: Pipeline) -> Counted:
    """Return the counts of a pipeline so far."""
    return Counted(
        [_plain(attrgetter(path)(pipeline)) for path in _COUNTERS],
        int(pipeline.counters.fragments.waiting),
        pipeline.first_ns,
        pipeline.now_ns,
        (pipeline.counters.earliest_ns, pipeline.counters.latest_ns),
        len(pipeline.tls.keys) + int(pipeline.tls.more_keys),
        pipeline.exchange.reporter.ledger,
        pipeline.counters.bare.first,
    )


def _plain(counted: Any) -> Any:
    return counted.counts() if isinstance(counted, Tally) else counted


def add_counted(pipeline: Pipeline, counted: Counted, packets: int, given_keys: int) -> None:
    """Add the counts of packets after the first ``packets``; ``given_keys`` are the keys that each run was given."""
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
    counters.fragments.dropped += counters.fragments.waiting  # a file ended, so they will never be complete
    counters.fragments.waiting = counted.waiting
    if counted.first_ns or counted.now_ns:
        if begun:
            counters.widen(counters.earliest_ns, counters.latest_ns)
        counters.widen(*counted.span)
        counters.first_ns = counters.first_ns if begun else counted.first_ns
        counters.now_ns = counted.now_ns
    pipeline.tls.more_keys += counted.keys - given_keys


class Section(Protocol):
    """The section of a protocol in reports, for a pipeline whose protocol objects no longer exist."""

    def __init__(self, section: dict[str, object], counted: list[tuple[int, str]]) -> None:
        self._section = section
        self._counted = counted

    def describe(self) -> dict[str, object]:
        """Return the section as it was."""
        return self._section

    def counted(self) -> list[tuple[int, str]]:
        """Return the number of messages as it was."""
        return self._counted


def counts_of(pipeline: Pipeline) -> tuple[Any, ...]:
    """Return the form of a pipeline for `copy` and `pickle`: a copy has its counts, but takes no packets."""
    ours = (pipeline.iso, pipeline.ibh, pipeline.s7, pipeline.plus, pipeline.tls)
    more = [(one.describe(), one.counted()) for one in pipeline.protocols if not any(one is each for each in ours)]
    return _with_counts, (counted_by(pipeline), more)


def _with_counts(counted: Counted, more: list[tuple[dict[str, object], list[tuple[int, str]]]]) -> Pipeline:
    from dissect.engine.pipeline import Pipeline

    made = Pipeline(Observer())
    add_counted(made, counted, 0, 0)
    made.protocols += [Section(section, messages) for section, messages in more]
    return made
