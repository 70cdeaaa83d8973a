"""`s7dissect blocks`: the blocks that were downloaded or uploaded, as a list, as files, or compared."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

import click

from dissect.cli.display import clock
from dissect.cli.formats import format_option, write_out, write_outcome
from dissect.cli.main import EXIT_GATE, EXIT_INTERRUPTED, EXIT_OK, EXIT_USAGE
from dissect.cli.no_results import no_results_text
from dissect.cli.options.reading import reading_options
from dissect.cli.reading import Reading
from dissect.cli.run import places_of
from dissect.meaning.report.formats import BLOCKS, Format
from dissect.packets.source.remote import shown
from dissect.wire.text import count, printable

if TYPE_CHECKING:
    from dissect.cli.options.select import Chosen
    from dissect.engine.program.carved import CarvedBlock
    from dissect.engine.transactions.naming import Naming
    from dissect.meaning.report.outcome import Outcome
    from dissect.meaning.report.words import Places
    from dissect.output.carve.listing import BlockList

_EXIT_CODES = (
    "Exit code: 0 success, with --diff no differences, 1 --diff found differences, 2 wrong use or an unreadable file (with "
    "--diff also a damaged one), 3 a damaged or truncated file, 5 the output could not be written, 130 interrupted. The "
    "results cover what was read."
)


#: The languages of `--code`, the first by default.
_LANGUAGES: Final = ("STL", "AWL")


class _Command(click.Command):
    """Allows ``--code`` without a language, although files follow."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Put in the default language."""
        given = list(args)
        for at, word in enumerate(args):
            if word == "--":
                break
            if word == "--code" and (at + 1 == len(args) or args[at + 1].upper() not in _LANGUAGES):
                given.insert(at + 1, _LANGUAGES[0])
                break
        return super().parse_args(ctx, given)


@click.command("blocks", cls=_Command, epilog=_EXIT_CODES)
@format_option(BLOCKS)
@click.option(
    "--code",
    "language",
    type=click.Choice(_LANGUAGES, case_sensitive=False),
    metavar="[STL|AWL]",
    help="Show header, interface and code of each block, English (STL, the default) or German (AWL), data blocks with values.",
)
@click.option(
    "--references", is_flag=True, help="Show which block reads and writes which address, and which calls which."
)
@click.option("--diff", "compares", is_flag=True, help="Report what changed from A to B (see above).")
@click.option(
    "-o",
    "--output",
    "output",
    type=click.Path(readable=False),
    metavar="DIR",
    help="Write each block to a file in DIR, with manifest.json.",
)
@click.option("--force", is_flag=True, help="Overwrite files in DIR.")
@reading_options("operation", scd=False)
def command(
    reading: Reading,
    format_: Format,
    language: str | None,
    references: bool,
    compares: bool,
    output: str | None,
    force: bool,
) -> int:
    """List the blocks that were downloaded to a PLC or uploaded from it, put together from their transfers.

    A line gives the time, packets, client and PLC, direction, type and number, size, whether all of it passed and was
    activated, and what the block says of itself. With --tags the values of data blocks follow. FILE is a pcap or pcapng file,
    plain or compressed with gzip or zstd; - is standard input. A folder that -o wrote, or a file of it, is read as well.

    With --diff FILE is A and B, each a capture, a folder or a block: new, gone, moved and changed blocks are listed. A alone is
    compared with itself: of each block the first version with the latest.
    """
    if force and output is None:
        raise click.UsageError("--force needs -o DIR.")
    if compares and output is not None:
        raise click.UsageError("--diff and -o cannot be combined.")
    if language is not None and references:
        raise click.UsageError("--code and --references cannot be combined.")
    if references and compares:
        raise click.UsageError("--references and --diff cannot be combined.")
    if compares:
        return _compare(reading, format_, language or _LANGUAGES[0])
    if output is not None:
        _check_folder(output, (), force)
    blocks, lost, places = _read(reading, reading.files)
    from dissect.output.carve.listing import BlockList

    listing = BlockList(blocks, lost, places, clock())
    if output is not None and blocks:  # an empty folder of ours would be in the way of the next run
        _write(output, listing, force)
    write_out(format_.lines(BLOCKS, _shown(listing, language, references, reading.naming)))
    if not blocks and not reading.chosen.impossible:
        click.echo(f"s7dissect: {_none(reading)}", err=True)
    return reading.gated()


def _shown(listing: BlockList, language: str | None, references: bool, naming: Naming | None) -> Outcome:
    """Return the blocks in the requested form."""
    if language is None and not references:
        return listing
    from dissect.output.carve.code import CodeListing, References

    if references:
        return References(listing.blocks)
    return CodeListing(listing.blocks, listing.places, listing.clock, language or _LANGUAGES[0], naming)


