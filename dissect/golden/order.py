"""The order of a connection's transactions: by packet, and on each side as its requests stood in the stream.

A request may have been captured whole while octets before it were still missing: its packet then comes before that of a
request which its side sent earlier. A session tells what was sent in which order, so the earlier one stands first.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Protocol


class Placed(Protocol):
    """What can be put in order: ``place`` is (packet, number), ``has_request`` whether the request was captured."""

    asked_by: int
    has_request: bool
    place: tuple[int, int]


def settle_places(placed: Iterable[Placed]) -> None:
    """Move places so that no request stands before one that its side sent earlier; numbers are given as they are sent."""
    latest: dict[int, int] = {}
    for one in sorted(placed, key=lambda one: one.place[1]):
        if one.has_request:
            packet = max(one.place[0], latest.get(one.asked_by, 0))
            latest[one.asked_by] = packet
            one.place = (packet, one.place[1])
