"""Numbers of connections and transactions, which count over all files of a run, where each file is read by a task of its own.

A task does not know how many connections and transactions the files before its own hold. It counts from numbers that nothing in
a capture can be taken for, and whoever puts the rows of all tasks together makes the numbers of the whole of them.
"""

from __future__ import annotations

import re
import secrets
from typing import Final, NamedTuple

from dissect.engine.pipeline import Pipeline
from dissect.jobs.spots import Spots

#: Digits of the number itself behind those of a mark.
_DIGITS: Final = 9
_ROOM: Final = 10**_DIGITS
#: Marks have nine digits too. So a marked number, and eight times that, fits in 64 bits, and it is no time in nanoseconds.
_LEAST: Final = 2 * 10**8
_MOST: Final = 9 * 10**8


class Offsets(NamedTuple):
    """What is added to the numbers of packets, connections and transactions of a part: how many came before it."""

    packets: int = 0
    connections: int = 0
    transactions: int = 0


def count_from(pipeline: Pipeline, before: Offsets) -> None:
    """Have a pipeline that has seen no packet yet count connections and transactions on from others."""
    pipeline.connections.count = before.connections
    pipeline.exchange.dialogue.count = before.transactions


class Marks:
    """What the numbers of one task begin with, drawn anew for each, and how many there were of both, after `over`."""

    def __init__(self) -> None:
        first = _LEAST + secrets.randbelow(_MOST - _LEAST)
        second = first
        while second == first:
            second = _LEAST + secrets.randbelow(_MOST - _LEAST)
        self._begins = Offsets(0, first * _ROOM, second * _ROOM)
        self.connections = 0
        self.transactions = 0

    def begin(self, pipeline: Pipeline) -> None:
        """Have a pipeline count in marked numbers."""
        count_from(pipeline, self._begins)

    def over(self, pipeline: Pipeline) -> None:
        """Take how far a pipeline has counted. OverflowError beyond what a task may have."""
        self.connections = int(pipeline.connections.count) - self._begins.connections
        self.transactions = int(pipeline.exchange.dialogue.count) - self._begins.transactions
        if max(self.connections, self.transactions) >= _ROOM:
            raise OverflowError(f"more than {_ROOM - 1} transactions")

    def spots(self, joint: bytes) -> Spots:
        """Return what finds marked numbers of transaction and connection that have ``joint`` between them."""
        begins = self._begins
        return Spots(b"%d" % (begins.transactions // _ROOM), b"%d" % (begins.connections // _ROOM), joint)

    def numbered(self, rows: bytes, before: Offsets, width: int = 0) -> bytes:
        """Return whole rows with the numbers of the whole; those of transactions take at least ``width`` characters."""
        rows = _replaced(rows, self._begins.connections, self.connections, before.connections, 0)
        return _replaced(rows, self._begins.transactions, self.transactions, before.transactions, width)


def _replaced(rows: bytes, begin: int, most: int, before: int, width: int) -> bytes:
    """Replace the marked numbers 1 to ``most``, where they stand alone."""
    mark = b"%d" % (begin // _ROOM)

    def number(match: re.Match[bytes]) -> bytes:
        own = int(match[1])
        return (b"%d" % (own + before)).ljust(width) if 0 < own <= most else match[0]

    # It begins with the mark, so that this is what is looked for; what stands before it is looked at afterwards.
    pattern = rb"%b(?<![0-9]{%d})([0-9]{%d})(?![0-9])" % (mark, len(mark) + 1, _DIGITS)
    return re.sub(pattern, number, rows)
