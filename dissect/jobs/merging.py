"""Pieces of all shares put together: rows in the order of one run, transactions with the numbers they have there.

What one run bounds for all connections together (requests that are open at once, what is kept of them, variables), several
runs bound each for itself. And each run sees of the connections that are not its own only as much as their numbers take.
Wherever that might make a difference, `DiffersError` says so, and what was merged before it is as one run has it.
"""

from __future__ import annotations

from collections.abc import Sequence
from operator import itemgetter
from typing import Final

from dissect.engine.options import MEMORY
from dissect.jobs.parts import Piece, Row
from dissect.transactions.pairing import MAX_OPEN_ALL
from dissect.variables.tracker import MAX_KEPT, MAX_VARIABLES

_STAMP: Final = itemgetter(0)


class DiffersError(Exception):
    """What follows might not be what one run finds; the text says why."""


class Numbers:
    """The numbers that transactions of shares have in one run: they count in the order in which they were begun."""

    def __init__(self, count: int) -> None:
        self._latest = 0
        self._own = [0] * count  # of each share, the latest
        self._known: list[dict[int, int]] = [{} for _ in range(count)]

    def begin(self, begun: Sequence[list[int]]) -> None:
        """Number the transactions that were begun: for each share their stamps, in the order of its own numbers."""
        stamps = [(stamp, share) for share, found in enumerate(begun) for stamp in found]
        stamps.sort()
        for _, share in stamps:
            self._latest += 1
            self._own[share] += 1
            self._known[share][self._own[share]] = self._latest

    def take(self, share: int, number: int) -> int:
        """Return the number of a transaction that is over, given that in its share."""
        return self._known[share].pop(number)


class Merger:
    """Takes pieces, one of each of ``count`` shares for the same stretch of packets, and returns their rows in order."""

    def __init__(self, count: int) -> None:
        self.numbers = Numbers(count)
        self._variables: list[set[str]] = [set() for _ in range(count)]

    def merge(self, pieces: Sequence[Piece], numbered: bool = True) -> list[Row]:
        """Return the rows of pieces with the numbers of one run (``numbered``), in its order. Raises `DiffersError`."""
        self._check(pieces)
        if not numbered:
            return sorted([row for piece in pieces for row in piece.rows], key=_STAMP)
        self.numbers.begin([piece.begun for piece in pieces])
        rows: list[Row] = []
        for share, piece in enumerate(pieces):
            take = self.numbers.take
            rows += [row._replace(number=take(share, row.number)) for row in piece.rows]
            for number in piece.unshown:
                take(share, number)
        rows.sort(key=_STAMP)
        return rows

    def _check(self, pieces: Sequence[Piece]) -> None:
        first = pieces[0]
        for piece in pieces:
            if piece.tangled or not _ascends(piece.begun) or not _ascends([row.stamp for row in piece.rows]):
                raise DiffersError("packets of several connections waited for each other")
            if (piece.opened, piece.ended, piece.left) != (first.opened, first.ended, first.left):
                raise DiffersError("a connection begins or ends where only its whole content shows it")
        for stamps in ([piece.begun for piece in pieces], [[row.stamp for row in piece.rows] for piece in pieces]):
            apart = [set(found) for found in stamps]
            if len(set().union(*apart)) != sum([len(found) for found in apart]):
                raise DiffersError("several connections gave up waiting at the same packet")
        if sum([piece.room for piece in pieces]) > MEMORY:
            raise DiffersError("connections keep so much of what is unfinished that some have to be given up")
        if sum([piece.requests for piece in pieces]) > MAX_OPEN_ALL:
            raise DiffersError("so many requests are open at once that some have to be given up")
        if sum([piece.sessions > 0 for piece in pieces]) > 1:
            raise DiffersError("several connections use TLS")
        if (
            sum([piece.variables for piece in pieces]) >= MAX_VARIABLES
            or sum([piece.kept for piece in pieces]) >= MAX_KEPT
        ):
            raise DiffersError("there are more variables than are remembered")
        for known, piece in zip(self._variables, pieces, strict=True):
            known.update(piece.plcs)
        if len(set().union(*self._variables)) != sum([len(known) for known in self._variables]):
            raise DiffersError("a station is both asked and asking")


def _ascends(stamps: list[int]) -> bool:
    return stamps == sorted(stamps)
