"""Exports of files that are read separately (option --separate).

Tasks of an export to Parquet write files of their own, which are moved into place in the order of the captures. Rows of other
formats are sent, and written by one process. Numbers that count over all files begin at a thousand million times the position
of the capture, so that each task knows them.
"""

from __future__ import annotations

import base64
import json
import os
import shutil
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import IO, TYPE_CHECKING, Any, Final, NamedTuple

import click

from dissect import __version__
from dissect.cli.options.jobs import cluster_meant
from dissect.cli.remote_export import close_wanted, task_sink
from dissect.cli.separate import about, read_file
from dissect.files.jobs.numbers import Offsets, count_from
from dissect.files.jobs.spool import ROWS_FOLDER, Spool, Spooled, opened
from dissect.files.jobs.tasks import About, Done, FileError
from dissect.output.export.extras import MissingLibraryError
from dissect.output.export.feed import Sink
from dissect.output.export.forms import ExportRequest, TableExport, Target
from dissect.output.export.parquet import ParquetSink, metadata_of
from dissect.output.export.remote import RemoteFolder
from dissect.output.export.tables import TABLES, Table, chosen_tables
from dissect.packets.source.remote import is_remote, shown
from dissect.wire.config.saving import PART
from dissect.wire.text import encodable

if TYPE_CHECKING:
    from dissect.cli.reading import Reading
    from dissect.cli.task import Task
    from dissect.output.export.transaction_rows import Row

#: The range of numbers that one capture has for its connections, transactions, operations, acts, findings and PDUs.
NUMBERS: Final = 10**9
_PARQUET: Final = "parquet"
_BYTES: Final = "base64"
#: Forms that one process writes while reading: their rows are not those of tables.
_ONE_RUN: Final = ("zeek", "zeek-json", "ecs", "stix")


class ExportPart(NamedTuple):
    """The output of a file's task: ``rows`` for one process to write, or Parquet files in ``folder``; rows by table."""

    about: About
    rows: Spooled | None
    folder: str
    counts: Mapping[str, int]


class _Sending(Sink):
    """Sends rows to the process that writes them: one line of JSON for several rows of a table, with bytes as base 64."""

    def __init__(self, file: IO[bytes]) -> None:
        self._file = file

    def take(self, table: Table, rows: Sequence[Row]) -> None:
        text = json.dumps([table.name, list(rows)], separators=(",", ":"), default=_packed)
        self._file.write(text.encode("ascii") + b"\n")

    def close(self) -> None:
        """Nothing waits."""

    def abandon(self) -> None:
        """Nothing is open, so there is nothing to abandon."""


def _packed(octets: bytes) -> dict[str, str]:
    return {_BYTES: base64.b64encode(octets).decode("ascii")}


def _unpacked(packed: dict[str, str]) -> bytes:
    return base64.b64decode(packed[_BYTES])


def refuse_form(target: Target) -> None:
    """Raise UsageError for a form that can only be written in a single run."""
    if target.form.name in _ONE_RUN:
        raise click.UsageError(
            f"--separate: {target.form.name} is written in one run; choose a form of tables, such as Parquet."
        )


def export_task(of: Task, target: Target, only: Sequence[str], reading: Reading) -> None:
    """Export the file of a task.

    Raises `FileError` if its rows cannot be written, OSError if they cannot be stored until then.
    """
    try:
        _export_task(of, target, only, reading)
    except OSError as error:
        if Path(of.folder).name.startswith(ROWS_FOLDER):
            raise  # the rows are only stored there: nothing has been written to the target yet
        # A library words errors of the system differently; for another machine its message is the only one.
        remote = is_remote(target.path) or not error.errno
        why = (error.strerror or str(error)) if remote else os.strerror(error.errno or 0)
        raise FileError(f"its rows cannot be written to {shown(target.path)}: {why}") from None
    except MissingLibraryError as error:
        raise FileError(str(error)) from None


