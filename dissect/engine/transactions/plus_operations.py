"""Operations of S7comm-plus: sessions, subscriptions with notifications, loaded, read and deleted blocks, test jobs.

`dissect.protocols.s7plus.events` recognises which of these a transaction is about.
"""

from __future__ import annotations

from collections import OrderedDict
from typing import Final

from mypy_extensions import i64

from dissect.engine.transactions import operation as kinds
from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.operation import (
    DONE,
    FAILED,
    MAX_SUBJECT,
    NOT_CAPTURED,
    REFUSED,
    Operation,
    OperationBook,
)
from dissect.engine.transactions.plus_loads import Load, beginning_of
from dissect.engine.transactions.transaction import ANSWERED, PUSH, Transaction
from dissect.protocols.s7plus.alarms import ALARM
from dissect.protocols.s7plus.assembly import MAX_PDU
from dissect.protocols.s7plus.bodies import parse_contents
from dissect.protocols.s7plus.check import check
from dissect.protocols.s7plus.contents import VariableAddress
from dissect.protocols.s7plus.event import (
    CONFIRMED,
    DELETED,
    LISTED,
    SEQUENCE_BEGUN,
    SEQUENCE_ENDED,
    SESSION,
    STREAMED,
    SUBSCRIBED,
    SUBSCRIBED_ALARMS,
    TEST_JOB,
    Event,
)
from dissect.protocols.s7plus.loads import LOADED
from dissect.protocols.s7plus.message import parse_plus
from dissect.protocols.s7plus.pieces import addresses_of
from dissect.protocols.s7plus.plain import REQUEST_SIZE, data_of
from dissect.protocols.s7plus.reads import Reads, reads_again
from dissect.protocols.s7plus.session import PlusSession

#: Kinds of operations by the events that begin them, except those that are acts (`dissect.engine.acts`).
_KINDS: Final[dict[str, str]] = {
    SESSION: kinds.SESSION,
    SUBSCRIBED: kinds.CYCLIC,
    SUBSCRIBED_ALARMS: kinds.MESSAGES,
    STREAMED: kinds.TRANSFER,
}
#: Events whose operations last until their object is deleted; the others are over with their transaction.
_LASTING: Final = frozenset((SESSION, SUBSCRIBED, SUBSCRIBED_ALARMS, TEST_JOB))
#: Events that belong to the load of a session.
_LOADING: Final = frozenset((LOADED, CONFIRMED, SEQUENCE_BEGUN, SEQUENCE_ENDED))
#: This many reads of the same variables are polling; the same number of different reads is remembered.
_POLLED: Final = 3
MAX_POLLS: Final = 1024
#: At this many open operations, those that the book has closed are removed.
_MANY: Final = 1024
#: Up to this size all captured octets of an answer are kept; if a larger one is incomplete, its rest may have been dropped.
_ALL_KEPT: Final = MAX_PDU - 0x10004
#: A poll is identified by its addresses if they have at most this size, else by a digest: a request may have 8 MiB.
_LARGEST: Final = 2048
#: The addresses in a request end with this.
_QUALIFIER: Final = b"\x00\x00\x04\xe8"
_THIRD: Final = 0x04
_LAST: Final = 0xE8


class Poll:
    """Reads of the same variables: their number, and their operation, None at first.

    ``asked`` are the addresses, empty if the poll is identified by a digest; ``read`` is the result of the check of such a
    request. ``numbers`` are the transactions before the operation began.
    """

    __slots__ = ("asked", "count", "frame", "numbers", "operation", "read", "time_ns")

    def __init__(self, transaction: Transaction, asked: bytes, read: Reads) -> None:
        self.asked = asked
        self.read: Reads = read
        self.count: i64 = 1
        self.frame: i64 = transaction.request_frame
        self.time_ns: i64 = transaction.request_ns
        self.numbers: list[int] = [int(transaction.number)]
        self.operation: Operation | None = None


class PlusOpen:
    """The unfinished operations of a connection by their object, and its polls by their addresses.

    The next notification or read usually belongs to the same operation as the last one. So ``pushing`` is the latest notified
    subscription, ``notified`` its object, and ``latest`` the poll of the last read.
    """

    __slots__ = ("latest", "load", "notified", "number", "objects", "polls", "pushing")

    def __init__(self, number: int) -> None:
        self.number = number  # of the connection
        self.objects: dict[int, Operation] = {}
        self.notified: i64 = -1
        self.pushing: Operation | None = None
        self.polls: dict[bytes, Poll] = {}
        self.latest: Poll | None = None
        self.load: Load = Load()


