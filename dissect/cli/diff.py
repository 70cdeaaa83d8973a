"""`s7dissect diff`: what changed from one session to another, in words, JSON or JUnit XML."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable
from itertools import islice

import click

from dissect.cli.formats import format_option, write_outcome
from dissect.cli.golden import load
from dissect.cli.main import EXIT_GATE, EXIT_INTERRUPTED, EXIT_OK, EXIT_USAGE
from dissect.cli.options.completing import from_table
from dissect.cli.options.reading import reading_options
from dissect.cli.reading import Reading
from dissect.meaning.report import words
from dissect.meaning.report.formats import DIFFERENCES, Format
from dissect.meaning.report.outcome import WIDE_PAGE, Case, Outcome, plain
from dissect.meaning.report.styled import Line
from dissect.testing.golden.comparison import differences
from dissect.testing.golden.difference import KINDS, Difference, DiffOptions
from dissect.testing.golden.model import GoldenError, Session
from dissect.wire.text import encodable, printable

DIFF_SCHEMA = "s7dissect.diff/1"

_EXIT_CODES = (
    "Exit code: 0 no differences, 1 differences, 2 wrong use, an unreadable file, or a damaged one (differences are reported, "
    "but unreliable), 5 the output could not be written, 130 interrupted."
)
_WIDTH = 76
_IGNORABLE = "\n".join(
    [textwrap.fill(f"{name:<11} {text}", _WIDTH, subsequent_indent=" " * 12) for name, text in KINDS.items()]
)


@click.command("diff", epilog=f"{_EXIT_CODES}\n\n\b\nKinds of differences for --ignore:\n{_IGNORABLE}")
@click.argument("first", metavar="A", type=click.Path(readable=False))
@click.argument("second", metavar="B", type=click.Path(readable=False))
@format_option(DIFFERENCES)
@click.option(
    "--ignore",
    multiple=True,
    shell_complete=from_table(lambda: KINDS, several=True),
    metavar="WHAT",
    help="Ignore this kind of difference: a name from the list below, or NAME:PATTERN with * and ?, such as 'values:DB10.*'; "
    "comma-separated or repeated.",
)
@click.option(
    "--latency",
    metavar="TOLERANCE",
    help="Also compare answer times; shifts up to the tolerance (20%, 5ms or 20%,5ms) are ignored.",
)
@click.option(
    "--max",
    "most",
    type=click.IntRange(min=0),
    default=100,
    show_default=True,
    metavar="N",
    help="Maximum number of differences to print.",
)
@reading_options("transaction", "connection", files=None, checksums=False)
def command(
    reading: Reading,
    first: str,
    second: str,
    format_: Format,
    ignore: tuple[str, ...],
    latency: str | None,
    most: int,
) -> int:
    """Report what changed from A to B, each a capture or a golden (see `s7dissect golden`).

    Transactions are matched by their request, not by their position, so one added or missing request is one difference. Times,
    addresses and reference numbers are not compared; answer times only with --latency.
    """
    try:
        options = DiffOptions([part for text in ignore for part in text.split(",") if part], latency, reading.naming)
    except ValueError as error:
        raise click.UsageError(str(error)) from None
    if first == "-" and second == "-":
        raise click.UsageError("only one of A and B can be standard input.")
    reading.naming = None  # names are written, and not kept in the sessions
    try:
        a, code_a = load(reading, (first,)), reading.code
        b, code_b = load(reading, (second,)), reading.code
    except GoldenError as error:
        raise click.ClickException(printable(str(error))) from None
    if EXIT_INTERRUPTED in {code_a, code_b}:
        return EXIT_INTERRUPTED
    differing = differences(a, b, options)
    shown = list(islice(differing, most))
    rest = sum([1 for _ in differing])
    write_outcome(format_, DIFFERENCES, SessionDifferences(a, b, shown, rest))
    if code_a or code_b:
        return EXIT_USAGE
    return EXIT_GATE if shown or rest else EXIT_OK


class SessionDifferences(Outcome):
    """The differences of two sessions, of which ``rest`` more are not shown.

    ``errors`` (kind, text) are tests that could not run. In JSON, other values come before and after the differences.
    """

    layout = WIDE_PAGE

    def __init__(self, a: Session, b: Session, shown: list[Difference], rest: int) -> None:
        self.a, self.b = a, b
        self.shown = shown
        self.rest = rest
        self.errors: list[tuple[str, str]] = []
        self.schema = DIFF_SCHEMA
        self.more: dict[str, object] = {}

    def text(self) -> Iterable[Line]:
        """Return a line for each difference."""
        rest = [f"and {words.count(self.rest, 'further difference')}"] if self.rest else []
        return plain([*[difference.text for difference in self.shown], *rest])

    def as_dict(self) -> dict[str, object]:
        """Return the differences as JSON-ready values."""
        a, b = self.a, self.b
        return {
            "schema": self.schema,
            "a": encodable(a.name),
            "b": encodable(b.name),
            "same": not self.shown and not self.rest,
            "count": len(self.shown) + self.rest,
            "not_shown": self.rest,
            "damage": [encodable(text) for text in (*a.damage, *b.damage)],
            "differences": [difference.as_dict() for difference in self.shown],
            **self.more,
        }

    def cases(self) -> tuple[str, str, list[Case]]:
        """Return a test for each connection of A, and one for connections that only B has.

        Damaged files and failed attempts are a test each.
        """
        a, b = self.a, self.b
        by_link: dict[int, list[Difference]] = {link.number: [] for link in a.links}
        for difference in self.shown:
            by_link.setdefault(difference.connection, []).append(difference)
        cases = [
            Case(
                f"connection {number}" if number else "added connections",
                tuple([(difference.kind, difference.text) for difference in differing]),
            )
            for number, differing in sorted(by_link.items())
        ]
        if self.rest:
            text = f"{words.count(self.rest, 'further difference')} not shown"
            cases.append(Case("further differences", (("more", text),), listed=False))
        for kind, text in [*[("damaged", text) for text in (*a.damage, *b.damage)], *self.errors]:
            cases.append(Case(f"{kind}: {text}", errors=((kind, text),)))
        return f"s7dissect diff {a.name} {b.name}", a.name, cases
