"""`s7dissect analyze`: what a capture contains, how fast it was, what failed and why."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import click

from dissect.cli.configuration import hosts
from dissect.cli.folders import any_folder, foreign
from dissect.cli.formats import format_option, write_outcome
from dissect.cli.gate import fail_on_option
from dissect.cli.look import clock, write_lines
from dissect.cli.options.given import was_given
from dissect.cli.options.jobs import indexed_option, separate_options
from dissect.cli.options.scd import scd_options
from dissect.cli.options.select import Chosen, select_options
from dissect.cli.options.tags import tag_options
from dissect.cli.options.tls import tls_option
from dissect.cli.reading import Reading
from dissect.cli.run import EXIT_CODES, checksums_option, files_argument, slow_option
from dissect.report.formats import ANALYSIS, Format, formats_for
from dissect.report.styled import Line

if TYPE_CHECKING:
    from dissect.engine.exchange import PayloadDecoder
    from dissect.engine.options import Options
    from dissect.jobs.analyses import Analyses
    from dissect.session import Run
    from dissect.tls.key_log import KeyLog
    from dissect.transactions.naming import Naming


@click.command("analyze", epilog=EXIT_CODES)
@files_argument
@format_option(ANALYSIS)
@click.option(
    "--brief", is_flag=True, help="At most 40 lines: findings, a row for each PLC, a line for each connection."
)
@click.option("--per-file", is_flag=True, help="One row for each file instead of the report.")
@slow_option
@select_options()
@checksums_option
@fail_on_option
@scd_options
@tag_options
@tls_option
@separate_options
@indexed_option
def command(
    files: tuple[str, ...],
    format_: Format,
    brief: bool,
    per_file: bool,
    slow_ns: int,
    checksums: bool,
    fail_on: frozenset[str],
    decoder: PayloadDecoder | None,
    chosen: Chosen,
    naming: Naming | None,
    tls_keys: KeyLog | None,
    separate: bool,
    jobs: int,
) -> int:
    """Summarize captures: what they contain, how fast it was, what failed and why.

    The report lists connections, transactions by function with answer times, findings, failed and slowest transactions, and
    what is missing from the capture.

    FILE is a pcap or pcapng file, plain or compressed with gzip or zstd; - is standard input. Several files are read in
    order; one that continues where the previous one ended (a ring buffer) continues its connections, unless --separate
    reads each file on its own. Of a folder each file is read on its own, in the order of their times, and has a row.
    """
    from dissect.engine.pipeline import Options
    from dissect.report.analysis import Analysis
    from dissect.report.summary import Summary

    if (brief or per_file) and format_ is not formats_for(ANALYSIS)[0]:
        raise click.UsageError(f"{'--brief' if brief else '--per-file'} is for text, not for -T {format_.name}.")
    if brief and per_file:
        raise click.UsageError("--brief and --per-file cannot be combined.")
    options = Options(slow_ns, decoder=decoder, checksums=checksums, tls_keys=tls_keys, naming=naming)
    reading = Reading(files, options, chosen, separate, jobs, [(decoder, "SCD is decoded over all files")])
    if per_file or (any_folder() and not brief and not was_given("format_")):
        write_lines(_rows(reading, len(files)))
        return reading.ended(fail_on)
    analysis = reading.sum(Analysis, _analyses)
    write_outcome(format_, ANALYSIS, Summary(analysis, reading.interrupted, clock(), hosts(), brief))
    return reading.ended(fail_on)


def _analyses(options: Options) -> Analyses:
    from dissect.jobs.analyses import Analyses  # late: most runs need none of it

    return Analyses(options)


def _rows(reading: Reading, count: int) -> Iterable[Line]:
    """Return a row for each of so many files."""
    from dissect.jobs.analyses import AnalysesByFile
    from dissect.report.analysis import Analysis
    from dissect.report.per_file import PerFile

    rows = PerFile()
    if reading.separate:
        reading.sum(Analysis, lambda options: AnalysesByFile(options, rows))
        return rows.lines(foreign(), joined=False)

    def begin(run: Run) -> None:
        rows.files = run.files
        run.lenient = count > 1

    reading.run(rows, begin)
    return rows.lines()
