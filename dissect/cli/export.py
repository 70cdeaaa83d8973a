"""`s7dissect export`: the contents of a capture as tables and logs for other tools."""

from __future__ import annotations

import errno
import json
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from dissect import __version__
from dissect.cli.main import EXIT_INTERRUPTED
from dissect.cli.no_results import complain_no_results
from dissect.cli.options.completing import from_table
from dissect.cli.options.reading import reading_options
from dissect.cli.reading import Reading
from dissect.packets.source.remote import is_remote, shown
from dissect.wire.config.saving import Saving, SavingFolder, expect_place, is_special
from dissect.wire.text import encodable, printable

if TYPE_CHECKING:
    from dissect.output.export.forms import Target

#: The file that marks a folder as our export, which --force may replace.
MARK = "s7dissect.json"

_EXIT_CODES = (
    "Exit code: 0 success, 2 wrong use, a missing library, an unreadable or unwritable file, 3 a damaged or truncated file "
    "(what could be read was written), 5 the output could not be written (disk full), 130 interrupted (nothing written)."
)


def _tables() -> dict[str, str]:
    from dissect.output.export.tables import TABLES

    return {name: table.about for name, table in TABLES.items()}


@click.command("export", epilog=_EXIT_CODES)
@click.option(
    "-o",
    "--output",
    "output",
    required=True,
    metavar="OUT",
    help="What to write; its form follows from the ending (.parquet, .duckdb, .sqlite, .csv, .arrow, .stix), or stands in "
    "front of it: parquet:FOLDER, zeek:FOLDER, zeek-json:FOLDER, ecs:FOLDER.",
)
@click.option(
    "--only",
    "only",
    multiple=True,
    metavar="TABLE",
    shell_complete=from_table(_tables),
    help="Only this table (`s7dissect help tables`) or log. Repeatable. One table alone is a file, several are files in the "
    "folder OUT.",
)
@click.option(
    "--zeek-compat",
    "zeek_compat",
    type=click.Choice(["strict"]),
    help="With zeek: leave out the rows that ICSNPP loses, to compare with a Zeek.",
)
@click.option(
    "--force", is_flag=True, help="Replace OUT if it exists: a file, or a folder that an earlier export wrote."
)
@reading_options(slow=True, separate=True)
def command(reading: Reading, output: str, only: tuple[str, ...], zeek_compat: str | None, force: bool) -> int:
    """Write tables and logs for other tools: Parquet, DuckDB, SQLite, CSV, Arrow, Zeek, Elastic, STIX.

    The tables are connections, transactions, items, values, operations, acts, findings, finding_counts, devices and pdus, with
    the same columns in every form (`s7dissect help tables`). Parquet, Arrow and DuckDB need the extra [data].

    FILE is a pcap or pcapng file, plain or compressed with gzip or zstd; - is standard input. With several files Parquet is
    divided into folders by day. OUT is written whole or not at all.
    """
    from dissect.cli.remote_export import refuse_place, saved_remotely
    from dissect.cli.separate_export import export_task, refuse_form
    from dissect.output.export.extras import MissingLibraryError
    from dissect.output.export.forms import UnknownFormError, target_of
    from dissect.output.export.tables import UnknownTableError

    reading.check()
    try:
        target = target_of(output, only, len(reading.named))
    except (UnknownFormError, UnknownTableError) as error:
        raise click.UsageError(printable(str(error))) from None
    if zeek_compat and not target.form.name.startswith("zeek"):
        raise click.UsageError("--zeek-compat needs the form zeek: or zeek-json:.")
    reading.as_task(lambda of: export_task(of, target, only, reading))
    if reading.stand_alone():
        refuse_form(target)
    names = [encodable(name) for name in reading.files]
    remote = is_remote(target.path)
    if remote:
        refuse_place(target)
    else:
        check_output(target, reading.files, force)
    place: Any  # a path, or a folder of another machine
    try:
        with saved_remotely(target, force, MARK) if remote else saved(target) as place:
            counts, findings_total = _exported(reading, target, only, place, {"strict": bool(zeek_compat)})
            if remote:
                place.write(MARK, mark_of(target.form.name, counts, names))
            elif target.folder:
                write_mark(place, target.form.name, counts, names)
    except _InterruptedError:
        click.echo(f"s7dissect: interrupted; {printable(shown(target.path))} was not written", err=True)
        return EXIT_INTERRUPTED
    except MissingLibraryError as error:
        raise click.ClickException(str(error)) from None
    reading.complain()
    summary = ", ".join([_counted(name, count, findings_total) for name, count in counts.items()])
    click.echo(f"s7dissect: {summary} written to {printable(shown(target.path))}", err=True)
    return reading.code


