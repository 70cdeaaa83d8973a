"""`Room`: limits the octets that all connections keep together, by evicting those that keep most.

Each buffer has its own limit; this one is for thousands of connections that all fill theirs. Nothing is counted while octets
pass: buffers cannot grow faster than the captured data, so they are added up now and then.
"""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.engine.transactions.connection import PROBING
from dissect.engine.transactions.open_requests import OpenRequests
from dissect.engine.transactions.side import Side

#: Maximum number of connections that are examined and evicted with one packet.
LOOK_AT_ONCE: Final = 64
LEAVE_AT_ONCE: Final = 4
#: Connections are grouped by the power of two of the octets that they keep, up to this power.
_SIZES: Final = 32


def held_octets(side: Side) -> int:
    """Return how many octets are kept for the connection of ``side``, both directions together.

    These are waiting segments and the latest ones that passed, unfinished TPKTs, TSDUs and PDUs, answers in parts, requests
    without an answer, answers without a request, and messages behind malformed headers.
    """
    held: i64 = 0
    for end in (side, side.peer):
        if end is not None:
            held += _held_by(end)
    aside = side.connection._aside
    if aside is not None:
        held += aside.octets
    joiner = side.connection.operations.joiner
    return held + (joiner.octets if joiner is not None else 0)


def _held_by(side: Side) -> i64:
    held: i64 = side.stream.held_size
    held += side.protocol.held(side)
    return held + _open(side.connection.open_requests[side.index])


def _open(requests: OpenRequests) -> i64:
    held: i64 = 0
    if requests.count:
        for transaction in requests.asked_after(-1):
            held += len(transaction._request_buf)
    for answer in requests.waiting():
        held += len(answer._response_buf)
    return held


def holds_something(side: Side) -> bool:
    """Return whether anything is open or unread on the connection of ``side``, so that forgetting it would lose something."""
    connection = side.connection
    if connection._state == PROBING and connection._probed:
        return True  # octets of a protocol not recognised yet
    for end in (side, side.peer):
        if end is not None:
            requests = connection.open_requests[end.index]
            if end.stream.held is not None or end.protocol.held(end) or requests.count or requests.waiting():
                return True
    return connection._aside is not None or connection.has_open_operations


class Room:
    """Finds the connections to evict, in small steps, because a live capture must not wait for a check of thousands.

    `begin` takes one side of each open connection. Each `step` then examines `LOOK_AT_ONCE` of them. If all together keep more
    than ``most`` octets, each further step returns up to `LEAVE_AT_ONCE` to evict, the fullest first (by powers of two), until
    half of ``most`` is left. ``busy`` is True until that is done; ``looks`` counts the examined connections; ``total`` is the
    sum of octets in the latest round.
    """

    def __init__(self, most: int) -> None:
        self.busy: bool = False
        self.looks: i64 = 0
        self._most: i64 = most
        self.total: i64 = 0
        self._sides: list[Side] = []
        self._at: i64 = 0
        self._by_size: list[list[Side]] = []

    def begin(self, sides: list[Side]) -> None:
        """Begin to look through ``sides``, unless the last round is still under way."""
        if not self.busy:
            self.busy = True
            self._sides = sides
            self._at = 0
            self.total = 0
            self._by_size = [[] for _ in range(_SIZES)]

    def step(self) -> list[tuple[int, Side]]:
        """Do a limited part of the work; return the connections to evict now, as (octets, side)."""
        gone: list[tuple[int, Side]] = []
        end: i64 = min(self._at + LOOK_AT_ONCE, len(self._sides))
        if self._at < end:
            for index in range(self._at, end):
                self._look(self._sides[index])
            self._at = end
            if end == len(self._sides) and self.total <= self._most:
                self._by_size = []  # nothing has to be evicted
            return gone
        while self._by_size and len(gone) < LEAVE_AT_ONCE:
            fullest = self._by_size[-1]
            if not fullest:
                self._by_size.pop()
                continue
            side = fullest.pop()
            if side.peer is None:
                continue  # it ended meanwhile
            held = held_octets(side)
            gone.append((held, side))
            self.total -= held
            if self.total <= self._most // 2:
                self._by_size = []
        if not self._by_size:
            self.busy = False
            self._sides = []
        return gone

    def _look(self, side: Side) -> None:
        self.looks += 1
        if side.peer is not None:
            held: i64 = held_octets(side)
            self.total += held
            self._by_size[min(int(held).bit_length(), _SIZES - 1)].append(side)
