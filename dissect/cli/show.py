"""`s7dissect show`: one line for each PDU, or its field tree and octets."""

from __future__ import annotations

import click

from dissect.cli.formats import format_option
from dissect.cli.gate import fail_on_option, gate
from dissect.cli.look import clock
from dissect.cli.main import EXIT_OK, EXIT_USAGE
from dissect.cli.nothing import Shown
from dissect.cli.options.numbers import NumberRange, Numbers
from dissect.cli.options.scd import scd_options
from dissect.cli.options.select import Chosen, select_options
from dissect.cli.options.tags import tag_options
from dissect.cli.options.tls import tls_option
from dissect.cli.run import (
    EXIT_CODES,
    checksums_option,
    complain,
    drive,
    files_argument,
    places_of,
)
from dissect.engine.exchange import PayloadDecoder
from dissect.engine.pipeline import Options
from dissect.report.formats import PDUS, Format, formats_for
from dissect.report.writer import PduFeed
from dissect.session import Run
from dissect.tls.key_log import KeyLog
from dissect.transactions.naming import Naming


@click.command("show", epilog=EXIT_CODES)
@files_argument
@format_option(PDUS)
@click.option(
    "--frame",
    "frames",
    type=NumberRange(),
    multiple=True,
    metavar="N",
    help="Only messages that packet N completes (packet N of each file), or packets such as 10-12. Repeatable.",
)
@select_options("message", results="messages")
@click.option("-V", "--verbose", is_flag=True, help="Add the field tree with byte ranges and a hex dump.")
@click.option("--tpdus", is_flag=True, help="List every COTP TPDU as well: fragments, and empty ones that acknowledge.")
@checksums_option
@fail_on_option
@scd_options
@tag_options
@tls_option
def command(
    files: tuple[str, ...],
    format_: Format,
    frames: tuple[range, ...],
    verbose: bool,
    tpdus: bool,
    checksums: bool,
    fail_on: frozenset[str],
    decoder: PayloadDecoder | None,
    chosen: Chosen,
    naming: Naming | None,
    tls_keys: KeyLog | None,
) -> int:
    """List S7comm and S7comm-plus PDUs, one line each, or dissect them (-V).

    A line gives the packet that completed the PDU, its time, source and destination, and its content. COTP connects,
    disconnects and errors and messages of other protocols are listed as well, and in the text output packet comments. To
    see values, use the transactions command: they take the request and its answer.

    FILE is a pcap or pcapng file, plain or compressed with gzip or zstd; - is standard input.
    """
    if verbose and not format_.verbose:
        names = " and ".join([row.name for row in formats_for(PDUS) if row.verbose])
        raise click.UsageError(f"-V applies to {names} only; -T {format_.name} has no longer form.")
    writer = chosen.writer(format_, PDUS, clock(), verbose)
    shown = PduFeed(writer, Numbers(frames) if frames else None, decoder, chosen.message_choice(), tpdus)
    options = Options(decoder=decoder, checksums=checksums, tls_keys=tls_keys, naming=naming)
    run = Run(files, shown, chosen.narrow(options))
    chosen.begin(run, files)
    writer.begin(places_of(run, files))
    shown_lines = Shown("message", len(writer.lines))
    code = drive(run, files, lambda: shown_lines.write(writer.take()), lambda: chosen.full)
    complain(run, code)
    if not frames:
        shown_lines.explain(run, chosen)
    code = _frames_missing(run, frames, shown.found, chosen, code)
    return gate(run, fail_on, chosen.ended(code))


def _frames_missing(run: Run, frames: tuple[range, ...], found: set[int], chosen: Chosen, code: int) -> int:
    """Say which packets complete no message, or are none; return the exit code, which is that of wrong use for the latter."""
    most = max([int(file.packets) for file in run.files], default=0)
    if code != EXIT_OK or chosen.where is not None or chosen.full:
        return code
    for asked in dict.fromkeys(frames):
        first, last = asked.start, asked.stop - 1
        named = f"packet {first}" if first == last else f"packets {first} to {last}"
        if last > most:
            click.echo(
                f"s7dissect: no {named if first == last else f'packet {last}'}; the last one is {most}", err=True
            )
            return EXIT_USAGE
        if not any([frame in asked for frame in found]):
            click.echo(f"s7dissect: {named} {'completes' if first == last else 'complete'} no message", err=True)
    return code
