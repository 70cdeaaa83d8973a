"""`s7dissect verify`: compares our dissection of a capture with Wireshark's, field by field."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import click

from dissect.cli.formats import format_option, write_out, write_outcome
from dissect.cli.main import EXIT_GATE, EXIT_USAGE
from dissect.cli.options.reading import reading_options
from dissect.cli.reading import Reading
from dissect.cli.separate import Interrupted
from dissect.cli.task import Task
from dissect.files.jobs.tasks import About
from dissect.meaning.report.formats import OUTCOME, Format
from dissect.meaning.report.outcome import Outcome, plain
from dissect.meaning.report.styled import Line
from dissect.packets.source.remote import is_remote
from dissect.wire.text import printable

if TYPE_CHECKING:
    from dissect.testing.oracle.compare import Comparison
    from dissect.testing.oracle.verification import Verification

_EXIT_CODES = (
    "Exit code: 0 all differences explained, 1 unexplained differences, or a check of S7comm-plus failed, 2 wrong use, an "
    "unreadable file, or tshark or pyshark is missing, 3 a damaged or truncated file (what could be read was compared), 5 the "
    "output could not be written, 130 interrupted."
)


@click.command("verify", epilog=_EXIT_CODES)
@format_option(OUTCOME)
@click.option("--known", "every", is_flag=True, help="Text: also list known differences, not only their number.")
@click.option("--reorder", is_flag=True, help="Let Wireshark reassemble out-of-order TCP segments first.")
@click.option("--pyshark", is_flag=True, help="Run tshark through pyshark instead of directly.")
@reading_options(selects=False, checksums=False, scd=False, tags=False, separate=True, indexed=False)
def command(reading: Reading, format_: Format, every: bool, reorder: bool, pyshark: bool) -> int:
    """Compare our dissection of captures with Wireshark's, field by field: TPKT, COTP, S7comm.

    Each difference gives the packet, the field, our value and Wireshark's. Known faults of Wireshark are recognized by their
    bytes, counted and explained; any other difference is a bug, ours or theirs.

    Wireshark has no dissector for S7comm-plus. Of its PDUs a line says how many are read to their last byte, and how many
    responses have the integrity id that follows from their request; with --tls-keys also of those inside TLS.

    Needs tshark (apt install tshark), and for --pyshark pyshark (pip install 's7dissect[tshark]'). FILE is a pcap or pcapng
    file; it is read several times, so it cannot be standard input.
    """
    from dissect.testing.oracle.compare import compare
    from dissect.testing.oracle.pyshark_reader import read_pyshark
    from dissect.testing.oracle.tshark import OracleError, read_tshark, version
    from dissect.testing.oracle.verification import Verification

    def compared(file: str) -> _Part:
        comparison = compare(file, read_pyshark if pyshark else read_tshark, reorder, reading.tls_keys)
        return _Part(About(file, comparison.loss, Path(file).stat().st_size), comparison)

    reading.as_task(lambda of: _task(of, compared))
    for file in reading.files:
        if file == "-" or is_remote(file) or (Path(file).exists() and not Path(file).is_file()):
            raise click.UsageError(f"{printable(file)}: a regular file is needed, because it is read several times.")
    try:
        verification = Verification(version(), every)
        verified = _Verified(verification)

        def take(file: str, part: _Part) -> None:
            verified.lines += verification.take(file, part.comparison)
            if format_.piecewise:
                write_out(verified.taken())

        reading.one_by_one(compared, take)
    except OracleError as error:
        click.echo(f"s7dissect: {printable(str(error))}", err=True)
        return EXIT_USAGE
    write_outcome(format_, OUTCOME, verified)
    return EXIT_GATE if not reading.interrupted and not verification.holds else reading.code


class _Part(NamedTuple):
    """The results of a file's task."""

    about: About
    comparison: Comparison


def _task(of: Task, compared: Callable[[str], _Part]) -> None:
    """Compare the file of a task."""
    from dissect.testing.oracle.tshark import OracleError

    try:
        of.result = compared(of.file)
    except OracleError:
        if Interrupted.asked():  # Ctrl-C reaches tshark too
            raise KeyboardInterrupt from None
        raise


class _Verified(Outcome):
    """A verification; ``lines`` are those of the captures that are not written yet."""

    def __init__(self, verification: Verification) -> None:
        self.lines: list[str] = []
        self._verification = verification

    def taken(self) -> Iterator[Line]:
        """Return these lines, once."""
        lines, self.lines = self.lines, []
        return plain(lines)

    def text(self) -> Iterator[Line]:
        """Yield the lines not written yet, then the summary."""
        yield from self.taken()
        yield from plain(self._verification.summary())

    def as_dict(self) -> Mapping[str, object]:
        """Return all differences."""
        return self._verification.as_dict()
