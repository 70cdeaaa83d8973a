"""`s7dissect show`: one line for each PDU, or its field tree and octets."""

from __future__ import annotations

import click
from mypy_extensions import i64

from dissect.cli.gate import fail_on_option, gate
from dissect.cli.main import EXIT_OK, EXIT_USAGE
from dissect.cli.options.scd import scd_options
from dissect.cli.run import (
    EXIT_CODES,
    checksums_option,
    complain,
    drive,
    files_argument,
    format_option,
    places_of,
    write,
)
from dissect.engine.conversation import Observer, Options
from dissect.engine.payload import PayloadDecoder
from dissect.ibh.packet import parse_packet
from dissect.ibh.tables import KIND_DATA, KIND_FRAGMENT
from dissect.iso.cotp import parse_tpdu
from dissect.iso.tables import DT, ED
from dissect.report.jsonl import PduLines
from dissect.report.lines import (
    carried,
    comment_line,
    message_name,
    netlink_line,
    pdu_line,
    plus_line,
    scd_line,
    tpdu_line,
)
from dissect.report.places import Places
from dissect.report.scd_tree import scd_tree_lines
from dissect.report.tree import netlink_tree_lines, plus_tree_lines, tpdu_tree_lines, tree_lines
from dissect.s7.hiding import without_secrets
from dissect.s7.message import parse_pdu
from dissect.s7plus.message import parse_plus
from dissect.session import Run
from dissect.transactions.connection import IBH, Connection
from dissect.transactions.payloads import ScdMessage
from dissect.transactions.table import Side
from dissect.transactions.transaction import Transaction
from dissect.wire.clock import Clock


@click.command("show", epilog=EXIT_CODES)
@files_argument
@format_option("text", "jsonl")
@click.option(
    "--frame", type=click.IntRange(min=1), metavar="N", help="Only what packet N completes (of each file, in several)."
)
@click.option("-V", "--verbose", is_flag=True, help="With the field tree, octet ranges and a hex view.")
@checksums_option
@fail_on_option
@scd_options
def command(
    files: tuple[str, ...],
    format_: str,
    frame: int | None,
    verbose: bool,
    checksums: bool,
    fail_on: frozenset[str],
    decoder: PayloadDecoder | None,
) -> int:
    """Write one line for each PDU of S7comm and S7comm-plus: the packet that completed it, when (UTC), who to whom, what.

    Text shows COTP connects, disconnects, errors, messages of other protocols and packet comments as well; -T jsonl writes
    PDUs only. Values need the request and its answer: the transactions command tells them.

    FILE is a pcap or pcapng file, also in gzip or zstd; - is standard input.
    """
    if verbose and format_ != "text":
        raise click.UsageError("-V is for text: -T jsonl has the fields of every PDU anyway.")
    shown = _Pdus(format_ == "jsonl", frame, verbose, decoder)
    run = Run(files, shown, Options(decoder=decoder, checksums=checksums))
    shown.begin(places_of(run, files))
    code = drive(run, files, lambda: write(shown.take()))
    complain(run, code)
    if code == EXIT_OK and frame is not None and not shown.found:
        most = max([int(file.packets) for file in run.files], default=0)
        if frame > most:
            click.echo(f"s7dissect: there is no packet {frame}: the last one is number {most}", err=True)
            return EXIT_USAGE
        click.echo(f"s7dissect: packet {frame} completes no {'S7 PDU' if format_ == 'jsonl' else 'message'}", err=True)
    return gate(run, fail_on, code)