def addresses_in(octets: bytes, end: i64 = 0) -> bytes:
    """Return the addresses of a read request: its body up to the qualifier, which begins at ``end`` (0: unknown)."""
    data, begin, size = data_of(octets)
    begin += REQUEST_SIZE
    if end > 0:
        return data[begin:end]
    at: i64 = begin + len(_QUALIFIER) - 1  # possible place of the last octet of the qualifier
    while at < size:  # several times as fast as `bytes.find`: the octet at this place shows the least distance to skip
        octet: i64 = data[at]
        if octet == _LAST and data[at - len(_QUALIFIER) + 1 : at + 1] == _QUALIFIER:
            return data[begin : at - len(_QUALIFIER) + 1]
        if octet == _THIRD:
            at += 1
        elif octet == 0:
            at += 2
        else:
            at += len(_QUALIFIER)
    return data[min(begin, size) : size]


class PlusOperations:
    """Follows the operations of all S7comm-plus connections."""

    def __init__(self, book: OperationBook) -> None:
        self._book = book
        self._holding: dict[int, PlusOpen] = {}  # connections with open operations, by number
        self._count = 0  # number of operations in these
        self._most = _MANY
        self._polling: OrderedDict[int, PlusOpen] = OrderedDict()  # connections with polls, by number
        self._poll_count = 0

    def take(self, event: Event, session: PlusSession, transaction: Transaction, code: int, kind: str = "") -> None:
        """Take an event of a transaction, which may begin or end an operation.

        ``code`` is its error, 0 for none; ``kind`` is the kind of operation of the event as an act, empty for none.
        """
        if event.kind == DELETED:
            if event.object_id in session.given:
                _open_on(transaction.connection).load.close(self._book)
            self._delete(event, transaction)
            return
        if event.kind == LISTED:
            self._list(event, transaction)
            return
        if event.kind in _LOADING:
            self._load(event, transaction, code)
            return
        kind = kind or _KINDS.get(event.kind, "")
        if not kind:
            return
        subject = session.describe() if event.kind == SESSION else event.text
        if event.kind == STREAMED and session.identity.kind:
            server = " ".join([text for text in (session.identity.kind, session.identity.order_number) if text])
            subject = f"{server}: {subject}"
        operation = self._book.begin(kind, str(event.object_id), transaction, subject[:MAX_SUBJECT])
        if kind == kinds.TRANSFER:
            operation.first_frame, operation.begin_ns, left_out = beginning_of(transaction)
            operation.octets = int(transaction.request_size) + left_out
        elif kind == kinds.UPLOAD:
            operation.octets = int(transaction.response_size)
            self._book.gather(operation, transaction.response_octets)
            if transaction.response_size <= _ALL_KEPT and not parse_plus(transaction.response_octets).whole:
                self._book.close(operation, NOT_CAPTURED)
                return
        if kind == kinds.TRANSFER and transaction._outcome == PUSH:
            self._book.close(operation, DONE)  # the request needed no answer
        elif event.kind not in _LASTING or transaction._outcome != ANSWERED or transaction.error_code >= 0x8000:
            self._book.settle(operation, transaction, DONE, REFUSED, code)
        else:
            self._remember(event.object_id, transaction, operation)

    def _load(self, event: Event, transaction: Transaction, code: int) -> None:
        """Take an event of a load, all of which is one operation (`dissect.engine.transactions.plus_loads`)."""
        load = _open_on(transaction.connection).load
        if event.kind == LOADED:
            load.take(self._book, event, transaction, code)
        elif event.kind == CONFIRMED:
            load.confirm(transaction, code)
        elif event.kind == SEQUENCE_BEGUN:
            load.begun(transaction)
        else:
            load.ended(self._book, transaction)

    def _delete(self, event: Event, transaction: Transaction) -> None:
        here = _open_on(transaction.connection)
        operation = here.objects.pop(event.object_id, None)
        if operation is None:
            return
        here.pushing = None
        self._count -= 1
        if not operation.result:
            operation._add(transaction)
            self._book.settle(operation, transaction, DONE, FAILED)

    def _list(self, event: Event, transaction: Transaction) -> None:
        """Add the items of a newly written list to the subject of its subscription."""
        operation = _open_on(transaction.connection).objects.get(event.object_id)
        if operation is not None and not operation.result and f" {event.text}," not in f" {operation.subject},":
            operation.subject = f"{operation.subject}, {event.text}"[:MAX_SUBJECT]

    def notified(self, subscription: i64, transaction: Transaction) -> bool:
        """Add a notification to the operation of its subscription; return True if that begins the operation.

        It begins with the first notification of a subscription that was made before the capture.
        """
        here = _open_on(transaction.connection)
        operation = here.pushing
        if operation is None or here.notified != subscription:
            operation = here.objects.get(int(subscription))
            if operation is None:
                return self._begin_before(subscription, transaction)
            here.pushing = operation
            here.notified = subscription
        if not operation.result:
            operation._push(transaction, int(transaction.response_size))
        return False

    def _begin_before(self, subscription: int, transaction: Transaction) -> bool:
        """Begin an operation with the first notification of a subscription that was made before the capture.

        Return False if it may have been made later, or too many operations are open.
        """
        connection = transaction.connection
        if not connection.mid_stream or subscription < 0 or len(connection.operations.these) >= kinds.MAX_OPEN:
            return False
        told = transaction._plus_halves()[1]
        alarms = told is not None and any([one.class_id == ALARM for one in told.contents.objects])
        subject = f"subscription 0x{subscription:08x} from before the capture"
        kind = kinds.MESSAGES if alarms else kinds.CYCLIC
        operation = self._book.begin(kind, str(subscription), transaction, subject)
        operation.asked_by = int(connection.client_side)
        operation._count_push(transaction, int(transaction.response_size))
        self._remember(subscription, transaction, operation)
        return True

    def _remember(self, object_id: int, transaction: Transaction, operation: Operation) -> None:
        """Keep an operation until its object is deleted."""
        if self._count >= self._most:
            self._sweep()
        here = _open_on(transaction.connection)
        here.pushing = None
        if object_id not in here.objects:
            self._count += 1
        here.objects[object_id] = operation
        self._holding[here.number] = here

    def _sweep(self) -> None:
        """Forget the operations that the book itself has closed."""
        self._count = 0
        for number, here in list(self._holding.items()):
            here.pushing = None
            here.objects = {key: one for key, one in here.objects.items() if not one.result}
            self._count += len(here.objects)
            if not here.objects:
                del self._holding[number]
        self._most = max(_MANY, 2 * self._count)

    def polled(self, session: PlusSession, transaction: Transaction) -> Reads:
        """Take a read of variables; the third read of the same ones begins an operation. Return what it requests."""
        octets = transaction.request_octets
        here = _open_on(transaction.connection)
        poll = here.latest
        if poll is None or not reads_again(octets, poll.asked, poll.read):
            read = Reads(check(octets))
            asked = addresses_in(octets, read.place)
            key = asked
            if len(asked) > _LARGEST:
                from hashlib import blake2b  # rarely used, and it loads OpenSSL

                key = blake2b(asked, digest_size=16).digest()
                asked = b""
            poll = here.polls.get(key)
            if poll is None:
                self._first(here, key, Poll(transaction, asked, read))
                return read
            poll.read = read
            here.latest = poll
        self._again(poll, session, transaction)
        return poll.read

    def _first(self, here: PlusOpen, key: bytes, poll: Poll) -> None:
        """Take the first read of these variables on a connection."""
        if self._poll_count >= MAX_POLLS:
            self._forget_poll()
        if len(here.polls) == 0:
            self._polling[here.number] = here
        here.latest = here.polls[key] = poll
        self._poll_count += 1

    def _again(self, poll: Poll, session: PlusSession, transaction: Transaction) -> None:
        """Take a further read of the same variables."""
        poll.count += 1
        operation = poll.operation
        if operation is not None:
            if not operation.result:
                operation._add(transaction)
        elif poll.count >= _POLLED:
            labels = [session.label(address) for address in _addresses(poll, transaction)]
            operation = self._book.begin(kinds.POLLING, "", transaction, ", ".join(labels)[:MAX_SUBJECT])
            operation.begin_ns = poll.time_ns
            operation.first_frame = poll.frame
            operation.parts = poll.count
            operation.transactions[:0] = poll.numbers
            poll.numbers = []
            poll.operation = operation
        else:
            poll.numbers.append(int(transaction.number))

    def finish(self, connection: Connection) -> None:
        """A connection is over but its operations are still open: close a load that needs no further step."""
        here = connection.operations.plus
        if here is not None and not here.load.in_sequence:
            here.load.close(self._book)

    def end(self, connection: Connection) -> None:
        """A connection is over: forget its polls and operations, which the book closes."""
        here = connection.operations.plus
        if here is None:
            return
        if self._holding.pop(here.number, None) is not None:
            self._count -= len(here.objects)
        if self._polling.pop(here.number, None) is not None:
            self._poll_count -= len(here.polls)
        connection.operations.plus = None

    def _forget_poll(self) -> None:
        """Forget the oldest poll of the connection that began to poll first."""
        number = next(iter(self._polling))
        here = self._polling[number]
        del here.polls[next(iter(here.polls))]
        here.latest = None
        self._poll_count -= 1
        if not here.polls:
            del self._polling[number]


def _addresses(poll: Poll, transaction: Transaction) -> list[VariableAddress]:
    """Return the addresses that a poll reads; ``transaction`` is one of its reads."""
    if poll.asked and poll.read.sound:
        return addresses_of(poll.asked)
    return parse_contents(parse_plus(transaction.request_octets), False).addresses


def _open_on(connection: Connection) -> PlusOpen:
    """Return the unfinished operations and the polls of a connection."""
    going = connection.operations
    here = going.plus
    if here is None:
        here = going.plus = PlusOpen(int(connection.number))
    return here
