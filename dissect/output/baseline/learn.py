"""`Learner`: learns a baseline from traffic. Memory is limited; entries that did not fit are counted."""

from __future__ import annotations

from typing import Final

from dissect.engine.acts.act import Act
from dissect.engine.acts.tables import DOWNLOAD, OUTPUTS, UPLOAD
from dissect.engine.observer import Observer
from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.transaction import BEHIND_MALFORMED, Transaction
from dissect.output.baseline.measures import AnswerTimes, RateWindow
from dissect.output.baseline.norms import Baseline, PairNorm
from dissect.output.baseline.subjects import Pair, Pairs, Subjects, moment, tsaps
from dissect.protocols.s7.tables import (
    DOWNLOAD_BLOCK,
    DOWNLOAD_ENDED,
    END_UPLOAD,
    FUNCTIONS,
    REQUEST_DOWNLOAD,
    START_UPLOAD,
)
from dissect.protocols.s7.tables import UPLOAD as UPLOAD_PIECE
from dissect.wire.text import Clock

MAX_PAIRS: Final = 1024
#: Maximum number of entries in all sets of all pairs together, and in one set.
MAX_ENTRIES: Final = 65536
MAX_SET: Final = 4096

_S: Final = 1_000_000_000
#: The functions of S7comm that are steps of a transfer.
_STEPS: Final = {
    DOWNLOAD: [FUNCTIONS.name(code) for code in (REQUEST_DOWNLOAD, DOWNLOAD_BLOCK, DOWNLOAD_ENDED)],
    UPLOAD: [FUNCTIONS.name(code) for code in (START_UPLOAD, UPLOAD_PIECE, END_UPLOAD)],
}
_MS: Final = 1_000_000


class _Learned:
    """The facts learned of one pair so far, and the times in the current capture."""

    __slots__ = (
        "acted", "acts", "answers", "connections", "first_ns", "functions", "last_ns", "ports", "reads", "second", "seconds_ns",
        "silence_ns", "ten", "top_1s", "top_10s", "transactions", "tsaps", "writes",
    )  # fmt: skip

    def __init__(self) -> None:
        self.ports: set[int] = set()
        self.tsaps: set[str] = set()
        self.functions: set[str] = set()
        self.acts: dict[str, int] = {}  # by kind: how many
        self.acted: set[str] = set()  # functions that requested them
        self.reads: set[str] = set()
        self.writes: set[str] = set()
        self.connections = 0
        self.transactions = 0
        self.answers = AnswerTimes()
        self.seconds_ns = 0
        self.silence_ns = -1
        self.top_1s = 0
        self.top_10s = 0
        self.restart()

    def restart(self) -> None:
        """Another capture begins: the time between them does not count as silence."""
        self.first_ns = -1
        self.last_ns = -1
        self.second = RateWindow(_S)
        self.ten = RateWindow(10 * _S)

    def pass_by(self, now_ns: int) -> None:
        """Count a transaction at ``now_ns``."""
        self.transactions += 1
        self.second.add(now_ns)
        self.ten.add(now_ns)
        self.top_1s = max(self.top_1s, self.second.highest)
        self.top_10s = max(self.top_10s, self.ten.highest)
        if self.last_ns < 0:
            self.first_ns = self.last_ns = now_ns
        elif now_ns > self.last_ns:
            self.silence_ns = max(self.silence_ns, now_ns - self.last_ns)
            self.seconds_ns += now_ns - self.last_ns
            self.last_ns = now_ns


