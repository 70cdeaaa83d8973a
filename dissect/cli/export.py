"""`s7dissect export`: what a capture holds as tables and logs that other tools read."""

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
from dissect.cli.indexed import may_match
from dissect.cli.main import EXIT_INTERRUPTED
from dissect.cli.nothing import expect_possible
from dissect.cli.options.completing import from_table
from dissect.cli.options.jobs import check_jobs, indexed_option, separate_options
from dissect.cli.options.scd import scd_options
from dissect.cli.options.select import Chosen, select_options
from dissect.cli.options.tags import tag_options
from dissect.cli.options.tls import tls_option
from dissect.cli.run import checksums_option, complain_of, drive, files_argument, slow_option
from dissect.cli.task import current
from dissect.source.remote import is_remote, shown
from dissect.wire.saving import Saving, SavingFolder, expect_place, is_special
from dissect.wire.text import encodable, printable

if TYPE_CHECKING:
    from dissect.engine.exchange import PayloadDecoder
    from dissect.export.forms import Export, Target
    from dissect.session import Run
    from dissect.tls.key_log import KeyLog
    from dissect.transactions.naming import Naming

#: The file by which a folder is known as an export of ours, which --force may replace.
MARK = "s7dissect.json"

_EXIT_CODES = (
    "Exit code: 0 success, 2 wrong use, a missing library, an unreadable or unwritable file, 3 a damaged or truncated file "
    "(what could be read was written), 5 the output could not be written (disk full), 130 interrupted (nothing written)."
)


def _tables() -> dict[str, str]:
    from dissect.export.tables import TABLES

    return {name: table.about for name, table in TABLES.items()}


@click.command("export", epilog=_EXIT_CODES)
@files_argument
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
@slow_option
@select_options()
@checksums_option
@scd_options
@tag_options
@tls_option
@separate_options
@indexed_option
def command(
    files: tuple[str, ...],
    output: str,
    only: tuple[str, ...],
    zeek_compat: str | None,
    force: bool,
    slow_ns: int,
    checksums: bool,
    decoder: PayloadDecoder | None,
    chosen: Chosen,
    naming: Naming | None,
    tls_keys: KeyLog | None,
    separate: bool,
    jobs: int,
) -> int:
    """Write tables and logs for other tools: Parquet, DuckDB, SQLite, CSV, Arrow, Zeek, Elastic, STIX.

    The tables are connections, transactions, items, values, operations, acts, findings, finding_counts, devices and pdus, with
    the same columns in every form (`s7dissect help tables`). Parquet, Arrow and DuckDB need the extra [data].

    FILE is a pcap or pcapng file, plain or compressed with gzip or zstd; - is standard input. With several files Parquet is
    divided into folders by day. OUT is written whole or not at all.
    """
    from dissect.cli.remote_export import export_separately_remotely, refuse_place, remote_export, saved_remotely
    from dissect.cli.separate_export import export_separately, export_task, refuse_form
    from dissect.engine.pipeline import Options
    from dissect.export.extras import MissingLibraryError
    from dissect.export.forms import Request, UnknownFormError, target_of
    from dissect.export.tables import UnknownTableError
    from dissect.report.happened import findings_in
    from dissect.session import Run

    of = current()
    separate = check_jobs(separate, jobs)
    try:
        target = target_of(output, only, len(of.files if of is not None else files))
    except (UnknownFormError, UnknownTableError) as error:
        raise click.UsageError(printable(str(error))) from None
    if zeek_compat and not target.form.name.startswith("zeek"):
        raise click.UsageError("--zeek-compat needs the form zeek: or zeek-json:.")
    options = Options(slow_ns, decoder=decoder, checksums=checksums, tls_keys=tls_keys, naming=naming)
    if of is not None:
        return export_task(of, target, only, chosen, options)
    if separate:
        from dissect.cli.separate import refuse

        refuse(chosen, [(decoder, "SCD is decoded over all files")])
        files = may_match(files, chosen)
        refuse_form(target)
    names = [encodable(name) for name in files]
    remote = is_remote(target.path)
    if remote:
        refuse_place(target)
    else:
        check_output(target, files, force)
    place: Any  # a path, or a folder of another machine
    try:
        with saved_remotely(target, force, MARK) if remote else saved(target) as place:
            losses: list[tuple[str, str]] = []
            found = 0
            if separate and (remote or len(files) > 1):
                counts, code = (
                    export_separately_remotely(files, jobs, target.path, only, place)
                    if remote
                    else export_separately(files, jobs, target, only, place)
                )
                _go_on(code)
            else:
                export = (
                    remote_export(place, only, names)
                    if remote
                    else target.form.open(
                        Request(place, target.folder, only, names, __version__, {"strict": bool(zeek_compat)})
                    )
                )
                run = Run(files, chosen.sieve(export.observer), chosen.narrow(options))
                chosen.begin(run, files)
                code = _export(export, run, files)
                expect_possible(run, chosen)
                counts = dict(export.counts)
                losses = [(file.name, file.loss) for file in run.files]
                found = findings_in(run.pipeline.exchange.ledger)
            if remote:
                place.write(MARK, mark_of(target.form.name, counts, names))
            elif target.folder:
                write_mark(place, target.form.name, counts, names)
    except _InterruptedError:
        click.echo(f"s7dissect: interrupted; {printable(shown(target.path))} was not written", err=True)
        return EXIT_INTERRUPTED
    except MissingLibraryError as error:
        raise click.ClickException(str(error)) from None
    complain_of(losses, code)
    said = ", ".join([_said(name, count, found) for name, count in counts.items()])
    click.echo(f"s7dissect: {said} written to {printable(shown(target.path))}", err=True)
    return code


def _said(name: str, count: int, found: int) -> str:
    """Return how many rows a table has; of findings only so many are in detail of all that were ``found``."""
    if name == "findings" and found > count:
        return f"{count} of {found} findings in detail"
    return f"{count} {(name if count != 1 else name.removesuffix('s')).replace('_', ' ')}"


def _export(export: Export, run: Run, files: Sequence[str]) -> int:
    """Read the files of a run to their end; return the exit code."""
    export.begin(run)
    try:
        code = drive(run, files)
        _go_on(code)
        export.close()
    except BaseException:
        export.abandon()
        raise
    return code


def _go_on(code: int) -> None:
    if code == EXIT_INTERRUPTED:
        raise _InterruptedError


class _InterruptedError(Exception):
    """Reading was broken off, so that nothing is to be left of the output."""


def check_output(target: Target, files: Sequence[str], force: bool) -> None:
    """Refuse an output that would destroy something."""
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
    """Give the place to write to, which becomes the output when the block ends well. Raises `OSError` that names the output."""
    if not target.folder:
        expect_place(target.path)  # databases have words of their own for it
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
    """Return what says of a folder who made it, of which captures, and how many rows it has."""
    told = {"schema": "s7dissect-export/1", "version": __version__, "form": form, "files": list(files), "rows": counts}
    return (json.dumps(told, indent=1) + "\n").encode()


def write_mark(folder: Path, form: str, counts: object, files: Sequence[str]) -> None:
    """Write `mark_of` into a folder."""
    (folder / MARK).write_bytes(mark_of(form, counts, files))
