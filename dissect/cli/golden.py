"""`s7dissect golden`: a capture as stable text to be reviewed, kept and compared."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING

import click

from dissect.cli.main import EXIT_DAMAGED, EXIT_INTERRUPTED, EXIT_OK
from dissect.cli.nothing import expect_possible
from dissect.cli.options.scd import scd_options
from dissect.cli.options.select import Chosen, select_options
from dissect.cli.options.tags import tag_options
from dissect.cli.options.tls import tls_option
from dissect.cli.run import complain, drive, files_argument, write
from dissect.cli.second_pass import check_out
from dissect.engine.pipeline import Options
from dissect.golden.model import GoldenError, Session
from dissect.golden.reading import SessionReader, is_golden, load_golden
from dissect.golden.writing import EXTRAS, golden_lines
from dissect.wire.saving import save
from dissect.wire.text import printable

if TYPE_CHECKING:
    from dissect.engine.exchange import PayloadDecoder
    from dissect.tls.key_log import KeyLog
    from dissect.transactions.naming import Naming

_EXIT_CODES = (
    "Exit code: 0 success, 2 wrong use, or an unreadable or unwritable file, 3 a damaged or truncated file (what could be read "
    "was written), 5 the output could not be written (disk full), 130 interrupted (nothing written)."
)


def choices(known: Iterable[str]) -> Callable[[click.Context, click.Parameter, str], frozenset[str]]:
    """Return the callback of an option that takes some of the names ``known``, with commas between them."""
    names = tuple(known)

    def chosen(ctx: click.Context, param: click.Parameter, value: str) -> frozenset[str]:
        wanted = [name.strip() for name in value.split(",") if name.strip()]
        for name in wanted:
            if name not in names:
                raise click.BadParameter(f"expected {', '.join(names)}, got {name!r}.", ctx, param)
        return frozenset(wanted)

    return chosen


@click.command("golden", epilog=_EXIT_CODES)
@files_argument
@click.option("-o", "--output", "output", default="-", metavar="OUT", help="File to write (default: standard output).")
@click.option("--force", is_flag=True, help="Overwrite OUT if it exists (never a FILE).")
@click.option(
    "--with",
    "extras",
    default="",
    metavar="WHAT",
    callback=choices(EXTRAS),
    help=f"Also include details that vary between recordings, comma-separated: {', '.join(EXTRAS)}.",
)
@select_options("transaction", "connection")
@scd_options
@tag_options
@tls_option
def command(
    files: tuple[str, ...],
    output: str,
    force: bool,
    extras: frozenset[str],
    decoder: PayloadDecoder | None,
    chosen: Chosen,
    naming: Naming | None,
    tls_keys: KeyLog | None,
) -> int:
    """Write the session in a capture as text: one transaction after another, with values and errors in words.

    The same session gives the same text whenever and wherever it was recorded: times, addresses, ports and reference numbers
    are left out, and connections are ordered by their content. FILE may also be such a text, which is then reformatted.
    """
    check_out(files, output, force)
    try:
        session, code = _session(files, Options(decoder=decoder, tls_keys=tls_keys), chosen)
    except GoldenError as error:
        raise click.ClickException(printable(str(error))) from None
    if code == EXIT_INTERRUPTED:
        return code
    if output == "-":
        write(golden_lines(session, extras, naming))
    else:
        save(output, "".join([f"{line}\n" for line in golden_lines(session, extras, naming)]).encode())
    return code


def _session(files: tuple[str, ...], options: Options, chosen: Chosen) -> tuple[Session, int]:
    if len(files) == 1 and Path(files[0]).is_file() and is_golden(files[0]):
        refuse_selection(files[0], chosen)
        return load_golden(files[0]), EXIT_OK
    return read_capture(files, options, chosen)


def refuse_selection(file: str, chosen: Chosen) -> None:
    """Refuse to select from a golden, which has no times, hosts or numbers."""
    if chosen.where is not None:
        raise click.UsageError(
            f"{printable(file)} is a golden, and only captures can be selected from; write it with `golden -Y` instead."
        )


def read_capture(files: tuple[str, ...], options: Options, chosen: Chosen | None = None) -> tuple[Session, int]:
    """Read what is selected of captures; return their session and the exit code so far; what was odd is reported on stderr."""
    from dissect.session import Run

    reader = SessionReader(files[0])
    if chosen is None:
        run = Run(files, reader, options)
    else:
        run = Run(files, chosen.sieve(reader), chosen.narrow(options))
        chosen.begin(run, files)
    code = drive(run, files)
    complain(run, EXIT_DAMAGED if code == EXIT_INTERRUPTED else code)
    if chosen is not None and code != EXIT_INTERRUPTED:
        expect_possible(run, chosen)
    if code == EXIT_INTERRUPTED:
        click.echo("s7dissect: interrupted; nothing was written", err=True)
    return reader.finish([f"{file.name}: {file.loss}" for file in run.files if file.loss]), code
