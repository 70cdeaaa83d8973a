from __future__ import annotations

import json
from typing import Any

from dissect.engine.findings.bounds import COUNTED
from dissect.engine.findings.catalogue import CATALOGUE
from dissect.engine.findings.reporter import Finding
from dissect.online.live.events import PROBLEM, TRANSACTION, Collector, Event
from dissect.online.live.json_lines import JsonLines
from dissect.online.live.lines import PlainLines, kinds_of
from dissect.online.monitor.lists import FindingList
from dissect.packets.source.live.reader import Drops
from tests.meaning.report.schemas import complaints
from tests.online.live.test_lines import conversation, events_of, status
from tests.properties.packets import EPOCH_NS

Told = dict[str, Any]


def told_of(*topics: str) -> list[Told]:
    lines = JsonLines(kinds_of(topics)).lines(events_of(conversation()))
    assert all(line.isascii() and "\n" not in line for line in lines)
    return [json.loads(line) for line in lines]


def test_what_has_a_schema_keeps_it_and_the_rest_is_an_event() -> None:
    told = told_of()
    for line in told:
        name = line["schema"].removeprefix("s7dissect.").removesuffix("/1")
        assert complaints(name, line, exact=True) == []
    kinds = [line.get("event", line["schema"]) for line in told]
    assert kinds[:3] == ["connection_opened", "s7dissect.transaction/1", "s7dissect.operation/1"]
    assert kinds[-2:] == ["connection_closed", "finding"]
    assert {line["finding"]["slug"] for line in told if line.get("event") == "finding"} <= CATALOGUE.keys()


def test_a_connection_says_how_it_ended() -> None:
    opened, closed = told_of("connections")
    assert opened["event"] == "connection_opened"
    assert opened["connection"]["number"] == closed["connection"]["number"] == 1
    ending = closed["connection"]["ending"]
    assert (ending["how"], ending["role"], ending["open_requests"]) == ("reset", "server", 1)
    assert closed["time"] == ending["time"]


def test_a_connection_is_told_as_it_was_when_it_opened() -> None:
    """However late the line is written: here when all is over."""
    opened, closed = told_of("connections")
    assert (opened["connection"]["pdus"], opened["connection"]["ending"]) == (0, None)
    assert closed["connection"]["pdus"] > 0


def test_lines_about_the_output_itself() -> None:
    lines = JsonLines(kinds_of([]))
    lost = json.loads(lines.lost(EPOCH_NS, {TRANSACTION: 3}))
    problem = json.loads(lines.line(Event(PROBLEM, EPOCH_NS, "evidence failed \udcff\x7f")))
    summary = json.loads(lines.summary(status(packets=5, drops=Drops(None, 2))))
    for line in (lost, problem, summary):
        assert complaints("event", line, exact=True) == []
    assert (lost["event"], lost["counts"]) == ("events_lost", {"transaction": 3})
    assert problem["event"] == "problem"
    assert (summary["summary"]["packets"], summary["summary"]["dropped"]) == (5, {"kernel": None, "interface": 2})


def test_what_was_only_counted_is_one_line() -> None:
    finding = Finding(CATALOGUE["security.plc_stop"], 0, [9], EPOCH_NS, "101 more, between 10.0.0.1 and 10.0.0.2")
    finding.repeated, finding.room = 101, COUNTED
    collector = Collector(lambda _: {})
    collector.repeated(finding)
    (event,) = collector.fresh
    told = json.loads(JsonLines(kinds_of([])).line(event))
    assert complaints("event", told, exact=True) == []
    assert (told["event"], told["repeated"], told["finding"]["frames"]) == ("finding", 101, [9])
    assert (told["finding"]["number"], told["finding"]["connection"]) == (None, None)
    line = PlainLines(kinds_of([])).line(event)
    assert line.endswith("ERROR  security.plc_stop  packet 9: 101 more, between 10.0.0.1 and 10.0.0.2")
    listed = FindingList()
    listed.note(finding)
    assert listed.facts({"security.plc_stop": 201})[0].details == ()
