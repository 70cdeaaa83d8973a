"""`s7dissect transactions`: one line for each request and its answer."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable

import click

from dissect.cli.gate import fail_on_option, gate
from dissect.cli.options.scd import scd_options
from dissect.cli.run import (
    EXIT_CODES,
    checksums_option,
    complain,
    drive,
    files_argument,
    format_option,
    nanoseconds,
    places_of,
    write,
)
from dissect.engine.conversation import Observer, Options
from dissect.engine.payload import PayloadDecoder
from dissect.report.jsonl import Choice, TransactionLines
from dissect.report.lines import csv_columns, transaction_cells, transaction_line
from dissect.report.places import Places
from dissect.session import Run
from dissect.transactions.transaction import Transaction
from dissect.wire.clock import Clock


@click.command("transactions", epilog=EXIT_CODES)
@files_argument
@format_option("text", "jsonl", "csv")
@click.option("--failed", is_flag=True, help="Only transactions with errors or without answer.")
@click.option(
    "--slow",
    "slow_ns",
    callback=nanoseconds,
    metavar="MS",
    help="Only transactions whose answer took longer than this many milliseconds; with --failed these as well.",
)
@checksums_option
@fail_on_option
@scd_options
def command(
    files: tuple[str, ...],
    format_: str,
    failed: bool,
    slow_ns: int | None,
    checksums: bool,
    fail_on: frozenset[str],
    decoder: PayloadDecoder | None,
) -> int:
    """Write one line for each request and its answer.

    It says when the request was sent (UTC), its number and packets, who asked whom, how long the answer took, the function,
    and each item with its value or why it was refused. Messages that nobody asked for have a line too.

    FILE is a pcap or pcapng file, also in gzip or zstd; - is standard input. A line comes when its transaction is complete,
    so a request without answer stands where it was given up.
    """
    choose = _choice(failed, slow_ns)
    # What is slow is a finding as well.
    options = Options(decoder=decoder, checksums=checksums)
    if slow_ns is not None:
        options.slow_ns = slow_ns
    take: Callable[[], list[str]]
    if format_ == "jsonl":
        lines = TransactionLines(choose)
        run = Run(files, lines, options)
        if len(files) > 1:
            lines.locate = places_of(run, files).locate
        take = lines.take
    else:
        rows = _Rows(format_ == "csv", choose)
        run = Run(files, rows, options)
        rows.begin(places_of(run, files))
        take = rows.take
    code = drive(run, files, lambda: write(take()))
    complain(run, code)
    return gate(run, fail_on, code)


def _choice(failed: bool, slow_ns: int | None) -> Choice | None:
    """Return what tells whether a transaction is wanted; None when all are."""
    if slow_ns is None:
        return (lambda transaction: transaction.failed) if failed else None

    def wanted(transaction: Transaction) -> bool:
        latency = transaction.latency_ns
        return (latency is not None and latency > slow_ns) or (failed and transaction.failed)

    return wanted


class _Rows(Observer):
    """Collects transactions as lines of text or CSV."""

    def __init__(self, as_csv: bool, choose: Choice | None) -> None:
        super().__init__()
        self._as_csv = as_csv
        self._choose = choose
        self._clock = Clock()
        self._places = Places([], False)
        self._rows: list[str] = []

    def begin(self, places: Places) -> None:
        """Name packets with ``places``; CSV begins with the names of its columns."""
        self._places = places
        if self._as_csv:
            self._rows.append(_csv_line(csv_columns(places)))

    def transaction(self, transaction: Transaction) -> None:
        """Add the line of a transaction."""
        if self._choose is not None and not self._choose(transaction):
            return
        if self._as_csv:
            self._rows.append(_csv_line(transaction_cells(transaction, self._clock, self._places)))
        else:
            self._rows.append(transaction_line(transaction, self._clock, self._places))

    def take(self) -> list[str]:
        """Return the lines collected since the last call."""
        rows = self._rows
        self._rows = []
        return rows


def _csv_line(cells: list[str]) -> str:
    buffer = io.StringIO()
    csv.writer(buffer, lineterminator="").writerow(cells)
    return buffer.getvalue()
