"""`BaselineComparison`: the differences of a run from a baseline, for programs; alerts have their own rules.

See `dissect.online.alerts`.
"""

from __future__ import annotations

from typing import Final

from dissect.engine.acts.act import Act
from dissect.engine.observer import Observer
from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.transaction import BEHIND_MALFORMED, Transaction
from dissect.output.baseline.norms import Baseline
from dissect.output.baseline.subjects import Pairs
from dissect.output.baseline.watch import BaselineWatch, Deviation

#: Maximum number of different deviations that are kept.
MOST: Final = 10_000


class BaselineComparison(Observer):
    """Observes a run and compares it with a baseline.

    ``found`` are the deviations in the order in which they were first seen, each once; ``more`` counts those beyond the bound.
    """

    def __init__(self, baseline: Baseline) -> None:
        super().__init__()
        self.wants_facts = False
        self.more = 0
        self._found: dict[str, Deviation] = {}
        self._watch = BaselineWatch(baseline)
        self._pairs = Pairs()
        self._judged: set[int] = set()  # open connections that were compared

    @property
    def found(self) -> list[Deviation]:
        """The deviations."""
        return list(self._found.values())

    def transaction(self, transaction: Transaction) -> None:
        """Compare a transaction; with the first one, its connection, whose client is known by then."""
        if transaction._outcome == BEHIND_MALFORMED:
            return
        connection = transaction.connection
        if int(connection.number) not in self._judged:
            self._judged.add(int(connection.number))
            self._connection(connection)
        for deviation in self._watch.transaction(self._pairs.of(connection), transaction):
            self._keep(deviation)

    def act(self, act: Act) -> None:
        """Compare an act."""
        for deviation in self._watch.act(self._pairs.of(act.connection), act):
            self._keep(deviation)

    def connection_closed(self, connection: Connection) -> None:
        """Compare a connection without transactions."""
        if int(connection.number) not in self._judged:
            self._connection(connection)
        self._judged.discard(int(connection.number))

    def _connection(self, connection: Connection) -> None:
        for deviation in self._watch.connection(self._pairs.of(connection), connection):
            self._keep(deviation)

    def _keep(self, deviation: Deviation) -> None:
        if deviation.text in self._found:
            return
        if len(self._found) < MOST:
            self._found[deviation.text] = deviation
        else:
            self.more += 1