def _export_task(of: Task, target: Target, only: Sequence[str], reading: Reading) -> None:
    name = encodable(of.file)
    folder = Path(of.folder, f".task-{of.place}{PART}")
    spool: Spool | None = None
    remote: RemoteFolder | None = None
    if is_remote(of.folder):
        remote = RemoteFolder(of.folder)
        sink: Any = task_sink(remote, of.place, only, name)
    elif target.form.name == _PARQUET:
        tables = chosen_tables(only)
        sink = ParquetSink(folder, tables, False, True, metadata_of(__version__, [name]), empty=False)
        shutil.rmtree(folder, ignore_errors=True)  # left by a process that died
        try:
            folder.mkdir()
        except FileNotFoundError:
            raise FileError(
                f"its rows cannot be written to {target.path}: that folder has to be one that all workers share"
            ) from None
    else:
        spool = Spool(of.folder, f"rows-{of.place}")
        sink = _Sending(spool.file)
    export = TableExport(ExportRequest(folder, True, only, [name], __version__), sink)
    run = reading.prepared(export.observer)
    export.begin(run)
    before = of.place * NUMBERS
    count_from(run.pipeline, Offsets(0, before, before))
    run.pipeline.exchange.watch.operations.count = before
    run.pipeline.exchange.watch.acts.count = before
    export.observer.count_from(before)
    try:
        read_file(run)
        if remote is not None:
            close_wanted(remote, export)
        else:
            export.close()
    except BaseException:
        export.abandon()
        if remote is None:
            shutil.rmtree(folder, ignore_errors=True)
        if spool is not None:
            spool.abandon()
        raise
    of.result = ExportPart(about(run), spool.done() if spool is not None else None, str(folder), export.counts)


def export_separately(reading: Reading, target: Target, only: Sequence[str], place: Path) -> dict[str, int]:
    """Export each file to ``place``; return the rows by table."""
    tables = chosen_tables(only)
    names = [encodable(name) for name in reading.files]
    counts: Counter[str] = Counter()
    if target.form.name == _PARQUET:
        gathered = _Gathered(place, tables, metadata_of(__version__, names))
        reading.apart(lambda done: gathered.take(done, counts), folder=str(place), kept=False)
        gathered.close()
        return {table.name: counts[table.name] for table in tables}
    with TemporaryDirectory(prefix=ROWS_FOLDER) as folder:
        export: Any = target.form.open(ExportRequest(place, target.folder, only, names, __version__))
        try:
            # no other machine can reach the folder
            there = "" if cluster_meant() else folder
            reading.apart(lambda done: _write(done, export.sink, counts), folder=there, kept=False)
            export.sink.close()
        except BaseException:
            export.abandon()
            raise
    return {table.name: counts[table.name] for table in tables}


def _write(done: Done, sink: Sink, counts: Counter[str]) -> None:
    part: ExportPart | None = done.result
    if part is None or part.rows is None:
        return
    counts.update(part.counts)
    with opened(part.rows) as file:
        for line in file:
            name, rows = json.loads(line, object_hook=_unpacked)
            sink.take(TABLES[name], [tuple(row) for row in rows])


class _Gathered:
    """Gathers the Parquet files of tasks in ``place``."""

    def __init__(self, place: Path, tables: Sequence[Table], metadata: Mapping[str, str]) -> None:
        self._place = place
        self._tables = tables
        self._metadata = metadata
        self._files: Counter[Path] = Counter()
        # Made now, so that a missing library is reported before anything is read.
        self._empty = ParquetSink(place, tables, False, True, metadata)

    def take(self, done: Done, counts: Counter[str]) -> None:
        """Move the files of a task to their place; they are numbered in the order in which they come."""
        part: ExportPart | None = done.result
        if part is None:
            return
        counts.update(part.counts)
        source = Path(part.folder)
        for path in sorted(source.rglob("*.parquet")):
            day = path.parent.relative_to(source)
            self._files[day] += 1
            (self._place / day).mkdir(parents=True, exist_ok=True)
            path.rename(self._place / day / f"part-{self._files[day]:04}.parquet")
        shutil.rmtree(source, ignore_errors=True)

    def close(self) -> None:
        """Remove files left by tasks that died; write a table without rows as well, with its columns."""
        for rest in self._place.glob(f".task-*{PART}"):
            shutil.rmtree(rest, ignore_errors=True)
        days = {day.parts[0] for day in self._files}
        missing = [table for table in self._tables if table.name not in days]
        if missing:
            ParquetSink(self._place, missing, False, True, self._metadata).close()
