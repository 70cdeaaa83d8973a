"""Operations of S7comm-plus: sessions, subscriptions with their notifications, blocks loaded, read out and deleted, test jobs.

Which transaction is which is known to `dissect.s7plus.events`.
"""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.s7plus.alarms import ALARM
from dissect.s7plus.assembly import MAX_PDU
from dissect.s7plus.bodies import parse_contents
from dissect.s7plus.contents import Address
from dissect.s7plus.events import (
    CHANGED,
    DELETED,
    LISTED,
    ORDERED,
    PASSWORD,
    READ_OUT,
    RESET,
    SESSION,
    START,
    STOP,
    STREAMED,
    SUBSCRIBED,
    SUBSCRIBED_ALARMS,
    TEST_JOB,
    Event,
)
from dissect.s7plus.message import INTEGRITY_SIZE, parsed
from dissect.s7plus.pieces import addresses_of
from dissect.s7plus.refusals import glimpse, reads_again
from dissect.s7plus.session import PlusSession
from dissect.s7plus.skimming import PLACE
from dissect.s7plus.tables import V3
from dissect.transactions import operation as kinds
from dissect.transactions.connection import Connection
from dissect.transactions.operation import DONE, FAILED, MAX_SUBJECT, NOT_CAPTURED, REFUSED, Operation, OperationBook
from dissect.transactions.transaction import ANSWERED, PUSH, Transaction

#: Kinds of operations by events that begin one.
_KINDS: Final[dict[str, str]] = {
    SESSION: kinds.SESSION,
    SUBSCRIBED: kinds.CYCLIC,
    SUBSCRIBED_ALARMS: kinds.MESSAGES,
    TEST_JOB: kinds.TEST_JOB,
    CHANGED: kinds.DOWNLOAD,
    READ_OUT: kinds.UPLOAD,
    STREAMED: kinds.TRANSFER,
    PASSWORD: kinds.PASSWORD,
    STOP: kinds.CONTROL,
    START: kinds.CONTROL,
    RESET: kinds.CONTROL,
    ORDERED: kinds.CONTROL,
}
#: Those that go on until their object is deleted; the others are over with their transaction.
_LASTING: Final = frozenset((SESSION, SUBSCRIBED, SUBSCRIBED_ALARMS, TEST_JOB))
#: How the order numbers of panels begin: who gets a stream says of itself that it is one.
_PANELS: Final = "6AV"
_DELETE: Final = "delete "
_LOAD: Final = "load "
#: Reads of the same variables that make it polling, and different ones that are remembered.
_POLLED: Final = 3
MAX_POLLS: Final = 1024
#: Operations that go on, after which those that are over are sought.
_MANY: Final = 1024
#: Octets up to which everything that passed of an answer is kept; of a larger one that ends too soon the rest may have passed.
_ALL_KEPT: Final = MAX_PDU - 0x10004
#: Octets of addresses that a poll is known by; of more there is a digest, as a request may have 8 MiB.
_LARGEST: Final = 2048
#: Where the body of a request begins (in version 3 behind the integrity part), and what ends the addresses in it.
_BODY: Final = 18
_QUALIFIER: Final = b"\x00\x00\x04\xe8"
_THIRD: Final = 0x04
_LAST: Final = 0xE8


class Poll:
    """How often the same variables were read, and the operation that this is, None at first.

    ``asked`` is what is asked for, empty where that is known by a digest; ``read`` what `dissect.s7plus.refusals.glimpse` says
    of such a request. ``numbers`` are those of the transactions before the operation began.
    """

    __slots__ = ("asked", "count", "frame", "numbers", "operation", "read", "time_ns")

    def __init__(self, transaction: Transaction, asked: bytes, read: i64) -> None:
        self.asked = asked
        self.read: i64 = read
        self.count: i64 = 1
        self.frame: i64 = transaction.request_frame
        self.time_ns: i64 = transaction.request_ns
        self.numbers: list[int] = [int(transaction.number)]
        self.operation: Operation | None = None


class PlusOpen:
    """What goes on on a connection: operations by their object, and what is read, by what is asked for.

    The subscription that was notified last and what was read last mostly are the next ones as well: ``notified`` is the object
    of ``pushing``, ``latest`` what was read.
    """

    __slots__ = ("latest", "notified", "number", "objects", "polls", "pushing")

    def __init__(self, number: int) -> None:
        self.number = number  # of the connection
        self.objects: dict[int, Operation] = {}
        self.notified: i64 = -1
        self.pushing: Operation | None = None
        self.polls: dict[bytes, Poll] = {}
        self.latest: Poll | None = None