def _exported(
    reading: Reading, target: Target, only: Sequence[str], place: Any, settings: dict[str, object]
) -> tuple[dict[str, int], int]:
    """Write an export to ``place``; return the rows by table, and how many findings there were if captures are read as one."""
    from dissect.cli.remote_export import export_separately_remotely, remote_export
    from dissect.cli.separate_export import export_separately
    from dissect.meaning.report.happened import findings_in
    from dissect.output.export.forms import ExportRequest

    remote = is_remote(target.path)
    if reading.separate and (remote or len(reading.files) > 1):
        apart = export_separately_remotely if remote else export_separately
        counts = apart(reading, target, only, place)
        _go_on(reading)
        if reading.chosen.where is not None and not any(counts.values()):
            complain_no_results(f"row of {', '.join(only)}" if only else "", reading.chosen)
        return counts, 0
    names = [encodable(name) for name in reading.files]
    if remote:
        export = remote_export(place, only, names)
    else:
        export = target.form.open(ExportRequest(place, target.folder, only, names, __version__, settings))
    try:
        run = reading.run(export.observer, export.begin)
        _go_on(reading)
        export.close()
    except BaseException:
        export.abandon()
        raise
    reading.expect_possible()
    return dict(export.counts), findings_in(run.pipeline.exchange.ledger)


def _counted(name: str, count: int, total: int) -> str:
    """Return the number of rows of a table; for findings also how many there were (``total``), since not all are in detail."""
    if name == "findings" and total > count:
        return f"{count} of {total} findings in detail"
    return f"{count} {(name if count != 1 else name.removesuffix('s')).replace('_', ' ')}"


def _go_on(reading: Reading) -> None:
    if reading.interrupted:
        raise _InterruptedError


class _InterruptedError(Exception):
    """Reading was interrupted, so no output must remain."""


def check_output(target: Target, files: Sequence[str], force: bool) -> None:
    """Refuse an output that would overwrite something."""
    path, name = Path(target.path), printable(target.path)
    if is_special(path):
        raise click.UsageError(f"{name} is a device or pipe; an export needs a file or folder.")
    if not path.exists():
        return
    if any(Path(file).exists() and Path(file).samefile(path) for file in files):
        raise click.UsageError(f"{name} is both input and output; choose another OUT.")
    if path.is_dir() != target.folder:
        is_one, needs = ("folder", "file") if path.is_dir() else ("file", "folder")
        raise click.UsageError(f"{name} is a {is_one}, and this export writes a {needs}; choose another OUT.")
    if path.is_dir() and not any(path.iterdir()):
        return
    if not force:
        raise click.UsageError(f"{name} exists; --force overwrites it.")
    if path.is_dir() and not (path / MARK).is_file():
        raise click.UsageError(f"{name} holds files that no export wrote; choose another OUT.")


@contextmanager
def saved(target: Target) -> Iterator[Path]:
    """Yield the path to write to, which becomes the output if the block ends well. Raises `OSError` that names the output."""
    if not target.folder:
        expect_place(target.path)  # databases have their own error messages for it
    saving: Any = SavingFolder(target.path) if target.folder else Saving(target.path)
    try:
        with saving:
            yield Path(saving.path)
    except OSError as error:
        if error.filename is not None and not str(error.filename).startswith(saving.path):
            raise
        why = os.strerror(error.errno) if error.errno not in {None, errno.EIO} else error.strerror or str(error)
        raise OSError(error.errno, why, target.path) from None


def mark_of(form: str, counts: object, files: Sequence[str]) -> bytes:
    """Return the content of that file: the program, the captures, and the number of rows."""
    mark = {"schema": "s7dissect-export/1", "version": __version__, "form": form, "files": list(files), "rows": counts}
    return (json.dumps(mark, indent=1) + "\n").encode()


def write_mark(folder: Path, form: str, counts: object, files: Sequence[str]) -> None:
    """Write `mark_of` into a folder."""
    (folder / MARK).write_bytes(mark_of(form, counts, files))
