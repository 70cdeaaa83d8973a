"""`s7dissect values`: which values variables had, when, and who read or wrote them."""

from __future__ import annotations

import os
import sys
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

import click

from dissect.cli.display import clock
from dissect.cli.formats import format_option
from dissect.cli.options.reading import reading_options
from dissect.cli.options.variables import wanted_of
from dissect.cli.reading import Reading
from dissect.cli.rows import Left, Rows
from dissect.cli.run import EXIT_CODES, files_meant
from dissect.meaning.report.certainty import values_left_out
from dissect.meaning.report.formats import VALUES, Format
from dissect.output.variables.collector import ValueCollector
from dissect.output.variables.summary import Summary, limits_text
from dissect.wire.text import printable, some

if TYPE_CHECKING:
    from dissect.files.session import Run
    from dissect.meaning.report.styled import Written
    from dissect.meaning.report.words import Places
    from dissect.output.variables.wanted import WantedSet
    from dissect.output.variables.writers import ValueWriter

#: Suffixes of captures: a name with one that does not exist is a missing file, not an address.
_CAPTURES: Final = (".pcap", ".pcapng", ".cap", ".gz", ".zst", ".dmp")
#: Maximum number of unseen names in a line.
_LISTED: Final = 10


def _interval(ctx: click.Context, param: click.Parameter, value: str | None) -> int:
    """Return a stretch of time in nanoseconds, 0 for none."""
    if value is None:
        return 0
    from dissect.meaning.select.errors import SelectError
    from dissect.meaning.select.grammar import Literal
    from dissect.meaning.select.literals import Duration

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
@reading_options("transaction", files=None, fails=True, separate=True)
def command(
    reading: Reading,
    format_: Format,
    changes: bool,
    every_ns: int,
    summary: bool,
    likely: bool,
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
    reading.files, wanted = _split(reading)
    reading.whole_only.append((summary, "--summary adds up one run"))
    writer: ValueWriter = reading.chosen.writer(format_, VALUES, clock())  # type: ignore[assignment]  # the kind says so
    choice = reading.chosen.choice("transaction")
    collector = ValueCollector(wanted, changes, every_ns, summary, choice, likely=likely)
    total = reading.rows(_ValueRows(writer, collector, at_once=not summary), "value")
    if summary:
        made = Summary(collector, sys.stdout.isatty())
        writer.summary(made)
        reading.write(writer.take(), results=bool(made.variables))
        if text := limits_text(made):
            click.echo(f"s7dissect: {text}", err=True)
    reading.complain()
    _miss(wanted, total.seen, reading.chosen.where is not None)
    _leave_out(total.doubts, likely)
    if wanted is None:
        reading.explain()
    else:
        reading.possible()
    return reading.gated()


class _ValueRows(Rows):
    """Values of variables."""

    writer: ValueWriter
    observer: ValueCollector

    def begin(self, places: Places) -> None:
        """Write the beginning of the output, if values are listed."""
        super().begin(places)
        if self.at_once:
            self.writer.values([])

    def take(self, run: Run) -> Sequence[Written]:
        """Return the rows of the values since the last time."""
        self.writer.values(self.observer.take())
        return self.writer.take()

    def left(self) -> Left:
        """Return which variables were seen, and the transactions left out because they are only likely."""
        return Left(seen=self.observer.found, doubts=self.observer.doubts)


def _leave_out(doubts: Mapping[str, int], likely: bool) -> None:
    """Report how many transactions were left out because they are only likely, and why; nothing if they were requested."""
    sentence = "" if likely else values_left_out(doubts)
    if sentence:
        click.echo(f"s7dissect: {sentence}; --likely lists them", err=True)


def _split(reading: Reading) -> tuple[tuple[str, ...], WantedSet | None]:
    """Return the files among the arguments, and the selected variables; the first argument is always a file."""
    words = reading.files
    captures = files_meant([word for at, word in enumerate(words) if at == 0 or _is_file(word)])
    names = [word for at, word in enumerate(words) if at > 0 and not _is_file(word)]
    return captures, wanted_of(names, reading.naming, reading.decoder)


def _is_file(word: str) -> bool:
    try:
        return word == "-" or Path(word).exists() or os.sep in word or word.lower().endswith(_CAPTURES)
    except OSError:
        return False  # no path can have this name


def _miss(wanted: WantedSet | None, names: Collection[str], selected: bool) -> None:
    """Report which of the chosen variables had neither a value nor a refusal in the captures, or the ``selected`` part."""
    if wanted is None:
        return
    missing = [printable(one.text) for one in wanted.all if one.text not in names]
    if missing:
        where = "selected" if selected else "read"
        click.echo(f"s7dissect: no value of {some(missing, _LISTED)} in what was {where}", err=True)
