"""The observer: who is told what happens. The engine itself never prints or writes; outputs override what they want to know."""

from __future__ import annotations

from mypy_extensions import i64, mypyc_attr

from dissect.findings.reporter import Finding
from dissect.stations.facts import Book, Fact
from dissect.transactions.connection import Connection
from dissect.transactions.operation import Operation
from dissect.transactions.payloads import ScdMessage
from dissect.transactions.side import Side
from dissect.transactions.transaction import Transaction


@mypyc_attr(allow_interpreted_subclasses=True)
class Observer:
    """Gets every event; override the methods you need. The ``wants_`` flags must be set before the first packet.

    ``own_book`` is for who keeps what stations say: a book that is given here before the pipeline is made has noted each fact
    before `fact` is told of it, and two need not be kept. Who looks at nothing else of facts clears ``wants_facts``.
    """

    def __init__(self) -> None:
        self.own_book: Book | None = None
        self.wants_facts: bool = True
        self.wants_pdus: bool = False
        self.wants_tpdus: bool = False

    def connection_opened(self, connection: Connection) -> None:
        """ISO-on-TCP or IBH-NetLink was recognised on a connection."""

    def connection_closed(self, connection: Connection) -> None:
        """A connection is over; all its transactions were reported before."""

    def tpdu(self, frame: i64, time_ns: i64, side: Side, octets: bytes) -> None:
        """A whole TPKT, header included (only with ``wants_tpdus``)."""

    def ibh_packet(self, frame: i64, time_ns: i64, side: Side, octets: bytes) -> None:
        """A whole IBH-NetLink packet, header included (only with ``wants_tpdus``)."""

    def pdu(self, frame: i64, time_ns: i64, side: Side, octets: bytes, cut: bool) -> None:
        """A whole S7 PDU, or one the capture cut (only with ``wants_pdus``)."""

    def plus_pdu(self, frame: i64, time_ns: i64, side: Side, octets: bytes, cut: bool) -> None:
        """A whole S7comm-plus PDU, its frames one behind the other, or what is known of one (only with ``wants_pdus``)."""

    def scd(self, frame: i64, time_ns: i64, side: Side, found: ScdMessage) -> None:
        """An SCD message of its own, not in an S7 item (only with ``wants_pdus``)."""

    def transaction(self, transaction: Transaction) -> None:
        """A transaction is complete, or given up."""

    def operation(self, operation: Operation) -> None:
        """An operation, several transactions that belong together, is over."""

    def finding(self, finding: Finding) -> None:
        """Something deserves attention."""

    def fact(self, fact: Fact) -> None:
        """A station said something of itself, new or not, behind what it was said in (unless ``wants_facts`` is cleared)."""

    def comment(self, frame: i64, text: str) -> None:
        """The capture holds a comment about a packet."""
