"""The facts about a capture in the catalogue, and the run that finds them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Final

from dissect.engine.observer import Observer
from dissect.engine.pipeline import Pipeline
from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.transaction import UNANSWERED, Transaction
from dissect.files.session import Run
from dissect.packets.source.packet import CONTINUES_NS, READING_FAILED

#: The two ends of a connection: address and port of one, address and port of the other.
Pair = tuple[bytes, int, bytes, int]
#: Maximum number of pairs that are kept of a file; a file with more cannot be ruled out by addresses.
MAX_PAIRS: Final = 10_000


@dataclass
class FileFacts:
    """A capture in short.

    ``pairs`` are the ends of every connection that `analyze` numbers, each pair once; ``all_pairs`` is False if some did not
    fit. Times are nanoseconds since 1970, 0 for a file without packets; if the clock of the capture ran ``backwards``, they are
    those of the first and the last packet. ``findings`` counts by slug. ``damage`` describes the unreadable part, empty for
    none.
    """

    name: str
    size: int
    mtime_ns: int
    packets: int = 0
    first_ns: int = 0
    last_ns: int = 0
    pdus: int = 0
    connections: int = 0
    transactions: int = 0
    errors: int = 0
    unanswered: int = 0
    findings: Mapping[str, int] = field(default_factory=dict)
    pairs: frozenset[Pair] = frozenset()
    all_pairs: bool = True
    damage: str = ""

    @property
    def backwards(self) -> bool:
        """Whether packets are not in the order of their times."""
        return bool(self.findings.get("capture.time_backwards"))

    @property
    def broken_off(self) -> bool:
        """True when the rest of the file was not read although it may be sound, so that its contents are unknown."""
        return READING_FAILED in self.damage


def continued(files: Iterable[FileFacts]) -> dict[str, str]:
    """Return the files that begin soon after the end of another file, as those of a ring do, each with that file.

    These are the files whose connections `dissect.files.session.Run` would continue, if they were read in the order of time.
    """
    found: dict[str, str] = {}
    before: FileFacts | None = None
    for facts in sorted([facts for facts in files if facts.packets], key=lambda facts: (facts.first_ns, facts.name)):
        if before is not None and 0 <= facts.first_ns - before.last_ns <= CONTINUES_NS:
            found[facts.name] = before.name
        before = facts
    return found


class FactsObserver(Observer):
    """Counts transactions, and keeps the ends of connections."""

    def __init__(self) -> None:
        super().__init__()
        self.connections = 0
        self.transactions = 0
        self.errors = 0
        self.unanswered = 0
        self.pairs: set[Pair] = set()
        self.all_pairs = True

    def connection_closed(self, connection: Connection) -> None:
        """Keep the ends of a connection."""
        self.connections += 1
        first, second = connection.tcp.ends
        pair = (first.address, int(first.port), second.address, int(second.port))
        if len(self.pairs) < MAX_PAIRS:
            self.pairs.add(pair)
        elif pair not in self.pairs:
            self.all_pairs = False

    def transaction(self, transaction: Transaction) -> None:
        """Count a transaction."""
        self.transactions += 1
        if transaction.has_errors:
            self.errors += 1
        if transaction._outcome == UNANSWERED and transaction.missed:
            self.unanswered += 1


def watched(path: str) -> tuple[Run, FactsObserver]:
    """Return a run over one file, which the caller steps to its end, and its observer."""
    seen = FactsObserver()
    return Run([path], seen), seen


def filled(facts: FileFacts, run: Run, seen: FactsObserver) -> FileFacts:
    """Return the facts completed with the results of a run that was stepped to its end."""
    pipeline = run.pipeline
    return replace(
        facts,
        packets=int(pipeline.frames),
        first_ns=int(pipeline.first_ns),
        last_ns=int(pipeline.now_ns),
        pdus=sum([count for protocol in pipeline.protocols for count, _ in protocol.counted()]),
        connections=seen.connections,
        transactions=seen.transactions,
        errors=seen.errors,
        unanswered=seen.unanswered,
        findings=_all_counts(pipeline),
        pairs=frozenset(seen.pairs),
        all_pairs=seen.all_pairs,
        damage="; ".join([file.loss for file in run.files if file.loss]),
    )


def _all_counts(pipeline: Pipeline) -> dict[str, int]:
    """Return how often each finding was made, including those that other findings explain: any of them may be selected."""
    counts = dict(pipeline.finding_counts)
    for (_, slug), count in pipeline.exchange.reporter.explained.items():
        counts[slug] = counts.get(slug, 0) + count
    return counts
