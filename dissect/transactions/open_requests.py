"""The requests of one side that are open, and the answers that found none of them (reference section 5).

One table per connection and asking side, because either end asks and their references are independent and may collide. The key
is (ROSCTR, PDU reference), as `dissect.transactions.pairing.key_of` puts it in one number; a reference is opaque, zero is
valid, it wraps and is used again at once. So an answered request leaves the table, and a request that finds its reference
still open replaces the old one, which stays unanswered. Both wait only when one came shortly after the other, and either both
are the same octets or so many may be open: a client that asks again after a second has given the first one up, and if both
waited, every later answer of a client that never changes its reference would meet the request before its own.

An answer that finds no request is held for a moment, because captures show packets out of order. A request that turns up
later takes it only when the answer acknowledged the request's octets (TCP ACK), so that it cannot take an older answer.
"""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.tcp.stream import FAR_AHEAD, HALF_SPACE, MASK
from dissect.transactions.transaction import Transaction

#: Answers without request that are held per connection and side, and for how long.
MAX_ORPHANS: Final = 64
ORPHAN_HOLD_NS: Final = 1_000_000_000
ORPHAN_HOLD_FRAMES: Final = 50
#: They are held this many times longer while a message of the asking side is unfinished, because a whole request may be in it.
UNFINISHED_HOLD: Final = 10
#: Identical requests that may wait under one reference, and how long after the one before them they may come.
MAX_REPEATS: Final = 8
REPEAT_NS: Final = 1_000_000_000
#: A client that got nothing for this long and asks again gave its request up: clients that have several open send one soon
#: after the other, or after an answer.
BESIDE_NS: Final = 200_000_000
#: Requests of a side that may wait behind others with their reference, as where all packets of a client were captured first.
#: Each answer looks at all of them.
MAX_BEHIND: Final = 256
#: Clients wait two seconds at least before they give a request up (reference 5.6).
GIVEN_UP_NS: Final = 2_000_000_000
#: Grants below this are looked at closely; no device is known to grant more than 8.
FEW_JOBS: Final = 64
#: So many of the longest open are looked at before the latest ones.
_FEW_OLD: Final = 8
#: Requests given up from the front of a table before it is made anew.
_FRESH: Final = 1024


class Orphan:
    """An answer without request, held for a moment; ``ack`` is the TCP acknowledgement it came with, -1 for none."""

    __slots__ = ("ack", "key", "packet", "transaction")

    def __init__(self, key: i64, transaction: Transaction, ack: i64, packet: i64) -> None:
        self.key: i64 = key
        self.transaction: Transaction = transaction
        self.ack: i64 = ack
        self.packet: i64 = packet  # packets of its connection seen when it came


def acknowledged(request: Transaction, end_seq: i64) -> bool:
    """Return whether a request acknowledged the other side's octets up to ``end_seq``, so that they came before it."""
    return request.request_ack >= 0 and ((request.request_ack - end_seq) & MASK) < HALF_SPACE


def excludes(request: Transaction, end_seq: i64, ack: i64) -> bool:
    """Return whether an answer that ends at ``end_seq`` and acknowledges up to ``ack`` cannot be that of a request.

    The request acknowledged it, or came when it was on its way. An acknowledgement far from the request tells nothing.
    """
    if request.request_seq >= 0 and ack >= 0 and ((request.request_seq - ack) & MASK) < FAR_AHEAD:
        return True
    return acknowledged(request, end_seq)


def no_answer(request: Transaction, before: Transaction) -> bool:
    """Return whether a client gave the request ``before`` up, because it had got nothing since when it sent ``request``."""
    return request.request_ns - before.request_ns > BESIDE_NS and request.request_ack == before.request_ack


