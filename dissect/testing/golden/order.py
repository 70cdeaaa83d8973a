"""The order of a connection's transactions: by packet, and on each side by the stream positions of its requests.

A request may be captured completely while earlier octets are still missing. Its packet then precedes that of a request which
its side sent earlier. A session shows the order of sending, so the earlier request comes first.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Protocol


class Placed(Protocol):
    """An object that can be ordered: ``place`` is (packet, number), ``has_request`` tells whether the request was captured."""

    asked_by: int
    has_request: bool
    place: tuple[int, int]


def settle_places(placed: Iterable[Placed]) -> None:
    """Change places so that each request comes after those that its side sent earlier; numbers are in the order of sending."""
    latest: dict[int, int] = {}
    for one in sorted(placed, key=lambda one: one.place[1]):
        if one.has_request:
            packet = max(one.place[0], latest.get(one.asked_by, 0))
            latest[one.asked_by] = packet
            one.place = (packet, one.place[1])
