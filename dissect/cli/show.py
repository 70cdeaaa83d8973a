"""`s7dissect show`: one line for each PDU, or its field tree and octets."""

from __future__ import annotations

import click
from mypy_extensions import i64

from dissect.cli.formats import format_option, write_out
from dissect.cli.gate import fail_on_option, gate
from dissect.cli.look import clock
from dissect.cli.main import EXIT_OK, EXIT_USAGE
from dissect.cli.options.scd import scd_options
from dissect.cli.run import (
    EXIT_CODES,
    checksums_option,
    complain,
    drive,
    files_argument,
    places_of,
)
from dissect.engine.observer import Observer, Options
from dissect.engine.payload import PayloadDecoder
from dissect.ibh.packet import parse_packet
from dissect.ibh.tables import KIND_DATA, KIND_FRAGMENT
from dissect.iso.cotp import parse_tpdu
from dissect.iso.tables import DT, ED
from dissect.report.formats import PDUS, Format, formats_for
from dissect.report.lines import carried, message_name
from dissect.report.writer import Writer
from dissect.session import Run
from dissect.transactions.connection import Connection
from dissect.transactions.payloads import ScdMessage
from dissect.transactions.table import Side
from dissect.transactions.transaction import Transaction


@click.command("show", epilog=EXIT_CODES)
@files_argument
@format_option(PDUS)
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
    format_: Format,
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
    if verbose and not format_.verbose:
        names = " and ".join([row.name for row in formats_for(PDUS) if row.verbose])
        raise click.UsageError(f"-V applies to {names} only; -T {format_.name} has no longer form.")
    writer = format_.writer(PDUS, clock(), verbose)
    shown = _Messages(writer, frozenset(frames), decoder)
    run = Run(files, shown, Options(decoder=decoder, checksums=checksums))
    writer.begin(places_of(run, files))
    code = drive(run, files, lambda: write_out(writer.take()))
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


class _Messages(Observer):
    """Hands a writer the messages that are asked for, each once."""

    def __init__(self, writer: Writer, frames: frozenset[int], decoder: PayloadDecoder | None) -> None:
        super().__init__()
        self.wants_pdus = True
        self.wants_tpdus = True
        self.found: set[int] = set()
        self._writer = writer
        self._frames = frames
        self._decoder = decoder
        self._before = 0  # lines before the message at hand

    def comment(self, frame: i64, text: str) -> None:
        """Hand on a comment."""
        if self._wanted(frame):
            self._writer.comment(frame, text)
            self._find(frame)

    def tpdu(self, frame: i64, time_ns: i64, side: Side, octets: bytes) -> None:
        """Hand on the TPKT of the PDU in it, or one that carries no S7."""
        self._writer.packet(octets)
        if not self._wanted(frame):
            return
        tpdu = parse_tpdu(octets[4:])
        if tpdu.type in {DT, ED}:
            begins = side.assembler.parts is None and side.assembler.clear
            if not (begins and carried(tpdu)) or (self._decoder and self._decoder.claims_tsdus(side.connection)):
                return
        self._writer.tpdu(frame, time_ns, side, octets)
        self._find(frame)

    def ibh_packet(self, frame: i64, time_ns: i64, side: Side, octets: bytes) -> None:
        """Hand on the packet of the PDU in it, or one that carries no part of a PDU."""
        self._writer.packet(octets)
        if not self._wanted(frame):
            return
        packet = parse_packet(octets)
        if packet.kind in {KIND_DATA, KIND_FRAGMENT} and packet.data:
            if not side.assembler.clear or not message_name(packet.data):
                return
        self._writer.ibh_packet(frame, time_ns, side, octets)
        self._find(frame)

    def pdu(self, frame: i64, time_ns: i64, side: Side, octets: bytes, cut: bool) -> None:
        """Hand on an S7 PDU."""
        if self._wanted(frame):
            self._writer.pdu(frame, time_ns, side, octets, cut)
            self._find(frame)

    def plus_pdu(self, frame: i64, time_ns: i64, side: Side, octets: bytes, cut: bool) -> None:
        """Hand on an S7comm-plus PDU."""
        if self._wanted(frame):
            self._writer.plus_pdu(frame, time_ns, side, octets, cut)
            self._find(frame)

    def scd(self, frame: i64, time_ns: i64, side: Side, found: ScdMessage) -> None:
        """Hand on an SCD message of its own."""
        self._scd(found, side.connection)

    def transaction(self, transaction: Transaction) -> None:
        """Hand on the SCD in an S7 transaction; where it stood in a write, the packet is that of the request."""
        for found in transaction.carried or ():
            self._scd(found, transaction.connection)

    def _scd(self, found: ScdMessage, connection: Connection) -> None:
        if self._wanted(found.frame):
            self._writer.scd_message(found, connection)
            self._find(found.frame)

    def _find(self, frame: int) -> None:
        """Note that a packet that was asked for has a message, if the format shows it."""
        if self._frames and len(self._writer.lines) > self._before:
            self.found.add(self._writer.places.number(frame))

    def _wanted(self, frame: int) -> bool:
        if not self._frames:
            return True
        self._before = len(self._writer.lines)
        return self._writer.places.number(frame) in self._frames