def _begin_at_first_frame(operation: Operation, transaction: Transaction) -> int:
    """Let an operation begin with the first frame of its request; return the octets of that which were not kept."""
    begun = transaction.connection.begun
    found = begun.get((int(transaction.pdu_ref), int(transaction.request_frame))) if begun is not None else None
    if found is None:
        return 0
    operation.first_frame, operation.begin_ns, left_out = found
    return left_out


def addresses_in(octets: bytes, end: i64 = 0) -> bytes:
    """Return what a read asks for: its body up to the qualifier, which begins at ``end``; 0 where that is to be found."""
    size: i64 = len(octets)
    begin: i64 = _BODY
    if size > 1 and octets[1] == V3:
        begin += INTEGRITY_SIZE
    if end > 0:
        return octets[begin:end]
    at: i64 = begin + len(_QUALIFIER) - 1  # of the last octet that may be one of it
    while at < size:  # several times as fast as `bytes.find`: what stands there says how far away it is at least
        octet: i64 = octets[at]
        if octet == _LAST and octets[at - len(_QUALIFIER) + 1 : at + 1] == _QUALIFIER:
            return octets[begin : at - len(_QUALIFIER) + 1]
        if octet == _THIRD:
            at += 1
        elif octet == 0:
            at += 2
        else:
            at += len(_QUALIFIER)
    return octets[min(begin, size) :]


