"""`s7dissect operations`: what several transactions did together, one line for each."""

from __future__ import annotations

import click

from dissect.cli.formats import format_option
from dissect.cli.gate import fail_on_option, gate
from dissect.cli.look import clock
from dissect.cli.nothing import Shown
from dissect.cli.options.numbers import DescribedChoice
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
from dissect.engine.pipeline import Options
from dissect.report.formats import OPERATIONS, Format
from dissect.report.writer import OperationChoice, OperationFeed
from dissect.session import Run
from dissect.tls.key_log import KeyLog
from dissect.transactions.naming import Naming
from dissect.transactions.operation import KINDS


@click.command("operations", epilog=EXIT_CODES)
@files_argument
@format_option(OPERATIONS)
@click.option(
    "--kind",
    "kinds",
    multiple=True,
    type=DescribedChoice(KINDS),
    metavar="KIND",
    help=f"Only this kind of operation: {', '.join(KINDS)}. Repeatable.",
)
@select_options("operation", results="operations")
@checksums_option
@fail_on_option
@tag_options
@tls_option
def command(
    files: tuple[str, ...],
    format_: Format,
    kinds: tuple[str, ...],
    checksums: bool,
    fail_on: frozenset[str],
    chosen: Chosen,
    naming: Naming | None,
    tls_keys: KeyLog | None,
) -> int:
    """List operations, one line each: several transactions that belong together.

    Operations are connection setups, block downloads and uploads, answers in several parts, cyclic and message subscriptions
    with their pushes, test jobs and passwords. A line gives client and server, duration, size and result.

    FILE is a pcap or pcapng file, plain or compressed with gzip or zstd; - is standard input. A line is written when its
    operation ends.
    """
    writer = chosen.writer(format_, OPERATIONS, clock())
    feed = OperationFeed(writer, chosen.choice("operation", _choice(frozenset(kinds))))
    options = Options(checksums=checksums, tls_keys=tls_keys, naming=naming)
    run = Run(files, chosen.sieve(feed) if fail_on else feed, chosen.narrow(options))
    chosen.begin(run, files)
    writer.begin(places_of(run, files))
    shown = Shown("operation", len(writer.lines))
    code = drive(run, files, lambda: shown.write(writer.take()), lambda: chosen.full)
    complain(run, code)
    shown.explain(run, chosen, [f"--kind {kind}" for kind in kinds])
    return gate(run, fail_on, chosen.ended(code), chosen.findings)


def _choice(kinds: frozenset[str]) -> OperationChoice | None:
    """Return what tells whether an operation is of one of ``kinds``; None when all are."""
    return (lambda operation: operation.kind in kinds) if kinds else None
