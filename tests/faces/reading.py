"""One reading of a capture for all faces: each output is written from the same pipeline.

A face is an output: lines for a person, JSON, CSV, fields, tables, logs of Zeek, documents of ECS, a STIX bundle. `Told` has
their results; `tests.faces.records` cuts these into records.
"""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from decimal import Decimal
from pathlib import Path
from typing import Any, Final, NamedTuple

from dissect.engine.findings.reporter import Finding
from dissect.engine.observer import Observer
from dissect.engine.pipeline import Options
from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.transaction import OUTCOMES
from dissect.files.session import Run
from dissect.meaning.bindings import load_carrier
from dissect.meaning.inventory.collector import Inventory
from dissect.meaning.inventory.outcome import Devices
from dissect.meaning.report.analysis import Analysis
from dissect.meaning.report.contract import analysis_as_dict
from dissect.meaning.report.formats import FORMATS, OPERATIONS, PDUS, TRANSACTIONS, VALUES
from dissect.meaning.report.outcome import json_outcome
from dissect.meaning.report.styled import Line
from dissect.meaning.report.text import analysis_lines
from dissect.meaning.report.words import Places
from dissect.meaning.report.writer import OperationFeed, PduFeed, TransactionFeed, Writer
from dissect.meaning.select.columns import FieldsWriter
from dissect.meaning.select.fields import FIELDS
from dissect.meaning.select.things import CONNECTION, FINDING, MESSAGE, OPERATION, TRANSACTION, Context, Found
from dissect.online.live.events import CLOSED, OPENED
from dissect.online.live.events import TRANSACTION as LIVE_TRANSACTION
from dissect.online.live.events import Collector as Live
from dissect.online.live.run import Fanout
from dissect.online.monitor import rows
from dissect.online.monitor.model import Model
from dissect.output.export.feed import Sink, TableFeed
from dissect.output.export.forms import FORMS, Export, ExportRequest
from dissect.output.export.tables import TABLES, Table
from dissect.output.export.transaction_rows import Row
from dissect.output.variables.collector import ValueCollector
from dissect.output.variables.writers import ValueWriter
from dissect.testing.golden.model import GoldenError
from dissect.testing.golden.reading import read_session

CAPTURES: Final = Path(__file__).resolve().parents[2] / "captures"
#: Forms of exports whose files are read for each capture; those of the tables are tested with all rows at once.
DOCUMENTS: Final = ("ecs", "stix", "zeek-json", "zeek")
#: This many bytes of a long capture are read: longer ones poll for hours.
MOST_BYTES: Final = 160_000
#: Width of a terminal in which all columns of the screens fit.
_WIDE: Final = 200


class Told(NamedTuple):
    """What all faces show for a capture.

    ``lines`` are those of an output, by what they are of and format; ``rows`` those of the tables, by name of table and column;
    ``documents`` the objects of each file of an export, by form and name of the file; ``things`` are the fields that
    ``-Y`` finds in findings and connections. ``goldens`` are the connections as ``where`` of the pytest plugin selects them,
    ``screens`` the rows of `monitor`, by column.
    """

    name: str
    lines: dict[tuple[str, str], list[str]]
    rows: dict[str, list[dict[str, Any]]]
    documents: dict[str, list[dict[str, Any]]]
    things: dict[str, list[dict[str, str]]]
    goldens: list[dict[str, Any]]
    screens: list[dict[str, str]]


class Kept(Sink):
    """Keeps the rows of tables."""

    def __init__(self) -> None:
        self.rows: dict[str, list[dict[str, Any]]] = {name: [] for name in TABLES}

    def take(self, table: Table, rows: Sequence[Row]) -> None:
        names = [column.name for column in table.stored]
        self.rows[table.name] += [dict(zip(names, row, strict=True)) for row in rows]


class _Witness(Observer):
    """Keeps what ``-Y`` finds in things, evaluated when they are reported, as in a selection."""

    def __init__(self) -> None:
        super().__init__()
        self.context = Context()
        self.things: dict[str, list[dict[str, str]]] = {kind: [] for kind in (FINDING, CONNECTION)}

    def connection_opened(self, connection: Connection) -> None:
        self.context.opened(connection)

    def connection_closed(self, connection: Connection) -> None:
        self.context.closed(connection)
        self.things[CONNECTION].append(fields_of(CONNECTION, connection, self.context))

    def finding(self, finding: Finding) -> None:
        found = Found(finding, self.context.connection(int(finding.connection)))
        self.things[FINDING].append(fields_of(FINDING, found, self.context))


