"""The terms of a baseline for a transaction: pair of client and server, function, areas, TSAPs."""

from __future__ import annotations

import re
from collections import OrderedDict
from typing import Final

from dissect.engine.transactions import payloads as carried
from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.plus_operations import addresses_in
from dissect.engine.transactions.transaction import PUSH, Transaction
from dissect.protocols.s7.items import Item
from dissect.protocols.s7.parameters import Parameters
from dissect.protocols.s7.syntaxes import DB_READ, SYMBOL
from dissect.protocols.s7.tables import AREA_LETTERS, DB_AREAS, READ_VAR, SYNTAX_IDS, WRITE_VAR
from dissect.protocols.s7plus.ids import AREAS, BLOCK_KINDS, block_name
from dissect.protocols.s7plus.items import WRITES
from dissect.protocols.s7plus.parameters import PlusParameters
from dissect.protocols.s7plus.tables import GET_MULTI_VARIABLES

#: Addresses of client and server, without ports: a client's port changes with each connection.
Pair = tuple[str, str]

_MAX_CACHED: Final = 4096
#: The addresses of S7comm-plus reads up to this many octets are remembered.
_LARGEST: Final = 2048
#: The pairs of this many connections are remembered: findings may come after the end of their connection.
_MAX_CONNECTIONS: Final = 16384
#: Maximum number of characters of a TSAP: real ones have a few octets, but the protocol allows 254.
_MAX_TSAP: Final = 64
#: Beginning or end of the result of `tsaps` if one of the two was not captured.
NOT_CAPTURED_CALLING: Final = "? > "
NOT_CAPTURED_CALLED: Final = " > ?"
_DB: Final = re.compile(r"DB[0-9]+(?=\.)")


class Subject:
    """The name of the function, and the areas that are read and written (``DB12``, ``M``, ``I``), each once, in wire order.

    ``is_push``: the server sends it unsolicited, so it is not a request of the client.
    """

    __slots__ = ("function", "is_push", "reads", "writes")

    def __init__(self, function: str, reads: tuple[str, ...], writes: tuple[str, ...], is_push: bool = False) -> None:
        self.function = function
        self.reads = reads
        self.writes = writes
        self.is_push = is_push


class Subjects:
    """A bounded cache of subjects by parameter block, as polling repeats the same blocks; when it is full, it is emptied.

    The subject of an S7comm-plus transaction depends on its contents: it is cached by function and areas, and that of reads,
    which are frequent, by the octets of their addresses.
    """

    def __init__(self) -> None:
        self._known: dict[Parameters, Subject] = {}
        self._read: dict[bytes, Subject] = {}
        self._said: dict[tuple[int, tuple[str, ...], bool], Subject] = {}

    def of(self, transaction: Transaction) -> Subject:
        """Return the subject of a transaction."""
        parameters = transaction.parameters
        if isinstance(parameters, PlusParameters):
            return self._plus(transaction, parameters)
        known = self._known.get(parameters)
        if known is None:
            if len(self._known) >= _MAX_CACHED:
                self._known.clear()
            known = _subject(transaction)
            self._known[parameters] = known
        return known

    def _plus(self, transaction: Transaction, parameters: PlusParameters) -> Subject:
        size = transaction.request_size
        if parameters.code != GET_MULTI_VARIABLES or transaction._outcome == PUSH or not 0 < size <= _LARGEST:
            return self._of_names(transaction, parameters)
        asked = addresses_in(transaction.request_octets)
        known = self._read.get(asked)
        if known is None:
            if len(self._read) >= _MAX_CACHED:
                self._read.clear()
            known = self._of_names(transaction, parameters)
            self._read[asked] = known
        return known

    def _of_names(self, transaction: Transaction, parameters: PlusParameters) -> Subject:
        key = (int(parameters.code), _plus_areas(transaction), transaction._outcome == PUSH)
        known = self._said.get(key)
        if known is None:
            if len(self._said) >= _MAX_CACHED:
                self._said.clear()
            _, names, push = key
            reads, writes = ((), names) if transaction.function in WRITES else (names, ())
            known = Subject(parameters.statistics_name, reads, writes, push)
            self._said[key] = known
        return known


def _subject(transaction: Transaction) -> Subject:
    parameters = transaction.parameters
    if transaction.is_scd:
        return Subject(carried.TITLE, (), ())
    areas = tuple(dict.fromkeys([name for item in parameters.items for name in area_names(item)]))
    reads = areas if parameters.function == READ_VAR else ()
    writes = areas if parameters.function == WRITE_VAR else ()
    return Subject(parameters.function_name, reads, writes, transaction._outcome == PUSH)


def _plus_areas(transaction: Transaction) -> tuple[str, ...]:
    """Return the blocks and areas of an S7comm-plus read, write or notification; attributes of objects are left out."""
    return tuple(dict.fromkeys([
        AREAS.get(item.address.area) or block_name(item.address.area)
        for item in transaction.plus_results
        if item.address is not None and (item.address.area in AREAS or item.address.area >> 16 in BLOCK_KINDS)
    ]))  # fmt: skip


def area_names(item: Item) -> list[str]:
    """Return the areas of an item: the block for DBs, the letter of other areas, the syntax of items without an area."""
    area = int(item.area)
    if area >= 0:
        letters = AREA_LETTERS.get(area, f"area0x{area:02x}")
        return [f"{letters}{item.db}" if area in DB_AREAS else letters]
    if item.syntax_id == DB_READ:
        return _DB.findall(item.address) or [SYNTAX_IDS.name(int(item.syntax_id))]
    if item.syntax_id == SYMBOL and item.address.startswith("SYM "):
        return [" ".join(item.address.split(" ")[:2])]
    return [SYNTAX_IDS.name(int(item.syntax_id))]


def tsaps(connection: Connection) -> str:
    """Return the TSAPs of a connection, ``01.00 > 01.02``; empty when the connect request was not captured."""
    calling, called = connection.tsap_calling, connection.tsap_called
    if calling is None and called is None:
        return ""
    return " > ".join(["?" if one is None else str(one)[:_MAX_TSAP] for one in (calling, called)])


def moment(transaction: Transaction) -> int:
    """Return the time of a transaction: that of its answer or, without one, of its request."""
    return int(transaction.response_ns or transaction.request_ns)


def pair_of(client: str, server: str) -> Pair | None:
    """Return the pair of two hosts given by their names in findings, which may include a VLAN; None for no hosts."""
    return (client.partition(" ")[0], server.partition(" ")[0]) if client else None


class Pairs:
    """The pairs of the latest connections, by number; bounded."""

    def __init__(self) -> None:
        self._known: OrderedDict[int, tuple[Pair, bool]] = OrderedDict()

    def of(self, connection: Connection) -> Pair:
        """Return the pair of a connection; it may change as long as it is not certain which end is the client."""
        number = int(connection.number)
        known = self._known.get(number)
        if known is not None and (known[1] or not connection.client_known):
            return known[0]
        pair = (connection.client.host, connection.server.host)
        self._known[number] = (pair, connection.client_known)
        if len(self._known) > _MAX_CONNECTIONS:
            self._known.popitem(last=False)
        return pair

    def numbered(self, number: int) -> Pair | None:
        """Return the pair of the connection with this number, None if it is not remembered."""
        known = self._known.get(number)
        return None if known is None else known[0]
