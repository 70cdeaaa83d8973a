"""Pairing: which answer belongs to which request (reference section 5).

One table of open requests per connection and asking side, because either end asks and their references are independent and
may collide. The key is (ROSCTR, PDU reference); a reference is opaque, zero is valid, it wraps and is used again at once. So
an answered request leaves the table, and a request that finds its reference still open replaces the old one, which stays
unanswered, unless both are the same octets: then both wait and are answered in turn.

An answer that finds no request is held for a moment, because captures show packets out of order. A request that turns up
later takes it only when the answer acknowledged the request's octets (TCP ACK), so that it cannot take an older answer.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from mypy_extensions import i64

from dissect.tcp.stream import HALF_SPACE, MASK

if TYPE_CHECKING:
    from dissect.transactions.transaction import Transaction

#: Requests open at once per connection and side; the granted AmQ is 8 or less in practice.
MAX_OPEN: Final = 4096
#: Orphan answers held per connection and side, and for how long.
MAX_ORPHANS: Final = 64
ORPHAN_HOLD_NS: Final = 1_000_000_000
ORPHAN_HOLD_FRAMES: Final = 50

#: Identical requests that may wait under one reference.
MAX_REPEATS: Final = 8

#: Added to the reference of a userdata request: ROSCTR is part of the key.
USERDATA_KEY: Final = 0x10000


class Orphan:
    """An answer without request, held for a moment; ``ack`` is the TCP acknowledgement it came with, -1 for none."""

    __slots__ = ("ack", "key", "packet", "transaction")

    def __init__(self, key: i64, transaction: Transaction, ack: i64, packet: i64) -> None:
        self.key: i64 = key
        self.transaction: Transaction = transaction
        self.ack: i64 = ack
        self.packet: i64 = packet  # packets of its connection seen when it came


class OpenRequests:
    """The open requests of one asking side, and the answers to it that found none."""

    __slots__ = ("count", "orphans", "table")

    def __init__(self) -> None:
        self.table: dict[int, Transaction] = {}
        self.count: i64 = 0  # identical requests share a key, so this may be more than len(table)
        self.orphans: list[Orphan] | None = None

    def add(self, key: i64, transaction: Transaction) -> Transaction | None:
        """Open a request; return the one it replaces (and by ``earlier`` those before it), which stay unanswered."""
        old = self.table.get(key)
        self.count += 1
        if old is not None:
            depth = self._depth(old)
            if depth < MAX_REPEATS and old.request_octets == transaction.request_octets:
                transaction.earlier = old
                old = None
            else:
                self.count -= depth
        self.table[key] = transaction
        return old

    def take(self, key: i64) -> Transaction | None:
        """Return the oldest open request of ``key`` and close it, None when there is none."""
        found = self.table.get(key)
        if found is None:
            return None
        self.count -= 1
        if found.earlier is None:
            del self.table[key]
            return found
        newer = found
        oldest = found.earlier
        while oldest.earlier is not None:
            newer = oldest
            oldest = oldest.earlier
        newer.earlier = None
        return oldest

    def oldest(self) -> Transaction | None:
        """Remove and return the entry that is open longest (the table is full), None when nothing is open."""
        for key in self.table:
            return self.take(key)
        return None

    def drain(self) -> list[Transaction]:
        """Remove and return every open request, oldest first."""
        found: list[Transaction] = []
        for entry in self.table.values():
            chain: list[Transaction] = []
            link: Transaction | None = entry
            while link is not None:
                chain.append(link)
                link = link.earlier
            chain.reverse()
            found.extend(chain)
        for transaction in found:
            transaction.earlier = None
        self.table = {}
        self.count = 0
        return found

    def _depth(self, transaction: Transaction) -> i64:
        size: i64 = 1
        link = transaction.earlier
        while link is not None:
            size += 1
            link = link.earlier
        return size

    def hold_orphan(self, key: i64, answer: Transaction, ack: i64, packet: i64) -> Transaction | None:
        """Keep an answer without request for a moment; return one that had to leave for it."""
        orphans = self.orphans
        if orphans is None:
            orphans = []
            self.orphans = orphans
        orphans.append(Orphan(key, answer, ack, packet))
        if len(orphans) > MAX_ORPHANS:
            return orphans.pop(0).transaction
        return None

    def match_orphan(self, key: i64, end_seq: i64) -> Transaction | None:
        """Return the held answer that fits a request ending at sequence number ``end_seq``, and release it."""
        orphans = self.orphans
        if orphans is None:
            return None
        for index, orphan in enumerate(orphans):
            if orphan.key == key and orphan.ack >= 0 and ((orphan.ack - end_seq) & MASK) < HALF_SPACE:
                del orphans[index]
                if not orphans:
                    self.orphans = None
                return orphan.transaction
        return None

    def expired_orphans(self, time_ns: i64, packet: i64) -> list[Transaction]:
        """Remove and return the held answers whose time is over."""
        orphans = self.orphans
        gone: list[Transaction] = []
        if orphans is None:
            return gone
        while orphans and (
            time_ns - orphans[0].transaction.response_ns > ORPHAN_HOLD_NS
            or packet - orphans[0].packet > ORPHAN_HOLD_FRAMES
        ):
            gone.append(orphans.pop(0).transaction)
        if not orphans:
            self.orphans = None
        return gone
