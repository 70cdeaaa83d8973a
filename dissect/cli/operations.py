"""`s7dissect operations`: what several transactions did together, one line for each."""

from __future__ import annotations

import click

from dissect.cli.gate import fail_on_option, gate
from dissect.cli.run import (
    EXIT_CODES,
    checksums_option,
    complain,
    drive,
    files_argument,
    format_option,
    places_of,
    write,
)
from dissect.engine.conversation import Observer, Options
from dissect.report.operations import operation_json, operation_line
from dissect.report.places import Places
from dissect.session import Run
from dissect.transactions.operation import KINDS, Operation
from dissect.wire.clock import Clock


@click.command("operations", epilog=EXIT_CODES)
@files_argument
@format_option("text", "jsonl")
@click.option("--kind", "kinds", multiple=True, type=click.Choice(list(KINDS)), help="Only operations of this kind.")
@checksums_option
@fail_on_option
def command(
    files: tuple[str, ...], format_: str, kinds: tuple[str, ...], checksums: bool, fail_on: frozenset[str]
) -> int:
    """Write one line for each operation: several transactions that belong together.

    That is: connections set up, blocks loaded into a PLC or read out of it, answers in several parts, cyclic and message
    subscriptions with what the PLC sent for them, test jobs, passwords. Each says who asked whom, how long it took, how much
    was carried and what came of it.

    FILE is a pcap or pcapng file, also in gzip or zstd; - is standard input. A line comes when its operation is over.
    """
    rows = _Rows(format_ == "jsonl", frozenset(kinds))
    run = Run(files, rows, Options(checksums=checksums))
    rows.places = places_of(run, files)
    code = drive(run, files, lambda: write(rows.take()))
    complain(run, code)
    return gate(run, fail_on, code)


class _Rows(Observer):
    """Collects operations as lines."""

    def __init__(self, as_jsonl: bool, kinds: frozenset[str]) -> None:
        super().__init__()
        self.places = Places([], False)
        self._line = operation_json if as_jsonl else operation_line
        self._kinds = kinds
        self._clock = Clock()
        self._lines: list[str] = []

    def operation(self, operation: Operation) -> None:
        """Add the line of an operation."""
        if not self._kinds or operation.kind in self._kinds:
            self._lines.append(self._line(operation, self._clock, self.places))

    def take(self) -> list[str]:
        """Return the lines collected since the last call."""
        lines = self._lines
        self._lines = []
        return lines
