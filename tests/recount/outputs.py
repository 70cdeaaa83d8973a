"""The output of every face for one capture, from one reading: the texts that `tests.recount.recount` reads."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from dissect.engine.observer import Observer
from dissect.files.session import Run
from dissect.meaning.inventory.outcome import Devices
from dissect.meaning.report.brief import brief_lines
from dissect.meaning.report.formats import FORMATS, OPERATIONS, PDUS, TRANSACTIONS
from dissect.meaning.report.styled import Line
from dissect.meaning.report.text import analysis_lines
from dissect.meaning.report.words import Places
from dissect.meaning.report.writer import OperationFeed, PduFeed, TransactionFeed, Writer
from dissect.online.alerts import Alert, AlertEngine
from dissect.online.alerts.loading import parse_rules
from dissect.online.live.run import Fanout
from dissect.online.live.session import Session
from dissect.online.monitor import rows
from dissect.online.monitor.model import Model
from dissect.output.export.feed import Sink, TableFeed
from dissect.output.export.forms import FORMS, ExportRequest
from dissect.output.export.tables import TABLES, Table
from dissect.output.export.transaction_rows import Row
from dissect.output.page.gathered import Gathered, span_of
from dissect.output.page.rendering import Side, render
from dissect.output.page.rows import Rows
from dissect.packets.source.files import open_capture
from dissect.wire.text import Clock
from tests.faces.reading import options_of
from tests.online.monitor.support import ended, events_of

#: Reports every finding once, and counts the later ones.
RULES: Final = '[[rule]]\nname = "all"\nwhen = "finding"\nfinding = "note"\ncooldown = "10d"\nburst = 10000\n'
#: Tables of an export whose cells are recounted.
EXPORTED: Final = ("connections", "findings", "finding_counts")
#: Columns of a screen: wide enough for all columns of connections.
WIDTH: Final = 200


class _Rows(Sink):
    """Keeps the rows of tables, as JSON."""

    def __init__(self) -> None:
        self.rows: list[str] = []

    def take(self, table: Table, rows: Sequence[Row]) -> None:
        names = [column.name for column in table.stored]
        for row in rows:
            self.rows.append(json.dumps({"table": table.name, **dict(zip(names, row, strict=True))}, default=str))


def text_of(lines: Any) -> str:
    """Return lines of any kind as one text."""
    texts = []
    for line in lines:
        if isinstance(line, bytes):
            texts.append(line.decode("utf-8", "backslashreplace"))
        else:
            texts.append(line.text if isinstance(line, Line) else line)
    return "\n".join(texts)


def _failed(observer: Observer, error: Exception) -> None:
    raise AssertionError(f"{type(observer).__name__} failed") from error


class _Written:
    """The writers of the lines of transactions, PDUs and operations, each behind the feed that its command has."""

    KINDS: Final = (
        ("transactions.jsonl", TRANSACTIONS, "jsonl"),
        ("transactions.txt", TRANSACTIONS, "text"),
        ("show.jsonl", PDUS, "jsonl"),
        ("operations.txt", OPERATIONS, "text"),
    )

    def __init__(self) -> None:
        self.writers: dict[str, Writer] = {name: FORMATS[form].writer(kind) for name, kind, form in self.KINDS}
        self.feeds: list[Observer] = []
        for name, kind, _ in self.KINDS:
            writer = self.writers[name]
            if kind == TRANSACTIONS:
                self.feeds.append(TransactionFeed(writer))
            else:
                self.feeds.append(OperationFeed(writer) if kind == OPERATIONS else PduFeed(writer))

    def take(self) -> dict[str, str]:
        return {name: text_of(writer.take()) for name, writer in self.writers.items()}


def outputs_of(path: Path, folder: Path) -> dict[str, str]:
    """Return the output of the faces for a capture, by the name of the face; ``folder`` takes the file of an export."""
    gathered = Gathered(Rows([path.name], Clock(), {}))
    written, tables, alerts = _Written(), _Rows(), list[Alert]()
    engine = AlertEngine(parse_rules(RULES), None, alerts.append)
    feed = TableFeed([table for name, table in TABLES.items() if name in EXPORTED], tables)
    target = folder / "bundle.stix"
    stix = FORMS["stix"].open(ExportRequest(target, False, (), [str(path)], "1"))
    run = Run([path], Fanout([gathered, *written.feeds, engine, feed, stix.observer], _failed), options_of(path))
    places = gathered.rows.places = Places(run.files, False)
    gathered.files = run.files
    for writer in written.writers.values():
        writer.begin(places)
    feed.begin(run.files)
    stix.begin(run)
    run.read()
    feed.finish(run.pipeline, run.files)
    stix.close()
    engine.finish()
    gathered.take(run.pipeline, run.files, span_of(run.pipeline))
    analysis = gathered.analysis
    said = {
        **written.take(),
        "analyze.txt": text_of(analysis_lines(analysis)),
        "brief.txt": text_of(brief_lines(analysis)),
        "devices.txt": text_of(Devices(gathered.inventory).text()),
        "page.html": render([Side(gathered, [path.name])], "0"),
        "alerts.jsonl": "\n".join([alert.as_json() for alert in alerts]),
        "tables.jsonl": "\n".join(tables.rows),
        "bundle.stix": target.read_text(encoding="utf-8") if target.exists() else "{}",
    }
    said["screens.txt"] = screens_of(path)
    return said


def screens_of(path: Path) -> str:
    """Return the rows of the screens of `monitor` after a whole capture."""
    session = ended(Session(lambda: open_capture(str(path)), options_of(path), name=path.name))
    model = Model()
    model.take(events_of(session))
    look = rows.Look(rows.sparks())
    lines = [rows.joined(rows.connection_row(one, WIDTH, look)) for one in model.connections(session.status().now_ns)]
    counts = session.run.pipeline.finding_counts
    lines += [f"FINDING {rows.joined(rows.finding_row(one, WIDTH, Clock()))}" for one in model.findings(counts)]
    lines += [f"ENTRY {rows.joined(rows.entry_row(entry, WIDTH, Clock()))}" for entry in model.entries]
    return "\n".join(lines)
