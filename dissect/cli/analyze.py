"""`s7dissect analyze`: what a capture contains, how fast it was, what failed and why."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import click

from dissect.cli.configuration import hosts
from dissect.cli.display import clock, write_lines
from dissect.cli.folders import any_folder, foreign
from dissect.cli.formats import format_option, write_outcome
from dissect.cli.options.given import was_given
from dissect.cli.options.reading import reading_options
from dissect.cli.reading import Reading
from dissect.cli.run import EXIT_CODES
from dissect.meaning.report.formats import ANALYSIS, Format, formats_for
from dissect.meaning.report.styled import Line

if TYPE_CHECKING:
    from dissect.engine.options import Options
    from dissect.files.jobs.analyses import Analyses
    from dissect.files.session import Run


@click.command("analyze", epilog=EXIT_CODES)
@format_option(ANALYSIS)
@click.option(
    "--brief", is_flag=True, help="At most 40 lines: findings, a row for each PLC, a line for each connection."
)
@click.option("--per-file", is_flag=True, help="One row for each file instead of the report.")
@reading_options(slow=True, fails=True, separate=True)
def command(reading: Reading, format_: Format, brief: bool, per_file: bool) -> int:
    """Summarize captures: what they contain, how fast it was, what failed and why.

    The report lists connections, transactions by function with answer times, findings, failed and slowest transactions, and
    what is missing from the capture.

    FILE is a pcap or pcapng file, plain or compressed with gzip or zstd; - is standard input. Several files are read in order;
    one that continues where the previous one ended (a ring buffer) continues its connections, unless --separate reads each file
    on its own. Each file of a folder is read separately, in the order of their times, and gets a row.
    """
    from dissect.meaning.report.analysis import Analysis
    from dissect.meaning.report.summary import Summary

    if (brief or per_file) and format_ is not formats_for(ANALYSIS)[0]:
        raise click.UsageError(f"{'--brief' if brief else '--per-file'} is for text, not for -T {format_.name}.")
    if brief and per_file:
        raise click.UsageError("--brief and --per-file cannot be combined.")
    if per_file or (any_folder() and not brief and not was_given("format_")):
        write_lines(_rows(reading))
    else:
        analysis = reading.sum(Analysis, _analyses)
        write_outcome(format_, ANALYSIS, Summary(analysis, reading.interrupted, clock(), hosts(), brief))
    reading.complain()
    if reading.possible() and (brief or per_file):  # the report names the selection
        reading.match()
    return reading.gated()


def _analyses(options: Options) -> Analyses:
    from dissect.files.jobs.analyses import Analyses  # imported late: most runs do not need it

    return Analyses(options)


def _rows(reading: Reading) -> Iterable[Line]:
    """Return a row for each file."""
    from dissect.files.jobs.analyses import AnalysesByFile
    from dissect.meaning.report.analysis import Analysis
    from dissect.meaning.report.per_file import PerFile

    rows = PerFile()
    if reading.separate:
        reading.sum(Analysis, lambda options: AnalysesByFile(options, rows))
        return rows.lines(foreign(), joined=False)

    def begin(run: Run) -> None:
        rows.files = run.files
        run.lenient = len(reading.files) > 1

    reading.run(rows, begin)
    return rows.lines()