def fields_of(kind: str, thing: object, context: Context) -> dict[str, str]:
    """Return the fields of a thing as `-T fields` writes them; it supports only transactions, operations and messages."""
    row: dict[str, str] = {}
    for name in names_of_fields(kind):
        field = FIELDS[name]
        found: Any = field.getters[kind](thing, context)
        values = found if type(found) in {list, tuple} else [] if found is None else [found]
        row[name] = ",".join([field.kind.shown(value) for value in values])
    return row


def names_of_fields(kind: str) -> list[str]:
    """Return the names of the fields that things of a kind have, in the order used for `-T fields`."""
    return [name for name, field in FIELDS.items() if kind in field.getters]


class _Writers:
    """The writers of records of every format, each behind the feed that its command has."""

    def __init__(self, witness: _Witness) -> None:
        self.feeds: list[Observer] = []
        self._writers: dict[tuple[str, str], Writer] = {}
        feeds: dict[str, tuple[str, Callable[[Writer], Observer]]] = {
            TRANSACTIONS: (TRANSACTION, TransactionFeed),
            OPERATIONS: (OPERATION, OperationFeed),
            PDUS: (MESSAGE, PduFeed),
        }
        for kind, (thing, feed) in feeds.items():
            for format_ in FORMATS.values():
                if kind not in format_.writers:
                    continue
                writer = format_.writer(kind)
                if isinstance(writer, FieldsWriter):
                    writer.write_fields(names_of_fields(thing), witness.context)
                writer.plain = True  # as in a pipe, where lines may be written as octets
                self._writers[kind, format_.name] = writer
                self.feeds.append(feed(writer))

    def begin(self, places: Places) -> None:
        for writer in self._writers.values():
            writer.begin(places)

    def take(self) -> dict[tuple[str, str], list[str]]:
        return {key: texts(writer.take()) for key, writer in self._writers.items()}


def texts(lines: Iterable[str | bytes | Line]) -> list[str]:
    """Return lines of any kind as text, one for each line."""
    found: list[str] = []
    for line in lines:
        if isinstance(line, bytes):
            found += line.decode("utf-8", "backslashreplace").split("\n")
        else:
            found += (line.text if isinstance(line, Line) else line).split("\n")
    return found


def _values(collector: ValueCollector, places: Places) -> dict[tuple[str, str], list[str]]:
    rows = collector.take()
    found: dict[tuple[str, str], list[str]] = {}
    for format_ in FORMATS.values():
        if VALUES in format_.writers:
            writer = format_.writer(VALUES)
            assert isinstance(writer, ValueWriter)
            writer.begin(places)
            writer.values(rows)
            found[VALUES, format_.name] = texts(writer.take())
    return found


def options_of(path: Path) -> Options:
    """Return the options with which a capture is read: SCD captures have a dictionary beside them."""
    dictionary, bindings = path.with_suffix(".toml"), path.with_suffix(".bind.toml")
    if bindings.exists():
        return Options(strict=True, decoder=load_carrier(dictionary, bindings))
    return Options(strict=True)


def _failed(observer: Observer, error: Exception) -> None:
    raise AssertionError(f"{type(observer).__name__} failed") from error


def begun(path: Path, folder: Path) -> Path:
    """Return a capture or, if it is long, a file in ``folder`` with its beginning."""
    if path.stat().st_size <= MOST_BYTES:
        return path
    with path.open("rb") as file:
        (folder / path.name).write_bytes(file.read(MOST_BYTES))
    return folder / path.name


