"""Repeated requests: their frequency and regularity, and the variables that they name."""

from __future__ import annotations

from typing import Final

from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.results import HEADER, NO_CODE, TransactionError
from dissect.engine.transactions.transaction import PUSH, Transaction
from dissect.meaning.report import facets
from dissect.output.page.bins import Spread
from dissect.output.page.rows import ERROR, MISSED, PUSHED, Station, outcome_of, station_of, time_of
from dissect.protocols.s7.items import Item
from dissect.protocols.s7.parameters import Parameters
from dissect.protocols.s7.tables import GROUP_CPU, READ_VAR, WRITE_VAR
from dissect.protocols.s7plus.parameters import PLUS
from dissect.wire.text import titled

#: Maximum number of distinct requests that are followed; if there are more, those with fewer than `REPEATED` repetitions are
#: dropped.
MAX_REQUESTS: Final = 2000
#: A request that came this many times is a poll.
REPEATED: Final = 4
#: Maximum number of refused transactions that are searched for their refused items.
_MAX_LOOKED: Final = 20_000
_READ_SZL: Final = (GROUP_CPU, 1)


class PolledRequest:
    """A request of one connection that may repeat; ``periods`` are the times from one to the next.

    ``parameters`` is the parameter block of the first one. Times across a gap in the capture are left out.
    """

    __slots__ = ("connection", "count", "errors", "last_ns", "missed", "parameters", "periods", "pushed", "subject")

    def __init__(self, connection: Connection, parameters: Parameters, pushed: bool) -> None:
        self.connection = connection
        self.parameters = parameters
        self.pushed = pushed
        self.subject = ""
        self.count = 0
        self.errors = 0
        self.missed = 0
        self.last_ns = -1
        self.periods = Spread()

    @property
    def items(self) -> list[Item]:
        """The items that the request names."""
        return self.parameters.items


def _subject(transaction: Transaction) -> str:
    request = transaction.request
    if transaction.parameters.userdata is None:
        return transaction.parameters.subject
    if request is None:
        return titled(transaction.function_name, facets.gist(transaction))
    return titled(transaction.function_name, facets.body_notes(request))


class PolledVariable:
    """How often one address of one PLC was read, written and refused, and by which clients."""

    __slots__ = ("clients", "read", "refused", "why", "written")

    def __init__(self) -> None:
        self.read = 0
        self.written = 0
        self.refused = 0
        self.why = ""
        self.clients: set[str] = set()


class Requests:
    """The distinct S7comm requests of a run. Polling with S7comm-plus, which numbers its requests, is an operation."""

    def __init__(self) -> None:
        self._known: dict[tuple[int, bool, bytes], PolledRequest] = {}
        self._refused: dict[tuple[Station, str], tuple[int, str]] = {}
        self._looked = 0
        self.not_followed = 0

    def take(self, transaction: Transaction) -> None:
        """Count a transaction."""
        parameters = transaction.parameters
        userdata = parameters.userdata
        if transaction.rosctr >= PLUS:
            return
        if userdata is not None:
            if (
                not (transaction._outcome == PUSH or (userdata.group, userdata.subfunction) == _READ_SZL)
                or userdata.continues
            ):
                return
        elif parameters.function not in {READ_VAR, WRITE_VAR}:
            return
        outcome = outcome_of(transaction)
        connection = transaction.connection
        octets = parameters.octets
        if userdata is not None and transaction.request_size:
            octets = transaction.request_octets[10:]  # the data determine what is requested
        elif outcome == PUSHED:
            octets = transaction.response_octets[:22]  # the head of a push; its data change
        key = (int(connection.number), outcome == PUSHED, octets)
        known = self._known.get(key)
        if known is None:
            if len(self._known) >= MAX_REQUESTS and not self._make_room():
                self.not_followed += 1
                return
            known = self._known.setdefault(key, PolledRequest(connection, parameters, outcome == PUSHED))
            known.subject = _subject(transaction)
        known.count += 1
        now = time_of(transaction)
        if known.last_ns >= 0 and now > known.last_ns:
            known.periods.add(now - known.last_ns)
        known.last_ns = now
        if outcome == ERROR:
            known.errors += 1
            self._look(transaction)
        elif outcome == MISSED:
            known.missed += 1

    def gap(self, connection: int) -> None:
        """Bytes of a connection (0: of all) are missing: do not count the period from the last request to the next."""
        for (number, _, _), known in self._known.items():
            if connection in {0, number}:
                known.last_ns = -1

    def polls(self) -> list[PolledRequest]:
        """Return the requests that are polls, the most frequent first."""
        found = [known for known in self._known.values() if known.periods.count >= REPEATED - 1]
        return sorted(found, key=lambda known: (-known.count, int(known.connection.number), known.subject))

    def variables(self) -> dict[tuple[Station, str], PolledVariable]:
        """Return the variables that were read or written, by PLC and address."""
        found: dict[tuple[Station, str], PolledVariable] = {}
        for known in self._known.values():
            if known.parameters.userdata is not None:
                continue
            server, client = station_of(known.connection), known.connection.client.host
            for item in known.items:
                variable = found.setdefault((server, item.label), PolledVariable())
                variable.clients.add(client)
                if known.parameters.function == WRITE_VAR:
                    variable.written += known.count
                else:
                    variable.read += known.count
        for place, (count, why) in self._refused.items():
            if place in found:
                found[place].refused, found[place].why = count, why
        return found

    @property
    def looked_at_all(self) -> bool:
        """Whether all refused transactions were searched for their refused items."""
        return self._looked <= _MAX_LOOKED

    def _look(self, transaction: Transaction) -> None:
        """Count which items were refused: all items if the request was refused as a whole."""
        self._looked += 1
        if self._looked > _MAX_LOOKED:
            return
        for error in transaction.errors:
            if error.part == HEADER:
                for asked in transaction.parameters.items:
                    self._count(transaction, asked, error)
                return
            results = transaction.s7_results
            item = results[error.item - 1].item if 0 < error.item <= len(results) else None
            if item is not None:
                self._count(transaction, item, error)

    def _count(self, transaction: Transaction, item: Item, error: TransactionError) -> None:
        """Count one item as refused; if the answer has no return code for it, that is unknown."""
        place = (station_of(transaction.connection), item.label)
        if len(self._refused) >= 4 * MAX_REQUESTS and place not in self._refused:
            return
        count, why = self._refused.get(place, (0, ""))
        if error.code == NO_CODE:
            self._refused[place] = (count, why or error.name)
        else:
            self._refused[place] = (count + 1, error.name)

    def _make_room(self) -> bool:
        """Forget requests that came too rarely to be polls; return False if there are none."""
        seldom = [key for key, known in self._known.items() if known.count < REPEATED]
        for key in seldom:
            del self._known[key]
        self.not_followed += len(seldom)
        return bool(seldom)
