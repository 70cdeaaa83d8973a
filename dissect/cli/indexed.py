"""Files that need not be opened (option --indexed): the index of their folder shows that nothing in them can match."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from dissect.cli.display import clock
from dissect.cli.folders import indexes
from dissect.cli.options.jobs import indexed_meant
from dissect.meaning.report import words
from dissect.wire.text import printable

if TYPE_CHECKING:
    from dissect.cli.options.select import Chosen


def may_match(files: tuple[str, ...], chosen: Chosen) -> tuple[str, ...]:
    """Return the files in which something can be selected, all of them without the option; stderr says how many are not opened.

    If no file is left, the first one stays, so that an empty output is written. Raises ClickException without an index.
    """
    if not indexed_meant():
        return files
    if chosen.where is None:
        raise click.UsageError("--indexed needs -Y: without it every file has something that is wanted.")
    from dissect.files.index.possible import Possible

    possible = Possible(chosen.where.text, clock().local)
    known = indexes()
    kept = [file for file in files if (facts := known.facts(file)) is None or possible(facts)]
    if not known.used:
        none = "no file has an index in its folder or one above: s7dissect index DIR makes one"
        raise click.ClickException("; ".join(map(printable, known.troubles)) or none)
    for trouble in known.troubles:
        click.echo(f"s7dissect: {printable(trouble)}; the files of this folder are opened", err=True)
    if not kept:
        where = printable(files[0]) if len(files) == 1 else f"any of {len(files)} files; only {printable(files[0])}"
        consequence = f"{where} is opened" if len(files) > 1 else f"{where}; it is opened all the same"
        click.echo(
            f"s7dissect: the index has nothing that -Y selects in {consequence}, to write an empty result", err=True
        )
        return files[:1]
    missing = len(files) - len(kept)
    if missing:
        verb, them = ("is", "it") if missing == 1 else ("are", "them")
        consequence = f"{missing} of {words.count(len(files), 'file')} {verb} not opened"
        click.echo(f"s7dissect: {consequence}: the index has nothing in {them} that -Y selects", err=True)
    return tuple(kept)
