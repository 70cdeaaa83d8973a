"""Shared by commands that read a capture twice and write another: checks, and a file that is complete or absent."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from dissect.cli.options.select import read_where
from dissect.cli.run import drive, places_of
from dissect.packets.source.pcapng_writer import CAPTURE_MODE
from dissect.wire.config.saving import Saving, expect_place
from dissect.wire.text import printable

if TYPE_CHECKING:
    from dissect.engine.observer import Observer
    from dissect.engine.pipeline import Options
    from dissect.files.recording.cutter import Around, Cutter
    from dissect.files.session import Run
    from dissect.meaning.select.packets import PacketSelection
    from dissect.meaning.select.selection import Selection
    from dissect.packets.source.pcapng_writer import PcapngWriter

_AROUND: Final = re.compile(r"([0-9]{1,9})(ms|s)?")
#: Octets that are gathered before they are written.
_BATCH: Final = 262_144


def _around(ctx: click.Context, param: click.Parameter, value: str | None) -> Around:
    from dissect.files.recording.cutter import Around

    if value is None:
        return Around()
    match = _AROUND.fullmatch(value)
    if not match:
        raise click.BadParameter(
            f"expected a number of packets or a time such as 500ms or 2s, got {value!r}.", ctx, param
        )
    number = int(match[1])
    if match[2] is None:
        return Around(packets=number)
    return Around(ns=number * (1_000_000 if match[2] == "ms" else 1_000_000_000))


#: ``--around``; the command's argument is called ``around``.
around_option: Final[Callable[[Any], Any]] = click.option(
    "--around",
    callback=_around,
    metavar="N|MS",
    help="Also N packets before and after each, or all within a time such as 500ms or 2s.",
)


def check_files(files: Sequence[str], output: str, force: bool) -> None:
    """Refuse input that cannot be read twice, and an output that would overwrite something."""
    for file in files:
        if file == "-" or (Path(file).exists() and not Path(file).is_file()):
            raise click.UsageError(f"{printable(file)}: a regular file is needed, because it is read twice.")
    check_out(files, output, force)


def check_out(files: Sequence[str], output: str, force: bool) -> None:
    """Refuse an output that is also an input, that exists (without ``force``), or that cannot be written.

    Raises `OSError` for the last.
    """
    for file in files:
        if output != "-" and Path(output).exists() and Path(file).exists() and Path(file).samefile(output):
            raise click.UsageError(f"{printable(output)} is both input and output; choose another OUT.")
    if output != "-" and Path(output).is_file() and not force:
        raise click.UsageError(f"{printable(output)} exists; --force overwrites it.")
    if output != "-":
        expect_place(output)


def read_first(
    files: Sequence[str], selection: Selection, where: str | None, options: Options
) -> tuple[Run, int, PacketSelection | None]:
    """Read a capture for the first time, observed by ``selection``; return the run, its exit code, the selected part."""
    from dissect.files.session import Run
    from dissect.meaning.select.packets import PacketSelection
    from dissect.online.live.run import Fanout

    chosen = read_where(where, kinds=("packet", "transaction", "finding"))
    packets = PacketSelection(chosen) if chosen is not None else None
    run = Run(files, Fanout([selection, packets], _failed) if packets is not None else selection, options)
    if chosen is not None:
        chosen.context.start = lambda: int(run.pipeline.first_ns)
        chosen.context.number = places_of(run, files).number
    return run, drive(run, files), packets


def _failed(_observer: Observer, error: Exception) -> None:
    """Let an error of one of two observers be reported like that of a single one."""
    raise error


def read_again(files: Sequence[str], cutter: Cutter) -> None:
    """Read a capture for the second time, to be written by ``cutter``."""
    from dissect.packets.source.files import open_capture

    for file in files:
        reader = open_capture(file)
        try:
            cutter.read_all(reader)
        finally:
            reader.close()


def name_of(output: str) -> str:
    """Return the name of an output for a sentence; - is standard output."""
    return "standard output" if output == "-" else printable(output)


@contextmanager
def written_whole(output: str, command: str = "") -> Iterator[PcapngWriter]:
    """Yield a writer of ``output``; a regular file appears when all is written, and not at all if something fails."""
    from dissect import __version__
    from dissect.packets.source.pcapng_writer import PcapngWriter

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


def tell_cut(cutter: Cutter, output: str, context: int = 0) -> None:
    """Report on stderr how much was written; ``context`` packets of it only open or close connections."""
    written = cutter.chosen + cutter.beside
    beside = f", {cutter.beside} of them for being near" if cutter.beside else ""
    if context:
        beside = f", {context} of them open or close connections{beside}"
    commented = f", {cutter.commented} with findings as comments" if cutter.commented else ""
    click.echo(
        f"s7dissect: {written} of {cutter.frames} packets written to {name_of(output)}{beside}{commented}", err=True
    )
    if cutter.secrets_kept:
        count = cutter.secrets_kept
        blocks = "1 block of TLS session keys" if count == 1 else f"{count} blocks of TLS session keys"
        click.echo(f"s7dissect: {name_of(output)} keeps {blocks}: it can be decrypted without other keys", err=True)
    if cutter.shortened:
        click.echo(
            f"s7dissect: {cutter.shortened} packets left memory before --around could select them; some may be missing",
            err=True,
        )
