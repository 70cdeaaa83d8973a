"""Findings that another one explains: named with their cause, listed with its number, and counted for nothing else."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Final

import pytest

import dissect
from dissect.engine.findings.bounds import KEPT
from dissect.engine.findings.catalogue import CATALOGUE
from dissect.engine.findings.reporter import MAX_DETAILED_ALL, Finding, Reporter
from dissect.engine.options import Options
from dissect.files.jobs.analyses import Analyses
from dissect.files.jobs.sums import part_of
from dissect.files.recording.event_capture import EventCapture
from dissect.files.session import Run
from dissect.meaning.report.analysis import Analysis
from dissect.meaning.report.contract import analysis_as_dict
from dissect.meaning.report.kept import BLOCK, FIRST, Findings
from dissect.meaning.report.per_file import PerFile
from dissect.meaning.report.text import analysis_lines
from dissect.online.alerts.engine import AlertEngine
from dissect.online.alerts.loading import parse_rules
from dissect.online.live.events import FINDING, Event
from dissect.online.live.json_lines import JsonLines
from dissect.online.live.lines import PlainLines
from dissect.output.export.ecs import ecs_export
from dissect.output.export.feed import TableFeed
from dissect.output.export.forms import ExportRequest
from dissect.output.export.stix import stix_export
from dissect.output.export.tables import FINDINGS
from dissect.output.page.gathered import Gathered
from dissect.output.page.rows import Rows
from dissect.testing.captures import Capture
from dissect.wire.text import Clock
from tests.cli.support import run
from tests.meaning.report.schemas import ROOT
from tests.output.export.support import Kept

CAPTURES: Final = ROOT / "captures"
CAUSES: Final = CAPTURES / "crafted" / "causes.pcapng"
#: What the capture has, in the order of the text.
EXPLAINED: Final = {
    "cotp.fragments_unanswered": {"session.cut": 1, "transaction.unanswered": 2},
    "cotp.number_unanswered": {"session.cut": 1, "session.too_many_jobs": 2, "transaction.unanswered": 3},
    "s7.malformed": {"security.protected": 2, "security.write_refused": 2, "transaction.refused": 2},
    "session.tpdu_too_small": {"transaction.unanswered": 1},
    "transaction.bit_count": {"transaction.item_error": 1},
}
ALL: Final = sum(sum(counts.values()) for counts in EXPLAINED.values())
SLUGS: Final = {slug for counts in EXPLAINED.values() for slug in counts}

Capfd = pytest.CaptureFixture[bytes]


def told(path: Path = CAUSES) -> dict[str, Any]:
    values: dict[str, Any] = json.loads(json.dumps(analysis_as_dict(dissect.analyze(path))))
    return values


# ---- analyze --------------------------------------------------------------------------------------------------------


def test_json_lists_them_with_the_number_of_their_cause() -> None:
    values = told()
    assert values["findings_explained"] == EXPLAINED
    assert not SLUGS & set(values["findings"])
    found = {one["number"]: one for one in values["finding_details"]}
    assert sorted(found) == [*range(1, len(values["finding_details"]) + 1)]
    explained = [one for one in found.values() if one["explained_by"] is not None]
    assert len(explained) == ALL
    for one in explained:
        cause = found[one["explained_by"]]
        assert one["because_of"] == cause["slug"]
        assert one["slug"] in EXPLAINED[cause["slug"]]
        assert cause["connection"] == one["connection"]
        assert (cause["explained_by"], cause["because_of"]) == (None, None)
        assert f"because of {cause['slug']}: " in one["detail"]


def test_text_names_them_with_their_cause(capfdbinary: Capfd) -> None:
    out = run(capfdbinary, "analyze", CAUSES).out
    assert (
        "because of it: security.protected (2 times), security.write_refused (2 times), transaction.refused (2 times)\n"
        in out
    )
    assert "because of it: session.cut, session.too_many_jobs (2 times), transaction.unanswered (3 times)\n" in out
    assert out.count("because of it: ") == len(EXPLAINED)
    for slug in SLUGS:
        assert f"warning  {slug}" not in out
    brief = run(capfdbinary, "analyze", "--brief", CAUSES).out
    assert brief.count("because of it ") + brief.count("… (") >= len(EXPLAINED)
    assert not [line for line in brief.splitlines() if line.split()[1:2] and line.split()[1].rstrip(":") in SLUGS]


def test_an_analysis_keeps_them_apart() -> None:
    analysis = dissect.analyze(CAUSES)
    assert not SLUGS & {finding.slug for finding in analysis.findings}
    assert {finding.slug for finding in analysis.explained} == SLUGS
    assert analysis.by_cause() == EXPLAINED


def test_many_findings_keep_their_causes_when_they_are_packed() -> None:
    kept = Findings()
    rule = CATALOGUE["transaction.refused"]
    for number in range(1, FIRST + 3 * BLOCK + 1):
        finding = Finding(rule, 1, [number], number, "")
        finding.number, finding.explained_by, finding.because = number, number // 2, "s7.malformed"
        kept.append(finding)
    for place, finding in enumerate(kept, 1):
        assert (finding.number, finding.explained_by, finding.because) == (place, place // 2, "s7.malformed")


def test_rows_by_file_count_them_not(capfdbinary: Capfd) -> None:
    values = told()
    severities = [CATALOGUE[slug].severity for slug, count in values["findings"].items() for _ in range(count)]
    rows = PerFile()
    reading = Run([CAUSES], rows)
    rows.files = reading.files
    while reading.step():
        pass
    list(rows.lines())
    counted = rows.of(0).findings
    assert counted == {severity: severities.count(severity) for severity in counted}


# ---- one process or many --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("where", ["", "server == 192.0.2.20 and slug matches 'unanswered'"])
def test_the_numbers_are_the_same_in_one_process_and_many(capfdbinary: Capfd, where: str) -> None:
    files = [str(CAPTURES / "szl.pcapng"), str(CAUSES), str(CAPTURES / "transfer.pcapng"), str(CAUSES)]
    options = ["-Y", where] if where else []
    several = [
        json.loads(run(capfdbinary, "analyze", "-T", "json", *way, *options, *files).out)
        for way in (["--separate", "--jobs", "1"], ["--separate", "--jobs", "2"], [])
    ]
    for key in ("findings", "findings_explained", "finding_details"):
        assert several[0][key] == several[1][key]
        assert several[0][key] == several[2][key]
    numbers = [one["number"] for one in several[0]["finding_details"]]
    assert len(set(numbers)) == len(numbers) > 0


def test_the_bounds_of_both_kinds_hold_for_the_sum() -> None:
    """As in one run: of a slug so many that are explained, and as many that are not."""
    sums = Analyses(Options())
    for part in range(3):
        analysis = Analysis()
        reading = Run([str(CAPTURES / "szl.pcapng")], analysis)
        reporter = reading.pipeline.exchange.reporter
        while reading.step():
            pass
        for connection in range(1000 * part + 1, 1000 * part + 401):
            reporter.note("s7.malformed", connection, [1], 1)
            reporter.because = reporter.noted("s7.malformed")
            reporter.note("transaction.refused", connection, [1], 1)
            reporter.because = None
            reporter.note("transaction.refused", connection, [2], 1)
        reading.pipeline.exchange.report_findings()
        sums.add(part_of(analysis, reading.pipeline, reading.files))
    found = sums.result
    assert found.finding_counts["transaction.refused"] >= 1200
    assert found.explained_counts == {("s7.malformed", "transaction.refused"): 1200}
    assert len(found.explained) == MAX_DETAILED_ALL
    numbers = sorted(int(one.number) for one in [*found.findings, *found.explained])
    assert numbers == [*range(1, len(numbers) + 1)]
    causes = {int(one.number): one for one in found.findings}
    assert all(causes[int(one.explained_by)].connection == one.connection for one in found.explained)


# ---- gates, alerts, recordings --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("what", "code"),
    [
        ("transaction.unanswered", 0),
        ("security.protected", 0),
        ("security.write_refused", 0),
        ("session.*", 1),  # session.tpdu_too_small
        ("s7.malformed", 1),
        ("error", 1),
    ],
)
@pytest.mark.parametrize("way", [["analyze"], ["analyze", "--separate"], ["transactions", "-T", "csv"], ["devices"]])
def test_a_gate_counts_what_has_no_cause(capfdbinary: Capfd, what: str, code: int, way: list[str]) -> None:
    assert run(capfdbinary, *way, "--fail-on", what, CAUSES).code == code


def test_an_alert_is_given_for_what_has_no_cause() -> None:
    alerts: list[Any] = []
    rules = parse_rules('[[rule]]\nname = "all"\nwhen = "finding"\nfinding = "note"\nactions = []\n')
    engine = AlertEngine(rules, None, alerts.append)
    reading = Run([CAUSES], engine)
    while reading.step():
        pass
    engine.finish()
    slugs = {alert.detail["finding"]["slug"] for alert in alerts}
    assert slugs == set(told()["findings"])


def test_a_recording_is_started_by_what_has_no_cause(tmp_path: Path) -> None:
    keeper = EventCapture(tmp_path, 0, 0, slugs=["transaction.refused"])
    keeper.add(1, bytes(60), 60, 1)
    finding = Finding(CATALOGUE["transaction.refused"], 1, [1], 1, "")
    finding.because = "s7.malformed"
    keeper.finding(finding)
    assert keeper.triggers == 0
    finding.because = ""
    keeper.finding(finding)
    assert keeper.triggers == 1
    keeper.close()


# ---- selections, tables, logs ---------------------------------------------------------------------------------------


def test_a_selection_counts_them_apart(capfdbinary: Capfd) -> None:
    for expression, findings, explained in (
        ("because_of == s7.malformed", {}, {"s7.malformed": EXPLAINED["s7.malformed"]}),
        ("slug == transaction.item_error", {}, {"transaction.bit_count": {"transaction.item_error": 1}}),
        ("slug == transaction.bit_count", {"transaction.bit_count": 1}, {}),
    ):
        values = json.loads(run(capfdbinary, "analyze", "-T", "json", "-Y", expression, CAUSES).out)
        assert (values["findings"], values["findings_explained"]) == (findings, explained)
        assert values["selection"]["findings_not_judged"] == 0


def test_numbers_of_a_selection_are_those_of_the_run(capfdbinary: Capfd) -> None:
    numbers = {one["number"]: one["slug"] for one in told()["finding_details"]}
    values = json.loads(run(capfdbinary, "analyze", "-T", "json", "-Y", "slug matches 'malformed|refused'", CAUSES).out)
    for one in values["finding_details"]:
        assert numbers[one["number"]] == one["slug"]
        if one["explained_by"] is not None:
            assert numbers[one["explained_by"]] == one["because_of"]


def test_cut_takes_the_number(capfdbinary: Capfd, tmp_path: Path) -> None:
    for one in told()["finding_details"][:6]:
        out = tmp_path / "out.pcapng"
        assert run(capfdbinary, "cut", CAUSES, "-o", out, "--finding", str(one["number"]), "--force").code == 0
        packets = json.loads(run(capfdbinary, "analyze", "-T", "json", out).out)["packets"]["read"]
        assert packets == len(set(one["frames"]))


def test_rows_have_number_and_cause() -> None:
    sink = Kept()
    feed = TableFeed([FINDINGS], sink)
    reading = Run([CAUSES], feed)
    feed.begin(reading.files)
    while reading.step():
        pass
    feed.finish(reading.pipeline, reading.files)
    names = [column.name for column in FINDINGS.stored]
    rows = {row[0]: dict(zip(names, row, strict=True)) for row in sink.rows["findings"]}
    for one in told()["finding_details"]:
        row = rows.pop(one["number"])
        assert (row["slug"], row["explained_by"], row["because_of"]) == (
            one["slug"],
            one["explained_by"],
            one["because_of"],
        )
    assert rows == {}


def exported(form: Any, folder: Path) -> str:
    export = form(ExportRequest(folder, True, [], [str(CAUSES)], "0"))
    reading = Run([CAUSES], export.observer)
    export.begin(reading)
    while reading.step():
        pass
    export.close()
    return "\n".join(
        path.read_text(encoding="utf-8") for path in ([folder] if folder.is_file() else sorted(folder.glob("*.ndjson")))
    )


def test_documents_of_ecs_are_alerts_only_without_a_cause(tmp_path: Path) -> None:
    folder = tmp_path / "ecs"
    folder.mkdir()
    found = [json.loads(line) for line in exported(ecs_export, folder).splitlines() if '"s7dissect.finding"' in line]
    assert len([one for one in found if "because_of" in one["s7dissect"]]) == ALL
    for one in found:
        assert one["event"]["kind"] == ("event" if "because_of" in one["s7dissect"] else "alert")


def test_stix_has_notes_and_no_sightings_of_what_is_explained(tmp_path: Path) -> None:
    objects = json.loads(exported(stix_export, tmp_path / "causes.json"))["objects"]
    notes = [one for one in objects if one["type"] == "note"]
    further = [note for note in notes if "have no object of their own" in note["content"]]
    assert len(notes) - len(further) == len(told()["finding_details"])
    observed = {one["id"] for one in objects if one["type"] == "observed-data"}
    for note in notes:
        about = observed & set(note["object_refs"])
        assert bool(about) is ("because of" not in note["content"])


# ---- live, pages, tests ---------------------------------------------------------------------------------------------


def test_lines_of_a_live_run_say_so() -> None:
    analysis = dissect.analyze(CAUSES)
    events = [
        Event(FINDING, int(finding.time_ns), finding) for finding in (analysis.findings[0], analysis.explained[0])
    ]
    plain = PlainLines({FINDING}).written(events)
    assert [str(line).split("  ")[1] for line in plain] == ["ERROR", "EXPLAINED"]
    first, second = [json.loads(line)["finding"] for line in JsonLines({FINDING}).lines(events)]
    assert (first["explained_by"], first["because_of"]) == (None, None)
    assert (second["explained_by"], second["because_of"]) == (first["number"], first["slug"])


def test_a_page_names_them_with_their_cause(tmp_path: Path, capfdbinary: Capfd) -> None:
    out = tmp_path / "page.html"
    assert run(capfdbinary, "report", CAUSES, "-o", out).code == 0
    page = out.read_text(encoding="utf-8")
    assert "Because of it: session.cut, transaction.unanswered (2 times)." in page
    for slug in SLUGS:
        assert f'id="f-{slug}"' not in page
    gathered = Gathered(Rows([], Clock(), {}))
    for finding in dissect.analyze(CAUSES).explained:
        gathered.finding(finding)
    assert len(gathered.analysis.findings) == 0


def test_a_test_of_a_capture_gets_those_without_a_cause() -> None:
    slugs = {finding.slug for finding in Capture(CAUSES).findings()}
    assert slugs == set(told()["findings"])
    events = [event for event in dissect.open(str(CAUSES)) if isinstance(event, dissect.Finding)]
    assert {event.slug for event in events if event.because} == SLUGS


# ---- bounds ---------------------------------------------------------------------------------------------------------


def test_what_is_explained_hides_nothing_behind_a_bound() -> None:
    """A thousand explained refusals leave room for the details of one that is not explained."""
    reporter = Reporter()
    for connection in range(2 * MAX_DETAILED_ALL):
        reporter.note("s7.malformed", connection, [1], 1)
        reporter.because = reporter.noted("s7.malformed")
        reporter.note("transaction.refused", connection, [1], 1)
        reporter.because = None
    reporter.note("transaction.refused", 1, [2], 2, "alone")
    assert reporter.fresh[-1].detail == "alone"
    assert reporter.counts == {"s7.malformed": 2 * MAX_DETAILED_ALL, "transaction.refused": 1}
    assert reporter.explained == {("s7.malformed", "transaction.refused"): 2 * MAX_DETAILED_ALL}
    assert len([one for one in reporter.fresh if one.room == KEPT]) == 2 * MAX_DETAILED_ALL + 1


def test_a_cause_that_was_only_counted_has_no_number() -> None:
    reporter = Reporter()
    for _ in range(101):
        reporter.note("s7.malformed", 1, [1], 1)
    reporter.because = reporter.noted("s7.malformed")
    reporter.note("transaction.refused", 1, [1], 1, "refused")
    (finding,) = [one for one in reporter.fresh if one.slug == "transaction.refused"]
    assert (finding.because, finding.explained_by) == ("s7.malformed", 0)
    assert finding.detail == "refused; because of s7.malformed"


def test_the_text_has_lines_for_all_rules() -> None:
    lines = [line.text for line in analysis_lines(dissect.analyze(CAUSES))]
    assert "      because of it: transaction.item_error" in lines
