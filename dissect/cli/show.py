"""`s7dissect show`: one line for each PDU, or its field tree and octets."""

from __future__ import annotations

import click

from dissect.cli.display import clock
from dissect.cli.formats import format_option
from dissect.cli.main import EXIT_OK, EXIT_USAGE
from dissect.cli.options.numbers import NumberRange, Numbers
from dissect.cli.options.reading import reading_options
from dissect.cli.reading import Reading
from dissect.cli.rows import Rows
from dissect.cli.run import EXIT_CODES
from dissect.meaning.report.formats import PDUS, Format, formats_for
from dissect.meaning.report.writer import PduFeed


@click.command("show", epilog=EXIT_CODES)
@format_option(PDUS)
@click.option(
    "--frame",
    "frames",
    type=NumberRange(),
    multiple=True,
    metavar="N",
    help="Only messages that packet N completes (packet N of each file), or packets such as 10-12. Repeatable.",
)
@click.option("-V", "--verbose", is_flag=True, help="Add the field tree with byte ranges and a hex dump.")
@click.option("--tpdus", is_flag=True, help="List every COTP TPDU as well: fragments, and empty ones that acknowledge.")
@reading_options("message", results="messages", fails=True)
def command(reading: Reading, format_: Format, frames: tuple[range, ...], verbose: bool, tpdus: bool) -> int:
    """List S7comm and S7comm-plus PDUs, one line each, or dissect them (-V).

    A line gives the packet that completed the PDU, its time, source and destination, and its content. COTP connects,
    disconnects and errors and messages of other protocols are listed as well, and in the text output packet comments. To see
    values, use the transactions command: they take the request and its answer.

    FILE is a pcap or pcapng file, plain or compressed with gzip or zstd; - is standard input.
    """
    if verbose and not format_.verbose:
        names = " and ".join([row.name for row in formats_for(PDUS) if row.verbose])
        raise click.UsageError(f"-V applies to {names} only; -T {format_.name} has no detailed form.")
    chosen = reading.chosen
    writer = chosen.writer(format_, PDUS, clock(), verbose)
    feed = PduFeed(writer, Numbers(frames) if frames else None, reading.decoder, chosen.message_choice(), tpdus)
    rows = Rows(writer, feed)
    rows.sieved = False
    reading.rows(rows, "message")
    reading.complain()
    if not frames or chosen.where is not None:
        reading.explain([f"--frame {one.start if len(one) == 1 else f'{one.start}-{one.stop - 1}'}" for one in frames])
    elif reading.possible() and reading.code == EXIT_OK and not chosen.full:
        reading.code = _frames_missing(max([int(file.packets) for file in reading.read], default=0), frames, feed.found)
    return reading.gated()


def _frames_missing(most: int, frames: tuple[range, ...], frames_seen: set[int]) -> int:
    """Report packets of a file, up to ``most``, that complete no message or do not exist; return the code of wrong use."""
    for asked in dict.fromkeys(frames):
        first, last = asked.start, asked.stop - 1
        named = f"packet {first}" if first == last else f"packets {first} to {last}"
        if last > most:
            click.echo(
                f"s7dissect: no {named if first == last else f'packet {last}'}; the last one is {most}", err=True
            )
            return EXIT_USAGE
        if not any([frame in asked for frame in frames_seen]):
            click.echo(f"s7dissect: {named} {'completes' if first == last else 'complete'} no message", err=True)
    return EXIT_OK
