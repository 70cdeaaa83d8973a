"""The open requests of one side, and waiting answers (reference section 5).

Each asking side of a connection has its own table, because either end may send requests and their references are independent.
The key is ROSCTR and PDU reference in one number (`key_of`). A reference is opaque: zero is valid, it wraps around, and a
client may reuse it at once.

A request leaves the table when it is answered, or when an answer can no longer come; reuse of its reference does not remove it.
The table holds the latest request of each key. If several are open with one key, a `Row` has all of them, and the answers that
match more than one (`dissect.engine.transactions.alike`).

An answer without a request is kept for a moment, because captures show packets out of order. A request that comes later gets it
only if the answer acknowledged the octets of the request (TCP ACK); so it cannot get an older answer.
"""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.engine.transactions.transaction import Transaction
from dissect.packets.tcp.stream import FAR_AHEAD, HALF_SPACE, MASK
from dissect.protocols.s7.tables import USERDATA
from dissect.protocols.s7plus.parameters import PLUS

#: Limits of the answers kept per connection and side: how many, how long, for how many packets of the connection.
MAX_ORPHANS: Final = 64
ORPHAN_HOLD_NS: Final = 1_000_000_000
ORPHAN_HOLD_FRAMES: Final = 50
#: They are kept this many times longer while a message of the asking side is unfinished, because it may contain a whole
#: request.
UNFINISHED_HOLD: Final = 10
#: A client that sends the same request again within this time got no answer and repeats it.
REPEAT_NS: Final = 1_000_000_000
#: After at least this time without an open request, the next request does not wait for anything.
SHORT_REST_NS: Final = 100_000_000
#: A client that got nothing for this long and sends another request gave the first one up: clients with several open requests
#: send one soon after the other, or after an answer.
BESIDE_NS: Final = 200_000_000
#: Maximum number of requests of a side that may wait in rows before the latest one with their reference. The oldest of a row
#: gives way.
MAX_BEHIND: Final = 256
#: No server answers a request after this long, once its reference is reused: clients give up after 2 to 5 s.
NEVER_NS: Final = 10_000_000_000
#: Clients wait at least two seconds before they give a request up (reference 5.6).
GIVEN_UP_NS: Final = 2_000_000_000
#: Only grants below this are checked exactly; no known device grants more than 8.
FEW_JOBS: Final = 64
#: `open_since` examines this many of the oldest open requests before the latest ones.
_FEW_OLD: Final = 8
#: The table is rebuilt whenever this many requests were removed from its front.
_FRESH: Final = 1024


#: Added to the reference of a userdata request: ROSCTR is part of the key.
USERDATA_KEY: Final = 0x10000
#: Added to the sequence number of an S7comm-plus request.
PLUS_KEY: Final = 0x20000
#: Added to the identifier of an SCD request: its transaction number, or its index and sub-index, together 25 bits.
SCD_KEY: Final = 0x40000000


def key_of(rosctr: i64, pdu_ref: i64) -> i64:
    """Return the key of a request, or the key of the request that an answer belongs to."""
    if rosctr < USERDATA:
        return pdu_ref
    if rosctr == USERDATA:
        return pdu_ref | USERDATA_KEY
    return pdu_ref | (PLUS_KEY if rosctr == PLUS else SCD_KEY)


#: Used by most tables instead of a list of their own; nothing is ever appended to it.
_NONE: Final[list[Transaction]] = []


class HeldAnswer:
    """An answer that waits for its request, or until its request is certain.

    ``ack`` is the TCP acknowledgement of its packet, -1 for none; ``packet`` is the number of packets of its connection seen
    until then. ``fits`` are the open requests that it may belong to, oldest first.
    """

    __slots__ = ("ack", "fits", "key", "packet", "transaction")

    def __init__(self, key: i64, transaction: Transaction, ack: i64, packet: i64) -> None:
        self.key: i64 = key
        self.transaction: Transaction = transaction
        self.ack: i64 = ack
        self.packet: i64 = packet
        self.fits: list[Transaction] = []


class Row:
    """The open requests with one key, oldest first, if there are several, and the answers that match more than one of them.

    ``wanted`` are the numbers of the requests to which these answers may belong.
    """

    __slots__ = ("answers", "key", "requests", "wanted")

    def __init__(self, key: i64, first: Transaction) -> None:
        self.key: i64 = key
        self.requests: list[Transaction] = [first]
        self.answers: list[HeldAnswer] = []
        self.wanted: set[int] = set()

    def hold(self, answer: HeldAnswer) -> None:
        """Keep an answer until it is known to which of ``answer.fits`` it belongs."""
        self.answers.append(answer)
        for request in answer.fits:
            self.wanted.add(request.number)


