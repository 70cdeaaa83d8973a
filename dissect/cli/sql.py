"""`s7dissect sql`: questions about a capture in SQL."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from dissect.cli.display import clock
from dissect.cli.formats import format_option, write_outcome
from dissect.cli.main import EXIT_OK
from dissect.cli.options.completing import from_table
from dissect.cli.options.reading import reading_options
from dissect.cli.reading import Reading
from dissect.cli.run import files_if_any, write
from dissect.meaning.report.formats import ROWS, Format

if TYPE_CHECKING:
    from dissect.output.export.sql import Query

_EXIT_CODES = (
    "Exit code: 0 success, 2 wrong use, a wrong query, a missing library or an unreadable file, 3 a damaged or truncated file "
    "(the result covers what was read), 5 the output could not be written, 130 interrupted."
)


def _names() -> dict[str, str]:
    from dissect.output.export.questions import QUESTIONS

    return {name: question.sentence for name, question in QUESTIONS.items()}


@click.command("sql", epilog=_EXIT_CODES)
@click.argument("query", metavar="QUERY", required=False, shell_complete=from_table(_names))
@format_option(ROWS)
@click.option("--questions", is_flag=True, help="List the questions that can be asked by name, with their SQL.")
@click.option("--allow-files", is_flag=True, help="Let the SQL read and write files and use the network.")
@reading_options(files=files_if_any)
def command(reading: Reading, query: str | None, format_: Format, questions: bool, allow_files: bool) -> int:
    """Query captures in SQL (DuckDB), without a file in between.

    QUERY is SQL over the tables connections, transactions, items, values, operations, acts, findings, finding_counts, devices
    and pdus (`s7dissect help tables`), or the name of a question, such as slowest or "who DB10.DBW4". Only the tables it names
    are made. Needs the extra [data].

    FILE is a pcap or pcapng file, plain or compressed with gzip or zstd; - is standard input.
    """
    if query is not None and not query:  # if it has only spaces, DuckDB reports it
        raise click.UsageError("QUERY is empty: give SQL or the name of a question (--questions lists them).")
    if questions:
        write(_questions())
        return EXIT_OK
    if query is None or not reading.files:
        raise click.UsageError(f"Missing argument '{'QUERY' if query is None else 'FILE...'}'.")
    from dissect.output.export.extras import MissingLibraryError
    from dissect.output.export.feed import TableFeed
    from dissect.output.export.result_lines import QueryOutcome
    from dissect.output.export.sql import MemorySink, SqlError

    try:
        asked, none = _query(query, allow_files)
        sink = MemorySink(asked.tables)
        feed = TableFeed(asked.tables, sink)
        run = reading.run(feed, lambda run: feed.begin(run.files))
        feed.finish(run.pipeline, run.files)
        write_outcome(format_, ROWS, QueryOutcome(asked.run(sink.tables()), none))
    except (SqlError, MissingLibraryError) as error:
        raise click.ClickException(str(error)) from None
    reading.complain()
    if reading.possible():
        reading.match()
    return reading.gated()


def _query(text: str, allow_files: bool) -> tuple[Query, str]:
    """Return the query, or the question of that name, and the message for no rows."""
    from dissect.output.export.questions import QUESTIONS, named
    from dissect.output.export.sql import Query
    from dissect.wire.config.hints import close_names

    try:
        saved = named(text, clock().local)
    except ValueError as error:
        raise click.UsageError(f"{str(error)[:1].upper()}{str(error)[1:]}.") from None
    if saved is not None:
        question, given = saved
        return Query(question.sql.strip(), allow_files, given), question.none
    if text and not any(map(str.isspace, text.strip())):
        near = close_names(text, QUESTIONS)
        hint = f" Did you mean {' or '.join(near)}?" if near else ""
        raise click.UsageError(f"{text!r} is neither SQL nor a question: {', '.join(QUESTIONS)}.{hint}")
    return Query(text, allow_files), ""


def _questions() -> list[str]:
    from dissect.output.export.questions import QUESTIONS

    lines: list[str] = []
    for question in QUESTIONS.values():
        lines += [
            f"{question.name}: {question.sentence}",
            *[
                f"    {one.name}: {one.about}" + (f" (else {one.default})" if one.default else "")
                for one in question.parameters
            ],
            *[f"    {line}" for line in question.sql.strip().split("\n")],
            "",
        ]
    return lines[:-1]
