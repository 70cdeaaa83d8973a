"""`s7dissect browser`: the whole analyzer as one HTML file that opens from the disk, without an installation."""

from __future__ import annotations

import hashlib
import tempfile
from pathlib import Path
from typing import Final

import click

from dissect.cli.main import EXIT_GATE, EXIT_OK
from dissect.cli.run import write
from dissect.cli.second_pass import check_out
from dissect.wire.config.saving import save
from dissect.wire.text import printable, reason

_EXIT_CODES: Final = (
    "Exit code: 0 success, 1 the file differs from the one that --verify makes, 2 wrong use or a package that cannot be had, "
    "5 the output could not be written."
)


@click.command("browser", epilog=_EXIT_CODES)
@click.option("-o", "--output", "output", metavar="OUT", help="The HTML file to write.")
@click.option(
    "--verify", "verified", metavar="FILE", help="Make the page and compare FILE with it, such as one that was mailed."
)
@click.option(
    "--packages",
    "folder",
    type=click.Path(readable=False, path_type=Path),
    metavar="DIR",
    help="Keep the packages of npm and PyPI here; what is there already is not fetched.",
)
@click.option("--force", is_flag=True, help="Overwrite OUT if it exists.")
def command(output: str | None, verified: str | None, folder: Path | None, force: bool) -> int:
    """Write the whole analyzer as one HTML file: it opens in a browser from the disk, and nothing is installed.

    The page needs no network and sends nothing. Python for browsers comes from npm and some packages from PyPI, in pinned
    versions; the same version of s7dissect with the same packages always gives the same file, so --verify tells whether a file
    is what it should be.
    """
    from dissect import __version__
    from dissect.output.browser.contents import Contents
    from dissect.output.browser.page import TooLargeError, made
    from dissect.output.browser.parts import Parts, PartsError

    if (output is None) == (verified is None):
        raise click.UsageError("give either -o OUT or --verify FILE.")
    if output is not None:
        try:
            check_out((), output, force)
        except OSError as error:
            raise click.ClickException(f"{printable(output)}: {reason(error)}") from None
    read = None if verified is None else _read(verified)
    with tempfile.TemporaryDirectory() as kept:
        parts = Parts(Path(kept) if folder is None else folder)
        try:
            parts.fetch()
            page = made(Contents(parts), __version__)
        except (PartsError, TooLargeError) as error:
            raise click.ClickException(printable(str(error))) from None
    digest = hashlib.sha256(page).hexdigest()
    if read is not None:
        same = read == page
        write(
            [
                f"{'the same' if same else 'DIFFERENT'}: SHA-256 {hashlib.sha256(read).hexdigest()}",
                f"made here: {digest}",
            ]
        )
        return EXIT_OK if same else EXIT_GATE
    assert output is not None
    save(output, page)
    write([f"{printable(output)}: {len(page):,} bytes, SHA-256 {digest}"])
    return EXIT_OK


def _read(file: str) -> bytes:
    try:
        return Path(file).read_bytes()
    except OSError as error:
        raise click.ClickException(f"{printable(file)}: {reason(error)}") from None
