"""What the analysing commands share: arguments, the drive through the files, progress, output, exit code."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any, Final

import click

from dissect.cli.main import EXIT_DAMAGED, EXIT_INTERRUPTED, EXIT_OK

if TYPE_CHECKING:
    from rich.progress import Progress, TaskID

    from dissect.session import Run

#: Files smaller than this are read faster than a progress bar appears.
_WORTH_A_BAR: Final = 20_000_000

_COLOURS: Final = {"heading": "cyan", "error": "red", "warning": "yellow", "note": "blue"}

#: The files to read: `-` is standard input.
files_argument = click.argument("files", nargs=-1, required=True, type=click.Path(), metavar="FILE...")

#: The limit from which an answer is slow.
slow_option = click.option(
    "--slow",
    "slow_ms",
    type=click.FloatRange(min=0, max=1e9),
    default=1000.0,
    show_default=True,
    metavar="MS",
    help="An answer later than this many milliseconds is a finding.",
)


def format_option(*formats: str) -> Callable[[Any], Any]:
    """Return the ``-T`` option of a command that writes ``formats``, the first of them by default."""
    return click.option(
        "-T",
        "--format",
        "format_",
        type=click.Choice(formats),
        default=formats[0],
        show_default=True,
        help="What to write.",
    )


def write(lines: Iterable[str]) -> None:
    """Write lines to stdout, in UTF-8 whatever the locale says, so that the same input gives the same octets everywhere."""
    text = "\n".join(lines)
    if text:
        sys.stdout.buffer.write(text.encode("utf-8", "backslashreplace") + b"\n")


def styler() -> Callable[[str, str], str]:
    """Return a function that colours text on a terminal and leaves it alone elsewhere (and with NO_COLOR set)."""
    if not sys.stdout.isatty() or os.environ.get("NO_COLOR"):
        return lambda text, _style: text

    def coloured(text: str, style: str) -> str:
        if style == "dim":
            return click.style(text, dim=True)
        return click.style(text, fg=_COLOURS.get(style), bold=style in {"heading", "error"})

    return coloured


def drive(run: Run, files: tuple[str, ...], each: Callable[[], None] | None = None) -> int:
    """Read every file of ``run``, call ``each`` after each step, and return the exit code.

    An interruption ends the reading; what was read is kept and told, and the code says so.
    """
    code = EXIT_OK
    previous = signal.signal(signal.SIGTERM, _interrupt)
    try:
        with _Bar(files) as bar:
            while run.step():
                if each is not None:
                    each()
                bar.show(run)
    except KeyboardInterrupt:
        code = EXIT_INTERRUPTED
        run.finish()
    finally:
        signal.signal(signal.SIGTERM, previous)
    if each is not None:
        each()
    if code == EXIT_OK and any(file.damage for file in run.files):
        code = EXIT_DAMAGED
    return code


def complain(run: Run, code: int) -> None:
    """Say on stderr what the results alone do not show: damaged files, an interruption."""
    for file in run.files:
        if file.damage:
            click.echo(f"s7dissect: {file.name}: {file.damage}", err=True)
    if code == EXIT_INTERRUPTED:
        click.echo("s7dissect: interrupted, the results cover what was read until then", err=True)


def _interrupt(_signal: int, _frame: FrameType | None) -> None:
    raise KeyboardInterrupt


class _Bar:
    """A progress bar on stderr: on a terminal only, and only for files worth one."""

    def __init__(self, files: tuple[str, ...]) -> None:
        self._total = sum(Path(file).stat().st_size for file in files if Path(file).is_file())
        self._wanted = sys.stderr.isatty() and self._total >= _WORTH_A_BAR
        self._progress: Progress | None = None
        self._task: TaskID | None = None

    def __enter__(self) -> _Bar:
        if self._wanted:
            from rich.console import Console
            from rich.progress import Progress

            self._progress = Progress(console=Console(stderr=True), transient=True)
            self._task = self._progress.add_task("reading", total=self._total)
            self._progress.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._progress is not None:
            self._progress.stop()

    def show(self, run: Run) -> None:
        """Show how far ``run`` has come."""
        if self._progress is not None and self._task is not None:
            self._progress.update(self._task, completed=float(sum(int(file.octets) for file in run.files)))
