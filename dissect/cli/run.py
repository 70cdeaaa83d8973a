"""Shared by the analysing commands: arguments, the loop over the files, progress, output, exit code."""

from __future__ import annotations

import gc
import os
import signal
import stat
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from itertools import islice
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any, Final, Self

import click

from dissect.cli.folders import any_folder, expanded
from dissect.cli.main import EXIT_DAMAGED, EXIT_INTERRUPTED, EXIT_OK
from dissect.cli.task import current
from dissect.packets.source import files as reading
from dissect.packets.source import remote
from dissect.packets.source.packet import CaptureError
from dissect.wire.text import printable

if TYPE_CHECKING:
    from rich.progress import Progress, TaskID

    from dissect.files.session import Run
    from dissect.meaning.report.words import Places

#: Files smaller than this are read faster than a progress bar appears.
_WORTH_A_BAR: Final = 20_000_000
#: Assumed growth of a compressed file, to decide whether it needs a progress bar.
_GROWS: Final = 10

#: Lines that are joined and written together; many more cost fresh memory each time.
PIECE: Final = 64
#: The most pieces that the system writes without joining them, 0 if it cannot.
if sys.platform == "win32":
    _GATHERED = 0
else:
    _GATHERED = os.sysconf("SC_IOV_MAX")

#: Marks in names that are patterns, ranges of days, or on another machine.
_NOT_PLAIN: Final = ("://", "*", "?", "[", "{")


def files_meant(files: Iterable[str]) -> tuple[str, ...]:
    """Return the files for the names. Raises `CaptureError` if a pattern matches no file, or a range of days is invalid."""
    names = tuple(files)
    of = current()
    if of is not None:
        return (of.file,)
    if any([mark in name for name in names for mark in _NOT_PLAIN]):
        names = tuple(remote.expand(names))
    return tuple(expanded(names))


def _files(_ctx: click.Context, _param: click.Parameter, files: tuple[str, ...]) -> tuple[str, ...]:
    return files_meant(files)


#: The files to read: `-` is standard input; patterns and ranges of days are expanded.
files_argument = click.argument(
    "files", nargs=-1, required=True, type=click.Path(readable=False), metavar="FILE...", callback=_files
)
#: The same where a command does without.
files_if_any: Final[Callable[[Any], Any]] = click.argument(
    "files", nargs=-1, type=click.Path(readable=False), metavar="FILE...", callback=_files
)


#: Packets that their receiver dropped do not belong to the conversation; the command gets ``checksums``.
checksums_option: Final[Callable[[Any], Any]] = click.option(
    "--checksums", is_flag=True, help="Ignore packets with a wrong TCP or UDP checksum, as their receiver does."
)


def nanoseconds(ctx: click.Context, param: click.Parameter, ms: str | None) -> int | None:
    """Return the value of an option in milliseconds as nanoseconds, None if it was not given."""
    if ms is None:
        return None
    try:
        number = float(ms)
    except ValueError:
        raise click.BadParameter(f"expected milliseconds, got {ms!r}.", ctx, param) from None
    if not 0 <= number <= 1e9:
        raise click.BadParameter(f"expected 0 to 1000000000 milliseconds, got {ms}.", ctx, param)
    return int(number * 1e6)


#: ``--slow MS``; the command's argument is ``slow_ns``.
slow_option: Final[Callable[[Any], Any]] = click.option(
    "--slow",
    "slow_ns",
    callback=nanoseconds,
    default="1000",
    show_default=True,
    metavar="MS",
    help="Report answers that take longer than this many milliseconds.",
)


#: The end of the help of each command.
EXIT_CODES: Final = (
    "Exit code: 0 success, 1 a finding that --fail-on names, 2 wrong use or an unreadable file, 3 a damaged or truncated file, "
    "5 the output could not be written, 130 interrupted. The results cover what was read."
)


# ---- output ---------------------------------------------------------------------------------------------------------


