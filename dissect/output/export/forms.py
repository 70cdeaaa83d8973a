"""The forms of ``s7dissect export``: one table; a form is found by a prefix (``parquet:DIR``) or by the ending of a name.

To add a form, derive a class from `Export` in a file of its own, and add a row to `FORMS`.
"""

from __future__ import annotations

import importlib
import os
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple, cast

from dissect.engine.observer import Observer
from dissect.files.session import Run
from dissect.output.export.feed import Sink, TableFeed
from dissect.output.export.parquet import metadata_of
from dissect.output.export.tables import TABLES, UnknownTableError, chosen_tables
from dissect.output.export.zeek.columns import LOGS
from dissect.wire.config.hints import close_names


class UnknownFormError(ValueError):
    """The form of an export cannot be found from its name."""


class Target(NamedTuple):
    """The target of an export: its form, its path, and whether the path is a folder."""

    form: Form
    path: str
    folder: bool


class Export(ABC):
    """An export while it is written. ``observer`` observes the run."""

    observer: Observer

    @property
    @abstractmethod
    def counts(self) -> Mapping[str, int]:
        """Rows written so far, by table or log."""

    @abstractmethod
    def begin(self, run: Run) -> None:
        """Take the run before its first packet."""

    @abstractmethod
    def flush(self) -> None:
        """Write the rows that wait."""

    @abstractmethod
    def close(self) -> None:
        """Write the rest, and close; called after the last packet."""

    @abstractmethod
    def abandon(self) -> None:
        """Close the files, which will be deleted; never raises."""


class ExportRequest(NamedTuple):
    """What to export: to ``path``; ``folder`` says whether that is a folder. ``parts`` are the wanted parts, all when empty.

    ``files`` are the captures, ``version`` is the version of this package.
    """

    path: Path
    folder: bool
    parts: Sequence[str]
    files: Sequence[str]
    version: str
    options: Mapping[str, Any] = {}


class Form(NamedTuple):
    """A form: the ``endings`` of its names, its help text, the function that makes it ("module:name"), and its parts.

    ``shape``: ``file``, ``folder``, or ``either``, which means a file if there is only one table.
    """

    name: str
    endings: tuple[str, ...]
    about: str
    maker: str
    shape: str
    parts: tuple[str, ...] = ()

    def names(self) -> tuple[str, ...]:
        """Return the names that ``--only`` takes."""
        return self.parts or tuple(TABLES)

    def open(self, request: ExportRequest) -> Export:
        """Begin an export. Raises `MissingLibraryError` if a library is missing, OSError if it cannot be written."""
        module, _, name = self.maker.partition(":")
        return cast("Export", getattr(importlib.import_module(module), name)(request))


class TableExport(Export):
    """An export of tables to a sink."""

    def __init__(self, request: ExportRequest, sink: Any) -> None:
        self.observer: TableFeed = TableFeed(chosen_tables(request.parts), cast("Sink", sink))
        self.sink = sink
        self._run: Run | None = None

    @property
    def counts(self) -> Mapping[str, int]:
        """The number of rows of each table."""
        return self.observer.counts

    def begin(self, run: Run) -> None:
        """Set the files of the run, by which packets are named."""
        self._run = run
        self.observer.begin(run.files)

    def flush(self) -> None:
        """Pass the rows that wait on to the sink."""
        self.observer.flush()

    def close(self) -> None:
        """Write the rest."""
        if self._run is not None:
            self.observer.finish(self._run.pipeline, self._run.files)
        self.sink.close()

    def abandon(self) -> None:
        """Abandon the sink."""
        self.sink.abandon()


def _metadata(request: ExportRequest) -> dict[str, str]:
    return metadata_of(request.version, request.files)


def parquet_export(request: ExportRequest) -> Export:
    """Return an export to Parquet."""
    from dissect.output.export.parquet import ParquetSink

    by_day = request.folder and len(request.files) > 1
    tables = chosen_tables(request.parts)
    return TableExport(request, ParquetSink(request.path, tables, not request.folder, by_day, _metadata(request)))


def arrow_export(request: ExportRequest) -> Export:
    """Return an export to Arrow IPC files."""
    from dissect.output.export.arrow_files import ArrowSink

    tables = chosen_tables(request.parts)
    return TableExport(request, ArrowSink(request.path, tables, not request.folder, _metadata(request)))


def csv_export(request: ExportRequest) -> Export:
    """Return an export to CSV files."""
    from dissect.output.export.csv_files import CsvSink

    return TableExport(request, CsvSink(request.path, chosen_tables(request.parts), not request.folder))


