"""`s7dissect transactions`: one line for each request and its answer."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable

import click

from dissect.cli.drive import complain, drive, files_argument, format_option, slow_option, write
from dissect.conversation import Observer, Options
from dissect.transactions.transaction import Transaction


@click.command("transactions")
@files_argument
@format_option("text", "jsonl", "csv")
@slow_option
@click.option("--failed", is_flag=True, help="Only transactions with errors or without answer.")
def command(files: tuple[str, ...], format_: str, slow_ms: float, failed: bool) -> int:
    """Write one line for each request of FILE... with its answer, items, values and answer time.

    Lines come when a transaction is complete, so an unanswered request stands where it was given up.
    """
    from dissect.session import Run

    observer, flush = _jsonl(failed) if format_ == "jsonl" else _lines(format_, failed)
    run = Run(files, observer, Options(int(slow_ms * 1e6)))
    code = drive(run, files, flush)
    complain(run, code)
    return code


def _jsonl(failed: bool) -> tuple[Observer, Callable[[], None]]:
    from dissect.report.jsonl import TransactionLines

    lines = TransactionLines(failed)

    def flush() -> None:
        write(lines.take())

    return lines, flush


class _Rows(Observer):
    def __init__(self, row: Callable[[Transaction], str], failed: bool) -> None:
        super().__init__()
        self._row = row
        self._failed = failed
        self.rows: list[str] = []

    def transaction(self, transaction: Transaction) -> None:
        if not self._failed or transaction.failed:
            self.rows.append(self._row(transaction))


def _lines(format_: str, failed: bool) -> tuple[Observer, Callable[[], None]]:
    from dissect.report.lines import CSV_COLUMNS, transaction_cells, transaction_line
    from dissect.wire.clock import Clock

    clock = Clock()
    if format_ == "csv":
        rows = _Rows(lambda transaction: _csv(transaction_cells(transaction, clock)), failed)
        rows.rows.append(_csv(CSV_COLUMNS))
    else:
        rows = _Rows(lambda transaction: transaction_line(transaction, clock), failed)

    def flush() -> None:
        write(rows.rows)
        rows.rows = []

    return rows, flush


def _csv(cells: list[str]) -> str:
    buffer = io.StringIO()
    csv.writer(buffer, lineterminator="").writerow(cells)
    return buffer.getvalue()
