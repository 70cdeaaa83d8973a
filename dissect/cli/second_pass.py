"""What commands share that read a capture twice and write another: what they refuse, and a file that is whole or not there."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Final

import click

from dissect.source.pcapng_writer import CAPTURE_MODE
from dissect.wire.saving import Saving
from dissect.wire.text import printable

if TYPE_CHECKING:
    from dissect.source.pcapng_writer import PcapngWriter

#: Octets that are gathered before they are written.
_BATCH: Final = 262_144


def check_files(files: Sequence[str], output: str, force: bool) -> None:
    """Refuse what cannot be read twice, and an output that would destroy something."""
    for file in files:
        if file == "-" or (Path(file).exists() and not Path(file).is_file()):
            raise click.UsageError(f"{printable(file)}: a regular file is needed, because it is read twice.")
        if output != "-" and Path(output).exists() and Path(file).exists() and Path(file).samefile(output):
            raise click.UsageError(f"{printable(output)} is both input and output; choose another OUT.")
    if output != "-" and Path(output).is_file() and not force:
        raise click.UsageError(f"{printable(output)} exists; --force overwrites it.")


def name_of(output: str) -> str:
    """Return how an output is called in a sentence; - is standard output."""
    return "standard output" if output == "-" else printable(output)


@contextmanager
def written_whole(output: str, command: str = "") -> Iterator[PcapngWriter]:
    """Give a writer of ``output``; a regular file appears when all is written, and not at all when something fails."""
    from dissect import __version__
    from dissect.source.pcapng_writer import PcapngWriter

    application = f"s7dissect {__version__} {command}".rstrip()
    if output == "-":
        writer = PcapngWriter("-", application=application, batch=_BATCH)
        yield writer
        writer.close()
        return
    with Saving(output, CAPTURE_MODE) as saving:
        try:
            writer = PcapngWriter(saving.path, application=application, batch=_BATCH)
            try:
                yield writer
                writer.close()
            finally:
                writer.abandon()
        except OSError as error:
            if error.filename != saving.path:
                raise
            raise OSError(error.errno, error.strerror, output) from None
