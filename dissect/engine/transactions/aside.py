"""Requests and answers behind malformed TPDU headers that wait on a connection, separately from ordinary ones.

See `dissect.engine.transactions.behind`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from mypy_extensions import i64

if TYPE_CHECKING:
    from dissect.engine.transactions.transaction import Transaction

#: Limits for one connection: the number of waiting messages, and their total size in octets. The oldest give way.
MAX_ASIDE: Final = 8
MAX_OCTETS: Final = 65536


class Held:
    """A request, or an answer with the open request that it matches (``request``).

    ``packet`` is the number of packets of its connection seen until then.
    """

    __slots__ = ("packet", "request", "transaction")

    def __init__(self, transaction: Transaction, request: Transaction | None, packet: i64) -> None:
        self.transaction: Transaction = transaction
        self.request: Transaction | None = request
        self.packet: i64 = packet

    @property
    def octets(self) -> i64:
        """The size in octets."""
        return self.transaction.request_size + self.transaction.response_size


class Aside:
    """The waiting requests and answers, oldest first."""

    __slots__ = ("held",)

    def __init__(self) -> None:
        self.held: list[Held] = []

    def answers(self) -> list[Transaction]:
        """Return the answers that wait."""
        return [one.transaction for one in self.held if one.request is not None]

    @property
    def octets(self) -> i64:
        """The size of all of them in octets."""
        octets: i64 = 0
        for one in self.held:
            octets += one.octets
        return octets

    def add(self, held: Held) -> list[Held]:
        """Keep a request or an answer; return those that it displaces, which may be the new one itself."""
        self.held.append(held)
        octets: i64 = self.octets
        gone: list[Held] = []
        while len(self.held) > MAX_ASIDE or octets > MAX_OCTETS:
            gone.append(self.held.pop(0))
            octets -= gone[-1].octets
        return gone
