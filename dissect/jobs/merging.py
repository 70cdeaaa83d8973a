"""Pieces of all shares put together: rows in the order of one run, transactions with the numbers they have there.

What one run bounds for all connections together (requests that are open at once, what is kept of them, variables), several
runs bound each for itself. And each run sees of the connections that are not its own only as much as their numbers take.
Wherever that might make a difference, `DiffersError` says so, and what was merged before it is as one run has it.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import chain

from dissect.engine.options import MEMORY
from dissect.jobs.parts import Piece
from dissect.report.styled import Line
from dissect.transactions.pairing import MAX_OPEN_ALL
from dissect.variables.tracker import MAX_KEPT, MAX_VARIABLES


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
        order = _order(begun)
        numbers = [0] * len(order)
        for number, at in enumerate(order, self._latest + 1):
            numbers[at] = number
        self._latest += len(order)
        at = 0
        for share, found in enumerate(begun):
            own = self._own[share] + 1
            self._known[share].update(zip(range(own, own + len(found)), numbers[at : at + len(found)], strict=True))
            self._own[share] += len(found)
            at += len(found)

    def take(self, share: int, numbers: Sequence[int], unshown: Iterable[int]) -> list[int]:
        """Return the numbers of transactions that are over, given those in their share; ``unshown`` are over as well."""
        known = self._known[share]
        found = [known[number] for number in numbers]
        for number in {*numbers, *unshown}:
            del known[number]
        return found


def _order(stamps: Sequence[list[int]]) -> list[int]:
    """Return the places of all stamps of all shares, one share behind the other, in the order of the stamps."""
    all_ = list(chain.from_iterable(stamps))
    return sorted(range(len(all_)), key=all_.__getitem__)


class Merger:
    """Takes pieces, one of each of ``count`` shares for the same stretch of packets, and returns their lines in order.

    Numbers take at least ``width`` characters.
    """

    def __init__(self, count: int, width: int = 0, numbered: bool = True) -> None:
        self._numbers = Numbers(count)
        self._width = width
        self._numbered = numbered
        self._variables: list[set[str]] = [set() for _ in range(count)]

    def merge(self, pieces: Sequence[Piece]) -> tuple[list[str | Line], list[int]]:
        """Return the lines of pieces as one run has them, and the packet of each. Raises `DiffersError`."""
        self._check(pieces)
        if self._numbered:
            self._numbers.begin([piece.begun for piece in pieces])
        made: list[str | Line] = []
        packets: list[int] = []
        for share, piece in enumerate(pieces):
            lines = piece.lines
            texts = lines.texts
            if self._numbered:
                numbers = self._numbers.take(share, lines.numbers, piece.unshown)
                mark, width = lines.mark, self._width
                texts = [
                    text.replace(mark, str(number).ljust(width)) for text, number in zip(texts, numbers, strict=True)
                ]
            made += [Line(text, *look) for text, look in zip(texts, lines.looks, strict=True)] if lines.looks else texts
            packets += lines.packets
        order = _order([piece.lines.stamps for piece in pieces])
        return [made[at] for at in order], [packets[at] for at in order]

    def _check(self, pieces: Sequence[Piece]) -> None:
        first = pieces[0]
        for piece in pieces:
            if piece.tangled or not _ascends(piece.begun) or not _ascends(piece.lines.stamps):
                raise DiffersError("packets of several connections waited for each other")
            if (piece.opened, piece.ended, piece.left) != (first.opened, first.ended, first.left):
                raise DiffersError("a connection begins or ends where only its whole content shows it")
        for stamps in ([piece.begun for piece in pieces], [piece.lines.stamps for piece in pieces]):
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
