"""The outputs of a live run: plain lines, JSON lines, the rows and details of the screens, the metrics."""

from __future__ import annotations

from collections.abc import Iterable

from dissect.engine.pipeline import Pipeline
from dissect.meaning.report.contract import connection_as_dict
from dissect.meaning.report.words import Places
from dissect.online.live.events import Collector, Event
from dissect.online.live.json_lines import JsonLines
from dissect.online.live.lines import PlainLines, kinds_of
from dissect.online.metrics.counters import Metrics
from dissect.online.metrics.exposition import Exposition
from dissect.online.monitor.details import connection_details, entry_lines, finding_details
from dissect.online.monitor.model import Model
from dissect.online.monitor.rows import Look, connection_row, entry_line, entry_row, finding_row, joined, sparks
from dissect.wire.text import Clock
from tests.fuzz.checks import check_json, check_line, check_lines


def new_watcher() -> Collector:
    """Return an object that keeps every event."""
    places = Places([], False)
    return Collector(lambda connection: connection_as_dict(connection, places))


def check_events(events: Iterable[Event]) -> None:
    """Every event is a safe line and an object of JSON."""
    told = list(events)
    kinds = kinds_of(())
    check_lines(PlainLines(kinds).lines(told))
    for line in JsonLines(kinds).lines(told):
        check_json(line)


def check_screens(events: Iterable[Event], pipeline: Pipeline) -> None:
    """Rows have the right width and are safe, and so are the details of everything that is shown."""
    model = Model()
    model.take(events)
    clock = Clock()
    for entry in model.entries:
        check_line(entry_line(entry, clock))
        for line in entry_lines(entry):
            check_line(line.text)
        for width in (40, 120):
            check_line(joined(entry_row(entry, width, clock)))
    for connection in model.connections(int(pipeline.now_ns)):
        check_line(joined(connection_row(connection, 100, Look(sparks()))))
        for line in connection_details(connection, model.entries):
            check_line(line.text)
    for finding in model.findings(pipeline.finding_counts):
        check_line(joined(finding_row(finding, 80, clock)))
        for line in finding_details(finding):
            check_line(line.text)


def check_metrics(metrics: Metrics, pipeline: Pipeline) -> None:
    """The exposition is text whose lines are safe, and knows every packet."""
    metrics.begin(pipeline)
    text = Exposition(metrics).text().decode()
    check_lines(text.split("\n"))
    assert text.endswith("\n")