def acknowledged(request: Transaction, end_seq: i64) -> bool:
    """Return whether a request acknowledged the other side's octets up to ``end_seq``, so that they existed before it."""
    return request._request_ack >= 0 and ((request._request_ack - end_seq) & MASK) < HALF_SPACE


def excludes(request: Transaction, end_seq: i64, ack: i64) -> bool:
    """Return whether an answer that ends at ``end_seq`` and acknowledges up to ``ack`` cannot be the one to ``request``.

    It cannot if it acknowledges nothing of the request's last segment, or if the request acknowledged it. An acknowledgement
    long after the request proves nothing.
    """
    if request._request_ack >= 0 and ack >= 0 and ((request._request_seq - ack) & MASK) < FAR_AHEAD:
        return True
    return acknowledged(request, end_seq)


def no_answer(request: Transaction, before: Transaction) -> bool:
    """Return whether the client got nothing between ``before`` and ``request`` for so long that it gave ``before`` up."""
    return request.request_ns - before.request_ns > BESIDE_NS and request._request_ack == before._request_ack


class OpenRequests:
    """The open requests of one asking side, and the answers that wait for it.

    Most clients wait for each answer, or have two requests open. So the two latest requests need neither a dictionary nor an
    int object as a key, even if others are open whose answers were not captured.
    """

    __slots__ = (
        "_before",
        "_before_key",
        "_given_up",
        "_rows",
        "_table",
        "answered",
        "asked_frame",
        "asked_seq",
        "beside",
        "count",
        "doubtful",
        "latest",
        "latest_key",
        "lost",
        "orphan_frame",
        "orphans",
        "repeats",
        "rest_ns",
        "undecided",
    )

    def __init__(self) -> None:
        self.latest: Transaction | None = None  # sent after `_before`, which was sent after all requests in `_table`
        self.latest_key: i64 = -1  # key of the request that was sent last, even if it is answered
        self._before: Transaction | None = None
        self._before_key: i64 = 0
        self._table: dict[int, Transaction] = {}
        self._rows: dict[int, Row] | None = None
        self._given_up: i64 = 0
        self.answered: i64 = 0  # number of the request that was answered last
        self.asked_frame: i64 = 0  # packet of the request that was sent last, and the place where it begins
        self.asked_seq: i64 = 0
        self.orphan_frame: i64 = 0  # packet of the latest answer that was dropped because no request came
        self.count: i64 = 0  # may be more than len(table), because several requests may share a key
        self.repeats: i64 = 0  # how often two requests in a row had the same key
        self.beside: bool = False  # two requests with one key were open at once, and no gap explains it
        self.rest_ns: i64 = SHORT_REST_NS  # the time without open requests after which pairs are no longer doubtful
        self.doubtful: bool = False  # two answers could not be told apart, so later answers may be shifted
        self.lost: list[Transaction] = (
            _NONE  # requests that were answered in the latest gap; the next answer will confirm it
        )
        self.orphans: list[HeldAnswer] | None = None
        self.undecided: list[Row] | None = None  # the rows that hold answers

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

    @property
    def held(self) -> i64:
        """Number of answers that belong to open requests, but to which one is not yet known."""
        held: i64 = 0
        if self.undecided is not None:
            for row in self.undecided:
                held += len(row.answers)
        return held

    def waiting(self) -> list[Transaction]:
        """Return the answers that wait for their request, or until their request is certain."""
        found = [answer.transaction for answer in self.orphans or []]
        if self.undecided is not None:
            for row in self.undecided:
                found += [answer.transaction for answer in row.answers]
        return found

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

    def row(self, key: i64) -> Row | None:
        """Return the row of ``key``, None if at most one request is open with it."""
        rows = self._rows
        return rows.get(key) if rows is not None else None

    def add(self, key: i64, transaction: Transaction) -> Transaction | None:
        """Open a request and return None; if its key is open already, only return the result of `find`."""
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

    def join(self, key: i64, transaction: Transaction, before: Transaction) -> Row:
        """Open a request whose key is that of ``before``, found by `add`, and return their row."""
        table = self.table
        rows = self._rows
        if rows is None:
            rows = self._rows = {}
        row = rows.get(key)
        if row is None:
            row = rows[key] = Row(key, before)
        row.requests.append(transaction)
        self.count += 1
        del table[key]  # so that the new one goes to the end: the table stays in the order of sending
        table[key] = transaction
        return row

    @property
    def full(self) -> bool:
        """True when more requests wait in rows than may."""
        return self.count - len(self.table) > MAX_BEHIND

    def close(self, key: i64, chosen: Transaction) -> None:
        """Close any of the open requests of ``key``; the others stay open."""
        row = self.row(key)
        self.count -= 1
        if row is None:
            if chosen is self.latest:
                self.latest = None
            elif chosen is self._before:
                self._before = None
            else:
                del self._table[key]
            return
        row.requests.remove(chosen)
        row.wanted.discard(chosen.number)
        if self._table[key] is chosen:
            self._table[key] = row.requests[len(row.requests) - 1]
            if len(self._table) > 1:  # it comes before those that were sent later
                self._table = dict(sorted(self._table.items(), key=_sent))
        if len(row.requests) == 1 and not row.answers:
            self._end_row(key)

    def _end_row(self, key: i64) -> None:
        rows = self._rows
        if rows is not None:
            del rows[key]
            if not rows:
                self._rows = None

    def repeat(self, opens: bool, answered: bool, since_ns: i64, gap_frame: i64) -> None:
        """Note that two requests in a row have the same reference, and whether it is known which of them are open.

        ``opens``: requests that were not captured may be open. ``answered``: there was an answer, ``since_ns`` ago;
        ``gap_frame`` is the packet of the latest gap. A client that waits for each answer has no request open one exchange
        later.
        """
        if self.repeats == 0:
            self.doubtful = opens
        if (
            self.count == 0
            and answered
            and (since_ns > self.rest_ns or (not self.beside and gap_frame < self.asked_frame))
        ):
            self.doubtful = False
        self.repeats += 1

    def under(self, key: i64) -> list[Transaction]:
        """Return the open requests with ``key``, oldest first; they stay open."""
        row = self.row(key)
        if row is not None:
            return list(row.requests)
        found = self.find(key)
        return [found] if found is not None else []

    def hold(self, row: Row, answer: HeldAnswer) -> None:
        """Keep an answer in ``row`` until it is known which request it belongs to."""
        if not row.answers:
            if self.undecided is None:
                self.undecided = []
            self.undecided.append(row)
        row.hold(answer)

    def release(self, row: Row) -> list[HeldAnswer]:
        """Remove and return the answers in ``row``."""
        answers = row.answers
        row.answers = []
        row.wanted = set()
        if self.undecided is not None:
            self.undecided = [one for one in self.undecided if one is not row] or None
        if len(row.requests) == 1:
            self._end_row(row.key)
        return answers

    def oldest(self) -> tuple[int, Transaction] | None:
        """Return the request that has been open longest, with its key, None if none is open; it stays open."""
        self._given_up += 1
        if self._given_up % _FRESH == 0:
            # Finding the first entry of a dict takes longer, the more entries were deleted before it.
            self._table = {key: found for key, found in self.table.items()}  # noqa: C416 - dict() copies the gaps too
        for key, found in self.table.items():
            row = self.row(key)
            return key, (found if row is None else row.requests[0])
        return None

    def asked_after(self, number: i64) -> list[Transaction]:
        """Return the open requests with a larger number than ``number``, in order of their numbers; they stay open."""
        return self._found(number, 0)

    def recent(self, number: i64, enough: i64) -> list[Transaction]:
        """Return the same as `asked_after`, but stop after more than ``enough`` were found."""
        return self._found(number, enough)

    def _found(self, number: i64, enough: i64) -> list[Transaction]:
        found: list[Transaction] = []
        for key, latest in reversed(self.table.items()):
            if latest.number <= number or 0 < enough < len(found):
                break  # those before it were sent earlier
            row = self.row(key)
            if row is None:
                found.append(latest)
            else:
                found += [one for one in row.requests if one.number > number]
        if len(found) > 1:
            found.sort(key=_number)
        return found

    def drain(self) -> list[Transaction]:
        """Close and return every open request, oldest first."""
        found = self._found(-1, 0)
        self._table = {}
        self._rows = None
        self.undecided = None
        self.count = 0
        return found

    def open_since(self, time_ns: i64, frame: i64, ack: i64, enough: i64) -> i64:
        """Return how many of the requests sent at ``time_ns`` or later are certainly open.

        Requests up to packet ``frame`` may be answered in a gap, unless they acknowledged octets up to ``ack``, the end of that
        gap (-1: unknown). Counting stops at ``enough``. Requests that share a key may be overlooked: all of them are at the
        place of their latest.
        """
        # After a lost answer its request stays open, and each new request calls this. So the oldest are examined first: they
        # often show that fewer than ``enough`` are recent.
        spare: i64 = self.count - enough
        for transaction in self._table.values():
            if not 0 <= spare <= _FEW_OLD or _certain(transaction, time_ns, frame, ack):
                break
            if spare == 0:
                return enough - 1
            spare -= 1
        count: i64 = 0
        recent = self.latest
        if recent is not None:  # the only one with its key: requests that share a key are in the table
            if enough == 0 or not _certain(recent, time_ns, frame, ack):
                return 0
            count = 1
        recent = self._before
        if recent is not None:
            if count == enough or not _certain(recent, time_ns, frame, ack):
                return count
            count += 1
        for key, transaction in reversed(self._table.items()):
            if count >= enough or not _certain(transaction, time_ns, frame, ack):
                break
            row = self.row(key)
            if row is None:
                count += 1
            else:
                for one in row.requests:
                    if _certain(one, time_ns, frame, ack):
                        count += 1
        return count

    def hold_orphan(self, key: i64, answer: Transaction, ack: i64, packet: i64) -> HeldAnswer | None:
        """Keep an answer for its request; return the oldest kept answer if there are too many, else None."""
        orphans = self.orphans
        if orphans is None:
            orphans = self.orphans = []
        orphans.append(HeldAnswer(key, answer, ack, packet))
        if len(orphans) > MAX_ORPHANS:
            return orphans.pop(0)
        return None

    def find_orphan(self, key: i64, end_seq: i64) -> HeldAnswer | None:
        """Return the kept answer that matches a request ending at sequence number ``end_seq``, None if there is none."""
        for orphan in self.orphans or []:
            if orphan.key == key and orphan.ack >= 0 and ((orphan.ack - end_seq) & MASK) < HALF_SPACE:
                return orphan
        return None

    def was_passed(self, key: i64, end_seq: i64) -> bool:
        """Return whether an answer came since the latest request that is not for the one with ``key`` and ``end_seq``."""
        for orphan in self.orphans or []:
            covers: bool = orphan.ack >= 0 and ((orphan.ack - end_seq) & MASK) < HALF_SPACE
            if orphan.transaction.response_frame > self.asked_frame and not (covers and orphan.key == key):
                return True
        return self.orphan_frame > self.asked_frame

    def release_orphan(self, orphan: HeldAnswer) -> None:
        """Stop holding an answer: its request has come."""
        if self.orphans is not None:
            self.orphans.remove(orphan)
            self.orphans = self.orphans or None

    def passed_orphans(self, end_seq: i64) -> list[HeldAnswer]:
        """Remove and return the kept answers that acknowledge less than the end ``end_seq`` of a request.

        Their own requests came before it and were not captured, because every later request ends later in the stream.
        """
        passed: list[HeldAnswer] = []
        kept: list[HeldAnswer] = []
        for orphan in self.orphans or []:
            if orphan.ack >= 0 and ((orphan.ack - end_seq) & MASK) >= HALF_SPACE:
                passed.append(orphan)
            else:
                kept.append(orphan)
        if passed:
            self.orphans = kept or None
        return passed

    def expired_orphans(self, time_ns: i64, packet: i64, unfinished: bool = False) -> list[HeldAnswer]:
        """Remove and return the kept answers whose time is over.

        ``packet`` is the number of packets of the connection seen so far. ``unfinished``: a message of the asking side is
        unfinished.
        """
        orphans = self.orphans
        times: i64 = UNFINISHED_HOLD if unfinished else 1
        gone: list[HeldAnswer] = []
        while orphans and (
            time_ns - orphans[0].transaction.response_ns > ORPHAN_HOLD_NS * times
            or packet - orphans[0].packet > ORPHAN_HOLD_FRAMES * times
        ):
            gone.append(orphans.pop(0))
        self.orphans = orphans or None
        return gone


def _certain(request: Transaction, time_ns: i64, frame: i64, ack: i64) -> bool:
    """Return whether a request was sent at ``time_ns`` or later and cannot be answered in a gap (see `open_since`)."""
    if request.request_ns < time_ns:
        return False
    return request.request_frame > frame or (ack >= 0 and acknowledged(request, ack))


def _number(transaction: Transaction) -> int:
    return transaction.number


def _sent(entry: tuple[int, Transaction]) -> int:
    return entry[1].number
