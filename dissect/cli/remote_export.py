"""Exports to a folder of another machine (``-o s3://…``, ``sftp://…``): Parquet, written by each process that reads."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

import click

from dissect import __version__
from dissect.files.jobs.tasks import Done, FileError
from dissect.output.export.extras import needed
from dissect.output.export.forms import Export, ExportRequest, TableExport, Target
from dissect.output.export.parquet import ParquetSink, metadata_of
from dissect.output.export.remote import UNFINISHED, RemoteFolder
from dissect.output.export.tables import chosen_tables
from dissect.packets.source.remote import shown
from dissect.wire.text import encodable, printable

if TYPE_CHECKING:
    from dissect.cli.reading import Reading

#: Transports that cannot write.
_READ_ONLY = ("http://", "https://")


def refuse_place(target: Target) -> None:
    """Raise UsageError for forms that cannot be written on another machine."""
    name = printable(shown(target.path))
    if target.form.name != "parquet":
        raise click.UsageError(
            f"{name}: {target.form.about} is written on this machine; Parquet can go to another one."
        )
    if target.path.startswith(_READ_ONLY):
        raise click.UsageError(f"{name}: captures can be read over HTTP, and nothing written; s3 and sftp can do both.")


@contextmanager
def saved_remotely(target: Target, force: bool, mark: str) -> Iterator[RemoteFolder]:
    """Yield the folder to write to; if the block raises, the files in it are removed. ``mark`` is the file of a whole export.

    Raises OSError that names the folder, UsageError if something would be overwritten.
    """
    folder = RemoteFolder(target.path)
    names = folder.names()
    if names and not force:
        raise click.UsageError(f"{printable(folder.name)} exists; --force overwrites it.")
    if names and mark not in names and UNFINISHED not in names:
        raise click.UsageError(f"{printable(folder.name)} holds files that no export wrote; choose another OUT.")
    if names:
        folder.clear()
    folder.write(UNFINISHED, f"s7dissect {__version__} writes an export here.\n".encode())
    try:
        yield folder
        folder.remove(UNFINISHED)
    except BaseException:
        with suppress(OSError):  # its reason is the one that is reported
            folder.clear()
        raise


def remote_export(folder: RemoteFolder, only: Sequence[str], names: Sequence[str]) -> Export:
    """Return an export of one run over captures with these names."""
    metadata = metadata_of(__version__, names)
    sink = ParquetSink(Path(), chosen_tables(only), False, len(names) > 1, metadata, create=folder.create)
    return TableExport(ExportRequest(Path(), True, only, names, __version__), sink)


def close_wanted(folder: RemoteFolder, export: Export) -> None:
    """Write the rest of a task's rows.

    Raises `FileError` if the export was aborted, because otherwise nothing would remove the rows.
    """
    if not folder.has(UNFINISHED):
        raise FileError(f"{folder.name}: the export was broken off meanwhile")
    export.close()


def task_sink(folder: RemoteFolder, place: int, only: Sequence[str], name: str) -> ParquetSink:
    """Return a writer for the rows of the capture ``name``: its position among all captures is in the names of its files.

    So a process that reads the capture again, after another one died, writes the same files.
    """
    tables, metadata = chosen_tables(only), metadata_of(__version__, [name])
    return ParquetSink(
        Path(), tables, False, True, metadata, empty=False, create=folder.create, part=f"part-{place + 1:04}"
    )


def export_separately_remotely(
    reading: Reading, target: Target, only: Sequence[str], folder: RemoteFolder
) -> dict[str, int]:
    """Export each file to ``folder``, the folder of ``target``; return the rows by table."""
    tables = chosen_tables(only)
    metadata = metadata_of(__version__, [encodable(name) for name in reading.files])
    needed("pyarrow.parquet")  # report a missing library before anything is read
    counts: Counter[str] = Counter()
    places = itertools.count(1)

    def take(done: Done) -> None:
        place = next(places)
        if done.result is not None:
            counts.update(done.result.counts)
        else:  # files of a process that died are incomplete
            folder.remove_matching(f"*/*/part-{place:04}-*.parquet")

    reading.apart(take, folder=target.path, kept=False)
    missing = [table for table in tables if not counts[table.name]]
    if missing:
        ParquetSink(Path(), missing, False, True, metadata, create=folder.create).close()
    return {table.name: counts[table.name] for table in tables}
