"""`s7dissect show`: one line for each PDU, or its field tree and octets."""

from __future__ import annotations

from collections.abc import Iterable

import click
from mypy_extensions import i64

from dissect.cli.gate import fail_on_option, gate
from dissect.cli.look import clock, write_lines
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
from dissect.engine.observer import Observer, Options
from dissect.engine.payload import PayloadDecoder
from dissect.ibh.packet import parse_packet
from dissect.ibh.tables import IBH_NETLINK, KIND_DATA, KIND_FRAGMENT
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
from dissect.report.styled import FAILED, HANG, PLAIN, TREE_HANG, Line
from dissect.report.tpdu_json import tpdu_json_line
from dissect.report.tree import netlink_tree_lines, plus_tree_lines, tpdu_tree_lines, tree_lines
from dissect.s7.hiding import without_secrets
from dissect.s7.message import Pdu, parse_pdu
from dissect.s7.tables import JOB, SUCCESS
from dissect.s7plus.message import parse_plus
from dissect.session import Run
from dissect.transactions.connection import Connection
from dissect.transactions.payloads import ScdMessage
from dissect.transactions.table import Side
from dissect.transactions.transaction import Transaction


@click.command("show", epilog=EXIT_CODES)
@files_argument
@format_option("text", "jsonl")
@click.option(
    "--frame",
    "frames",
    type=click.IntRange(min=1),
    multiple=True,
    metavar="N",
    help="Only messages that packet N completes (packet N of each file). May be given several times.",
)
@click.option("-V", "--verbose", is_flag=True, help="Add the field tree with byte ranges and a hex dump.")
@checksums_option
@fail_on_option
@scd_options
def command(
    files: tuple[str, ...],
    format_: str,
    frames: tuple[int, ...],
    verbose: bool,
    checksums: bool,
    fail_on: frozenset[str],
    decoder: PayloadDecoder | None,
) -> int:
    """List S7comm and S7comm-plus PDUs, one line each, or dissect them (-V).

    A line gives the packet that completed the PDU, its time, source and destination, and its content. COTP connects,
    disconnects and errors and messages of other protocols are listed as well, and in text packet comments. To see values, use
    the transactions command: they take the request and its answer.

    FILE is a pcap or pcapng file, plain or compressed with gzip or zstd; - is standard input.
    """
    if verbose and format_ != "text":
        raise click.UsageError("-V applies to text only; -T jsonl always includes the fields.")
    shown = _Pdus(format_ == "jsonl", frozenset(frames), verbose, decoder)
    run = Run(files, shown, Options(decoder=decoder, checksums=checksums))
    shown.begin(places_of(run, files))
    if format_ == "jsonl":
        code = drive(run, files, lambda: write([line.text for line in shown.take()]))
    else:
        code = drive(run, files, lambda: write_lines(shown.take()))
    complain(run, code)
    most = max([int(file.packets) for file in run.files], default=0)
    for frame in dict.fromkeys(frames):
        if code != EXIT_OK or frame in shown.found:
            continue
        if frame > most:
            click.echo(f"s7dissect: no packet {frame}; the last one is {most}", err=True)
            return EXIT_USAGE
        click.echo(f"s7dissect: packet {frame} completes no message", err=True)
    return gate(run, fail_on, code)


