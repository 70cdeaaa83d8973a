"""`s7dissect values`: what values variables had, when, and who read or wrote them."""

from __future__ import annotations

import os
import sys
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

import click

from dissect.cli.formats import format_option, write_out
from dissect.cli.gate import fail_on_option, gate
from dissect.cli.indexed import may_match
from dissect.cli.look import clock
from dissect.cli.nothing import Shown, complain_impossible
from dissect.cli.options.jobs import check_jobs, indexed_option, separate_options
from dissect.cli.options.scd import scd_options
from dissect.cli.options.select import Chosen, select_options
from dissect.cli.options.tags import tag_options
from dissect.cli.options.tls import tls_option
from dissect.cli.options.variables import wanted_of
from dissect.cli.run import EXIT_CODES, checksums_option, complain, drive, files_meant, places_of
from dissect.cli.task import Task, current
from dissect.engine.exchange import PayloadDecoder
from dissect.engine.pipeline import Options
from dissect.report.certainty import values_left_out
from dissect.report.formats import VALUES, Format
from dissect.session import Run
from dissect.tls.key_log import KeyLog
from dissect.transactions.naming import Naming
from dissect.variables.collector import Collector
from dissect.variables.summary import Summary, limits_text
from dissect.wire.text import printable

if TYPE_CHECKING:
    from dissect.cli.separate_rows import Total
    from dissect.report.styled import Written
    from dissect.variables.wanted import WantedSet
    from dissect.variables.writers import ValueWriter

#: Ends of names of captures: what has one and is no file is a file that is missing, not an address.
_CAPTURES: Final = (".pcap", ".pcapng", ".cap", ".gz", ".zst", ".dmp")
#: Names of what was not seen that one line lists.
_LISTED: Final = 10


def _interval(ctx: click.Context, param: click.Parameter, value: str | None) -> int:
    """Return a stretch of time in nanoseconds, 0 for none."""
    if value is None:
        return 0
    from dissect.select.errors import SelectError
    from dissect.select.grammar import Literal
    from dissect.select.literals import Duration

    try:
        ns = Duration().nanoseconds(Literal(value, False, 0, len(value)))
    except SelectError as error:
        raise click.BadParameter(f"{printable(error.reason)}.", ctx, param) from None
    if ns <= 0:
        raise click.BadParameter(f"expected a time above 0, such as 500ms or 1s; got {value!r}.", ctx, param)
    return min(ns, 2**62)