def read(path: Path, folder: Path) -> Told:
    """Read a capture once for all faces; ``folder`` is empty and takes the files of exports."""
    witness, analysis, inventory, collector = _Witness(), Analysis(), Inventory(), ValueCollector()
    live = Live(lambda _connection: {}, (OPENED, CLOSED, LIVE_TRANSACTION), scd=False)
    writers = _Writers(witness)
    kept = Kept()
    feed = TableFeed(TABLES.values(), kept)
    exports = {form: _export(form, folder, path) for form in DOCUMENTS}
    observers = [witness, analysis, inventory, collector, live, *writers.feeds, feed]
    fanout = Fanout([*observers, *[export.observer for export in exports.values()]], _failed)
    fanout.own_book = analysis.own_book
    run = Run([path], fanout, options_of(path))
    places = Places(run.files, False)
    writers.begin(places)
    feed.begin(run.files)
    for export in exports.values():
        export.begin(run)
    run.read()
    feed.finish(run.pipeline, run.files)
    for export in exports.values():
        export.close()
    analysis.take(run.pipeline, run.files)
    inventory.take(run.pipeline, run.files)
    devices = Devices(inventory)
    lines = {
        **writers.take(),
        **_values(collector, places),
        ("analysis", "text"): texts(analysis_lines(analysis)),
        ("analysis", "json"): [json.dumps(analysis_as_dict(analysis))],
        ("devices", "text"): texts(devices.text()),
        ("devices", "json"): ["".join(texts(json_outcome(devices)))],
        ("devices", "csv"): texts(FORMATS["csv"].lines("devices", devices)),
    }
    screens = _screens(live, run.pipeline.now_ns)
    return Told(path.name, lines, kept.rows, _documents(folder), witness.things, _goldens(path), screens)


def _goldens(path: Path) -> list[dict[str, Any]]:
    """Return the connections that the pytest plugin compares: all, selected by an expression."""
    try:
        session = read_session(path, decoder=options_of(path).decoder, where="connection >= 1")
    except GoldenError:  # too long for a golden
        return []
    found = []
    for link in session.links:
        outcomes = Counter([one.outcome for one in link.transactions])
        row: dict[str, Any] = {name: outcomes[name] for name in OUTCOMES[1:]}
        row |= {name: getattr(link, name) for name in ("carrier", "protocol", "ended", "ended_by", "tpdu_size")}
        row["client"], row["server"] = link.addresses
        if link.span is not None:
            row |= {name: getattr(link.span, name) for name in ("number", "first_frame", "first_ns")}
        found.append(row)
    return found


def _screens(live: Live, now_ns: int) -> list[dict[str, str]]:
    """Return the rows of the list of connections of `monitor`, wide enough for all columns."""
    model = Model()
    model.take(live.fresh)
    columns = rows._columns(_WIDE)
    look = rows.Look(rows.sparks())
    return [{column.head: column.cell(one, look)[0] for column, _ in columns} for one in model.connections(now_ns)]


def _export(form: str, folder: Path, path: Path) -> Export:
    shape = FORMS[form].shape
    target = folder / form
    if shape == "folder":
        target.mkdir()
    return FORMS[form].open(ExportRequest(target, shape == "folder", (), [str(path)], "1"))


def _documents(folder: Path) -> dict[str, list[dict[str, Any]]]:
    """Return the objects of each file that the exports wrote."""
    found: dict[str, list[dict[str, Any]]] = {}
    for path in sorted(folder.rglob("*")):
        if path.suffix == ".log" and path.parent.name == "zeek":
            found[f"zeek.{path.stem}"] = list(_log(path.read_text(encoding="utf-8").split("\n")))
        elif path.suffix in {".ndjson", ".log"}:
            lines = path.read_text(encoding="utf-8").splitlines()
            found[f"{path.parent.name}.{path.stem}"] = [json.loads(line, parse_float=Decimal) for line in lines]
        elif path.name == "stix":
            found["stix"] = json.loads(path.read_text(encoding="utf-8")).get("objects", [])
    return found


def _log(lines: list[str]) -> Iterator[dict[str, Any]]:
    """Yield the rows of a log of tab-separated values, each cell read by the type of its column."""
    heads = {line.split("\t")[0]: line.split("\t")[1:] for line in lines if line.startswith("#")}
    for line in lines:
        if line and not line.startswith("#"):
            cells = zip(heads["#fields"], heads["#types"], line.split("\t"), strict=True)
            yield {name: _cell(kind, text) for name, kind, text in cells if text != "-"}


def _cell(kind: str, text: str) -> Any:
    if kind.startswith("vector["):
        return [_cell(kind[7:-1], one) for one in text.split(",")] if text != "(empty)" else []
    if kind in {"count", "port"}:
        return int(text)
    if kind in {"time", "interval"}:
        return Decimal(text)
    if kind == "bool":
        return text == "T"
    return _unescaped(text) if text != "(empty)" else ""


def _unescaped(text: str) -> str:
    octets = re.sub(rb"\\x([0-9a-f]{2})", lambda found: bytes.fromhex(found[1].decode()), text.encode())
    return octets.replace(b"\\\\", b"\\").decode("utf-8", "surrogateescape")