class PlusOperations:
    """Follows the operations of all connections that speak S7comm-plus."""

    def __init__(self, book: OperationBook) -> None:
        self._book = book
        self._holding: dict[int, PlusOpen] = {}  # those with operations that go on, by connection
        self._count = 0  # of these operations
        self._most = _MANY
        self._polling: dict[int, PlusOpen] = {}  # those that read, by connection
        self._poll_count = 0

    def take(self, event: Event, session: PlusSession, transaction: Transaction, code: int) -> None:
        """Take an event of a transaction: it may begin an operation, or end one. ``code`` is the error it got, 0 for none."""
        if event.kind == DELETED:
            self._delete(event, transaction)
            return
        if event.kind == LISTED:
            self._list(event, transaction)
            return
        kind = _KINDS.get(event.kind, "")
        subject = session.describe() if event.kind == SESSION else event.text
        if event.kind == STREAMED and session.identity.order_number.startswith(_PANELS):
            subject = f"panel {session.identity.order_number}: {subject}"
        if event.kind == CHANGED:
            kind = kinds.DELETE if subject.startswith(_DELETE) else kinds.DOWNLOAD
            subject = subject.removeprefix(_DELETE).removeprefix(_LOAD)
        if not kind:
            return
        operation = self._book.begin(kind, str(event.object_id), transaction, subject[:MAX_SUBJECT])
        if kind in {kinds.DOWNLOAD, kinds.TRANSFER}:
            left_out = _begin_at_first_frame(operation, transaction)
            operation.octets = int(transaction.request_size) + left_out
            if kind == kinds.DOWNLOAD:
                self._book.gather(operation, transaction.request_octets)
                operation.dropped += left_out
        elif kind == kinds.UPLOAD:
            operation.octets = int(transaction.response_size)
            self._book.gather(operation, transaction.response_octets)
            if transaction.response_size <= _ALL_KEPT and not parsed(transaction.response_octets).whole:
                self._book.close(operation, NOT_CAPTURED)
                return
        if kind == kinds.TRANSFER and transaction.outcome == PUSH:
            self._book.close(operation, DONE)  # no answer was wanted
        elif event.kind not in _LASTING or transaction.outcome != ANSWERED or transaction.error_code >= 0x8000:
            self._book.settle(operation, transaction, DONE, REFUSED, code)
        else:
            self._remember(event.object_id, transaction, operation)

    def _delete(self, event: Event, transaction: Transaction) -> None:
        here = _open_on(transaction.connection)
        operation = here.objects.pop(event.object_id, None)
        if operation is None:
            return
        here.pushing = None
        self._count -= 1
        if not operation.result:
            operation.add(transaction)
            self._book.settle(operation, transaction, DONE, FAILED)

    def _list(self, event: Event, transaction: Transaction) -> None:
        """Name what a subscription asks for since its list was written."""
        operation = _open_on(transaction.connection).objects.get(event.object_id)
        if operation is not None and not operation.result and f" {event.text}," not in f" {operation.subject},":
            operation.subject = f"{operation.subject}, {event.text}"[:MAX_SUBJECT]

    def notified(self, subscription: i64, transaction: Transaction) -> bool:
        """Count a notification for its subscription; True for the first of one that was made before the capture."""
        here = _open_on(transaction.connection)
        operation = here.pushing
        if operation is None or here.notified != subscription:
            operation = here.objects.get(int(subscription))
            if operation is None:
                return self._begin_before(subscription, transaction)
            here.pushing = operation
            here.notified = subscription
        if not operation.result:
            operation.push(transaction, int(transaction.response_size))
        return False

    def _begin_before(self, subscription: int, transaction: Transaction) -> bool:
        """Begin an operation with the first notification of a subscription that was made before the capture began.

        Returns False where it may have been made later, or there are too many.
        """
        connection = transaction.connection
        if not connection.mid_stream or subscription < 0 or len(connection.operations.these) >= kinds.MAX_OPEN:
            return False
        told = transaction.plus_halves()[1]
        alarms = told is not None and any([one.class_id == ALARM for one in told.contents.objects])
        subject = f"subscription 0x{subscription:08x} from before the capture"
        kind = kinds.MESSAGES if alarms else kinds.CYCLIC
        operation = self._book.begin(kind, str(subscription), transaction, subject)
        operation.asked_by = int(connection.client_side)
        operation.count_push(transaction, int(transaction.response_size))
        self._remember(subscription, transaction, operation)
        return True

    def _remember(self, object_id: int, transaction: Transaction, operation: Operation) -> None:
        """Keep an operation until its object is deleted. What the book has closed by itself leaves when there are many."""
        if self._count >= self._most:
            self._sweep()
        here = _open_on(transaction.connection)
        here.pushing = None
        if object_id not in here.objects:
            self._count += 1
        here.objects[object_id] = operation
        self._holding[here.number] = here

    def _sweep(self) -> None:
        """Forget what the book has closed by itself."""
        self._count = 0
        for number, here in list(self._holding.items()):
            here.pushing = None
            here.objects = {key: one for key, one in here.objects.items() if not one.result}
            self._count += len(here.objects)
            if not here.objects:
                del self._holding[number]
        self._most = max(_MANY, 2 * self._count)

    def polled(self, session: PlusSession, transaction: Transaction) -> i64:
        """Take a read of variables: the third of the same ones, each soon after the other, begins an operation.

        Returns what `dissect.s7plus.refusals.glimpse` says of its request.
        """
        octets = transaction.request_octets
        here = _open_on(transaction.connection)
        poll = here.latest
        if poll is None or not reads_again(octets, poll.asked, poll.read):
            read: i64 = glimpse(octets)
            asked = addresses_in(octets, read >> PLACE)
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
        """Take what was not read before on this connection."""
        if self._poll_count >= MAX_POLLS:
            self._forget_poll()
        if len(here.polls) == 0:
            self._polling[here.number] = here
        here.latest = here.polls[key] = poll
        self._poll_count += 1

    def _again(self, poll: Poll, session: PlusSession, transaction: Transaction) -> None:
        """Count what was read before."""
        poll.count += 1
        operation = poll.operation
        if operation is not None:
            if not operation.result:
                operation.add(transaction)
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

    def end(self, connection: Connection) -> None:
        """A connection is over: what is open there is closed by the book."""
        here = connection.operations.plus
        if here is None:
            return
        if self._holding.pop(here.number, None) is not None:
            self._count -= len(here.objects)
        if self._polling.pop(here.number, None) is not None:
            self._poll_count -= len(here.polls)
        connection.operations.plus = None

    def _forget_poll(self) -> None:
        """Forget the first poll of the connection that polled first."""
        number = next(iter(self._polling))
        here = self._polling[number]
        del here.polls[next(iter(here.polls))]
        here.latest = None
        self._poll_count -= 1
        if not here.polls:
            del self._polling[number]


def _addresses(poll: Poll, transaction: Transaction) -> list[Address]:
    """Return what is read."""
    if poll.asked and poll.read >> PLACE:
        return addresses_of(poll.asked)
    return parse_contents(parsed(transaction.request_octets), False).addresses


def _open_on(connection: Connection) -> PlusOpen:
    """Return what goes on on a connection."""
    going = connection.operations
    here = going.plus
    if here is None:
        here = going.plus = PlusOpen(int(connection.number))
    return here
