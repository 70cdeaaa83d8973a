"""Object numbers that belong to one recording of an S7comm-plus session, and their meanings.

In each recording, a device gives new numbers to the sessions and subscriptions that clients create, and a client numbers the
variables of a subscription as it likes. A comparison maps the numbers of objects from one recording to the other, and names
variables as they were requested.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Final

from dissect.protocols.s7plus.bodies import parse_contents
from dissect.protocols.s7plus.events import take
from dissect.protocols.s7plus.layouts import (
    ADDRESS,
    EXPLORE_HEAD,
    INVOKE_HEAD,
    ITEM_COUNTS,
    LINK_REQUEST,
    OBJECT_ID,
    OBJECT_ID_VLQ,
    SECOND_PART,
)
from dissect.protocols.s7plus.message import PlusPdu, parse_plus
from dissect.protocols.s7plus.program import Program
from dissect.protocols.s7plus.session import Identity, PlusSession
from dissect.protocols.s7plus.tables import CREATE_OBJECT, NOTIFICATION, V1
from dissect.testing.golden.exchange import PLUS, Exchange
from dissect.testing.golden.model import Link, Transaction
from dissect.testing.golden.plus import Names
from dissect.wire.varint import VLQ, build_varint

#: Parts with the id of an object, and the field that holds it.
_FIELDS: Final = {
    id(layout): name
    for layout, name in (
        (OBJECT_ID, "rid"),
        (OBJECT_ID_VLQ, "rid"),
        (ITEM_COUNTS, "link"),
        (ADDRESS, "area"),
        (LINK_REQUEST, "rid"),
        (EXPLORE_HEAD, "rid"),
        (INVOKE_HEAD, "sub_session"),
        (SECOND_PART, "object_id"),
    )
}
#: Stable numbers of both sizes; each is as long as a number from a device, so that positions stay the same.
_STABLE: Final = 0x7FFE0000
_STABLE_SMALL: Final = 0x3000
_SMALL: Final = 0x4000
#: Maximum number of objects of a connection that are tracked.
MAX_OBJECTS: Final = 4096


def made(exchange: Exchange) -> list[int]:
    """Return the ids that a device gave to the objects a request created, in order."""
    response = exchange.plus[1]
    if response is None or response.function != CREATE_OBJECT:
        return []
    return parse_contents(response, False).ids


class Objects:
    """The objects created on the connections of a session, and the names of the variables subscribed there."""

    def __init__(self) -> None:
        self._stable: dict[Link, dict[int, int]] = {}
        self._names: dict[Link, dict[int, Names]] = {}
        self._exchanges: dict[tuple[Link, Exchange], Exchange] = {}

    def stable(self, transaction: Transaction) -> Exchange:
        """Return the exchange of a transaction with a stable number for each object that was created on its connection."""
        exchange = transaction.exchange
        if exchange.kind != PLUS:
            return exchange
        key = transaction.connection, exchange
        exchange_ = self._exchanges.get(key)
        if exchange_ is None:
            exchange_ = renumbered(exchange, self._stable_of(transaction.connection))
            self._exchanges[key] = exchange_
        return exchange_

    def _stable_of(self, link: Link) -> dict[int, int]:
        """Return the stable number for each id; it counts the objects that the device created before."""
        numbers = self._stable.get(link)
        if numbers is None:
            numbers = {}
            for id_ in _all_made(link.transactions):
                if id_ not in numbers and len(numbers) < MAX_OBJECTS:
                    numbers[id_] = (_STABLE_SMALL if id_ < _SMALL else _STABLE) + len(numbers)
            self._stable[link] = numbers
        return numbers

    def names(self, transaction: Transaction) -> Names:
        """Return the names for the references of a notification, empty if its subscription is unknown."""
        link = transaction.connection
        names = self._names.get(link)
        if names is None:
            names = _subscribed(link)
            self._names[link] = names
        return names.get(transaction.number, {})


class NamedPair:
    """A pair of transactions, with the names for the references in their notifications."""

    def __init__(self, objects: Objects, a: Transaction, b: Transaction) -> None:
        self._objects = objects
        self._pair = a, b

    def both(self) -> tuple[Names, Names]:
        """Return the names for the references of both, empty if the subscription is unknown."""
        return self._objects.names(self._pair[0]), self._objects.names(self._pair[1])


def with_objects(transaction: Transaction, numbers: Mapping[int, int]) -> Transaction:
    """Return a transaction with different object numbers; the transaction itself if it contains none of them."""
    exchange = renumbered(transaction.exchange, numbers)
    if exchange is transaction.exchange:
        return transaction
    copy = Transaction(transaction.connection, transaction.asked_by, exchange, transaction.outcome, transaction.reason)
    copy.number = transaction.number
    copy.latency_ns = transaction.latency_ns
    copy.certainty, copy.doubt = transaction.certainty, transaction.doubt
    return copy


def _all_made(transactions: Iterable[Transaction]) -> list[int]:
    return [id_ for each in transactions if each.exchange.kind == PLUS for id_ in made(each.exchange)]


def _subscribed(link: Link) -> dict[int, Names]:
    """Return, for each notification of a connection, the names of the items of its subscription."""
    session = PlusSession(Program(), Identity())
    subscribed: dict[int, Names] = {}
    known: dict[int, Names] = {}
    for each in link.transactions:
        exchange = each.exchange
        if exchange.kind != PLUS:
            continue
        request, response = exchange.plus
        if request is not None:
            facts = take(session, request.function, exchange.request, exchange.response)
            if facts is not None:
                known = {}  # from now on the list may be different
        elif response is not None and response.opcode == NOTIFICATION:
            id_ = response.subscription_id
            names = known.get(id_)
            if names is None:
                references = session.subscriptions.get(id_, {})
                names = {reference: session.label(address) for reference, address in references.items()}
                known[id_] = names
            if names:
                subscribed[each.number] = names
    return subscribed


def same_objects(pairs: Iterable[tuple[Transaction, Transaction]]) -> dict[int, int]:
    """Return the object of the first recording for each object of the second, matched by the requests that created them."""
    same: dict[int, int] = {}
    for one, other in pairs:
        if one.exchange.kind == other.exchange.kind == PLUS and len(same) < MAX_OBJECTS:
            same.update(zip(made(other.exchange), made(one.exchange), strict=False))
    return same


def renumbered(exchange: Exchange, numbers: Mapping[int, int]) -> Exchange:
    """Return an exchange with different object numbers; the exchange itself if it contains none of them."""
    if exchange.kind != PLUS or not numbers:
        return exchange
    request, response = _renumbered(exchange.request, numbers), _renumbered(exchange.response, numbers)
    if request == exchange.request and response == exchange.response:
        return exchange
    seen = exchange.request_seen, exchange.response_seen
    return Exchange(exchange.kind, request, response, exchange.scd, seen, exchange.subscribed)


def _renumbered(octets: bytes, numbers: Mapping[int, int]) -> bytes:
    """Return a PDU with different object numbers; a number that would change its size stays."""
    if not octets:
        return octets
    pdu = parse_plus(octets)
    changed = bytearray(octets)
    if pdu.opcode == NOTIFICATION and pdu.version != V1:
        number = numbers.get(pdu.subscription_id, -1)
        if number >= 0:
            _put(changed, pdu, 1, 5, number.to_bytes(4, "big"))  # after its opcode
    for part in parse_contents(pdu).parts:
        name = _FIELDS.get(id(part.layout))
        field = part.find(name) if name is not None else None
        number = numbers.get(field.value, -1) if field is not None else -1
        if field is not None and number >= 0:
            octets = build_varint(number, VLQ) if field.field.size == VLQ else number.to_bytes(4, "big")
            _put(changed, pdu, field.offset, field.end, octets)
    return bytes(changed)


def _put(changed: bytearray, pdu: PlusPdu, begin: int, end: int, octets: bytes) -> None:
    """Write octets into a PDU if the size stays the same; positions count within its data."""
    if len(octets) == end - begin:
        for at in range(begin, end):
            changed[pdu.place(at)] = octets[at - begin]
