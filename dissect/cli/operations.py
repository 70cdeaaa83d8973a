"""`s7dissect operations`: groups of transactions that belong together, one line for each."""

from __future__ import annotations

import click

from dissect.cli.display import clock
from dissect.cli.formats import format_option
from dissect.cli.options.numbers import DescribedChoice
from dissect.cli.options.reading import reading_options
from dissect.cli.reading import Reading
from dissect.cli.rows import Rows
from dissect.cli.run import EXIT_CODES
from dissect.engine.transactions.operation import KINDS
from dissect.meaning.report.formats import OPERATIONS, Format
from dissect.meaning.report.writer import OperationChoice, OperationFeed


@click.command("operations", epilog=EXIT_CODES)
@format_option(OPERATIONS)
@click.option(
    "--kind",
    "kinds",
    multiple=True,
    type=DescribedChoice(KINDS),
    metavar="KIND",
    help=f"Only this kind of operation: {', '.join(KINDS)}. Repeatable.",
)
@reading_options("operation", results="operations", fails=True, scd=False)
def command(reading: Reading, format_: Format, kinds: tuple[str, ...]) -> int:
    """List operations, one line each: several transactions that belong together.

    Operations are connection setups, block downloads and uploads, answers in several parts, cyclic and message subscriptions
    with their pushes, test jobs and passwords. A line gives client and server, duration, size and result.

    FILE is a pcap or pcapng file, plain or compressed with gzip or zstd; - is standard input. A line is written when its
    operation ends.
    """
    writer = reading.chosen.writer(format_, OPERATIONS, clock())
    feed = OperationFeed(writer, reading.chosen.choice("operation", _choice(frozenset(kinds))))
    reading.rows(Rows(writer, feed), "operation")
    reading.complain()
    reading.explain([f"--kind {kind}" for kind in kinds])
    return reading.gated()


def _choice(kinds: frozenset[str]) -> OperationChoice | None:
    """Return a function that selects operations of ``kinds``; None for all."""
    return (lambda operation: operation.kind in kinds) if kinds else None
