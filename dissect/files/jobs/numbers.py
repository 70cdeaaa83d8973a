"""Numbers of connections and transactions in a run whose files are read by separate tasks.

These numbers count over all files, but a task does not know how many there are in the files before its own. So it counts from
marked numbers, which cannot be confused with anything in a capture; they are replaced when the rows of all tasks are joined.
"""

from __future__ import annotations

import re
import secrets
from typing import Final, NamedTuple

from dissect.engine.pipeline import Pipeline
from dissect.files.jobs.spots import Spots

#: Digits of the number itself, after those of the mark.
_DIGITS: Final = 9
_ROOM: Final = 10**_DIGITS
#: Range of marks, which have nine digits. With this, eight times a marked number fits in 64 bits, and it is not a plausible
#: time in ns.
_LEAST: Final = 2 * 10**8
_MOST: Final = 9 * 10**8


class Offsets(NamedTuple):
    """The numbers of packets, connections and transactions before a part; they are added to its numbers."""

    packets: int = 0
    connections: int = 0
    transactions: int = 0


def count_from(pipeline: Pipeline, before: Offsets) -> None:
    """Let a pipeline count connections and transactions from ``before`` on; call it before the first packet."""
    pipeline.connections.count = before.connections
    pipeline.exchange.dialogue.count = before.transactions


class Marks:
    """The random marks of one task's numbers; after `over`, also its numbers of connections and transactions."""

    def __init__(self) -> None:
        first = _LEAST + secrets.randbelow(_MOST - _LEAST)
        second = first
        while second == first:
            second = _LEAST + secrets.randbelow(_MOST - _LEAST)
        self._begins = Offsets(0, first * _ROOM, second * _ROOM)
        self.connections = 0
        self.transactions = 0

    def begin(self, pipeline: Pipeline) -> None:
        """Let a pipeline count in marked numbers."""
        count_from(pipeline, self._begins)

    def over(self, pipeline: Pipeline) -> None:
        """Note how far a pipeline has counted. Raises OverflowError if that is more than a task may have."""
        self.connections = int(pipeline.connections.count) - self._begins.connections
        self.transactions = int(pipeline.exchange.dialogue.count) - self._begins.transactions
        if max(self.connections, self.transactions) >= _ROOM:
            raise OverflowError(f"more than {_ROOM - 1} transactions")

    def spots(self, joint: bytes) -> Spots:
        """Return a `Spots`, which finds marked numbers of transaction and connection with ``joint`` between them."""
        begins = self._begins
        return Spots(b"%d" % (begins.transactions // _ROOM), b"%d" % (begins.connections // _ROOM), joint)

    def numbered(self, rows: bytes, before: Offsets, width: int = 0) -> bytes:
        """Replace marked numbers in complete rows; those of transactions are padded to at least ``width`` characters."""
        rows = _replaced(rows, self._begins.connections, self.connections, before.connections, 0)
        return _replaced(rows, self._begins.transactions, self.transactions, before.transactions, width)


def _replaced(rows: bytes, begin: int, most: int, before: int, width: int) -> bytes:
    """Replace the marked numbers 1 to ``most``, if no digit is next to them."""
    mark = b"%d" % (begin // _ROOM)

    def number(match: re.Match[bytes]) -> bytes:
        own = int(match[1])
        return (b"%d" % (own + before)).ljust(width) if 0 < own <= most else match[0]

    # The pattern begins with the mark, for a fast search; the look-behind then checks what precedes the mark.
    pattern = rb"%b(?<![0-9]{%d})([0-9]{%d})(?![0-9])" % (mark, len(mark) + 1, _DIGITS)
    return re.sub(pattern, number, rows)
