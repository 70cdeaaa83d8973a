"""Folders as arguments: the captures in them, which are read one by one."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Final

import click

from dissect.wire.text import printable

if TYPE_CHECKING:
    from dissect.files.index.lookup import Indexes

#: Key in the context of a command: the named folders, each with its files that are not captures.
_FOLDERS: Final = "dissect.cli.folders.foreign"
#: Key in the context of a command: the indexes that it uses.
_INDEXES: Final = "dissect.cli.folders.indexes"
#: The file that marks a folder of blocks, which `blocks` reads directly.
_BLOCKS: Final = "manifest.json"


def expanded(names: tuple[str, ...]) -> list[str]:
    """Return the names, with each folder replaced by its captures in the order of the times of their packets.

    Raises ClickException for a folder without a capture.
    """
    paths: list[str] = []
    for name in names:
        paths += _captures(name) if _is_meant(name) else [name]
    return paths


def any_folder() -> bool:
    """Return whether the running command was given a folder, so that its files are read one by one."""
    ctx = click.get_current_context(silent=True)
    return ctx is not None and _FOLDERS in ctx.meta


def foreign() -> list[str]:
    """Return the files in folders of the running command whose names are not those of captures."""
    ctx = click.get_current_context(silent=True)
    return list(ctx.meta.get(_FOLDERS, [])) if ctx is not None else []


def _is_meant(name: str) -> bool:
    if name == "-" or not os.path.isdir(name):  # noqa: PTH112 - a name that no path can have is simply not there
        return False
    if click.get_current_context().command.name != "blocks":
        return True
    from dissect.files.index.update import captures

    return not Path(name, _BLOCKS).exists() and next(captures(Path(name)), "") != ""


def _captures(folder: str) -> list[str]:
    from dissect.files.index.update import captures
    from dissect.packets.source.order import by_time

    unreadable: dict[str, str] = {}
    paths = [os.path.join(folder, name) for name in captures(Path(folder), unreadable)]  # noqa: PTH118
    for name, why in unreadable.items():
        click.echo(f"s7dissect: {printable(os.path.join(folder, name))}: {why}", err=True)  # noqa: PTH118
    if not paths:
        raise click.ClickException(f"{printable(folder)}: a folder without a capture (.pcap, .pcapng, .cap).")
    click.get_current_context().meta.setdefault(_FOLDERS, []).extend(_others(folder))
    return by_time(paths, _known_first())


def _known_first() -> Callable[[str], int | None]:
    """Return a function for the time of a file's first packet, None without one: from an index, else from the file."""
    from dissect.packets.source.order import first_ns

    known = indexes()  # an unusable one is ignored here

    def first(path: str) -> int | None:
        facts = known.facts(path)
        if facts is None:
            return first_ns(path)
        return facts.first_ns if facts.packets else None

    return first


def indexes() -> Indexes:
    """Return the indexes of the running command, each opened once."""
    from dissect import __version__
    from dissect.files.index.lookup import Indexes

    opened: Indexes = click.get_current_context().meta.setdefault(_INDEXES, Indexes(__version__))
    return opened


def _others(folder: str) -> list[str]:
    """Return the files of a folder, without those of its subfolders, whose names are not those of captures."""
    from dissect.files.index.update import is_capture

    with os.scandir(folder) as entries:
        return sorted(
            [entry.path for entry in entries if entry.is_file() and not is_capture(entry.name) and entry.name[0] != "."]
        )