@click.command("values", epilog=EXIT_CODES)
@click.argument("files", nargs=-1, required=True, type=click.Path(readable=False), metavar="FILE... [ADDRESS|TAG]...")
@format_option(VALUES)
@click.option("--changes", is_flag=True, help="Only values that differ from the one before, and the first of each.")
@click.option(
    "--every",
    "every_ns",
    callback=_interval,
    metavar="TIME",
    help="At most one value of a variable per interval, such as 500ms, 1s or 5min: the first.",
)
@click.option(
    "--summary", is_flag=True, help="One row for each variable: how often, extremes, period, who reads, who writes."
)
@click.option(
    "--likely",
    is_flag=True,
    help="Also values whose request and answer are only likely a pair, because packets are missing; each is marked.",
)
@select_options("transaction")
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
    changes: bool,
    every_ns: int,
    summary: bool,
    likely: bool,
    checksums: bool,
    fail_on: frozenset[str],
    decoder: PayloadDecoder | None,
    chosen: Chosen,
    naming: Naming | None,
    tls_keys: KeyLog | None,
    separate: bool,
    jobs: int,
) -> int:
    """List the values of variables, one row for each that was read, written or pushed.

    A row gives the time and packet of the value, who read or wrote it, how (read, write, push, modify, force, notification,
    pdo), address, tag, type, the value, and the one before it where that was different. A refused read or write has no value;
    --summary counts it. Where packets are missing, it may be only likely that an answer belongs to its request: values of such
    pairs are left out and counted; --likely lists them, marked.

    FILE is a pcap or pcapng file, plain or compressed with gzip or zstd; - is standard input. ADDRESS (DB10.DBD4,
    DB10.DBD4:REAL, MW20, I0.1, 0x6041:0) and TAG (a name of the files of --tags, an element, or a structure for all of its
    members) choose variables: their values are found wherever an item covers them, and put together where it covers a part.
    """
    if summary and (changes or every_ns):
        raise click.UsageError("--summary covers all values; it cannot be combined with --changes or --every.")
    if summary and likely:
        raise click.UsageError(
            "--summary only counts values that are only likely; --likely lists them without --summary."
        )
    captures, wanted = _split(files, naming, decoder)
    writer: ValueWriter = chosen.writer(format_, VALUES, clock())  # type: ignore[assignment]  # the kind says so
    collector = Collector(wanted, changes, every_ns, summary, chosen.choice("transaction"), likely=likely)
    options = Options(decoder=decoder, checksums=checksums, tls_keys=tls_keys, naming=naming)
    separate = check_jobs(separate, jobs)
    of = current()
    if of is not None:
        return _task(of, writer, collector, chosen, options, bool(fail_on))
    if separate:
        from dissect.cli.separate import refuse
        from dissect.cli.separate_rows import no_places, rows_separately

        refuse(chosen, [(decoder, "SCD is decoded over all files"), (summary, "--summary adds up one run")])
        captures = list(may_match(tuple(captures), chosen))
        writer.begin(no_places(captures))
        writer.values([])  # what the output begins with

        def say(total: Total) -> None:
            _miss(wanted, total.seen)
            _leave_out(total.doubts, likely)

        return rows_separately(captures, jobs, writer, fail_on, say)
    run = Run(captures, chosen.sieve(collector) if fail_on else collector, chosen.narrow(options))
    chosen.begin(run, captures)
    writer.begin(places_of(run, captures))

    if not summary:
        writer.values([])  # what the output begins with
    shown = Shown("value", len(writer.lines))

    def write() -> None:
        writer.values(collector.take())
        shown.write(writer.take())

    code = drive(run, captures, None if summary else write)
    if summary:
        made = Summary(collector, sys.stdout.isatty())
        writer.summary(made)
        (shown.write if made.variables else write_out)(writer.take())
        if text := limits_text(made):
            click.echo(f"s7dissect: {text}", err=True)
    complain(run, code)
    _miss(wanted, collector.found)
    _leave_out(collector.doubts, likely)
    if wanted is None:
        shown.explain(run, chosen)
    else:
        complain_impossible(run, chosen)
    return gate(run, fail_on, chosen.ended(code), chosen.findings)


def _task(of: Task, writer: ValueWriter, collector: Collector, chosen: Chosen, options: Options, findings: bool) -> int:
    """Read the file of a task; ``findings`` tells whether a selection of these counts."""
    run = Run([of.file], chosen.sieve(collector) if findings else collector, chosen.narrow(options))
    writer.begin(places_of(run, of.files))
    writer.values([])

    def take() -> list[Written]:
        writer.values(collector.take())
        return writer.take()

    from dissect.cli.separate_rows import rows_task

    return rows_task(of, run, chosen, writer, take, lambda: ({}, collector.found, collector.doubts))


def _leave_out(doubts: Mapping[str, int], likely: bool) -> None:
    """Say how many transactions were left out that are only likely, and why; nothing where they were asked for."""
    said = "" if likely else values_left_out(doubts)
    if said:
        click.echo(f"s7dissect: {said}; --likely lists them", err=True)


def _split(
    words: Sequence[str], naming: Naming | None, decoder: PayloadDecoder | None
) -> tuple[list[str], WantedSet | None]:
    """Return the files among the arguments, and what the others choose; the first is a file, whatever it is called."""
    captures = files_meant([word for at, word in enumerate(words) if at == 0 or _is_file(word)])
    names = [word for at, word in enumerate(words) if at > 0 and not _is_file(word)]
    return list(captures), wanted_of(names, naming, decoder)


def _is_file(word: str) -> bool:
    try:
        return word == "-" or Path(word).exists() or os.sep in word or word.lower().endswith(_CAPTURES)
    except OSError:
        return False  # no path can have such a name


def _miss(wanted: WantedSet | None, found: Collection[str]) -> None:
    """Say which of the chosen variables had neither a value nor a refusal."""
    if wanted is None:
        return
    missing = [printable(one.text) for one in wanted.all if one.text not in found]
    if missing:
        more = f" and {len(missing) - _LISTED} more" if len(missing) > _LISTED else ""
        click.echo(f"s7dissect: no value of {', '.join(missing[:_LISTED])}{more} in what was read", err=True)