def sqlite_export(request: ExportRequest) -> Export:
    """Return an export to a SQLite database."""
    from dissect.output.export.sqlite import SqliteSink

    return TableExport(request, SqliteSink(request.path, chosen_tables(request.parts), _metadata(request)))


def duckdb_export(request: ExportRequest) -> Export:
    """Return an export to a DuckDB database."""
    from dissect.output.export.duckdb_file import DuckdbSink

    return TableExport(request, DuckdbSink(request.path, chosen_tables(request.parts), _metadata(request)))


#: The parts of an export in `dissect.output.export.ecs`.
ECS_PARTS: Final = ("transactions", "findings", "finding_counts", "connections")
_HERE: Final = "dissect.output.export.forms:"
_ZEEK: Final = "dissect.output.export.zeek.export:"
#: All forms by name.
FORMS: Final[dict[str, Form]] = {
    form.name: form
    for form in (
        Form("parquet", (".parquet",), "Parquet", f"{_HERE}parquet_export", "either"),
        Form("duckdb", (".duckdb", ".ddb"), "DuckDB database", f"{_HERE}duckdb_export", "file"),
        Form("sqlite", (".sqlite", ".sqlite3", ".db"), "SQLite database", f"{_HERE}sqlite_export", "file"),
        Form("csv", (".csv",), "CSV files", f"{_HERE}csv_export", "either"),
        Form("arrow", (".arrow", ".feather", ".ipc"), "Arrow IPC files", f"{_HERE}arrow_export", "either"),
        Form(
            "ecs",
            (),
            "documents of the Elastic Common Schema",
            "dissect.output.export.ecs:ecs_export",
            "folder",
            ECS_PARTS,
        ),
        Form(
            "stix",
            (".stix", ".stix.json"),
            "STIX bundle",
            "dissect.output.export.stix:stix_export",
            "file",
            ("findings",),
        ),
        Form("zeek", (), "logs of Zeek", f"{_ZEEK}tsv_export", "folder", tuple(LOGS)),
        Form("zeek-json", (), "logs of Zeek in JSON", f"{_ZEEK}json_export", "folder", tuple(LOGS)),
    )
}


def target_of(text: str, only: Sequence[str], files: int) -> Target:
    """Return the target that the user names with ``text``; ``only`` are the wanted parts, ``files`` the number of captures.

    Raises `UnknownFormError` and `UnknownTableError` with suggestions.
    """
    prefix, colon, rest = text.partition(":")
    form = FORMS.get(prefix) if colon else None
    path = rest if form is not None else text
    prefixed = form is not None
    if form is None:
        name = text.rstrip("/").lower()
        form = next((one for one in FORMS.values() if name.endswith(one.endings)), None)
    if form is None:
        raise UnknownFormError(_unknown(prefix if colon and len(prefix) > 1 else "", text))
    if not path:
        raise UnknownFormError(f"{text} names no file or folder.")
    if path == "-":  # means standard output in other commands, so it is not the name of a file
        raise UnknownFormError(
            f"{text} is not possible: an export is not written to standard output; name a file or folder."
        )
    for name in only:
        if name not in form.names():
            near = close_names(name, form.names())
            hint = f"Did you mean {' or '.join(near)}?" if near else f"Known are {', '.join(form.names())}."
            raise UnknownTableError(f"no part {name!r} in {form.about}. {hint}")
    single = form.shape == "file" or (form.shape == "either" and not prefixed and len(set(only)) == 1 and files == 1)
    return Target(form, path, not single)


def _unknown(prefix: str, text: str) -> str:
    if "://" in text:  # Parquet is the only form that can be written to another machine
        parquet = FORMS["parquet"]
        name = text.rstrip("/")
        return f"the form of {text!r} is not known. Write {name}{parquet.endings[0]} or {parquet.name}:{name}."
    endings = [ending for form in FORMS.values() for ending in form.endings]
    if prefix:
        near = close_names(prefix, FORMS)
    else:
        ending = os.path.splitext(text)[1]  # noqa: PTH122 - a name, whatever it is of
        near = close_names(ending, endings) if ending else []
    hint = f" Did you mean {' or '.join(near)}?" if near else ""
    known = ", ".join([form.endings[0] if form.endings else f"{form.name}:DIR" for form in FORMS.values()])
    return f"the form of {text!r} is not known.{hint} Known are names that end in {known}, or FORM:PATH."


def listed_forms() -> Iterable[str]:
    """Yield each form with its endings, for a help text."""
    for form in FORMS.values():
        yield f"{form.name} ({', '.join(form.endings)})" if form.endings else form.name
