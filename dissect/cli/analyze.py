"""`s7dissect analyze`: what a capture contains, how fast it was, what failed and why."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from dissect.cli.formats import format_option, write_outcome
from dissect.cli.gate import fail_on_option, gate
from dissect.cli.look import clock
from dissect.cli.main import EXIT_INTERRUPTED
from dissect.cli.options.scd import scd_options
from dissect.cli.options.tls import tls_option
from dissect.cli.run import (
    EXIT_CODES,
    checksums_option,
    complain,
    drive,
    files_argument,
    slow_option,
)
from dissect.report.formats import ANALYSIS, Format

if TYPE_CHECKING:
    from dissect.engine.exchange import PayloadDecoder
    from dissect.tls.key_log import KeyLog


@click.command("analyze", epilog=EXIT_CODES)
@files_argument
@format_option(ANALYSIS)
@slow_option
@checksums_option
@fail_on_option
@scd_options
@tls_option
def command(
    files: tuple[str, ...],
    format_: Format,
    slow_ns: int,
    checksums: bool,
    fail_on: frozenset[str],
    decoder: PayloadDecoder | None,
    tls_keys: KeyLog | None,
) -> int:
    """Summarize captures: what they contain, how fast it was, what failed and why.

    The report lists connections, transactions by function with answer times, findings, failed and slowest transactions, and
    what is missing from the capture.

    FILE is a pcap or pcapng file, plain or compressed with gzip or zstd; - is standard input. Several files are read in
    order; one that continues where the previous one ended (a ring buffer) continues its connections.
    """
    from dissect.engine.pipeline import Options
    from dissect.report.analysis import Analysis
    from dissect.report.summary import Summary
    from dissect.session import Run

    analysis = Analysis()
    run = Run(files, analysis, Options(slow_ns, decoder=decoder, checksums=checksums, tls_keys=tls_keys))
    code = drive(run, files)
    analysis.take(run.pipeline, run.files)
    write_outcome(format_, ANALYSIS, Summary(analysis, code == EXIT_INTERRUPTED, clock()))
    complain(run, code)
    return gate(run, fail_on, code)
