"""The filter for transactions: words that must occur, `failed`, `slow`, and `c12` for connection 12.

Words are searched in the ends of the connection, the function, the addresses and the errors. Polling repeats the same few
parameter blocks, so their texts are remembered. If all requests are different, there may be too little time to search them: the
number of new ones is bounded, and transactions that were not searched are counted.
"""

from __future__ import annotations

import re
from typing import Final

from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.operation import Operation
from dissect.engine.transactions.transaction import Transaction
from dissect.meaning.report import facets
from dissect.meaning.report.certainty import mark
from dissect.meaning.report.operations import NAMES, result
from dissect.meaning.select import Where
from dissect.meaning.select.things import Message
from dissect.online.monitor.entries import What
from dissect.protocols.s7.parameters import Parameters

FAILED: Final = "failed"
SLOW: Final = "slow"

#: The texts of this many parameter blocks are remembered, and this many new ones are searched at once.
_REMEMBERED: Final = 4096
_NEW_AT_ONCE: Final = 2000
#: At most this many items of a request are searched, and this many characters of the filter used.
_ITEMS: Final = 32
_MOST_TYPED: Final = 200
_CONNECTION: Final = re.compile(r"c([0-9]{1,9})")


class Wanted:
    """A filter: the words that were typed, and an expression ``where``. Without both, everything is wanted.

    ``unsearched`` counts transactions since the filter was set that were not searched, because too many came at once.
    """

    def __init__(self, typed: str = "", slow_ns: int = 1_000_000_000, where: Where | None = None) -> None:
        self.typed = " ".join(typed[:_MOST_TYPED].split())
        self.where = where
        self.unsearched = 0
        tokens = self.typed.casefold().split()
        self.failed = FAILED in tokens
        self.slow = SLOW in tokens
        numbers = [match[1] for match in map(_CONNECTION.fullmatch, tokens) if match]
        self._connection = int(numbers[-1]) if numbers else 0
        self._words = [word for word in tokens if word not in {FAILED, SLOW} and not _CONNECTION.fullmatch(word)]
        self._slow_ns = slow_ns
        self._said: dict[Parameters, str] = {}
        self._new = 0

    @property
    def everything(self) -> bool:
        """Whether everything is selected."""
        return not self.typed and self.where is None

    @property
    def text(self) -> str:
        """The expression and the words, for the screen."""
        return " ".join([part for part in (self.where.text if self.where is not None else "", self.typed) if part])

    def begin(self) -> None:
        """Begin with another batch of events: as many new parameter blocks may be searched again."""
        self._new = 0

    def toggled(self, word: str) -> str:
        """Return the typed words with ``word`` added, or removed if it is there."""
        tokens = self.typed.split()
        there = [token for token in tokens if token.casefold() != word]
        return " ".join(there if len(there) < len(tokens) else [*tokens, word])

    def takes(self, what: What) -> bool:
        """Return whether an entry is wanted."""
        if self.where is not None and not self._selected(what, self.where):
            return False
        if not self.typed:
            return True
        connection = what[1] if isinstance(what, tuple) else what.connection
        if self._connection and connection.number != self._connection:
            return False
        if self.failed or self.slow:
            if not isinstance(what, Transaction):
                return False
            late = self.slow and is_slow(what, self._slow_ns)
            if not (late or (self.failed and what.failed)):
                return False
        return not self._words or self._occur(what, connection)

    @staticmethod
    def _selected(what: What, where: Where) -> bool:
        if isinstance(what, Transaction):
            return where.transaction(what)
        if isinstance(what, Operation):
            return where.operation(what)
        found, connection = what
        return where.message(
            Message("scd", int(found.frame), int(found.time_ns), connection, int(found.side), found.octets, scd=found)
        )

    def _occur(self, what: What, connection: Connection) -> bool:
        left = [word for word in self._words if word not in ends_of(connection)]
        if not left:
            return True
        if isinstance(what, Transaction):
            said = self._asked(what.parameters)
            if said is None:
                self.unsearched += 1
                return False
            if what.failed:
                said = f"{said} {facets.outcome(what)} {facets.gist(what)}".casefold()
            if what.doubt:
                said = f"{said} {mark(what)}".casefold()
        elif isinstance(what, Operation):
            said = f"{NAMES[what.kind]} {what.subject} {result(what)}".casefold()
        else:
            said = f"scd {what[0].binding} {what[0].subject}".casefold()
        return all([word in said for word in left])

    def _asked(self, parameters: Parameters) -> str | None:
        """Return the text of a parameter block; None if too many new ones came at once."""
        said = self._said.get(parameters)
        if said is None:
            self._new += 1
            if self._new > _NEW_AT_ONCE:
                return None
            if len(self._said) >= _REMEMBERED:
                self._said.clear()
            addresses = " ".join([item.address for item in parameters.items[:_ITEMS]])
            said = f"{parameters.function_name} {parameters.subject} {addresses}".casefold()
            self._said[parameters] = said
        return said


def is_slow(transaction: Transaction, slow_ns: int) -> bool:
    """Return whether an answer came later than ``slow_ns`` after its request."""
    latency = transaction.latency_ns
    return latency is not None and latency > slow_ns


def ends_of(connection: Connection) -> str:
    """Return both ends as they are shown."""
    return f"{connection.tcp.ends[0]} {connection.tcp.ends[1]}"
