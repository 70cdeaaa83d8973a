"""The requests that began subscriptions: with a push, `cut` also writes the requests of its subscription, and their answers."""

from __future__ import annotations

from typing import Final

from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.operation import CYCLIC, MESSAGES, TEST_JOB, Operation
from dissect.engine.transactions.operations import subscription_of
from dissect.engine.transactions.transaction import PUSH, Transaction
from dissect.meaning.select.spans import Span
from dissect.protocols.s7plus.events import subscription_of as number_of

#: From this many requests on, those of no running operation are dropped; and the greatest number after that.
_MANY: Final = 2048
MAX_KEPT: Final = 65_536


class Asked:
    """A request with its answer: their packets, the ranges of their octets, and their first and last time."""

    __slots__ = ("connection", "frames", "from_ns", "number", "spans", "to_ns")

    def __init__(self, transaction: Transaction, frames: list[int], spans: list[Span | None]) -> None:
        times = [int(at) for at in (transaction.request_ns, transaction.response_ns) if at]
        self.number = int(transaction.number)
        self.connection: Connection = transaction.connection
        self.frames = frames
        self.spans = spans
        self.from_ns = min(times)
        self.to_ns = max(times)


class SubscriptionBook:
    """Requests that may have begun or changed a subscription, while it runs. ``forgotten`` counts those that `of` missed."""

    def __init__(self) -> None:
        self.forgotten = 0
        self._asked: dict[int, Asked] = {}
        self._look_at = min(_MANY, MAX_KEPT)

    def note(self, transaction: Transaction, frames: list[int], spans: list[Span | None]) -> None:
        """Take a finished transaction; reads, writes and pushes are ignored, as they begin no subscription."""
        if transaction._outcome == PUSH or (transaction.parameters.userdata is None and not transaction.is_plus):
            return
        if len(self._asked) >= self._look_at:
            self._drop()
        self._asked[int(transaction.number)] = Asked(transaction, frames, spans)

    def of(self, push: Transaction) -> list[Asked]:
        """Return the requests of the subscription of a push, if they were captured."""
        running = _notified(push) if push.is_plus else subscription_of(push)
        if running is None:
            return []
        self.forgotten += running.transactions[0] not in self._asked
        return [self._asked[number] for number in running.transactions if number in self._asked]

    def _drop(self) -> None:
        """Forget requests that belong to no running operation."""
        going: dict[int, Operation] = {}
        for one in self._asked.values():
            going.update({id(operation): operation for operation in one.connection.operations.these})
        running = {number for operation in going.values() for number in operation.transactions}
        self._asked = {number: one for number, one in self._asked.items() if number in running}
        if len(self._asked) >= MAX_KEPT:  # a quarter at once, because each time all of them are examined
            self._asked = dict(list(self._asked.items())[MAX_KEPT // 4 :])
        self._look_at = min(max(_MANY, 2 * len(self._asked)), MAX_KEPT)


def _notified(push: Transaction) -> Operation | None:
    """Return the operation of an S7comm-plus notification, None for none."""
    key = str(number_of(push.response_octets))
    going = push.connection.operations
    found = [going.find(kind, key) for kind in (CYCLIC, MESSAGES, TEST_JOB)]
    return next((operation for operation in found if operation is not None), None)
