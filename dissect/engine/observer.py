"""`Observer`, which gets the events of the engine. The engine itself never prints or writes; outputs derive from this class."""

from __future__ import annotations

from typing import Any

from mypy_extensions import i64, mypyc_attr

from dissect.engine.acts.act import Act
from dissect.engine.findings.ledger import Ledger
from dissect.engine.findings.reporter import Finding
from dissect.engine.stations.facts import Book, Fact
from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.operation import Operation
from dissect.engine.transactions.payloads import ScdMessage
from dissect.engine.transactions.side import Side
from dissect.engine.transactions.transaction import Transaction
from dissect.wire.copies import derived, keep_out


@mypyc_attr(allow_interpreted_subclasses=True)
class Observer:
    """Gets every event; override the methods you need. The ``wants_`` flags must be set before the first packet.

    An observer that keeps what stations say may set ``own_book`` before the pipeline is made. The engine then writes each fact
    into that book, instead of its own, before it calls `fact`. Clear ``wants_facts`` if the book is enough.

    With ``wants_every_finding`` it gets each finding, before any limit, and each event without a finding (`Finding.bare`). An
    observer that passes on only selected findings has ``own_ledger``, with the facts of these findings.
    """

    def __init__(self) -> None:
        self.own_book: Book | None = None
        self.own_ledger: Ledger | None = None
        self.wants_facts: bool = True
        self.wants_every_finding: bool = False
        self.wants_pdus: bool = False
        self.wants_tpdus: bool = False

    def __reduce__(self) -> tuple[Any, ...]:
        return derived(self)

    def connection_opened(self, connection: Connection) -> None:
        """A connection is recognised as a protocol that the engine reads: ISO-on-TCP, IBH-NetLink, or SCD on a bound port."""

    def connection_closed(self, connection: Connection) -> None:
        """A connection is over; all its transactions were reported before."""

    def tpdu(self, frame: i64, time_ns: i64, side: Side, octets: bytes) -> None:
        """A whole TPKT, header included (only with ``wants_tpdus``)."""

    def ibh_packet(self, frame: i64, time_ns: i64, side: Side, octets: bytes) -> None:
        """A whole IBH-NetLink packet, header included (only with ``wants_tpdus``)."""

    def pdu(self, frame: i64, time_ns: i64, side: Side, octets: bytes, cut: bool) -> None:
        """A whole S7 PDU, or a PDU that the capture cut off (only with ``wants_pdus``)."""

    def plus_pdu(self, frame: i64, time_ns: i64, side: Side, octets: bytes, cut: bool) -> None:
        """A whole S7comm-plus PDU, its frames joined, or the captured part of one (only with ``wants_pdus``)."""

    def scd(self, frame: i64, time_ns: i64, side: Side, found: ScdMessage) -> None:
        """An SCD message that is not in an item of S7 (only with ``wants_pdus``)."""

    def transaction(self, transaction: Transaction) -> None:
        """A transaction is complete, or will never be."""

    def operation(self, operation: Operation) -> None:
        """An operation (several transactions that belong together) is over."""

    def act(self, act: Act) -> None:
        """A client did something to a device, or tried to; comes before the operation of this act, if it took several steps."""

    def finding(self, finding: Finding) -> None:
        """Something deserves attention."""

    def repeated(self, finding: Finding) -> None:
        """Note findings of a rule that were only counted since the last report: ``finding.repeated`` is their number."""

    def fact(self, fact: Fact) -> None:
        """A station stated a fact about itself, new or not; comes after the event that stated it (with ``wants_facts``)."""

    def comment(self, frame: i64, text: str) -> None:
        """The capture holds a comment about a packet."""


keep_out(Observer)
