"""What all faces show for many captures: the differences, the comparisons, unread places, and the rows of all tables."""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Callable, Iterable
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any, Final, NamedTuple

from dissect.output.export.arrow_files import ArrowSink
from dissect.output.export.csv_files import CsvSink
from dissect.output.export.duckdb_file import DuckdbSink
from dissect.output.export.extras import MissingLibraryError
from dissect.output.export.parquet import ParquetSink
from dissect.output.export.sqlite import SqliteSink
from dissect.output.export.tables import TABLES
from tests.faces.comparing import Compared, Difference, compare
from tests.faces.coverage import Coverage, Place
from tests.faces.known import ALONE, SUMS, VIEWS
from tests.faces.reading import begun, read
from tests.faces.records import cut

#: A difference, and the capture that shows it.
Shown = tuple[str, Difference]


class Gathered(NamedTuple):
    """The results for many captures.

    ``coverage`` knows the places of records that no fact reads. ``forms`` is the folder for each form of the tables, with all
    rows of all captures, and ``rows`` are these rows. ``logs`` are those of Zeek, by capture, as JSON and as tab-separated
    values.
    """

    differences: list[Shown]
    compared: Compared
    coverage: Coverage
    forms: Path | None
    rows: dict[str, list[dict[str, Any]]]
    logs: dict[str, dict[str, list[dict[str, Any]]]]

    @property
    def unread(self) -> list[Place]:
        """The places that no fact reads and that are not known to be in one face only."""
        return sorted([place for place in self.coverage.unread if not is_alone(place)])


def captures_in(folder: Path) -> list[Path]:
    """Return every capture below a folder, in the same order on every machine."""
    return sorted([path for path in folder.rglob("*") if ".pcap" in path.name])


def _sinks(folder: Path) -> list[Any]:
    """Return a sink for each form of the tables whose library is installed."""
    tables = list(TABLES.values())
    about = {"version": "1"}
    for name in ("csv", "parquet", "arrow"):
        (folder / name).mkdir()
    makers: list[Callable[[], Any]] = [
        lambda: SqliteSink(folder / "rows.sqlite", tables, about),
        lambda: CsvSink(folder / "csv", tables, False),
        lambda: ParquetSink(folder / "parquet", tables, False, False, about),
        lambda: ArrowSink(folder / "arrow", tables, False, about),
        lambda: DuckdbSink(folder / "rows.duckdb", tables, about),
    ]
    sinks = []
    for make in makers:
        with contextlib.suppress(MissingLibraryError):
            sinks.append(make())
    return sinks


_KEPT: Final = frozenset(("zeek", "zeek-json"))


def gather(paths: Iterable[Path], forms: Path | None = None, before: Gathered | None = None) -> Gathered:
    """Read captures, each once, and compare what all faces show.

    ``forms`` takes the tables in every form. Places that were read in the captures ``before`` count as read.
    """
    coverage = before.coverage if before is not None else Coverage()
    found = Gathered([], Compared(), coverage, forms, {name: [] for name in TABLES}, {})
    for path in paths:
        with tempfile.TemporaryDirectory() as folder:
            told = read(begun(path, Path(folder)), _new(folder))
        records = cut(told)
        found.differences.extend([(path.name, one) for one in compare(records, found.compared)])
        coverage.add(records)
        for name, rows in told.rows.items():
            found.rows[name].extend(rows)
        logs = {name: rows for name, rows in told.documents.items() if name.partition(".")[0] in _KEPT}
        found.logs[path.name] = logs
    if forms is not None:
        _write(forms, found.rows)
    return found


def _write(folder: Path, rows: dict[str, list[dict[str, Any]]]) -> None:
    """Write the rows of all captures in each form of the tables whose library is installed."""
    for sink in _sinks(folder):
        for name, table in TABLES.items():
            sink.take(table, [tuple(row.values()) for row in rows[name]])
        sink.close()


def _new(folder: str) -> Path:
    path = Path(folder) / "written"
    path.mkdir()
    return path


def is_alone(place: Place) -> bool:
    """Return whether a place of a record is known to be in one face only, or is checked in another record."""
    record, face, name = place
    if face in VIEWS or record in SUMS or (record, face) == ("function", "tables"):
        return True
    return any([fnmatchcase(name, pattern) for pattern in ALONE.get((record, face), ())])