def write(lines: Iterable[str]) -> None:
    """Write lines to stdout, in UTF-8 whatever the locale, so that the same input gives the same octets everywhere."""
    source = iter(lines)
    while piece := list(islice(source, PIECE)):
        if all(map(str.isascii, piece)):
            piece.append("")
            octets = "\n".join(piece).encode("ascii")
        else:  # joined first, a single arrow would make a tree of ASCII text a wide string
            octets = b"\n".join([line.encode("utf-8", "backslashreplace") for line in (*piece, "")])
        sys.stdout.buffer.write(octets)
    sys.stdout.buffer.flush()  # a reader of a live capture wants immediate output


def write_octets(lines: Iterable[bytes]) -> None:
    """Write lines that are octets already."""
    source = iter(lines)
    while piece := list(islice(source, PIECE)):
        piece.append(b"")
        sys.stdout.buffer.write(b"\n".join(piece))
    sys.stdout.buffer.flush()


def write_bytes(octets: bytes) -> None:
    """Write lines to stdout that are encoded as `write` does."""
    sys.stdout.buffer.write(octets)
    sys.stdout.buffer.flush()


def write_pieces(pieces: list[bytes]) -> None:
    """Write pieces of output without joining them first; a piece need not end at a line end."""
    out = sys.stdout.buffer
    written = 0
    if sys.platform != "win32" and len(pieces) <= _GATHERED:
        try:
            descriptor = out.fileno()
        except OSError:  # it is no file
            pass
        else:
            out.flush()
            written = os.writev(descriptor, pieces)
    if written < sum(map(len, pieces)):
        out.write(b"".join(pieces)[written:])
        out.flush()


def places_of(run: Run, files: Sequence[str]) -> Places:
    """Return how packets of ``run`` over ``files`` are named; may be called during the run."""
    from dissect.cli.configuration import hosts
    from dissect.meaning.report.words import Places

    return Places(run.files, len(files) > 1, hosts())


# ---- the drive ------------------------------------------------------------------------------------------------------


def drive(
    run: Run, files: Sequence[str], each: Callable[[], None] | None = None, done: Callable[[], bool] | None = None
) -> int:
    """Read every file of ``run``, call ``each`` after each step, and return the exit code.

    When ``done`` returns True after a step, reading ends: all requested results are there.

    An interruption (SIGINT, SIGTERM) ends the reading between two steps, or while waiting for input; earlier results are kept
    and reported, and the exit code shows it. Raises `CaptureError` before anything is read if one of ``files`` is not a
    capture.
    """
    code = EXIT_OK
    run.lenient = run.lenient or any_folder()
    if len(files) > 1 and not run.lenient:
        check_captures(files)
    # The engine makes no cycles, so nothing waits for the collector; its walks over thousands of open connections would only
    # make pauses.
    gc.disable()
    try:
        with Interruption() as interruption, Bar(files, each is not None) as bar:
            while not interruption.asked and run.step():
                if each is not None:
                    each()
                bar.show(sum([file.octets for file in run.files]))
                if done is not None and done():
                    break
            if interruption.asked:
                code = EXIT_INTERRUPTED
    except KeyboardInterrupt:
        code = EXIT_INTERRUPTED
    except CaptureError as error:
        raise _safe(error) from None
    finally:
        gc.enable()
    run.finish()
    if each is not None:
        each()
    if code == EXIT_OK and any(file.loss for file in run.files):
        code = EXIT_DAMAGED
    return code


def complain(run: Run, code: int) -> None:
    """Report on stderr problems that the results do not show: damaged files, an interruption."""
    complain_of([(file.name, file.loss) for file in run.files], code)


def complain_of(losses: Iterable[tuple[str, str]], code: int) -> None:
    """Do the same for files with descriptions of damage, empty for sound ones."""
    for name, loss in losses:
        if loss:
            click.echo(f"s7dissect: {printable(name)}: {printable(loss)}", err=True)
    if code == EXIT_INTERRUPTED:
        click.echo("s7dissect: interrupted; the results cover what was read so far", err=True)


def check_captures(files: Sequence[str]) -> None:
    """Check every file before the first is analysed, so that a wrong one is reported at once and not after an hour."""
    for file in files:
        if file == "-" or gives_once(file):
            continue
        try:
            reading.open_capture(file).close()
        except CaptureError as error:
            raise _safe(error) from None