class OpenRequests:
    """The open requests of one asking side, and the answers to it that found none of them.

    Most clients wait for each answer, or have two requests open. So the two that were asked last need no dictionary and no int
    object as a key, even where others are open whose answers were not captured.
    """

    __slots__ = (
        "_before",
        "_before_key",
        "_given_up",
        "_table",
        "anew",
        "answered",
        "count",
        "latest",
        "latest_key",
        "orphans",
    )

    def __init__(self) -> None:
        self.latest: Transaction | None = None  # asked after `_before`, and that after all those of `_table`
        self.latest_key: i64 = 0
        self._before: Transaction | None = None
        self._before_key: i64 = 0
        self._table: dict[int, Transaction] = {}
        self._given_up: i64 = 0
        self.anew: i64 = 0  # number of the latest request that a client asked again when it had got nothing for a while
        self.answered: i64 = 0  # number of the request that was answered last
        self.count: i64 = 0  # identical requests share a key, so this may be more than len(table)
        self.orphans: list[Orphan] | None = None

    @property
    def table(self) -> dict[int, Transaction]:
        """The open requests by their keys, in the order of asking; to be looked at, and changed in here only."""
        before = self._before
        if before is not None:
            self._before = None
            self._table[self._before_key] = before
        latest = self.latest
        if latest is not None:
            self.latest = None
            self._table[self.latest_key] = latest
        return self._table

    def asked_last(self) -> Transaction | None:
        """Return the request that was asked last of those that are open."""
        if self.latest is not None or self._before is not None:
            return self.latest or self._before
        return next(reversed(self._table.values()), None) if self.count else None

    def find(self, key: i64) -> Transaction | None:
        """Return what is open under ``key``, the latest of several that are identical; None when nothing is."""
        latest = self.latest
        if latest is not None and key == self.latest_key:
            return latest
        before = self._before
        if before is not None and key == self._before_key:
            return before
        return self._table.get(key) if self._table else None

    def add(self, key: i64, transaction: Transaction) -> Transaction | None:
        """Open a request, unless something is open under its key (`find`): then return that."""
        latest = self.latest
        if latest is not None and key == self.latest_key:
            return latest
        before = self._before
        if before is not None and key == self._before_key:
            return before
        if self._table and (found := self._table.get(key)) is not None:
            return found
        self.count += 1
        if latest is not None:
            if before is not None:
                self._table[self._before_key] = before
            self._before, self._before_key = latest, self.latest_key
        self.latest, self.latest_key = transaction, key
        return None

    def add_again(self, key: i64, transaction: Transaction, old: Transaction) -> Transaction | None:
        """Open a request whose key ``old`` holds; return what it replaces (and by ``earlier`` those before it)."""
        depth = self._depth(old)
        self.count += 1
        if (
            depth < MAX_REPEATS
            and transaction.request_ns - old.request_ns <= REPEAT_NS
            and old.request_octets == transaction.request_octets
        ):
            if no_answer(transaction, old):
                self.anew = transaction.number
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
        """Open a request whose key ``old`` holds, and keep ``old`` behind it; False when too many wait so already.

        For a request that acknowledges octets the capture has not shown yet, the answer to ``old`` is among them; and for one
        that a client asks beside others.
        """
        table = self.table
        if self.count - len(table) >= MAX_BEHIND:
            return False
        self.count += 1
        transaction.superseded = old
        del table[key]  # so that the new one goes to the end: the table stays in the order of asking
        table[key] = transaction
        return True

    def row(self, found: Transaction) -> list[Transaction]:
        """Return all that is open under the key of ``found``, which is what `find` returns for it, oldest first. They stay."""
        row: list[Transaction] = []
        behind: Transaction | None = found
        while behind is not None:
            link: Transaction | None = behind
            while link is not None:
                row.append(link)
                link = link.earlier
            behind = behind.superseded
        row.reverse()
        return row

    def first(self, found: Transaction) -> Transaction:
        """Return the oldest of the `row` of ``found``."""
        oldest = found
        while oldest.superseded is not None or oldest.earlier is not None:
            oldest = oldest.superseded or oldest.earlier or oldest
        return oldest

    def close(self, key: i64, chosen: Transaction) -> None:
        """Close one of those that are open under ``key``, whatever waits before or behind it."""
        newer: Transaction | None = None  # the one that ``head`` waits behind
        head: Transaction | None = self.table.get(key)
        while head is not None:
            link: Transaction | None = head
            while link is not None:
                if link.earlier is chosen:
                    link.earlier = chosen.earlier
                    chosen.earlier = None
                    self.count -= 1
                    return
                link = link.earlier
            if head is chosen:
                self._close_head(key, newer, head)
                return
            newer = head
            head = head.superseded

    def _close_head(self, key: i64, newer: Transaction | None, head: Transaction) -> None:
        self.count -= 1
        rest = head.superseded
        if head.earlier is not None:
            head.earlier.superseded = rest
            rest = head.earlier
        head.earlier = None
        head.superseded = None
        if newer is not None:
            newer.superseded = rest
        elif rest is not None:
            self._table[key] = rest
        else:
            del self._table[key]

    def take_superseded(self, found: Transaction, end_seq: i64, ack: i64) -> Transaction | None:
        """Close and return the request kept behind ``found`` that an answer belongs to, if any.

        The answer ends at ``end_seq`` and came with the acknowledgement ``ack``.
        """
        newer = found
        older = found.superseded
        while older is not None and excludes(older, end_seq, ack):
            newer = older
            older = older.superseded
        return self._take_behind(newer, older) if older is not None else None

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
        """Close the oldest open request of ``key`` and return it; ``found`` is what `find` returns for it."""
        self.count -= 1
        if found.earlier is not None:
            return _earliest_of(found)
        if found is self.latest:
            self.latest = None
        elif found is self._before:
            self._before = None
        else:
            del self._table[key]
        return found

    def _take_behind(self, newer: Transaction, older: Transaction) -> Transaction:
        """Close the oldest of the identical requests ``older``, which are kept behind ``newer``, and return it."""
        self.count -= 1
        if older.earlier is not None:
            return _earliest_of(older)
        newer.superseded = older.superseded
        older.superseded = None
        return older

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
            self._table = {key: found for key, found in self.table.items()}  # noqa: C416 - dict() copies the gaps too
        for key, found in self.table.items():
            newer = found
            behind = found.superseded
            while behind is not None and behind.superseded is not None:
                newer = behind
                behind = behind.superseded
            return self._take_behind(newer, behind) if behind is not None else self.take(key, found)
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
        self._table = {}
        self.count = 0
        return found

    def open_since(self, time_ns: i64, frame: i64, enough: i64) -> i64:
        """Return how many requests were asked at ``time_ns`` or later, after packet ``frame``, and are still open.

        Stops counting at ``enough``. Of identical requests, which have the place of the first, some may be overlooked.
        """
        # A lost answer leaves its request open, and every later one asks here: often the longest open show that it is fewer.
        spare: i64 = self.count - enough
        for transaction in self._table.values():
            if not 0 <= spare <= _FEW_OLD or (transaction.request_ns >= time_ns and transaction.request_frame > frame):
                break
            if spare == 0:
                return enough - 1
            spare -= 1
        count: i64 = 0
        recent = self.latest
        if recent is not None:  # what is identical to another one is in the table
            if recent.request_ns < time_ns or recent.request_frame <= frame or enough == 0:
                return 0
            count = 1
        recent = self._before
        if recent is not None:
            if recent.request_ns < time_ns or recent.request_frame <= frame or count == enough:
                return count
            count += 1
        for transaction in reversed(self._table.values()):
            behind: Transaction | None = transaction
            link: Transaction | None = None
            while behind is not None and link is None and count < enough:
                link = behind
                while link is not None and link.request_ns >= time_ns and link.request_frame > frame:
                    count += 1
                    link = link.earlier
                behind = behind.superseded
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
            orphans = self.orphans = []
        orphans.append(Orphan(key, answer, ack, packet))
        if len(orphans) > MAX_ORPHANS:
            return orphans.pop(0).transaction
        return None

    def find_orphan(self, key: i64, end_seq: i64) -> Orphan | None:
        """Return the held answer that fits a request ending at sequence number ``end_seq``, None when there is none."""
        for orphan in self.orphans or []:
            if orphan.key == key and orphan.ack >= 0 and ((orphan.ack - end_seq) & MASK) < HALF_SPACE:
                return orphan
        return None

    def release_orphan(self, orphan: Orphan) -> None:
        """Stop holding an answer: its request turned up."""
        if self.orphans is not None:
            self.orphans.remove(orphan)
            self.orphans = self.orphans or None

    def passed_orphans(self, end_seq: i64) -> list[Transaction]:
        """Remove and return the held answers that acknowledge less than a request that ends at sequence number ``end_seq``.

        What they answer came before that request, and was not seen: every later request ends further on.
        """
        passed: list[Transaction] = []
        kept: list[Orphan] = []
        for orphan in self.orphans or []:
            if orphan.ack >= 0 and ((orphan.ack - end_seq) & MASK) >= HALF_SPACE:
                passed.append(orphan.transaction)
            else:
                kept.append(orphan)
        if passed:
            self.orphans = kept or None
        return passed

    def expired_orphans(self, time_ns: i64, packet: i64, unfinished: bool = False) -> list[Transaction]:
        """Remove and return the held answers whose time is over; ``unfinished``: a message of the asking side is."""
        orphans = self.orphans
        times: i64 = UNFINISHED_HOLD if unfinished else 1
        gone: list[Transaction] = []
        while orphans and (
            time_ns - orphans[0].transaction.response_ns > ORPHAN_HOLD_NS * times
            or packet - orphans[0].packet > ORPHAN_HOLD_FRAMES * times
        ):
            gone.append(orphans.pop(0).transaction)
        self.orphans = orphans or None
        return gone


def _earliest_of(found: Transaction) -> Transaction:
    """Take the oldest of several identical requests out of the chain that begins with ``found``, and return it."""
    newer = oldest = found
    while oldest.earlier is not None:
        newer = oldest
        oldest = oldest.earlier
    newer.earlier = None
    return oldest


def _number(transaction: Transaction) -> int:
    return transaction.number
