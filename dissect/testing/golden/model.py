"""A recorded session, from a capture or a golden: connections, and on each the transactions in the order of their requests.

Comparison, `serve` and `replay` all read this model.

The octets of both PDUs, without their references (`dissect.testing.golden.masking`), are the reference; items, values and
errors are parsed from them on demand, by the parsers that read captures. Equal transactions share one `Exchange`.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final, NamedTuple

from dissect.engine.transactions.transaction import HOLE, SURE
from dissect.testing.golden.exchange import Exchange, ItemRecord
from dissect.wire.errors import Error

#: Maximum number of transactions of a session, and maximum total size of its distinct exchanges; a test is never larger.
MAX_TRANSACTIONS: Final = 1_000_000
MAX_OCTETS: Final = 256 * 1024 * 1024


class GoldenError(Error):
    """A golden that cannot be read, or a capture that cannot become one; the message says where and what to do."""


class Span(NamedTuple):
    """The position of a connection in its capture: its number, and its first and last packet with their times since 1970.

    If its end was not captured, its last packet is used.
    """

    number: int
    first_frame: int
    first_ns: int
    last_frame: int
    last_ns: int


class Tpdus(NamedTuple):
    """TPDUs around the messages of a connection, without TPKT; empty if not captured. A golden has them in words.

    ``requested``: a connect request was seen. ``confirm`` is the server's answer to it (CC, DR or ER), ``farewell`` the last DR
    or ER of the side that ended the connection. ``pdu_length`` is the PDU length in force at the end.
    """

    requested: bool = False
    confirm: bytes = b""
    farewell: bytes = b""
    pdu_length: int = 0


class Transaction:
    """A request and its answer, either of which may be missing.

    ``number`` counts from 1 over the session, in its order; ``asked_by`` is ``client`` or ``server``; ``outcome`` and
    ``reason`` are those of `dissect.engine.transactions`.

    The other attributes belong to one recording; they are None, empty or 0 if unknown. ``certainty`` and ``doubt`` are those of
    `dissect.engine.transactions`. ``time_ns`` is the time of the request (of the answer if there is no request), in nanoseconds
    since 1970.
    1970. ``recorded`` has both PDUs with their references. ``frame`` is the first packet, ``last_frame`` the packet that
    completed the transaction, and ``place`` the packet that gives its place in the order.
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
        """The function octet, -1 if there is none."""
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
        """The request's PDU without its references, empty if there is none."""
        return self.exchange.request

    @property
    def response(self) -> bytes:
        """The answer's PDU without its references, empty if there is none."""
        return self.exchange.response

    @property
    def error_code(self) -> int:
        """The error code of the whole answer, 0 for success."""
        return self.exchange.error_code

    @property
    def scd(self) -> tuple[str, ...]:
        """The decoded SCD in it, one line per message."""
        return self.exchange.scd

    def __repr__(self) -> str:
        return f"Transaction({self.number}, {self.function_name}, {self.outcome})"


class Link:
    """A connection: its endpoints (TSAPs as octets, None if not captured), the negotiated sizes, and how it ended.

    ``carrier`` is ``tcp``, ``udp`` or ``ibh``. ``begun``: its beginning was captured. Sizes are 0 if not negotiated. ``ended``
    is how it ended (`dissect.engine.transactions.ending`), ``ended_by`` ``client``, ``server`` or empty, ``farewell`` a DR or
    ER in words. ``addresses`` of client and server belong to one recording and are empty if unknown; so do ``span`` and
    ``tpdus``, which are None if unknown.
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
        """Protocol, carrier and TSAPs: they identify the connection in every recording."""
        return self.protocol, self.carrier, self.calling, self.called


class Session:
    """Connections in their canonical order, and the distinct exchanges on them."""

    __slots__ = ("_exchanges", "_messages", "_octets", "_total", "damage", "links", "name")

    def __init__(self, name: str = "") -> None:
        self.name = name
        self.damage: list[str] = []  # damage in the files that the session was read from
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
        """The connections in the order in which they began; for a golden, in the order of its text."""
        return sorted(self.links, key=lambda link: link.span.number if link.span is not None else 0)

    def share(self, exchange: Exchange) -> Exchange:
        """Return the stored exchange equal to ``exchange``, or ``exchange`` itself if it is new.

        Raises GoldenError if the session is too long (`MAX_TRANSACTIONS`, `MAX_OCTETS`).
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
        shared = self._exchanges.get(key)
        if shared is not None:
            return shared
        size = len(exchange.request) + len(exchange.response)
        self._take(size + sum([len(line) for line in exchange.scd]) if exchange.scd else size)
        self._exchanges[key] = exchange
        return exchange

    def keep(self, octets: bytes) -> bytes:
        """Return the stored message equal to this recorded one, or store it. Raises GoldenError as `share` does."""
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
        """Set the order of the connections, and number them and their transactions."""
        self.links = list(links)
        number = 0
        for index, link in enumerate(self.links, 1):
            link.number = index
            for transaction in link.transactions:
                number += 1
                transaction.number = number
