"""`s7dissect report`: captures as one HTML page with a verdict, plots and tables."""

from __future__ import annotations

import sys
from itertools import islice
from typing import TYPE_CHECKING, Final

import click

from dissect.cli.configuration import config_typed, hosts
from dissect.cli.display import clock
from dissect.cli.main import EXIT_INTERRUPTED
from dissect.cli.options.given import was_given
from dissect.cli.options.reading import reading_options
from dissect.cli.options.variables import wanted_of
from dissect.cli.reading import Reading
from dissect.cli.run import files_if_any, places_of
from dissect.cli.second_pass import check_out
from dissect.packets.source.remote import shown
from dissect.wire.config.saving import save
from dissect.wire.text import printable

if TYPE_CHECKING:
    from dissect.engine.observer import Observer
    from dissect.files.session import Run
    from dissect.output.page.rendering import Side
    from dissect.output.variables.wanted import WantedSet

#: Options that say how captures are read, and their parameters.
_READING: Final = {
    "--checksums": "checksums",
    "--scd": "scd",
    "--bind": "bind",
    "--tags": "tags",
    "--tags-encoding": "encoding",
    "--tags-db": "numbers",
    "--tls-keys": "tls_keys",
}
_EXIT_CODES: Final = (
    "Exit code: 0 success, 2 wrong use, or an unreadable or unwritable file, 3 a damaged or truncated file (the report covers "
    "what could be read), 5 the output could not be written (disk full), 130 interrupted (nothing written)."
)


def needs_template_engine() -> None:
    """Refuse, with what to do, where the extra for reports is not installed."""
    from dissect.output.page import rendering

    if not rendering.is_installed():
        raise click.ClickException(rendering.NEEDS)


def _two_captures(ctx: click.Context, param: click.Parameter, both: tuple[str, str] | None) -> tuple[str, str] | None:
    """Refuse an option in place of the second capture; without this, click's error would not fit."""
    if both is not None and both[1].startswith("-"):
        raise click.BadParameter(f"expected two captures, got {both[0]!r} and the option {both[1]!r}.", ctx, param)
    return both


@click.command("report", epilog=_EXIT_CODES)
@click.option(
    "-o", "--output", "output", required=True, metavar="OUT", help="The HTML file to write; - is standard output."
)
@click.option(
    "--plot",
    "plotted",
    multiple=True,
    metavar="TAG",
    help="Plot the values of this tag or address, such as DB1.DBD4:REAL, and who writes it (see `s7dissect help values`). "
    "Repeatable.",
)
@click.option(
    "--diff",
    "both",
    nargs=2,
    type=click.Path(readable=False),
    default=None,
    callback=_two_captures,
    metavar="A B",
    help="Instead of FILE: two captures side by side, their plots overlaid.",
)
@click.option(
    "--full-paths",
    is_flag=True,
    help="Name FILE in the commands of the page as you named it; without this option by its name alone, without its folder.",
)
@click.option("--force", is_flag=True, help="Overwrite OUT if it exists (never a FILE).")
@reading_options(files=files_if_any, slow=True)
def command(
    reading: Reading, output: str, plotted: tuple[str, ...], both: tuple[str, str] | None, full_paths: bool, force: bool
) -> int:
    """Write captures as one HTML page: what broke, since when and who is affected, plots, and tables to sort and search.

    The page is one file that works offline and loads nothing from a network. Its size is bounded: it says what it left out.
    FILE is as for `analyze`; several files are read as one capture.
    """
    from dissect import __version__
    from dissect.output.page.rendering import MAX_DIFFERENCES, render
    from dissect.testing.golden.comparison import differences
    from dissect.testing.golden.difference import DiffOptions
    from dissect.testing.golden.reading import SessionReader

    needs_template_engine()
    files = reading.files
    if bool(files) == bool(both):
        raise click.UsageError("give either FILE or --diff A B." if files else "missing FILE (or --diff A B).")
    check_out(files or both or (), output, force)

    plots = wanted_of(plotted, reading.naming, reading.decoder) if plotted else None
    if both is not None and reading.chosen.where is not None:
        raise click.UsageError("--diff compares whole captures; cut them first to compare a part.")
    if both is None:
        side, code = _read(reading, files, plots, full_paths)
        if code == EXIT_INTERRUPTED:
            return _unwritten(code)
        write_page(output, render([side], __version__))
        return code
    first, second = SessionReader(both[0]), SessionReader(both[1])
    a, code = _read(reading, both[:1], plots, full_paths, first)
    if code == EXIT_INTERRUPTED:
        return _unwritten(code)
    b, second_code = _read(reading, both[1:], plots, full_paths, second)
    if second_code == EXIT_INTERRUPTED:
        return _unwritten(second_code)
    differing = differences(first.finish([]), second.finish([]), DiffOptions([], None, reading.naming))
    shown = [printable(difference.text) for difference in islice(differing, MAX_DIFFERENCES)]
    write_page(output, render([a, b], __version__, shown, sum([1 for _ in differing])))
    return max(code, second_code)


def _read(
    reading: Reading, files: tuple[str, ...], plots: WantedSet | None, full_paths: bool, beside: Observer | None = None
) -> tuple[Side, int]:
    """Read captures for a report and one more observer; return the contents and the exit code so far."""
    from dissect.online.live.run import Fanout
    from dissect.output.page.gathered import Gathered, span_of
    from dissect.output.page.rendering import Side
    from dissect.output.page.rows import Rows

    names = ["stdin" if file == "-" else shown(file) for file in files]
    rows = Rows(names, clock(), hosts(), _reading(), full_paths)
    gathered = Gathered(rows, plots)
    observer = gathered if beside is None else Fanout([gathered, beside], _failed)

    def begin(run: Run) -> None:
        rows.places = places_of(run, files)
        gathered.files = run.files

    reading.files = files
    run = reading.run(observer, begin)
    # A report of a part covers the selected time.
    gathered.take(run.pipeline, run.files, span_of(run.pipeline) if reading.chosen.where is None else None)
    gathered.analysis.part = reading.part(run)
    if not reading.interrupted:
        reading.complain()
        reading.expect_possible()
    return Side(gathered, names), reading.code


def _reading() -> list[tuple[str, str]]:
    """Return the options for reading captures, as typed: the page shows them in commands to type."""
    params = click.get_current_context().params
    settings = [("--config", name) for name in config_typed()]
    for option, parameter in _READING.items():
        if was_given(parameter):
            value = params[parameter]
            if isinstance(value, dict):
                value = [f"{name}={number}" for name, number in value.items()]
            elif isinstance(value, bool):
                value = [""] if value else []
            settings += [(option, str(one)) for one in ([value] if isinstance(value, str) else value)]
    return settings


def _unwritten(code: int) -> int:
    click.echo("s7dissect: interrupted; nothing was written", err=True)
    return code


def _failed(_observer: Observer, error: Exception) -> None:
    """Let an error of one of two observers be reported like that of a single one."""
    raise error


def write_page(output: str, page: str) -> None:
    """Write a page, whole or not at all."""
    if output == "-":
        sys.stdout.buffer.write(page.encode())
        sys.stdout.buffer.flush()
    else:
        save(output, page.encode())
