"""The open requests of one side, and the answers that came before their request (reference section 5).

Each asking side of a connection has a table of its own, because either end may send requests and their references are
independent. The key is ROSCTR and PDU reference, in one number (`dissect.transactions.pairing.key_of`). A reference is opaque:
zero is valid, it wraps, and a client may use it again at once.

An answered request leaves the table. A new request whose key is still open replaces the old one, which stays unanswered. Both
stay open only if the new one came soon after the old one, and if the two are identical or the grant allows so many open ones. A
client that asks again after a second has given the old request up: if both stayed open, each later answer of a client that
never changes its reference would be paired with the request before its own.

Requests under one key are linked in two ways: `Transaction.earlier` is an identical request, `Transaction.superseded` another
request of the same reference. The table holds the latest one.

An answer that finds no request is held for a moment as an `Orphan`, because captures show packets out of order. A request that
comes later takes it only if the answer acknowledged the request's octets (TCP ACK); so it cannot take an older answer.
"""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.tcp.stream import FAR_AHEAD, HALF_SPACE, MASK
from dissect.transactions.transaction import Transaction

#: Bounds of the answers held per connection and side: how many, how long, for how many packets of the connection.
MAX_ORPHANS: Final = 64
ORPHAN_HOLD_NS: Final = 1_000_000_000
ORPHAN_HOLD_FRAMES: Final = 50
#: They are held this many times longer while a message of the asking side is unfinished, because a whole request may be in it.
UNFINISHED_HOLD: Final = 10
#: Identical requests that may be open under one key, and how long after the one before each of them may come.
MAX_REPEATS: Final = 8
REPEAT_NS: Final = 1_000_000_000
#: A client that got nothing for this long and asks again gave its request up: clients that have several open send one soon
#: after the other, or after an answer.
BESIDE_NS: Final = 200_000_000
#: Requests of a side that may wait behind others with their reference, as where all packets of a client were captured first.
#: Each answer looks at all of them.
MAX_BEHIND: Final = 256
#: Clients wait at least two seconds before they give a request up (reference 5.6).
GIVEN_UP_NS: Final = 2_000_000_000
#: Only grants below this are checked closely; no device is known to grant more than 8.
FEW_JOBS: Final = 64
#: `open_since` looks at so many of the longest open requests before the latest ones.
_FEW_OLD: Final = 8
#: The table is rebuilt whenever so many requests were given up from its front.
_FRESH: Final = 1024


class Orphan:
    """An answer that is held for its request; ``ack`` is the TCP acknowledgement it came with, -1 for none."""

    __slots__ = ("ack", "key", "packet", "transaction")

    def __init__(self, key: i64, transaction: Transaction, ack: i64, packet: i64) -> None:
        self.key: i64 = key
        self.transaction: Transaction = transaction
        self.ack: i64 = ack
        self.packet: i64 = packet  # how many packets of its connection had been seen when it came


def acknowledged(request: Transaction, end_seq: i64) -> bool:
    """Return whether a request acknowledged the other side's octets up to ``end_seq``: then they were there before it."""
    return request.request_ack >= 0 and ((request.request_ack - end_seq) & MASK) < HALF_SPACE


def excludes(request: Transaction, end_seq: i64, ack: i64) -> bool:
    """Return whether an answer that ends at ``end_seq`` and acknowledges up to ``ack`` cannot be that of ``request``.

    It cannot if it acknowledges nothing of the request's last segment, or if the request acknowledged it. An acknowledgement
    far behind the request proves nothing.
    """
    if request.request_seq >= 0 and ack >= 0 and ((request.request_seq - ack) & MASK) < FAR_AHEAD:
        return True
    return acknowledged(request, end_seq)


