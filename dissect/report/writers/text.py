"""Records as lines for a person."""

from __future__ import annotations

from collections.abc import Iterable

from mypy_extensions import i64

from dissect.ibh.packet import parse_packet
from dissect.ibh.tables import IBH_NETLINK
from dissect.iso.cotp import parse_tpdu
from dissect.report.lines import (
    comment_line,
    netlink_line,
    pdu_line,
    plus_line,
    scd_line,
    styled_transaction,
    tpdu_line,
)
from dissect.report.operations import styled_operation
from dissect.report.styled import FAILED, HANG, PLAIN, TREE_HANG, Line
from dissect.report.writer import Writer
from dissect.s7.message import Pdu, parse_pdu
from dissect.s7.tables import JOB, SUCCESS
from dissect.s7plus.message import parse_plus
from dissect.transactions.connection import Connection
from dissect.transactions.operation import Operation
from dissect.transactions.payloads import ScdMessage
from dissect.transactions.table import Side
from dissect.transactions.transaction import Transaction
from dissect.wire.clock import Clock


class TextWriter(Writer):
    """Writes a line for each record; a PDU with ``verbose`` as its field tree and octets as well."""

    def __init__(self, clock: Clock | None = None, verbose: bool = False) -> None:
        super().__init__(clock, verbose)
        self._packet: bytes = b""  # the TPKT or IBH-NetLink packet at hand

    def transaction(self, transaction: Transaction) -> None:
        """Add the line of a transaction."""
        self.lines.append(styled_transaction(transaction, self.clock, self.places))

    def operation(self, operation: Operation) -> None:
        """Add the line of an operation."""
        self.lines.append(styled_operation(operation, self.clock, self.places))

    def comment(self, frame: i64, text: str) -> None:
        """Add the line of a comment."""
        self._add(comment_line(int(frame), text, self.places))

    def packet(self, octets: bytes) -> None:
        """Keep the packet that the next PDU is in."""
        self._packet = octets

    def tpdu(self, frame: i64, time_ns: i64, side: Side, octets: bytes) -> None:
        """Add the line of a TPDU that carries no S7 PDU."""
        tpdu = parse_tpdu(octets[4:])
        connection = side.connection
        line = tpdu_line(tpdu, int(frame), int(time_ns), connection, int(side.index), self.clock, self.places)
        self._add(line, bool(tpdu.malformed))
        if self.verbose:
            from dissect.report.tree import tpdu_tree_lines  # late: only -V shows trees

            self._tree(tpdu_tree_lines(octets))

    def ibh_packet(self, frame: i64, time_ns: i64, side: Side, octets: bytes) -> None:
        """Add the line of an IBH-NetLink packet that carries no part of a PDU."""
        packet = parse_packet(octets)
        connection = side.connection
        line = netlink_line(packet, int(frame), int(time_ns), connection, int(side.index), self.clock, self.places)
        self._add(line, bool(packet.malformed))
        if self.verbose:
            from dissect.report.tree import netlink_tree_lines

            self._tree(netlink_tree_lines(octets))

    def pdu(self, frame: i64, time_ns: i64, side: Side, octets: bytes, cut: bool) -> None:
        """Add the line of an S7 PDU."""
        connection = side.connection
        pdu = parse_pdu(octets, frame, time_ns, connection.number, side.index, cut)
        self._add(pdu_line(pdu, connection, self.clock, self.places), _says_no(pdu))
        if self.verbose:
            from dissect.report.tree import tree_lines

            self._tree(tree_lines(pdu, self._whole(octets, cut), connection.protocol == IBH_NETLINK))

    def plus_pdu(self, frame: i64, time_ns: i64, side: Side, octets: bytes, cut: bool) -> None:
        """Add the line of an S7comm-plus PDU."""
        connection = side.connection
        pdu = parse_plus(octets, frame, time_ns, connection.number, side.index, cut)
        self._add(plus_line(pdu, connection, self.clock, self.places), bool(pdu.malformed))
        if self.verbose:
            from dissect.report.tree import plus_tree_lines

            self._tree(plus_tree_lines(pdu, self._whole(octets, cut)))

    def scd_message(self, found: ScdMessage, connection: Connection) -> None:
        """Add the line of an SCD message."""
        self._add(scd_line(found, connection, self.clock, self.places), found.message.error is not None)
        if self.verbose:
            from dissect.report.scd_tree import scd_tree_lines

            self._tree(scd_tree_lines(found))

    def _whole(self, octets: bytes, cut: bool) -> bytes:
        """Return the packet at hand where it carries a PDU whole, else nothing."""
        return self._packet if self._packet.endswith(octets) and not cut else b""

    def _add(self, text: str, failed: bool = False) -> None:
        self.lines.append(Line(text, FAILED if failed else PLAIN, HANG))

    def _tree(self, lines: Iterable[str]) -> None:
        for text in lines:
            self.lines.append(Line(text, PLAIN, TREE_HANG))


def _says_no(pdu: Pdu) -> bool:
    """Tell whether a PDU is damaged, or refuses something."""
    refused = [code for code in pdu.return_codes() if code != SUCCESS] if pdu.rosctr != JOB else []
    return bool(pdu.malformed or pdu.error_class > 0 or pdu.error_code > 0 or refused)
