"""Files that need not be opened (option --indexed): the index of their folder says that nothing in them can be selected."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from dissect import __version__
from dissect.cli.look import clock
from dissect.cli.options.jobs import indexed_meant
from dissect.report import words
from dissect.source.remote import is_remote
from dissect.wire.text import printable

if TYPE_CHECKING:
    from dissect.cli.options.select import Chosen
    from dissect.index.facts import FileFacts


def may_match(files: tuple[str, ...], chosen: Chosen) -> tuple[str, ...]:
    """Return the files in which something can be selected, all of them without the option; stderr says how many are not opened.

    If no file is left, the first one stays, so that the output is written, with nothing in it. Raises ClickException without an
    index.
    """
    if not indexed_meant():
        return files
    if chosen.where is None:
        raise click.UsageError("--indexed needs -Y: without it every file has something that is wanted.")
    from dissect.index.possible import Possible

    possible = Possible(chosen.where.text, clock().local)
    indexes = _Indexes()
    kept = [file for file in files if (facts := indexes.facts(file)) is None or possible(facts)]
    if not indexes.used:
        none = "no file has an index in its folder or one above: s7dissect index DIR makes one"
        raise click.ClickException("; ".join(indexes.troubles) or none)
    for trouble in indexes.troubles:
        click.echo(f"s7dissect: {trouble}; the files of this folder are opened", err=True)
    if not kept:
        where = printable(files[0]) if len(files) == 1 else f"any of {len(files)} files; only {printable(files[0])}"
        said = f"{where} is opened" if len(files) > 1 else f"{where}; it is opened all the same"
        click.echo(f"s7dissect: the index has nothing that -Y selects in {said}, to write an empty result", err=True)
        return files[:1]
    missing = len(files) - len(kept)
    if missing:
        verb, them = ("is", "it") if missing == 1 else ("are", "them")
        said = f"{missing} of {words.count(len(files), 'file')} {verb} not opened"
        click.echo(f"s7dissect: {said}: the index has nothing in {them} that -Y selects", err=True)
    return tuple(kept)


class _Indexes:
    """What indexes know of files; each is read once. ``used``: there was one that can; ``troubles`` say why others cannot."""

    def __init__(self) -> None:
        self.used = False
        self.troubles: list[str] = []
        self._by_folder: dict[Path, dict[str, FileFacts] | None] = {}

    def facts(self, file: str) -> FileFacts | None:
        """Return what is known of a file as it is now; None when nothing is."""
        if file == "-" or is_remote(file):
            return None
        path = Path(file).absolute()
        try:
            state = path.stat()
        except OSError:  # it is reported where it is read
            return None
        for folder in path.parents:
            known = self._index(folder)
            if known is not None:
                facts = known.get(path.relative_to(folder).as_posix())
                now = (state.st_size, state.st_mtime_ns)
                return facts if facts is not None and (facts.size, facts.mtime_ns) == now else None
        return None

    def _index(self, folder: Path) -> dict[str, FileFacts] | None:
        if folder not in self._by_folder:
            self._by_folder[folder] = self._read(folder)
        return self._by_folder[folder]

    def _read(self, folder: Path) -> dict[str, FileFacts] | None:
        from dissect.index.place import index_of
        from dissect.index.store import Store, StoreError

        path = index_of(folder)
        if not path.is_file():
            return None
        try:
            with Store(path, __version__, changes=False) as store:
                found = {facts.name: facts for facts in store.files()}
        except StoreError as error:
            self.troubles.append(printable(str(error)))
            return {}
        self.used = True
        return found