def no_answer(request: Transaction, before: Transaction) -> bool:
    """Return whether the client, when it sent ``request``, had got nothing since ``before`` for so long that it gave up."""
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
        self.latest: Transaction | None = None  # sent after `_before`, which was sent after all those in `_table`
        self.latest_key: i64 = 0
        self._before: Transaction | None = None
        self._before_key: i64 = 0
        self._table: dict[int, Transaction] = {}
        self._given_up: i64 = 0
        self.anew: i64 = 0  # number of the latest request that repeats one which the client had given up (`no_answer`)
        self.answered: i64 = 0  # number of the request that was answered last
        self.count: i64 = 0  # may be more than len(table): several requests may share a key
        self.orphans: list[Orphan] | None = None

    @property
    def table(self) -> dict[int, Transaction]:
        """The latest open request of each key, in the order in which they were sent; do not change it outside this class."""
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
        """Return the latest open request, None when none is open."""
        if self.latest is not None or self._before is not None:
            return self.latest or self._before
        return next(reversed(self._table.values()), None) if self.count else None

    def find(self, key: i64) -> Transaction | None:
        """Return the latest open request of ``key``, None when none is open."""
        latest = self.latest
        if latest is not None and key == self.latest_key:
            return latest
        before = self._before
        if before is not None and key == self._before_key:
            return before
        return self._table.get(key) if self._table else None

    def add(self, key: i64, transaction: Transaction) -> Transaction | None:
        """Open a request and return None; if its key is open already, only return what `find` does."""
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
        """Open a request whose key is that of ``old``, found by `add`; return ``old`` if the new one replaces it, else None.

        ``old`` then brings the identical requests before it, linked by ``earlier``.
        """
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
            transaction.superseded = old.superseded  # only the latest of identical requests has this link
            old.superseded = None
            self.table[key] = transaction
            return None
        self.count -= depth
        del self.table[key]  # so that the new one goes to the end: the table stays in the order of sending
        self.table[key] = transaction
        return old

    def supersede(self, key: i64, transaction: Transaction, old: Transaction) -> bool:
        """Open a request whose key is that of ``old``, and keep ``old`` open behind it; False when too many wait so already.

        This is for a request that acknowledges octets which the capture has not shown yet (they hold the answer to ``old``),
        and for one that a client sends while it still waits for others.
        """
        table = self.table
        if self.count - len(table) >= MAX_BEHIND:
            return False
        self.count += 1
        transaction.superseded = old
        del table[key]  # so that the new one goes to the end: the table stays in the order of sending
        table[key] = transaction
        return True

    def row(self, found: Transaction) -> list[Transaction]:
        """Return all open requests of one key, oldest first; they stay open. ``found`` is what `find` returns for the key."""
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
        """Close ``chosen``, which is any of the open requests of ``key``; the others stay open."""
        newer: Transaction | None = None  # the request that ``head`` waits behind
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
        """Close and return the request kept behind ``found`` that an answer belongs to, None for none.

        The answer ends at ``end_seq`` and came with the acknowledgement ``ack``.
        """
        newer = found
        older = found.superseded
        while older is not None and excludes(older, end_seq, ack):
            newer = older
            older = older.superseded
        return self._take_behind(newer, older) if older is not None else None

    def drop_superseded(self, found: Transaction) -> list[Transaction]:
        """Close and return all requests kept behind ``found``, oldest first: no answers to them will come."""
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
        """Close and return ``found``, which is what `find` returns for ``key``, or the oldest of those identical to it."""
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
        """Close and return ``older``, which is kept behind ``newer``, or the oldest of the requests identical to it."""
        self.count -= 1
        if older.earlier is not None:
            return _earliest_of(older)
        newer.superseded = older.superseded
        older.superseded = None
        return older

    def lose(self, found: Transaction, frame: i64, hole_frame: i64) -> Transaction | None:
        """Close those of several identical requests whose answers are in a gap; return them, linked by ``earlier``.

        The answer in packet ``frame`` is taken to belong to the latest request captured before it. Requests before that one
        will not be answered if they came before packet ``hole_frame``, at which the gap was given up.
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
        """Close and return the request that has been open longest (the table is full), None when none is open."""
        self._given_up += 1
        if self._given_up % _FRESH == 0:
            # Finding the first entry of a dict takes longer the more entries were deleted before it.
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
        """Return the open requests with a larger number than ``number``, in order of their numbers; they stay open."""
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
        """Close and return every open request, oldest first."""
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
        """Return how many of the requests sent at ``time_ns`` or later, and after packet ``frame``, are still open.

        Counting stops at ``enough``. Some identical requests may be overlooked: they stand at the place of their first one.
        """
        # After a lost answer its request stays open and each new request calls this. So the oldest are looked at first: they
        # often show that fewer than ``enough`` are recent.
        spare: i64 = self.count - enough
        for transaction in self._table.values():
            if not 0 <= spare <= _FEW_OLD or (transaction.request_ns >= time_ns and transaction.request_frame > frame):
                break
            if spare == 0:
                return enough - 1
            spare -= 1
        count: i64 = 0
        recent = self.latest
        if recent is not None:  # alone under its key: requests that share one are in the table
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
        """Hold an answer for its request; return the oldest held answer if there are too many, else None."""
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
        """Stop holding an answer: its request has come."""
        if self.orphans is not None:
            self.orphans.remove(orphan)
            self.orphans = self.orphans or None

    def passed_orphans(self, end_seq: i64) -> list[Transaction]:
        """Remove and return the held answers that acknowledge less than a request that ends at sequence number ``end_seq``.

        Their own requests came before that one and were not captured: every later request ends further on.
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
        """Remove and return the held answers whose time is over.

        ``packet`` is how many packets of the connection were seen. ``unfinished``: a message of the asking side is unfinished.
        """
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
    """Remove the oldest of several identical requests from the chain that begins with ``found``, and return it."""
    newer = oldest = found
    while oldest.earlier is not None:
        newer = oldest
        oldest = oldest.earlier
    newer.earlier = None
    return oldest


def _number(transaction: Transaction) -> int:
    return transaction.number
