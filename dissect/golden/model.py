"""A recorded session, of a capture or a golden: connections, and on each the transactions in the order they were asked in.

What compares sessions, serves them and plays them again reads this one model.

The octets of both PDUs, without their references (`dissect.golden.masking`), are the truth; items, values and errors are read
from them when somebody looks, by the parsers that read captures. Transactions that say the same share one `Exchange`.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final, NamedTuple

from dissect.golden.exchange import Exchange, ItemRecord
from dissect.transactions.transaction import HOLE, SURE
from dissect.wire.errors import Error

#: Transactions of a session, and octets of its distinct exchanges; what is longer is no test any more.
MAX_TRANSACTIONS: Final = 1_000_000
MAX_OCTETS: Final = 256 * 1024 * 1024


class GoldenError(Error):
    """A golden that cannot be read, or a capture that cannot become one: says where and what to do."""


class Span(NamedTuple):
    """Where a connection stood in its capture: its number there, first and last packet, and their times since 1970.

    Where its end was not captured, the last packet of it counts.
    """

    number: int
    first_frame: int
    first_ns: int
    last_frame: int
    last_ns: int


class Tpdus(NamedTuple):
    """What a golden has in words: the TPDUs around the messages of a connection, without TPKT, empty where not captured.

    ``requested`` tells that a connect request was seen, ``confirm`` is what the server answered to it (CC, DR or ER),
    ``farewell`` the last DR or ER of the side that ended it. ``pdu_length`` is what counted at the end.
    """

    requested: bool = False
    confirm: bytes = b""
    farewell: bytes = b""
    pdu_length: int = 0


class Transaction:
    """A request and its answer, either of which may be missing.

    ``number`` counts from 1 over the session, in its order; ``asked_by`` is ``client`` or ``server``; ``outcome`` and
    ``reason`` are those of `dissect.transactions`. ``certainty`` and ``doubt``, which are too, belong to one recording, as does
    what is None where it is not known: ``time_ns`` of the request (of the answer when there is none), nanoseconds since 1970;
    ``latency_ns``; ``pdu_ref``; ``recorded``, both PDUs
    with their references. ``frame`` is the packet it began with, ``place`` the one by which it stands in order, ``last_frame``
    the one it was over with; 0 where not known.
    """

    __slots__ = (
        "asked_by",
        "certainty",
        "connection",
        "doubt",
        "exchange",
        "frame",
        "last_frame",
        "latency_ns",
        "number",
        "outcome",
        "pdu_ref",
        "place",
        "reason",
        "recorded",
        "time_ns",
    )

    def __init__(self, connection: Link, asked_by: str, exchange: Exchange, outcome: str, reason: str = "") -> None:
        self.connection = connection
        self.asked_by = asked_by
        self.exchange = exchange
        self.outcome = outcome
        self.reason = reason
        self.certainty = SURE if outcome == "answered" or (outcome == "unanswered" and reason == HOLE) else ""
        self.doubt = ""
        self.number = 0
        self.frame = 0
        self.place = 0
        self.last_frame = 0
        self.recorded: tuple[bytes, bytes] | None = None
        self.time_ns: int | None = None
        self.latency_ns: int | None = None
        self.pdu_ref: int | None = None

    @property
    def function(self) -> int:
        """The function octet, -1 where there is none."""
        return self.exchange.function

    @property
    def function_name(self) -> str:
        """Name of the function."""
        return self.exchange.function_name

    @property
    def items(self) -> list[ItemRecord]:
        """Items of a read or write with their values."""
        return self.exchange.items

    @property
    def request(self) -> bytes:
        """The request's PDU without its references, empty when there is none."""
        return self.exchange.request

    @property
    def response(self) -> bytes:
        """The answer's PDU without its references, empty when there is none."""
        return self.exchange.response

    @property
    def error_code(self) -> int:
        """The code by which the answer as a whole says no, 0 when it does not."""
        return self.exchange.error_code

    @property
    def scd(self) -> tuple[str, ...]:
        """SCD that was decoded in it, a line each."""
        return self.exchange.scd

    def __repr__(self) -> str:
        return f"Transaction({self.number}, {self.function_name}, {self.outcome})"