def _read(reading: Reading, files: tuple[str, ...]) -> tuple[Sequence[CarvedBlock], int, Places]:
    """Return the blocks of files, how many exceeded the limit, and how packets are named."""
    from dissect.meaning.report.words import Places
    from dissect.output.carve.folder import FolderError, read_block, read_folder
    from dissect.output.carve.reading import BlockCollector

    try:
        if len(files) == 1 and Path(files[0]).is_dir():
            _refuse_selection(files[0], reading.chosen)
            return read_folder(files[0]), 0, Places([], False)
        if len(files) == 1 and Path(files[0]).is_file():
            block = read_block(files[0])
            if block is not None:
                _refuse_selection(files[0], reading.chosen)
                return [block], 0, Places([], False)
    except FolderError as error:
        raise click.ClickException(str(error)) from None
    collector = BlockCollector(reading.chosen.choice("operation"))
    reading.files = files
    run = reading.run(collector, sieved=False)
    reading.complain()
    reading.possible()
    return collector.ordered(), collector.lost, places_of(run, files)


def _none(reading: Reading) -> str:
    """Return the message for a capture without blocks."""
    return (
        "no block was downloaded or uploaded"
        if reading.chosen.where is None
        else no_results_text("block", reading.chosen)
    )


def _refuse_selection(path: str, chosen: Chosen) -> None:
    if chosen.where is not None:
        raise click.UsageError(f"{printable(path)} is not a capture: -Y, --connection and --time select packets.")


# ---- files ----------------------------------------------------------------------------------------------------------


def _check_folder(output: str, names: Sequence[str], force: bool) -> None:
    """Refuse an invalid folder, or one with files that would be overwritten."""
    from dissect.output.carve.folder import occupied

    home = Path(output)
    if home.exists() and not home.is_dir():
        raise click.UsageError(f"{printable(output)} is not a folder; choose another DIR.")
    taken = [] if force else occupied(output, names)
    if taken:
        more = f" and {len(taken) - 1} more" if len(taken) > 1 else ""
        raise click.UsageError(f"{printable(str(home / taken[0]))}{more} exists; --force overwrites it.")


def _write(output: str, listing: BlockList, force: bool) -> None:
    from dissect.meaning.report.plus_blobs import dictionaries
    from dissect.output.carve.folder import Plan, write_folder

    plan = Plan(listing.blocks, dictionaries())
    _check_folder(output, list(plan.files), force)
    write_folder(output, plan, listing.as_dict())


# ---- comparison -----------------------------------------------------------------------------------------------------


def _alike(first: Sequence[CarvedBlock], second: Sequence[CarvedBlock], alone: bool) -> str:
    """Return the message for blocks without differences; ``alone``: they are from one capture."""
    from dissect.engine.program.compare import versions

    kept = [versions(blocks, True).values() for blocks in (first, second)]
    compared = count(len(kept[1]), "block")
    text = f"no differences between the versions of {compared}" if alone else f"no differences in {compared}"
    parts = sum([not row[-1].complete for row in kept[1]]) + (
        0 if alone else sum([not row[-1].complete for row in kept[0]])
    )
    if not parts:
        return text
    return f"{text}; {count(parts, 'version is', 'versions are')} incomplete, compared as far as possible"


def _compare(reading: Reading, format_: Format, language: str) -> int:
    from dissect.engine.program.compare import compare, over_time
    from dissect.output.carve.code import details_of
    from dissect.output.carve.listing import BlockChanges

    files = reading.files
    if len(files) > 2:
        raise click.UsageError("--diff takes A and B: two captures, folders or blocks, or one capture.")
    first, _, _ = _read(reading, files[:1])
    code = reading.code
    if len(files) == 1:
        second = first
        changes = over_time(list(first))
    else:
        second, _, _ = _read(reading, files[1:])
        code = max(code, reading.code)
        changes = compare(list(first), list(second))
    if code == EXIT_INTERRUPTED:
        return code
    details = details_of(first, second, language, reading.naming)
    write_outcome(format_, BLOCKS, BlockChanges(changes, files[0], files[-1], details))
    without = [shown(file) for file, blocks in zip(files, (first, second), strict=False) if not blocks]
    if not reading.chosen.impossible:
        for name in without:
            click.echo(f"s7dissect: {printable(name)}: {_none(reading)}", err=True)
    if not changes and not without:
        click.echo(f"s7dissect: {_alike(first, second, len(files) == 1)}", err=True)
    if reading.chosen.ended(code):
        return EXIT_USAGE
    return EXIT_GATE if changes else EXIT_OK
