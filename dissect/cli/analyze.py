"""`s7dissect analyze`: what a capture contains, how fast it was, what failed and why."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from dissect.cli.configuration import hosts
from dissect.cli.folders import any_folder, foreign
from dissect.cli.formats import format_option, write_outcome
from dissect.cli.gate import fail_on_option, gate, gate_of
from dissect.cli.indexed import may_match
from dissect.cli.look import clock, write_lines
from dissect.cli.main import EXIT_INTERRUPTED
from dissect.cli.nothing import complain_impossible
from dissect.cli.options.given import was_given
from dissect.cli.options.jobs import check_jobs, indexed_option, separate_options
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
    slow_option,
)
from dissect.cli.task import current
from dissect.report.formats import ANALYSIS, Format, formats_for

if TYPE_CHECKING:
    from dissect.engine.exchange import PayloadDecoder
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
    from dissect.session import Run

    if (brief or per_file) and format_ is not formats_for(ANALYSIS)[0]:
        raise click.UsageError(f"{'--brief' if brief else '--per-file'} is for text, not for -T {format_.name}.")
    if brief and per_file:
        raise click.UsageError("--brief and --per-file cannot be combined.")
    separate = check_jobs(separate, jobs)
    per_file = per_file or (any_folder() and not brief and not was_given("format_"))
    analysis = Analysis()
    options = Options(slow_ns, decoder=decoder, checksums=checksums, tls_keys=tls_keys, naming=naming)
    of = current()
    if of is not None:
        from dissect.cli.separate import found_task

        return found_task(of, analysis, chosen.sieve(analysis), options, chosen)
    if separate:
        from dissect.cli.separate import add_separately, refuse
        from dissect.jobs.analyses import Analyses, AnalysesByFile

        refuse(chosen, [(decoder, "SCD is decoded over all files")])
        files = may_match(files, chosen)
        sums = AnalysesByFile(options) if per_file else Analyses(options)
        code = add_separately(files, jobs, sums, Analysis)
        if isinstance(sums, AnalysesByFile):
            write_lines(sums.rows.lines(foreign(), joined=False))
            return gate_of(sums.found.finding_counts, fail_on, code)
        write_outcome(format_, ANALYSIS, Summary(sums.found, code == EXIT_INTERRUPTED, clock(), hosts(), brief))
        return gate_of(sums.found.finding_counts, fail_on, code)
    if per_file:
        from dissect.report.per_file import PerFile

        rows = PerFile()
        run = Run(files, chosen.sieve(rows), chosen.narrow(options))
        rows.files = run.files
        chosen.begin(run, files)
        run.lenient = len(files) > 1
        code = drive(run, files)
        write_lines(rows.lines())
        complain(run, code)
        complain_impossible(run, chosen)
        return gate(run, fail_on, chosen.ended(code), chosen.findings)
    run = Run(files, chosen.sieve(analysis), chosen.narrow(options))
    chosen.begin(run, files)
    code = drive(run, files)
    analysis.take(run.pipeline, run.files)
    analysis.part = chosen.part(run)
    write_outcome(format_, ANALYSIS, Summary(analysis, code == EXIT_INTERRUPTED, clock(), hosts(), brief))
    complain(run, code)
    complain_impossible(run, chosen)
    return gate(run, fail_on, chosen.ended(code), chosen.findings)