class Link:
    """A connection: who speaks (TSAPs as octets, None where not captured), what was negotiated, how it ended.

    ``carrier`` is ``tcp``, ``udp`` or ``ibh``; ``begun`` tells that its beginning was captured; sizes are 0 where not
    negotiated. ``ended`` is how (`dissect.transactions.ending`), ``ended_by`` ``client``, ``server`` or empty, ``farewell`` a
    DR or ER in words. ``addresses`` of client and server are those of one recording, empty where not known; so are ``span``
    and ``tpdus``, None where not known.
    """

    __slots__ = (
        "addresses",
        "begun",
        "called",
        "calling",
        "carrier",
        "ended",
        "ended_by",
        "farewell",
        "number",
        "protocol",
        "refused",
        "span",
        "tpdu_size",
        "tpdu_size_asked",
        "tpdus",
        "transactions",
    )

    def __init__(self) -> None:
        self.number = 0
        self.protocol = ""
        self.carrier = "tcp"
        self.calling: bytes | None = None
        self.called: bytes | None = None
        self.addresses: tuple[str, str] = ("", "")
        self.begun = False
        self.tpdu_size = 0
        self.tpdu_size_asked = 0
        self.refused = ""
        self.ended = ""
        self.ended_by = ""
        self.farewell = ""
        self.span: Span | None = None
        self.tpdus: Tpdus | None = None
        self.transactions: list[Transaction] = []

    @property
    def who(self) -> tuple[str, str, bytes | None, bytes | None]:
        """Protocol, carrier and TSAPs: what tells it from others in every recording."""
        return self.protocol, self.carrier, self.calling, self.called


class Session:
    """Connections in their canonical order, and the distinct exchanges on them."""

    __slots__ = ("_exchanges", "_messages", "_octets", "_total", "damage", "links", "name")

    def __init__(self, name: str = "") -> None:
        self.name = name
        self.damage: list[str] = []  # what was wrong with the files it was read from
        self.links: list[Link] = []
        self._exchanges: dict[tuple[str, bytes, bytes, tuple[str, ...], bool, bool, bytes], Exchange] = {}
        self._messages: dict[bytes, bytes] = {}
        self._octets = 0
        self._total = 0

    @property
    def transactions(self) -> list[Transaction]:
        """All transactions, connection by connection."""
        return [transaction for link in self.links for transaction in link.transactions]

    @property
    def as_begun(self) -> list[Link]:
        """The connections in the order in which they began; of a golden, in which they stand."""
        return sorted(self.links, key=lambda link: link.span.number if link.span is not None else 0)

    def share(self, exchange: Exchange) -> Exchange:
        """Return the exchange that says the same, which is ``exchange`` itself when it is new.

        Raises GoldenError when the session is too long (`MAX_TRANSACTIONS`, `MAX_OCTETS`).
        """
        self._total += 1
        if self._total > MAX_TRANSACTIONS:
            message = f"{self.name}: more than {MAX_TRANSACTIONS} transactions; cut it first (s7dissect cut)"
            raise GoldenError(message)
        key = (
            exchange.kind,
            exchange.request,
            exchange.response,
            exchange.scd,
            exchange.request_seen,
            exchange.response_seen,
            exchange.subscribed,
        )
        found = self._exchanges.get(key)
        if found is not None:
            return found
        size = len(exchange.request) + len(exchange.response)
        self._take(size + sum([len(line) for line in exchange.scd]) if exchange.scd else size)
        self._exchanges[key] = exchange
        return exchange

    def keep(self, octets: bytes) -> bytes:
        """Return a message as it was recorded; of equal ones the first. Raises GoldenError as `share` does."""
        known = self._messages.setdefault(octets, octets)
        if known is octets:
            self._take(len(octets))
        return known

    def _take(self, size: int) -> None:
        self._octets += size
        if self._octets > MAX_OCTETS:
            message = (
                f"{self.name}: more than {MAX_OCTETS >> 20} MiB of distinct messages; cut it first (s7dissect cut)"
            )
            raise GoldenError(message)

    def arrange(self, links: Iterable[Link]) -> None:
        """Take the connections in this order and number them and their transactions."""
        self.links = list(links)
        number = 0
        for index, link in enumerate(self.links, 1):
            link.number = index
            for transaction in link.transactions:
                number += 1
                transaction.number = number
