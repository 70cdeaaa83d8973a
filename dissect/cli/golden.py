"""`s7dissect golden`: a capture as stable text to be reviewed, kept and compared."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

import click

from dissect.cli.main import EXIT_DAMAGED, EXIT_OK
from dissect.cli.options.completing import from_table
from dissect.cli.options.reading import reading_options
from dissect.cli.reading import Reading
from dissect.cli.run import complain, write
from dissect.cli.second_pass import check_out
from dissect.testing.golden.model import GoldenError, Session
from dissect.testing.golden.reading import SessionReader, is_golden, load_golden
from dissect.testing.golden.writing import EXTRAS, golden_lines
from dissect.wire.config.saving import save
from dissect.wire.text import printable

_EXIT_CODES = (
    "Exit code: 0 success, 2 wrong use, or an unreadable or unwritable file, 3 a damaged or truncated file (what could be read "
    "was written), 5 the output could not be written (disk full), 130 interrupted (nothing written)."
)


def choices(known: Iterable[str]) -> Callable[[click.Context, click.Parameter, str], frozenset[str]]:
    """Return the callback of an option that takes some of the names ``known``, separated by commas."""
    names = tuple(known)

    def chosen(ctx: click.Context, param: click.Parameter, value: str) -> frozenset[str]:
        wanted = [name.strip() for name in value.split(",") if name.strip()]
        for name in wanted:
            if name not in names:
                raise click.BadParameter(f"expected {', '.join(names)}, got {name!r}.", ctx, param)
        return frozenset(wanted)

    return chosen


@click.command("golden", epilog=_EXIT_CODES)
@click.option("-o", "--output", "output", default="-", metavar="OUT", help="File to write (default: standard output).")
@click.option("--force", is_flag=True, help="Overwrite OUT if it exists (never a FILE).")
@click.option(
    "--with",
    "extras",
    default="",
    metavar="WHAT",
    callback=choices(EXTRAS),
    shell_complete=from_table(lambda: dict.fromkeys(EXTRAS, ""), several=True),
    help=f"Also include details that vary between recordings, comma-separated: {', '.join(EXTRAS)}.",
)
@reading_options("transaction", "connection", checksums=False)
def command(reading: Reading, output: str, force: bool, extras: frozenset[str]) -> int:
    """Write the session in a capture as text: one transaction after another, with values and errors in words.

    The same session gives the same text whenever and wherever it was recorded: times, addresses, ports and reference numbers
    are left out, and connections are ordered by their content. FILE may also be such a text, which is then reformatted.
    """
    check_out(reading.files, output, force)
    naming, reading.naming = reading.naming, None  # names are written, and not kept in the session
    try:
        session = load(reading, reading.files)
    except GoldenError as error:
        raise click.ClickException(printable(str(error))) from None
    if reading.interrupted:
        return reading.code
    if output == "-":
        write(golden_lines(session, extras, naming))
    else:
        save(output, "".join([f"{line}\n" for line in golden_lines(session, extras, naming)]).encode())
    return reading.code


def load(reading: Reading, files: tuple[str, ...]) -> Session:
    """Return the session of captures or of a golden; damage is reported on stderr."""
    if len(files) == 1 and files[0] != "-" and Path(files[0]).is_file() and is_golden(files[0]):
        if reading.chosen.where is not None:
            raise click.UsageError(
                f"{printable(files[0])} is a golden, and only captures can be selected from; write it with `golden -Y` instead."
            )
        reading.code = EXIT_OK
        return load_golden(files[0])
    reading.files = files
    reader = SessionReader(files[0])
    run = reading.run(reader)
    if reading.interrupted:
        complain(run, EXIT_DAMAGED)  # the session itself is not shown
        click.echo("s7dissect: interrupted; nothing was written", err=True)
    else:
        reading.complain()
        reading.expect_possible()
    return reader.finish([f"{file.name}: {file.loss}" for file in run.files if file.loss])
