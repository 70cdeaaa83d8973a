"""The formats of option ``-T``: one table, which every command uses.

CONTRIBUTING.md says how to add one ("To add an output"): a file in dissect/meaning/report/writers and a row of `FORMATS`. No
command has to be changed: ``--help``, completion and the hint after a wrong name are made from the rows. Lines are `str` (or
UTF-8 octets), or `Line` to be wrapped and coloured on a terminal.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING, Any, Final, NamedTuple, cast

if TYPE_CHECKING:
    from dissect.meaning.report.outcome import Outcome
    from dissect.meaning.report.styled import Line
    from dissect.meaning.report.writer import Writer
    from dissect.wire.text import Clock

# Kinds of results. There are many of these records, one after another; they are given to a `Writer`.
TRANSACTIONS: Final = "transactions"
PDUS: Final = "PDUs"
OPERATIONS: Final = "operations"
VALUES: Final = "values"
#: Events of a live run are given to a class like `dissect.online.live.lines.PlainLines`.
EVENTS: Final = "events"
# The single result of a command is given to a function, as an `Outcome`.
ANALYSIS: Final = "analysis"
ALERTS: Final = "alerts"
DIFFERENCES: Final = "differences"
OUTCOME: Final = "outcome"
#: Rows of a query.
ROWS: Final = "rows"
#: Blocks of a program, and stations.
BLOCKS: Final = "blocks"
DEVICES: Final = "devices"

KINDS: Final = (
    TRANSACTIONS, PDUS, OPERATIONS, VALUES, EVENTS, ANALYSIS, ALERTS, DIFFERENCES, OUTCOME, ROWS, BLOCKS, DEVICES,
)  # fmt: skip


class Format(NamedTuple):
    """A format: its name, a few words about it for the help, and for each kind of result the class or function that writes it.

    ``writers`` has them as "module:name", so that modules are imported only when something is written. ``verbose``: the format
    has a long form of PDUs (option -V of `show`). ``piecewise``: a result that takes long may be written piece by piece.
    """

    name: str
    about: str
    writers: Mapping[str, str]
    verbose: bool = False
    piecewise: bool = False

    def writer(self, kind: str, clock: Clock | None = None, verbose: bool = False) -> Writer:
        """Return a new writer of records of a kind; KeyError for a kind it does not take."""
        return cast("Writer", self.maker(kind)(clock, verbose))

    def lines(self, kind: str, outcome: Outcome) -> Iterable[str | Line]:
        """Return the lines of a single result; KeyError for a kind it does not take."""
        return cast("Iterable[str | Line]", self.maker(kind)(outcome))

    def maker(self, kind: str) -> Callable[..., Any]:
        """Return the class or function that writes a kind; KeyError for a kind it does not take."""
        module, _, name = self.writers[kind].partition(":")
        return cast("Callable[..., Any]", getattr(importlib.import_module(module), name))


def _row(name: str, about: str, *writers: tuple[str, tuple[str, ...]], **options: bool) -> Format:
    return Format(name, about, {kind: where for where, kinds in writers for kind in kinds}, **options)


#: All formats by name. A command offers those formats that support its kind of result, in this order; the first is its default.
FORMATS: Final[dict[str, Format]] = {
    row.name: row
    for row in (
        _row(
            "text",
            "lines for a person",
            ("dissect.meaning.report.writers.text:TextWriter", (TRANSACTIONS, PDUS, OPERATIONS)),
            ("dissect.output.variables.writers:ValueText", (VALUES,)),
            ("dissect.online.live.lines:PlainLines", (EVENTS,)),
            (
                "dissect.meaning.report.outcome:text_outcome",
                (ANALYSIS, ALERTS, DIFFERENCES, OUTCOME, ROWS, BLOCKS, DEVICES),
            ),
            verbose=True,
            piecewise=True,
        ),
        _row(
            "jsonl",
            "a JSON object on each line",
            ("dissect.meaning.report.writers.jsonl:JsonlWriter", (TRANSACTIONS, PDUS, OPERATIONS)),
            ("dissect.output.variables.writers:ValueJsonl", (VALUES,)),
            ("dissect.online.live.json_lines:JsonLines", (EVENTS,)),
            ("dissect.meaning.report.outcome:json_outcome", (ALERTS,)),
            ("dissect.output.export.result_lines:json_lines", (ROWS,)),
        ),
        _row(
            "csv",
            "rows for a spreadsheet",
            ("dissect.meaning.report.writers.csv:CsvWriter", (TRANSACTIONS,)),
            ("dissect.output.variables.writers:ValueCsv", (VALUES,)),
            ("dissect.output.export.result_lines:csv_lines", (ROWS,)),
            ("dissect.meaning.report.outcome:csv_outcome", (BLOCKS, DEVICES)),
        ),
        _row(
            "json",
            "one JSON object",
            ("dissect.meaning.report.outcome:json_outcome", (ANALYSIS, DIFFERENCES, OUTCOME, BLOCKS, DEVICES)),
        ),
        _row(
            "fields",
            "the fields named with -e",
            ("dissect.meaning.select.columns:FieldsWriter", (TRANSACTIONS, PDUS, OPERATIONS)),
        ),
        _row("html", "a page to read and print", ("dissect.output.carve.page:html_outcome", (BLOCKS,))),
        _row("junit", "JUnit XML", ("dissect.meaning.report.writers.junit:junit_outcome", (DIFFERENCES,))),
    )
}


def formats_for(kind: str) -> list[Format]:
    """Return the formats that take a kind of result, in the order of the table."""
    return [row for row in FORMATS.values() if kind in row.writers]