class _Pdus(Observer):
    """Collects PDUs as lines."""

    def __init__(self, as_jsonl: bool, frame: int | None, verbose: bool, decoder: PayloadDecoder | None) -> None:
        super().__init__()
        self._decoder = decoder
        self.wants_pdus = True
        self.wants_tpdus = not as_jsonl
        self.found = False
        self._as_jsonl = as_jsonl
        self._frame = frame
        self._verbose = verbose
        self._clock = Clock()
        self._pdus = PduLines()
        self._places = Places([], False)
        self._packet = b""  # the TPKT or IBH-NetLink packet at hand
        self._lines: list[str] = []

    def begin(self, places: Places) -> None:
        """Name packets with ``places``."""
        self._places = places
        if places.several:
            self._pdus.locate = places.locate

    def take(self) -> list[str]:
        """Return the lines collected since the last call."""
        lines = self._lines
        self._lines = []
        self.found = self.found or bool(lines)
        return lines

    def comment(self, frame: i64, text: str) -> None:
        """Add the line of a comment."""
        if not self._as_jsonl and self._wanted(frame):
            self._lines.append(comment_line(frame, text, self._places))

    def tpdu(self, frame: i64, time_ns: i64, side: Side, octets: bytes) -> None:
        """Remember the TPKT for the PDU in it; add the line of one that carries no S7."""
        self._packet = octets
        if not self._wanted(frame):
            return
        tpdu = parse_tpdu(octets[4:])
        if tpdu.type in {DT, ED}:
            begins = side.assembler.parts is None and side.assembler.clear
            if not (begins and carried(tpdu)) or (self._decoder and self._decoder.claims_tsdus(side.connection)):
                return
        self._lines.append(tpdu_line(tpdu, frame, time_ns, side.connection, side.index, self._clock, self._places))
        if self._verbose:
            self._lines.extend(tpdu_tree_lines(octets))

    def ibh_packet(self, frame: i64, time_ns: i64, side: Side, octets: bytes) -> None:
        """Remember the packet for the PDU in it; add the line of one that carries no part of one."""
        self._packet = octets
        if not self._wanted(frame):
            return
        packet = parse_packet(octets)
        if packet.kind in {KIND_DATA, KIND_FRAGMENT} and packet.data:
            if not side.assembler.clear or not message_name(packet.data):
                return
        where = side.connection, side.index, self._clock, self._places
        self._lines.append(netlink_line(packet, frame, time_ns, *where))
        if self._verbose:
            self._lines.extend(netlink_tree_lines(octets))

    def pdu(self, frame: i64, time_ns: i64, side: Side, octets: bytes, cut: bool) -> None:
        """Add the line of an S7 PDU."""
        if not self._wanted(frame):
            return
        connection = side.connection
        if self._as_jsonl:
            pdu = parse_pdu(without_secrets(octets), frame, time_ns, connection.number, side.index, cut)
            self._lines.append(self._pdus.line(pdu, connection))
            return
        pdu = parse_pdu(octets, frame, time_ns, connection.number, side.index, cut)
        self._lines.append(pdu_line(pdu, connection, self._clock, self._places))
        if self._verbose:
            whole = self._packet if self._packet.endswith(octets) and not cut else b""
            self._lines.extend(tree_lines(pdu, whole, connection.state == IBH))

    def plus_pdu(self, frame: i64, time_ns: i64, side: Side, octets: bytes, cut: bool) -> None:
        """Add the line of an S7comm-plus PDU."""
        if not self._wanted(frame):
            return
        connection = side.connection
        pdu = parse_plus(octets, frame, time_ns, connection.number, side.index, cut)
        if self._as_jsonl:
            self._lines.append(self._pdus.plus_line(pdu, connection))
            return
        self._lines.append(plus_line(pdu, connection, self._clock, self._places))
        if self._verbose:
            whole = self._packet if self._packet.endswith(octets) and not cut else b""
            self._lines.extend(plus_tree_lines(pdu, whole))

    def scd(self, frame: i64, time_ns: i64, side: Side, found: ScdMessage) -> None:
        """Add the line of an SCD message of its own."""
        if self._wanted(frame):
            self._scd(found, side.connection)

    def transaction(self, transaction: Transaction) -> None:
        """Add the lines of the SCD in an S7 transaction; where it stood in a write, the packet is that of the request."""
        for found in transaction.carried or ():
            if self._wanted(found.frame):
                self._scd(found, transaction.connection)

    def _scd(self, found: ScdMessage, connection: Connection) -> None:
        if self._as_jsonl:
            self._lines.append(self._pdus.scd_line(found, connection))
            return
        self._lines.append(scd_line(found, connection, self._clock, self._places))
        if self._verbose:
            self._lines.extend(scd_tree_lines(found))

    def _wanted(self, frame: int) -> bool:
        return self._frame is None or self._places.number(frame) == self._frame
