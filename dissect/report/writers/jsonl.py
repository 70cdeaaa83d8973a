"""Records as lines of JSON (docs/json.md)."""

from __future__ import annotations

from mypy_extensions import i64

from dissect.iso.cotp import parse_tpdu
from dissect.report.jsonl import PduLines, TransactionLines
from dissect.report.operations import operation_json
from dissect.report.places import Places
from dissect.report.tpdu_json import tpdu_json_line
from dissect.report.writer import Writer
from dissect.s7.hiding import without_secrets
from dissect.s7.message import parse_pdu
from dissect.s7plus.message import parse_plus
from dissect.transactions.connection import Connection
from dissect.transactions.operation import Operation
from dissect.transactions.payloads import ScdMessage
from dissect.transactions.table import Side
from dissect.transactions.transaction import Transaction
from dissect.wire.clock import Clock


class JsonlWriter(Writer):
    """Writes an object for each record, all of them with everything that is known."""

    def __init__(self, clock: Clock | None = None, verbose: bool = False) -> None:
        super().__init__(clock, verbose)
        self._transactions: TransactionLines = TransactionLines()
        self._pdus: PduLines = PduLines()

    def begin(self, places: Places) -> None:
        """Name packets with ``places``."""
        super().begin(places)
        if places.several:
            self._transactions.locate = places.locate
            self._pdus.locate = places.locate

    def transaction(self, transaction: Transaction) -> None:
        """Add the line of a transaction."""
        self.lines.append(self._transactions.line(transaction))

    def operation(self, operation: Operation) -> None:
        """Add the line of an operation."""
        self.lines.append(operation_json(operation, self.clock, self.places))

    def tpdu(self, frame: i64, time_ns: i64, side: Side, octets: bytes) -> None:
        """Add the line of a TPDU that carries no S7 PDU."""
        tpdu = parse_tpdu(octets[4:])
        connection = side.connection
        self.lines.append(tpdu_json_line(tpdu, int(frame), int(time_ns), connection, int(side.index), self.places))

    def pdu(self, frame: i64, time_ns: i64, side: Side, octets: bytes, cut: bool) -> None:
        """Add the line of an S7 PDU."""
        connection = side.connection
        pdu = parse_pdu(without_secrets(octets), frame, time_ns, connection.number, side.index, cut)
        self.lines.append(self._pdus.line(pdu, connection))

    def plus_pdu(self, frame: i64, time_ns: i64, side: Side, octets: bytes, cut: bool) -> None:
        """Add the line of an S7comm-plus PDU."""
        connection = side.connection
        pdu = parse_plus(octets, frame, time_ns, connection.number, side.index, cut)
        self.lines.append(self._pdus.plus_line(pdu, connection))

    def scd_message(self, found: ScdMessage, connection: Connection) -> None:
        """Add the line of an SCD message."""
        self.lines.append(self._pdus.scd_line(found, connection))
