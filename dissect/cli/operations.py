"""`s7dissect operations`: what several transactions did together, one line for each."""

from __future__ import annotations

import click

from dissect.cli.gate import fail_on_option, gate
from dissect.cli.look import clock, write_lines
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
from dissect.engine.observer import Observer, Options
from dissect.report.operations import operation_json, styled_operation
from dissect.report.places import Places
from dissect.report.styled import Line
from dissect.session import Run
from dissect.transactions.operation import KINDS, Operation


@click.command("operations", epilog=EXIT_CODES)
@files_argument
@format_option("text", "jsonl")
@click.option(
    "--kind",
    "kinds",
    multiple=True,
    type=click.Choice(list(KINDS)),
    metavar="KIND",
    help=f"Only this kind of operation: {', '.join(KINDS)}. Repeatable.",
)
@checksums_option
@fail_on_option
def command(
    files: tuple[str, ...], format_: str, kinds: tuple[str, ...], checksums: bool, fail_on: frozenset[str]
) -> int:
    """List operations, one line each: several transactions that belong together.

    Operations are connection setups, block downloads and uploads, answers in several parts, cyclic and message subscriptions
    with their pushes, test jobs and passwords. A line gives client and server, duration, size and result.

    FILE is a pcap or pcapng file, plain or compressed with gzip or zstd; - is standard input. A line is written when its
    operation ends.
    """
    told = _Told(frozenset(kinds), format_ == "jsonl")
    run = Run(files, told, Options(checksums=checksums))
    told.places = places_of(run, files)
    code = drive(run, files, told.write)
    complain(run, code)
    return gate(run, fail_on, code)


class _Told(Observer):
    """Collects operations as lines of text or JSON."""

    def __init__(self, kinds: frozenset[str], as_json: bool) -> None:
        super().__init__()
        self.places = Places([], False)
        self._kinds = kinds
        self._as_json = as_json
        self._clock = clock()
        self._lines: list[Line] = []
        self._objects: list[str] = []

    def operation(self, operation: Operation) -> None:
        """Add the line of an operation."""
        if self._kinds and operation.kind not in self._kinds:
            return
        if self._as_json:
            self._objects.append(operation_json(operation, self._clock, self.places))
        else:
            self._lines.append(styled_operation(operation, self._clock, self.places))

    def write(self) -> None:
        """Write the lines collected since the last call."""
        if self._as_json:
            write(self._objects)
            self._objects = []
        else:
            write_lines(self._lines)
            self._lines = []