class _Pdus(Observer):
    """Collects PDUs as lines."""

    def __init__(self, as_jsonl: bool, frames: frozenset[int], verbose: bool, decoder: PayloadDecoder | None) -> None:
        super().__init__()
        self._decoder = decoder
        self.wants_pdus = True
        self.wants_tpdus = True
        self.found: set[int] = set()
        self._as_jsonl = as_jsonl
        self._frames = frames
        self._verbose = verbose
        self._clock = clock()
        self._pdus = PduLines()
        self._places = Places([], False)
        self._packet = b""  # the TPKT or IBH-NetLink packet at hand
        self._lines: list[Line] = []

    def begin(self, places: Places) -> None:
        """Name packets with ``places``."""
        self._places = places
        if places.several:
            self._pdus.locate = places.locate

    def take(self) -> list[Line]:
        """Return the lines collected since the last call."""
        lines = self._lines
        self._lines = []
        return lines

    def comment(self, frame: i64, text: str) -> None:
        """Add the line of a comment."""
        if not self._as_jsonl and self._wanted(frame):
            self._find(frame)
            self._add(comment_line(frame, text, self._places))

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
        self._find(frame)
        if self._as_jsonl:
            self._add(tpdu_json_line(tpdu, frame, time_ns, side.connection, int(side.index), self._places))
            return
        where = side.connection, side.index, self._clock, self._places
        self._add(tpdu_line(tpdu, frame, time_ns, *where), bool(tpdu.malformed))
        if self._verbose:
            self._tree(tpdu_tree_lines(octets))

    def ibh_packet(self, frame: i64, time_ns: i64, side: Side, octets: bytes) -> None:
        """Remember the packet for the PDU in it; add the line of one that carries no part of one."""
        self._packet = octets
        if not self._wanted(frame):
            return
        if self._as_jsonl:
            return
        packet = parse_packet(octets)
        if packet.kind in {KIND_DATA, KIND_FRAGMENT} and packet.data:
            if not side.assembler.clear or not message_name(packet.data):
                return
        where = side.connection, side.index, self._clock, self._places
        self._find(frame)
        self._add(netlink_line(packet, frame, time_ns, *where), bool(packet.malformed))
        if self._verbose:
            self._tree(netlink_tree_lines(octets))

    def pdu(self, frame: i64, time_ns: i64, side: Side, octets: bytes, cut: bool) -> None:
        """Add the line of an S7 PDU."""
        if not self._wanted(frame):
            return
        self._find(frame)
        connection = side.connection
        if self._as_jsonl:
            pdu = parse_pdu(without_secrets(octets), frame, time_ns, connection.number, side.index, cut)
            self._add(self._pdus.line(pdu, connection))
            return
        pdu = parse_pdu(octets, frame, time_ns, connection.number, side.index, cut)
        self._add(pdu_line(pdu, connection, self._clock, self._places), _says_no(pdu))
        if self._verbose:
            whole = self._packet if self._packet.endswith(octets) and not cut else b""
            self._tree(tree_lines(pdu, whole, connection.protocol == IBH_NETLINK))

    def plus_pdu(self, frame: i64, time_ns: i64, side: Side, octets: bytes, cut: bool) -> None:
        """Add the line of an S7comm-plus PDU."""
        if not self._wanted(frame):
            return
        self._find(frame)
        connection = side.connection
        pdu = parse_plus(octets, frame, time_ns, connection.number, side.index, cut)
        if self._as_jsonl:
            self._add(self._pdus.plus_line(pdu, connection))
            return
        self._add(plus_line(pdu, connection, self._clock, self._places), bool(pdu.malformed))
        if self._verbose:
            whole = self._packet if self._packet.endswith(octets) and not cut else b""
            self._tree(plus_tree_lines(pdu, whole))

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
        self._find(found.frame)
        if self._as_jsonl:
            self._add(self._pdus.scd_line(found, connection))
            return
        self._add(scd_line(found, connection, self._clock, self._places), found.message.error is not None)
        if self._verbose:
            self._tree(scd_tree_lines(found))

    def _add(self, text: str, failed: bool = False) -> None:
        self._lines.append(Line(text, FAILED if failed else PLAIN, HANG))

    def _tree(self, lines: Iterable[str]) -> None:
        self._lines += [Line(text, PLAIN, TREE_HANG) for text in lines]

    def _find(self, frame: int) -> None:
        if self._frames:
            self.found.add(self._places.number(frame))

    def _wanted(self, frame: int) -> bool:
        return not self._frames or self._places.number(frame) in self._frames


def _says_no(pdu: Pdu) -> bool:
    """Tell whether a PDU is damaged, or refuses something."""
    refused = [code for code in pdu.return_codes() if code != SUCCESS] if pdu.rosctr != JOB else []
    return bool(pdu.malformed or pdu.error_class > 0 or pdu.error_code > 0 or refused)
