"""Pairing: which answer belongs to which request (reference section 5).

One table of open requests per connection and asking side, because either end asks and their references are independent and
may collide. The key is (ROSCTR, PDU reference); a reference is opaque, zero is valid, it wraps and is used again at once. So
an answered request leaves the table, and a request that finds its reference still open replaces the old one, which stays
unanswered. Only when both are the same octets and one came shortly after the other do both wait and are answered in turn; a
client that asks the same again after a second has given the first one up, and if both waited, every later answer of a
client that never changes its reference would meet the request before its own.

An answer that finds no request is held for a moment, because captures show packets out of order. A request that turns up
later takes it only when the answer acknowledged the request's octets (TCP ACK), so that it cannot take an older answer.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from mypy_extensions import i64

from dissect.s7.tables import USERDATA
from dissect.s7plus.parameters import PLUS
from dissect.tcp.stream import HALF_SPACE, MASK

if TYPE_CHECKING:
    from dissect.transactions.transaction import Transaction

#: Requests open at once per connection and side; the granted AmQ is 8 or less in practice.
MAX_OPEN: Final = 4096
#: Requests open at once on all connections; when there are more, each side keeps only its latest `FEW_OPEN`.
MAX_OPEN_ALL: Final = 65536
FEW_OPEN: Final = 16
#: Orphan answers held per connection and side, and for how long.
MAX_ORPHANS: Final = 64
ORPHAN_HOLD_NS: Final = 1_000_000_000
ORPHAN_HOLD_FRAMES: Final = 50

#: Identical requests that may wait under one reference, and how long after the one before them they may come.
MAX_REPEATS: Final = 8
REPEAT_NS: Final = 1_000_000_000
#: Clients wait two seconds at least before they give a request up (reference 5.6).
GIVEN_UP_NS: Final = 2_000_000_000

#: Requests given up from the front of a table before it is made anew.
_FRESH: Final = 1024

#: Added to the reference of a userdata request: ROSCTR is part of the key.
USERDATA_KEY: Final = 0x10000
#: Added to the sequence number of an S7comm-plus request.
PLUS_KEY: Final = 0x20000
#: Added to what an SCD request is known by: its transaction number, or index and sub-index, of 25 bits together.
SCD_KEY: Final = 0x40000000


def key_of(rosctr: i64, pdu_ref: i64) -> i64:
    """Return the key of a request, or of the request that an answer belongs to."""
    if rosctr < USERDATA:
        return pdu_ref
    if rosctr == USERDATA:
        return pdu_ref | USERDATA_KEY
    return pdu_ref | (PLUS_KEY if rosctr == PLUS else SCD_KEY)


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

    __slots__ = ("_given_up", "count", "orphans", "table")

    def __init__(self) -> None:
        self.table: dict[int, Transaction] = {}
        self._given_up: i64 = 0
        self.count: i64 = 0  # identical requests share a key, so this may be more than len(table)
        self.orphans: list[Orphan] | None = None

    def add(self, key: i64, transaction: Transaction) -> None:
        """Open a request under a key that `table` does not hold."""
        self.count += 1
        self.table[key] = transaction

    def add_again(self, key: i64, transaction: Transaction, old: Transaction) -> Transaction | None:
        """Open a request whose key ``old`` holds; return what it replaces (and by ``earlier`` those before it)."""
        depth = self._depth(old)
        self.count += 1
        if (
            depth < MAX_REPEATS
            and transaction.request_ns - old.request_ns <= REPEAT_NS
            and old.request_octets == transaction.request_octets
        ):
            transaction.earlier = old
            transaction.superseded = old.superseded  # what waits behind an entry of the table hangs on that entry
            old.superseded = None
            self.table[key] = transaction
            return None
        self.count -= depth
        del self.table[key]  # so that the new one goes to the end: the table stays in the order of asking
        self.table[key] = transaction
        return old

    def supersede(self, key: i64, transaction: Transaction, old: Transaction) -> bool:
        """Open a request whose key ``old`` holds, and keep ``old`` behind it; False when too many wait there already.

        For a request that acknowledges octets the capture has not shown yet: the answer to ``old`` is among them.
        """
        depth: i64 = 1
        link = old.superseded
        while link is not None:
            depth += 1
            link = link.superseded
        if depth >= MAX_REPEATS:
            return False
        self.count += 1
        transaction.superseded = old
        del self.table[key]  # so that the new one goes to the end: the table stays in the order of asking
        self.table[key] = transaction
        return True

    def take_superseded(self, found: Transaction, end_seq: i64) -> Transaction | None:
        """Close and return the request kept behind ``found`` that an answer ending at ``end_seq`` belongs to, if any."""
        newer = found
        older = found.superseded
        while older is not None and older.acknowledged(end_seq):
            newer = older
            older = older.superseded
        if older is not None:
            newer.superseded = older.superseded
            older.superseded = None
            self.count -= 1
        return older

    def drop_superseded(self, found: Transaction) -> list[Transaction]:
        """Close and return the requests kept behind ``found``, oldest first; no answers to them will come."""
        dropped: list[Transaction] = []
        link = found.superseded
        found.superseded = None
        while link is not None:
            behind = link.superseded
            link.superseded = None
            identical: Transaction | None = link
            while identical is not None:
                dropped.append(identical)
                self.count -= 1
                before = identical.earlier
                identical.earlier = None
                identical = before
            link = behind
        dropped.reverse()
        return dropped

    def take(self, key: i64, found: Transaction) -> Transaction:
        """Close the oldest open request of ``key`` and return it; ``found`` is what `table` holds there."""
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

    def lose(self, found: Transaction, frame: i64, hole_frame: i64) -> Transaction | None:
        """Remove those of several identical requests whose answers are in a gap; return them, linked by ``earlier``.

        The answer that came, in packet ``frame``, is taken for that of the latest request captured before it. What was
        asked before that one, and before the hole was given up at ``hole_frame``, will not be answered.
        """
        keep = found
        while keep.earlier is not None and keep.request_frame > frame:
            keep = keep.earlier
        while keep.earlier is not None and keep.earlier.request_frame > hole_frame:
            keep = keep.earlier
        lost = keep.earlier
        if lost is not None:
            keep.earlier = None
            self.count -= self._depth(lost)
        return lost

    def oldest(self) -> Transaction | None:
        """Remove and return the request that is open longest (the table is full), None when nothing is open."""
        self._given_up += 1
        if self._given_up % _FRESH == 0:
            # Finding the first entry of a dict takes the longer the more were deleted before it.
            self.table = {key: found for key, found in self.table.items()}  # noqa: C416 - dict() copies the gaps too
        for key, found in self.table.items():
            behind = found.superseded
            if behind is not None:  # the others kept with it are given up with it
                found.superseded = None
                self.count -= 1
                return behind
            return self.take(key, found)
        return None

    def asked_after(self, number: i64) -> list[Transaction]:
        """Return the open requests with a larger number than ``number``, in order of their numbers. They stay."""
        found: list[Transaction] = []
        for entry in self.table.values():
            row: Transaction | None = entry
            while row is not None:
                link: Transaction | None = row
                while link is not None:
                    if link.number > number:
                        found.append(link)
                    link = link.earlier
                row = row.superseded
        found.sort(key=_number)
        return found

    def drain(self) -> list[Transaction]:
        """Remove and return every open request, oldest first."""
        found: list[Transaction] = []
        for entry in self.table.values():
            found.extend(self.drop_superseded(entry))
            link: Transaction | None = entry
            while link is not None:
                found.append(link)
                link = link.earlier
        for transaction in found:
            transaction.earlier = None
        found.sort(key=_number)
        self.table = {}
        self.count = 0
        return found

    def open_since(self, time_ns: i64, frame: i64, enough: i64) -> i64:
        """Return how many requests were asked at ``time_ns`` or later, after packet ``frame``, and are still open.

        Stops counting at ``enough``, so that it costs no more when there are thousands.
        An identical request has the place of the one before it, so that some of them may be overlooked.
        """
        count: i64 = 0
        for transaction in reversed(self.table.values()):
            link: Transaction | None = transaction
            while link is not None and link.request_ns >= time_ns and link.request_frame > frame:
                count += 1
                link = link.earlier
            if link is transaction or count >= enough:
                break
        return count

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

    def find_orphan(self, key: i64, end_seq: i64) -> Orphan | None:
        """Return the held answer that fits a request ending at sequence number ``end_seq``, None when there is none."""
        orphans = self.orphans
        if orphans is not None:
            for orphan in orphans:
                if orphan.key == key and orphan.ack >= 0 and ((orphan.ack - end_seq) & MASK) < HALF_SPACE:
                    return orphan
        return None

    def release_orphan(self, orphan: Orphan) -> None:
        """Stop holding an answer: its request turned up."""
        orphans = self.orphans
        if orphans is not None:
            orphans.remove(orphan)
            if not orphans:
                self.orphans = None

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


def _number(transaction: Transaction) -> int:
    return transaction.number