def gives_once(file: str) -> bool:
    """Return whether a file can be read only once, as pipes can."""
    path = Path(file)
    try:
        return path.exists() and not path.is_file() and not path.is_dir()
    except OSError:
        return False


def _safe(error: CaptureError) -> CaptureError:
    """Return the error with control characters in file names escaped, so that it is safe for a terminal."""
    return CaptureError(printable(str(error)))


#: Seconds within which two SIGTERM are one.
_TWICE_S: Final = 0.5


class Signals:
    """SIGINT and SIGTERM during a run: the first one is stored in ``asked``; `react` handles the rest.

    A second SIGTERM within `_TWICE_S` is a duplicate: `timeout` sends one to the process and one to its group. A second Ctrl-C
    is intended.
    """

    def __init__(self) -> None:
        self.asked = False
        self._terminated = -_TWICE_S
        self._previous: dict[signal.Signals, Any] = {}

    def __enter__(self) -> Self:
        for number in (signal.SIGINT, signal.SIGTERM):
            self._previous[number] = signal.signal(number, self._note)
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._previous.items():
            signal.signal(number, handler)

    def _note(self, number: int, frame: FrameType | None) -> None:
        now = time.monotonic()
        if number == signal.SIGTERM:
            before, self._terminated = self._terminated, now
            if now - before < _TWICE_S:
                return
        again = self.asked
        self.asked = True
        self.react(again, frame)

    def react(self, again: bool, frame: FrameType | None) -> None:
        """Handle a signal in ``frame``; ``again``: it is not the first."""


class Interruption(Signals):
    """Signals while files are read.

    The first one is only remembered, so that no packet is left half analysed. If the process waits for input, KeyboardInterrupt
    aborts the wait. A second signal aborts in any case.
    """

    def react(self, again: bool, frame: FrameType | None) -> None:
        """Abort a wait for input, and on the second signal anything."""
        if again or _in_source(frame):
            raise KeyboardInterrupt


def _in_source(frame: FrameType | None) -> bool:
    """Return whether a signal arrived while octets were being read: in the modules that read files, or below them."""
    while frame is not None:
        if frame.f_code.co_filename in {reading.__file__, remote.__file__}:
            return True
        frame = frame.f_back
    return False


# ---- progress -------------------------------------------------------------------------------------------------------


class Bar:
    """A progress bar on stderr: only on a terminal, only for large files, and never among lines of results."""

    def __init__(self, files: Sequence[str], streaming: bool) -> None:
        self._progress: Progress | None = None
        self._task: TaskID | None = None
        self._total: int | None = 0
        self._wanted = False
        if sys.stderr is None or not sys.stderr.isatty() or (streaming and not _goes_to_file()):
            return
        worth = 0
        for path in [Path(file) for file in files]:
            try:
                if not path.is_file():
                    continue
                size = path.stat().st_size
                compressed = _is_compressed(path)
            except OSError:  # it is reported where it is read
                continue
            else:
                worth += size * _GROWS if compressed else size
                # The decompressed size of a file is not known before its end.
                self._total = None if compressed or self._total is None else self._total + size
        self._wanted = worth >= _WORTH_A_BAR

    def __enter__(self) -> Self:
        if self._wanted:
            from rich.console import Console
            from rich.progress import BarColumn, DownloadColumn, Progress, TextColumn, TimeRemainingColumn

            self._progress = Progress(
                TextColumn("reading"),
                BarColumn(),
                DownloadColumn(),
                TimeRemainingColumn(),
                console=Console(stderr=True),
                transient=True,
            )
            self._task = self._progress.add_task("reading", total=self._total)
            self._progress.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._progress is not None:
            self._progress.stop()

    def show(self, octets: int) -> None:
        """Show how many octets of the files were read."""
        if self._progress is not None and self._task is not None:
            self._progress.update(self._task, completed=float(octets))


def _goes_to_file() -> bool:
    """Return whether stdout is a file, not a terminal or a pipe into a pager."""
    try:
        return stat.S_ISREG(os.fstat(sys.stdout.fileno()).st_mode)
    except (OSError, ValueError):
        return False


def _is_compressed(path: Path) -> bool:
    with path.open("rb") as file:
        return file.read(4)[:2] in {b"\x1f\x8b", b"\x28\xb5"}