class Learner(Observer):
    """Observes a run; `baseline` returns what it learned. ``left_out`` counts pairs and entries that did not fit."""

    def __init__(self) -> None:
        super().__init__()
        self.left_out = 0
        self._pairs: dict[Pair, _Learned] = {}
        self._names = Pairs()
        self._subjects = Subjects()
        self._asked: set[int] = set()  # open connections that had a transaction
        self._entries = 0
        self._latest = (0, "")  # the latest transaction, and its function
        self._begin_ns = -1
        self._end_ns = -1

    def restart(self) -> None:
        """Another capture begins, at another time."""
        for learned in self._pairs.values():
            learned.restart()

    def transaction(self, transaction: Transaction) -> None:
        """Learn from a transaction with any outcome; messages behind a malformed header are not normal."""
        if transaction._outcome == BEHIND_MALFORMED:
            return
        connection = transaction.connection
        learned = self._learned(connection)
        if learned is None:
            return
        if int(connection.number) not in self._asked:
            self._asked.add(int(connection.number))
            self._learn_ends(learned, connection)  # now, as alerts do; they may change later
        subject = self._subjects.of(transaction)
        self._keep(learned.functions, (subject.function,))
        self._latest = (int(transaction.number), subject.function)
        self._keep(learned.reads, subject.reads)
        self._keep(learned.writes, subject.writes)
        now_ns = moment(transaction)
        self._begin_ns = now_ns if self._begin_ns < 0 else min(self._begin_ns, now_ns)
        self._end_ns = max(self._end_ns, now_ns)
        learned.pass_by(now_ns)
        latency_ns = transaction.latency_ns
        if latency_ns is not None:  # the answer time of a pair that is only likely is unknown
            learned.answers.add(latency_ns)

    def act(self, act: Act) -> None:
        """Note an act, which is not normal only because it was captured."""
        learned = self._learned(act.connection)
        if learned is None:
            return
        learned.acts[act.kind] = learned.acts.get(act.kind, 0) + 1
        if act.connection.plus is not None or act.kind == OUTPUTS:
            return  # their functions serve other purposes, too
        if act.operation is not None and act.row.lasts:
            learned.acted.update(_STEPS[act.kind])
        elif act.transactions[:1] == [self._latest[0]]:  # it comes right after its transaction
            learned.acted.add(self._latest[1])

    def connection_closed(self, connection: Connection) -> None:
        """Learn the port and the TSAPs of a connection."""
        self._asked.discard(int(connection.number))
        learned = self._learned(connection)
        if learned is None:
            return
        learned.connections += 1
        self._learn_ends(learned, connection)

    def baseline(self, captures: tuple[str, ...] = ()) -> Baseline:
        """Return the result of learning so far."""
        clock = Clock()
        baseline = Baseline({pair: _norm(pair, learned) for pair, learned in self._pairs.items()}, captures)
        if self._begin_ns >= 0:
            baseline.begin = clock.iso(self._begin_ns)
            baseline.end = clock.iso(self._end_ns)
        baseline.left_out = self.left_out
        return baseline

    def _learn_ends(self, learned: _Learned, connection: Connection) -> None:
        port = int(connection.server.port)
        if port not in learned.ports and self._fits(len(learned.ports)):
            learned.ports.add(port)
        named = tsaps(connection)
        if named:
            self._keep(learned.tsaps, (named,))

    def _learned(self, connection: Connection) -> _Learned | None:
        pair = self._names.of(connection)
        learned = self._pairs.get(pair)
        if learned is None:
            if len(self._pairs) >= MAX_PAIRS:
                self.left_out += 1
                return None
            learned = self._pairs[pair] = _Learned()
        return learned

    def _keep(self, known: set[str], names: tuple[str, ...]) -> None:
        for name in names:
            if name not in known:
                if self._fits(len(known)):
                    known.add(name)

    def _fits(self, size: int) -> bool:
        if size >= MAX_SET or self._entries >= MAX_ENTRIES:
            self.left_out += 1
            return False
        self._entries += 1
        return True


def _norm(pair: Pair, learned: _Learned) -> PairNorm:
    norm = PairNorm(*pair)
    norm.server_ports = frozenset(learned.ports)
    norm.tsaps = frozenset(learned.tsaps)
    norm.functions = frozenset(learned.functions - learned.acted)
    norm.functions_seen = frozenset(learned.functions & learned.acted)
    norm.acts = frozenset()
    norm.acts_seen = dict(learned.acts)
    norm.reads = frozenset(learned.reads)
    norm.writes = frozenset(learned.writes)
    norm.connections = learned.connections
    norm.transactions = learned.transactions
    norm.seconds = learned.seconds_ns / _S
    norm.highest_1s = learned.top_1s or None
    norm.highest_10s = learned.top_10s or None
    answers = learned.answers
    if answers.count:
        norm.median_ms = (answers.quantile(0.5) or 0) / _MS
        norm.p99_ms = (answers.quantile(0.99) or 0) / _MS
        norm.longest_ms = answers.longest / _MS
    # Rounded up to the precision of the file, so that the same silence does not count as longer.
    norm.longest_silence = -(-learned.silence_ns // 1000) / 1e6 if learned.silence_ns >= 0 else None
    return norm
