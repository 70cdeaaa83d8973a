"""`s7dissect open`: a capture, or a part of it, in Wireshark, with the results as comments of its packets."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Final

import click

from dissect.cli.main import EXIT_INTERRUPTED
from dissect.cli.options.numbers import NumberRange
from dissect.cli.options.reading import reading_options
from dissect.cli.options.select import where_option
from dissect.cli.reading import Reading
from dissect.cli.run import Signals, complain
from dissect.cli.second_pass import around_option, check_files, name_of, read_again, read_first, tell_cut, written_whole
from dissect.packets.source.wireshark import find_program
from dissect.wire.text import printable

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from dissect.files.recording.cutter import Around, Cutter
    from dissect.meaning.select.selection import Choice

_EXIT_CODES: Final = (
    "Exit code: 0 success, 2 wrong use, an unreadable or unwritable file, nothing to show, or no Wireshark, 3 a damaged or "
    "truncated file (what could be read was shown), 5 the output could not be written (disk full), 130 interrupted."
)


@click.command("open", epilog=_EXIT_CODES)
@where_option(
    "packet",
    "transaction",
    "finding",
    help="Only packets that this expression selects by their own fields, or by those of the transactions they carry (see "
    "`s7dissect help select`).",
)
@around_option
@click.option(
    "--frame",
    "frame",
    type=NumberRange(),
    metavar="N",
    help="Go to packet N of FILE (default: the first packet of the most severe finding).",
)
@click.option(
    "-o",
    "--output",
    "output",
    metavar="OUT",
    help="Keep the file as OUT. Without it, the file is temporary and is deleted when Wireshark ends.",
)
@click.option("--force", is_flag=True, help="Overwrite OUT if it exists (never a FILE).")
@reading_options(selects=False, checksums=False)
def command(
    reading: Reading,
    where: str | None,
    around: Around,
    frame: range | None,
    output: str | None,
    force: bool,
) -> int:
    """Open a capture in Wireshark at the packet that matters, with findings as packet comments.

    Wireshark gets a copy of FILE, with -Y a part of it; comments in FILE are kept. Its display filter `frame.comment contains
    "s7dissect:"` shows the packets with findings.

    Without Wireshark on this machine, -o OUT writes the file and says how to open it elsewhere.
    """
    from dissect.meaning.select.selection import Selection, Wanted

    if output == "-":
        raise click.UsageError("-o -: Wireshark opens a file; `s7dissect cut FILE -o -` writes to standard output.")
    if where is None and (around.packets or around.ns):
        raise click.UsageError("--around needs -Y: all packets are shown.")
    files = reading.files
    check_files(files, output or "-", force)
    program = find_program("wireshark")
    if not program and output is None:
        raise click.ClickException(
            "Wireshark was not found here; -o OUT writes the file to open it elsewhere, with wireshark -r OUT -g PACKET."
        )
    selection = Selection(Wanted())
    run, code, packets = read_first(files, selection, where, reading.options())
    if code == EXIT_INTERRUPTED:
        return code
    complain(run, code)
    choice = selection.choice(-(2**63), 2**63)
    if packets is not None:
        choice.narrow(packets.test())
    with _place(output) as path:
        cutter = _write(files, path, choice, around, frame.start if frame is not None else 0)
        if output is not None:
            tell_cut(cutter, output)
        number = _target(cutter, choice, frame.start if frame is not None else None)
        if not program:
            click.echo(f"s7dissect: open it with: wireshark -r {name_of(path)} -g {number}", err=True)
            return code
        return _show(program, path, number) or code


@contextmanager
def _place(output: str | None) -> Iterator[str]:
    """Yield the path to write to: ``output``, or one in a temporary folder that is removed afterwards."""
    if output is not None:
        yield output
        return
    # No other user may read this folder: captures contain passwords.
    with tempfile.TemporaryDirectory(prefix="s7dissect-") as folder:
        yield str(Path(folder, "s7dissect.pcapng"))


def _write(files: Sequence[str], path: str, choice: Choice, around: Around, mark: int) -> Cutter:
    """Read the files again, and write the selected packets."""
    from dissect.files.recording.cutter import Cutter

    with written_whole(path, "open") as writer:
        cutter = Cutter(choice, writer, around, mark)
        read_again(files, cutter)
        if not cutter.chosen:
            raise click.ClickException("no packet matches; there is nothing to open.")
        if mark and mark not in cutter.numbers:
            missing = f"-Y leaves out packet {mark}" if mark <= cutter.frames else f"there is no packet {mark}"
            raise click.ClickException(f"--frame: {missing}.")
    return cutter


def _target(cutter: Cutter, choice: Choice, frame: int | None) -> int:
    """Return the number, in the written file, of the packet to go to."""
    numbers = cutter.numbers
    if frame is not None:
        return numbers[frame]
    return next((numbers[commented] for commented in choice.comments if commented in numbers), numbers[0])


class _Waiting(Signals):
    """Signals while Wireshark runs: a termination is passed on to it; it handles an interruption from the keyboard itself."""

    def __init__(self) -> None:
        super().__init__()
        self._child: subprocess.Popen[bytes] | None = None

    def started(self, child: subprocess.Popen[bytes]) -> None:
        """Wireshark runs: end it if a signal came while it was started."""
        self._child = child
        if self.asked:
            child.terminate()

    def react(self, again: bool, frame: object) -> None:
        """Hand the signal on."""
        if self._child is not None:
            self._child.terminate()


def _show(program: str, path: str, number: int) -> int:
    """Run Wireshark on a file until it is closed; return 130 when it was interrupted."""
    with _Waiting() as waiting:
        try:
            child = subprocess.Popen([program, "-r", os.path.abspath(path), "-g", str(number)], stdout=sys.stderr)  # noqa: PTH100 - a name from the user that begins with - is a file too
        except OSError as error:
            raise click.ClickException(f"{printable(program)} cannot be started: {error.strerror}.") from None
        waiting.started(child)
        code = child.wait()
    if waiting.asked:
        return EXIT_INTERRUPTED
    if code:
        raise click.ClickException(f"Wireshark ended with code {code}; its own message, if any, is above.")
    return 0
