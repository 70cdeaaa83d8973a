"""Every face counts events: what is said of 300 refusals and of 27 writes is 300 and 27, whatever is shown in detail."""

from __future__ import annotations

import json
import re
import sqlite3
from pathlib import Path
from typing import Any, Final

import pytest

import dissect
from dissect.engine.findings.catalogue import CATALOGUE
from dissect.engine.findings.ledger import Ledger
from dissect.files.session import Run
from dissect.meaning.report.analysis import Analysis
from dissect.meaning.report.contract import analysis_as_dict
from dissect.meaning.report.finding_lines import findings_lines
from dissect.meaning.report.happened import by_gravity, facts_of, span, times
from dissect.meaning.report.summary import Summary
from dissect.output.export.ecs import ecs_export
from dissect.output.export.forms import ExportRequest, sqlite_export
from dissect.output.export.stix import stix_export
from dissect.output.page.findings import findings_of
from dissect.output.page.verdict import verdict
from dissect.wire.text import Clock, cut_inside, printable
from tests.meaning.report.schemas import ROOT
from tests.meaning.report.support import WORD, begun, saved
from tests.output.page.support import gathered_of
from tests.properties.messages import dt, read_answer, read_job, write_answer, write_job
from tests.properties.packets import EPOCH_NS

MS: Final = 1_000_000
SECOND: Final = 1_000 * MS
REFUSALS: Final = 300
WRITES: Final = 27
WRITTEN: Final = "27 writes on 1 connection, 00:00:01 to 00:00:27"
REFUSED: Final = "300 refused items on 1 connection, 00:00:28 to 00:05:27"


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """27 writes and then 300 refused reads, one of them a second."""
    talk = begun()
    for number in range(1, WRITES + REFUSALS + 1):
        if number <= WRITES:
            talk.send(0, dt(write_job(number, [WORD], [b"\x00\x07"])))
            talk.send(1, dt(write_answer(number, [0xFF])))
        else:
            talk.send(0, dt(read_job(number, [WORD])))
            talk.send(1, dt(read_answer(number, [WORD], [0x0A])))
    packets = talk.packets()
    begin = len(packets) - 2 * (WRITES + REFUSALS)
    midnight = EPOCH_NS // (86_400 * SECOND) * 86_400 * SECOND
    timed = [packet._replace(time_ns=midnight + place) for place, packet in enumerate(packets[:begin])]
    for place, packet in enumerate(packets[begin:]):
        timed.append(packet._replace(time_ns=midnight + (place // 2 + 1) * SECOND + place % 2 * MS))
    return saved(tmp_path_factory.mktemp("happened") / "many.pcapng", timed)


def exported(form: Any, path: Path, capture: Path, folder: bool) -> None:
    export = form(ExportRequest(path, folder, [], [str(capture)], "0"))
    run = Run([capture], export.observer)
    export.begin(run)
    while run.step():
        pass
    export.close()


def test_text_says_all_of_them(capture: Path) -> None:
    lines = [getattr(line, "text", "").strip() for line in Summary(dissect.analyze(capture)).text()]
    assert WRITTEN in lines
    assert REFUSED in lines
    assert any(line.startswith("warning  security.write (27 times): ") for line in lines)
    assert "and 297 more" in "\n".join(lines)


def test_brief_says_all_of_them(capture: Path) -> None:
    text = "\n".join([getattr(line, "text", "") for line in Summary(dissect.analyze(capture), brief=True).text()])
    assert f"security.write ({WRITTEN}): " in text
    assert f"transaction.item_error ({REFUSED}): " in text


def test_json_has_the_facts(capture: Path) -> None:
    told: Any = analysis_as_dict(dissect.analyze(capture))
    assert told["findings"] == {"security.write": 1, "transaction.item_error": REFUSALS}
    written, refused = (told["finding_facts"][slug] for slug in ("security.write", "transaction.item_error"))
    assert (written["events"], written["reports"], written["reported"]) == (WRITES, 1, "once a connection")
    assert (refused["events"], refused["reports"], refused["reported"]) == (REFUSALS, REFUSALS, "each")
    assert (written["in_last_tenth"], refused["in_last_tenth"]) == (False, True)
    assert refused["last_time"].endswith("T00:05:27.001000000Z")
    (pair,) = refused["pairs"]
    assert (pair["events"], pair["connections"], refused["hosts"]) == (REFUSALS, 1, 2)
    details = [one for one in told["finding_details"] if one["slug"] == "transaction.item_error"]
    assert refused["first_frame"] == details[0]["frames"][0]
    assert refused["last_frame"] == told["packets"]["read"] > details[-1]["frames"][-1]


def test_the_page_says_all_of_them(capture: Path) -> None:
    gathered = gathered_of([capture])
    since = verdict(gathered).sentences[1]
    assert since.startswith("It happened 300 times: the first time at ")
    assert since.endswith(", 28.00 s after the capture began, the last time 299.00 s later.")
    told = {one["rule"].slug: one for one in findings_of(gathered)}
    assert told["security.write"]["facts"] == WRITTEN
    assert (told["security.write"]["times"], told["transaction.item_error"]["count"]) == ("27 times", REFUSALS)


def test_tables_have_all_of_them(capture: Path, tmp_path: Path) -> None:
    exported(sqlite_export, tmp_path / "a.db", capture, False)
    rows = sqlite3.connect(tmp_path / "a.db").execute(
        "select scope, slug, events, reports, connections, end_ns - ts_ns from finding_counts order by scope, slug"
    )
    assert rows.fetchall() == [
        ("pair", "security.write", WRITES, 1, 1, 26 * SECOND),
        ("pair", "transaction.item_error", REFUSALS, REFUSALS, 1, 299 * SECOND),
        ("rule", "security.write", WRITES, 1, 1, 26 * SECOND),
        ("rule", "transaction.item_error", REFUSALS, REFUSALS, 1, 299 * SECOND),
    ]


def test_stix_observes_all_of_them(capture: Path, tmp_path: Path) -> None:
    exported(stix_export, tmp_path / "a.json", capture, False)
    objects = json.loads((tmp_path / "a.json").read_text())["objects"]
    notes = {one["object_refs"][0]: one["labels"][0] for one in objects if one["type"] == "note"}
    observed: dict[str, int] = {}
    for one in objects:
        if one["type"] == "observed-data":
            observed[notes[one["id"]]] = observed.get(notes[one["id"]], 0) + one["number_observed"]
    assert observed == {"security.write": WRITES, "transaction.item_error": REFUSALS}
    sightings = sum([one["count"] for one in objects if one["type"] == "sighting"])
    assert sightings == WRITES * len(CATALOGUE["security.write"].techniques)


def test_ecs_has_facts_and_capture_quality_apart(capture: Path, tmp_path: Path) -> None:
    cut = tmp_path / "cut.pcapng"
    cut.write_bytes(capture.read_bytes()[:-7])
    folder = tmp_path / "ecs"
    folder.mkdir()
    exported(ecs_export, folder, cut, True)
    counts = [json.loads(line) for line in (folder / "finding_counts.ndjson").read_text().splitlines()]
    events = {one["rule"]["id"]: one["s7dissect"]["events"] for one in counts if one["s7dissect"]["scope"] == "rule"}
    assert events == {"security.write": WRITES, "transaction.item_error": REFUSALS - 1, "capture.damaged": 1} | {
        slug: 1 for slug in events if slug.startswith(("tpkt.", "session.", "transaction.un"))
    }
    assert {one["event"]["kind"] for one in counts} == {"metric"}
    found = [json.loads(line) for line in (folder / "findings.ndjson").read_text().splitlines()]
    (damaged,) = [one for one in found if one["rule"]["id"] == "capture.damaged"]
    assert damaged["event"]["kind"] == "event"
    assert damaged["event"]["category"] == ["network"]
    assert damaged["event"]["dataset"] == "s7dissect.capture_quality"
    (written,) = [one for one in found if one["rule"]["id"] == "security.write"]
    assert (written["event"]["kind"], "intrusion_detection" in written["event"]["category"]) == ("alert", True)


def test_what_changes_a_plant_comes_first_then_what_came_first() -> None:
    ledger = Ledger()
    order = ("transaction.size_mismatch", "security.memory", "tpkt.garbage", "security.plc_start", "security.plc_stop")
    for place, slug in enumerate(order):
        for _ in range(place + 1):
            ledger.add(slug, "", "c", "s", 1, [place + 1], EPOCH_NS + place, True)
    ledger.add("security.write", "", "c", "s", 1, [1], EPOCH_NS - 5, True)
    shown = [rule.slug for rule in by_gravity((*sorted(order), "security.write"), ledger)]
    assert shown == [
        "security.plc_stop",
        "security.plc_start",
        "security.memory",
        "transaction.size_mismatch",
        "tpkt.garbage",
        "security.write",
    ]


def test_moments_of_different_days_have_their_days() -> None:
    clock = Clock()
    noon = EPOCH_NS // (86_400 * SECOND) * 86_400 * SECOND + 43_200 * SECOND
    assert span(clock, noon, noon) == "at 12:00:00.000"
    assert span(clock, noon, noon + 40 * MS) == "12:00:00.000 to 12:00:00.040"
    assert span(clock, noon, noon + 60 * SECOND) == "12:00:00 to 12:01:00"
    day = clock.moment(noon)[:10]
    after = clock.moment(noon + 86_400 * SECOND)[:10]
    assert span(clock, noon, noon + 86_400 * SECOND) == f"{day} 12:00:00 to {after} 12:00:00"
    assert times(CATALOGUE["security.write"], 1) == "1 write"
    assert times(CATALOGUE["s7.malformed"], 3) == "3 times"


def test_the_outcome_is_not_cut_off() -> None:
    long = f"10.0.0.1 to 10.0.0.2: {'x' * 500}, refused: 0x0a"
    shown = cut_inside(long, 120)
    assert shown.startswith("10.0.0.1 to 10.0.0.2: ")
    assert shown.endswith("x, refused: 0x0a")
    assert len(shown) < 130
    assert cut_inside("a\x1bb", 10) == printable("a\x1bb")


def test_an_analysis_before_its_run_has_no_facts() -> None:
    assert Analysis().ledger.rules == {}


def test_all_faces_show_findings_in_one_order() -> None:
    """The text, JSON and the report page; the browser edition takes the order of JSON."""
    several = 0
    for path in sorted((ROOT / "captures").rglob("*.pcap*")):
        if path.name.endswith(".gz"):
            continue
        gathered = gathered_of([path])
        analysis = gathered.analysis
        told: Any = analysis_as_dict(analysis)
        listed = [slug for slug in told["finding_facts"] if slug in told["findings"]]
        lines = [line.text for line in findings_lines(analysis, gathered.rows.places, facts_of(analysis, Clock()))]
        shown = [line.split()[1].rstrip(":") for line in lines if re.match(r"  (error|warning|note)  ", line)]
        assert listed == shown, path.name
        assert [one["rule"].slug for one in findings_of(gathered)] == shown, path.name
        several += len(shown) > 2
    assert several > 10
