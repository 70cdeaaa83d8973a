"""What connections keep of packets that passed, and which of them have to leave when that is too much in sum.

Each buffer has a bound of its own; thousands of connections that fill theirs are bounded here. Nothing is counted while
octets pass: a buffer cannot grow by more than what was captured, so that it is enough to add up now and then.
"""

from __future__ import annotations

from collections.abc import Iterable

from mypy_extensions import i64

from dissect.transactions.pairing import OpenRequests
from dissect.transactions.table import Side


def held_octets(side: Side) -> int:
    """Return the octets that are kept for the connection of ``side``, both directions together.

    Segments that wait for those before them and the latest ones that passed, unfinished packets, TSDUs and PDUs, answers in
    parts, requests without answer and answers without request.
    """
    held: i64 = 0
    for end in (side, side.peer):
        if end is not None:
            held += _held_by(end)
    joiner = side.connection.operations.joiner
    return held + (joiner.octets if joiner is not None else 0)


def _held_by(side: Side) -> i64:
    stream = side.stream
    held: i64 = stream.held_octets + len(stream.last) + len(stream.before)
    held += side.framer.buffered
    if side.ibh is not None:
        held += side.ibh.buffered
    if side.assembler.parts is not None:
        held += len(side.assembler.parts)
    if side.plus is not None and side.plus.parts is not None:
        held += len(side.plus.parts)
    if side.backlog is not None:
        held += len(side.backlog.octets)
    return held + _open(side.connection.open_requests[side.index])


def _open(requests: OpenRequests) -> i64:
    held: i64 = 0
    if requests.count:
        for transaction in requests.asked_after(-1):
            held += len(transaction.request_buf)
    if requests.orphans is not None:
        for orphan in requests.orphans:
            held += len(orphan.transaction.response_buf)
    return held


def over_limit(sides: Iterable[Side], most: int) -> list[tuple[int, Side]]:
    """Return those that hold most of more than ``most`` octets, as (octets, side), until half of ``most`` is left; else none.

    ``sides`` is one side of each connection.
    """
    holders = [(held_octets(side), side) for side in sides]
    total = sum([held for held, _ in holders])
    gone: list[tuple[int, Side]] = []
    if total <= most:
        return gone
    holders.sort(key=_first, reverse=True)
    for held, side in holders:
        if total <= most // 2:
            break
        gone.append((held, side))
        total -= held
    return gone


def _first(holder: tuple[int, Side]) -> int:
    return holder[0]
