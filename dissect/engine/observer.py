"""Who is told what happens, and what a user can set."""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64, mypyc_attr

from dissect.engine.payload import PayloadDecoder
from dissect.findings.finding import Finding
from dissect.transactions.connection import Connection
from dissect.transactions.naming import Naming
from dissect.transactions.operation import Operation
from dissect.transactions.payloads import ScdMessage
from dissect.transactions.table import Side
from dissect.transactions.transaction import Transaction

#: Octets that all connections together may keep of what is unfinished.
MEMORY: Final = 128 * 1024 * 1024
#: What is kept is added up whenever so many octets were captured; it cannot have grown by more in between.
LOOK_OCTETS: Final = 32 * 1024 * 1024


class Options:
    """What a user can set. ``slow_ns``: an answer later than this is slow. ``strict``: a bug of ours raises.

    ``decoder`` looks for another protocol in what passes, ``naming`` knows names for addresses.
    ``overdue_ns``: a request still open after this is told at once,
    before it is known what becomes of it; 0 for never, as in a file what becomes of it is known.

    ``memory`` bounds the octets that all connections together keep of unfinished packets, PDUs and transactions, within
    `LOOK_OCTETS`: when they keep more, those that hold most are given up and told (`stream.evicted`).
    ``checksums``: TCP segments and UDP datagrams with a wrong checksum are left out, as their receiver did.
    """

    def __init__(
        self,
        slow_ns: int = 1_000_000_000,
        strict: bool = False,
        decoder: PayloadDecoder | None = None,
        overdue_ns: int = 0,
        memory: int = MEMORY,
        checksums: bool = False,
        naming: Naming | None = None,
    ) -> None:
        self.slow_ns: i64 = slow_ns
        self.overdue_ns: i64 = overdue_ns
        self.memory: i64 = memory
        self.checksums: bool = checksums
        self.strict: bool = strict
        self.decoder: PayloadDecoder | None = decoder
        self.naming: Naming | None = naming


@mypyc_attr(allow_interpreted_subclasses=True)
class Observer:
    """Is told what happens; override what you want to know. The ``wants_`` flags must be set before the first packet."""

    def __init__(self) -> None:
        self.wants_pdus: bool = False
        self.wants_tpdus: bool = False

    def connection_opened(self, connection: Connection) -> None:
        """ISO-on-TCP or IBH-NetLink was recognised on a connection."""

    def connection_closed(self, connection: Connection) -> None:
        """A connection is over; all its transactions were told before."""

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

    def comment(self, frame: i64, text: str) -> None:
        """The capture holds a comment about a packet."""
