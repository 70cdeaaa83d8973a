"""Every output tells the same certainty of the same transaction, and none adds what is only likely to times and values.

`captures/crafted/certainty.pcapng` has what there is: pairs that are sure, pairs that are only likely for each of both
reasons, an answer that is surely missing, and two that are perhaps. A new output has to be put into one of the lists here.
"""

from __future__ import annotations

import csv
import io
import json
import re
import sqlite3
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, Final

import pytest

import dissect
from dissect.engine.observer import Observer
from dissect.engine.pipeline import Options
from dissect.engine.transactions.transaction import (
    CERTAINTIES,
    DOUBT_TEXTS,
    HOLE,
    PERHAPS_ANSWERED,
    REASON_TEXTS,
    Transaction,
)
from dissect.files.session import Run
from dissect.meaning.inventory.collector import Inventory
from dissect.meaning.report.certainty import SHORT, left_out, values_left_out
from dissect.meaning.report.formats import FORMATS, TRANSACTIONS, VALUES
from dissect.online.metrics.counters import Metrics
from dissect.online.monitor.details import connection_details, entry_lines
from dissect.online.monitor.model import Model
from dissect.online.monitor.rows import entry_row, joined
from dissect.output.baseline import Learner
from dissect.output.export.forms import FORMS
from dissect.output.page.data import Data
from dissect.testing.golden import diff_sessions, golden_text, read_session
from dissect.testing.golden.parsing import parse_golden
from dissect.wire.text import Clock
from tests.cli.support import run
from tests.online.live.support import never, taken
from tests.online.monitor.support import of_capture
from tests.output.page.support import gathered_of, page_of

Capture = pytest.CaptureFixture[bytes]
#: By the number of a transaction: its certainty and its doubt.
Told = dict[int, tuple[str, str]]

CAPTURE: Final = Path(__file__).resolve().parents[2] / "captures" / "crafted" / "certainty.pcapng"
#: The pairs that are only likely, and why; the answers that are missing, surely and perhaps.
LIKELY: Final = {14: "gaps", 20: "alike"}
MISSING: Final = {5: "sure", 9: "likely", 10: "likely"}
#: The packets with the values of the likely pairs.
LIKELY_FRAMES: Final = {30, 49}
#: Requests with an answer, and those of them whose pair is sure.
ANSWERED: Final = 16
SURE: Final = ANSWERED - len(LIKELY)


def truth() -> Told:
    """Return what the library says."""
    found = [event for event in dissect.open(CAPTURE, pdus=False) if isinstance(event, Transaction)]
    return {one.number: (one.certainty, one.doubt) for one in found}


def test_the_capture_has_what_is_needed() -> None:
    told = truth()
    assert {number: doubt for number, (_, doubt) in told.items() if doubt} == LIKELY
    assert {told[number] for number in LIKELY} == {("likely", "gaps"), ("likely", "alike")}
    assert {number: told[number][0] for number in MISSING} == MISSING
    assert sum(1 for certainty, _ in told.values() if certainty == "sure") == SURE + 1
    assert set(LIKELY.values()) == set(DOUBT_TEXTS) == set(SHORT)
    assert {certainty for certainty, _ in told.values()} == {"", *CERTAINTIES}


# ---- the outputs that list transactions -----------------------------------------------------------------------------


def by_mark(lines: Iterable[str]) -> Told:
    """Return what lines for a person tell: the mark of a pair, the sentence of a missing answer; all other pairs are sure."""
    told: Told = {}
    for line in lines:
        number = int(re.search(r"#(\d+) ", line)[1])  # type: ignore[index]
        doubts = [doubt for doubt, said in SHORT.items() if f"(likely: {said})" in line]
        if doubts:
            told[number] = ("likely", doubts[0])
        elif REASON_TEXTS[HOLE] in line or PERHAPS_ANSWERED in line:
            told[number] = ("sure" if REASON_TEXTS[HOLE] in line else "likely", "")
        else:
            told[number] = ("" if "NO ANSWER" in line else "sure", "")
    return told


def by_keys(objects: Iterable[dict[str, Any]], number: str = "number") -> Told:
    """Return what objects tell that name only what is not sure."""
    told: Told = {}
    for one in objects:
        certain = one["outcome"] == "answered" or one.get("reason") == "hole"
        told[int(one[number])] = (one.get("certainty", "sure" if certain else ""), one.get("doubt", ""))
        if one.get("doubt"):
            assert one.get("latency_ns", one.get("latency_ms")) is None
    return told


def by_columns(rows: Iterable[dict[str, Any]], number: str) -> Told:
    """Return what rows tell that always have both columns."""
    return {int(row[number]): (row["certainty"] or "", row["doubt"] or "") for row in rows}


def text(fd: Capture, _: Path) -> Told:
    return by_mark(run(fd, "transactions", CAPTURE).out.splitlines())


def jsonl(fd: Capture, _: Path) -> Told:
    return by_keys(json.loads(line) for line in run(fd, "transactions", "-T", "jsonl", CAPTURE).out.splitlines())


def csv_rows(fd: Capture, _: Path) -> Told:
    rows = list(csv.DictReader(io.StringIO(run(fd, "transactions", "-T", "csv", CAPTURE).out)))
    assert {int(row["number"]) for row in rows if row["outcome"] == "answered" and not row["latency_ns"]} == set(LIKELY)
    return by_columns(rows, "number")


def fields(fd: Capture, _: Path) -> Told:
    names = [word for name in ("number", "certainty", "doubt") for word in ("-e", name)]
    rows = [line.split("\t") for line in run(fd, "transactions", "-T", "fields", *names, CAPTURE).out.splitlines()]
    return {int(number): (certainty, doubt) for number, certainty, doubt in rows}


def several_files(fd: Capture, folder: Path) -> Told:
    """Of several files each line has the names of files as well, and is written by other code."""
    empty = folder / "empty.pcapng"
    run(fd, "cut", CAPTURE, "-o", empty, "-Y", "frame == 1")
    lines = run(fd, "transactions", "-T", "jsonl", empty, CAPTURE).out.splitlines()
    return by_keys(json.loads(line) for line in lines)


def selection(fd: Capture, _: Path) -> Told:
    told: Told = {}
    for certainty in ("", *CERTAINTIES):
        for doubt in ("", *DOUBT_TEXTS):
            where = f"{f'certainty == {certainty}' if certainty else 'not certainty'} and "
            where += f"doubt == {doubt}" if doubt else "not doubt"
            for line in run(fd, "transactions", "-T", "jsonl", "-Y", where, CAPTURE).out.splitlines():
                told[int(json.loads(line)["number"])] = (certainty, doubt)
    return told


def python_where(_fd: Capture, _: Path) -> Told:
    found = {
        event.number for event in dissect.open(CAPTURE, pdus=False, where="doubt") if isinstance(event, Transaction)
    }
    assert found == set(LIKELY)
    return truth()


def golden(_fd: Capture, _: Path) -> Told:
    """Goldens have the same order, but number the transactions anew."""
    session = read_session(CAPTURE)
    read_again = parse_golden(golden_text(session))
    assert [(one.certainty, one.doubt) for one in read_again.transactions] == [
        (one.certainty, one.doubt) for one in session.transactions
    ]
    return {one.number: (one.certainty, one.doubt) for one in session.transactions}


def monitor_lines(fd: Capture, _: Path) -> Told:
    return by_mark(line for line in run(fd, "monitor", CAPTURE, "--plain", "--only", "transactions").out.splitlines())


def monitor_json(fd: Capture, _: Path) -> Told:
    lines = run(fd, "monitor", CAPTURE, "-T", "jsonl", "--only", "transactions").out.splitlines()
    return by_keys(one for one in map(json.loads, lines) if "outcome" in one)


def screen_rows(_fd: Capture, _: Path) -> Told:
    entries = [entry for entry in watched().entries if isinstance(entry.what, Transaction)]
    return by_mark(joined(entry_row(entry, 400, Clock())) for entry in entries)


def screen_details(_fd: Capture, _: Path) -> Told:
    told: Told = {}
    for entry in watched().entries:
        if isinstance(entry.what, Transaction):
            lines = [line.text for line in entry_lines(entry)]
            told |= by_mark(lines[:1])
            doubt = told[entry.what.number][1]
            assert (
                (f"  only likely: {DOUBT_TEXTS[doubt]}" in lines)
                if doubt
                else not any("only likely" in one for one in lines)
            )
    return told


def page_rows(_fd: Capture, _: Path) -> Told:
    """The page lists only what failed and what was slow; each row says what any other line says."""
    rows = gathered_of([CAPTURE]).rows
    found = [event for event in dissect.open(CAPTURE, pdus=False) if isinstance(event, Transaction)]
    return by_mark(f"#{one.number} {rows.transaction(one)['cells'][6]}" for one in found)


def frames(_fd: Capture, _: Path) -> Told:
    rows = dissect.frames(CAPTURE, library="arrow")["transactions"].to_pylist()
    assert {row["transaction"] for row in rows if row["outcome"] == "answered" and row["latency_ns"] is None} == set(
        LIKELY
    )
    return by_columns(rows, "transaction")


def sql(fd: Capture, _: Path) -> Told:
    query = "SELECT transaction, certainty, doubt FROM transactions"
    lines = run(fd, "sql", "-T", "jsonl", query, CAPTURE).out.splitlines()
    return by_columns([json.loads(line) for line in lines], "transaction")


def items(fd: Capture, _: Path) -> Told:
    """Every item carries the certainty of its transaction, but not why it is only likely."""
    lines = run(fd, "sql", "-T", "jsonl", "SELECT DISTINCT transaction, certainty FROM items", CAPTURE).out.splitlines()
    found = {int(one["transaction"]): one["certainty"] or "" for one in map(json.loads, lines)}
    return {number: (found.get(number, certainty), doubt) for number, (certainty, doubt) in truth().items()}


def table_export(form: str) -> Callable[[Capture, Path], Told]:
    def told(fd: Capture, folder: Path) -> Told:
        out = folder / f"out{FORMS[form].endings[0]}"
        assert run(fd, "export", CAPTURE, "-o", out, "--only", "transactions").code == 0
        return by_columns(table_rows(form, out), "transaction")

    return told


def table_rows(form: str, out: Path) -> list[dict[str, Any]]:
    """Return the rows that an export wrote."""
    if form == "csv":
        return list(csv.DictReader(io.StringIO(out.read_text(encoding="utf-8"))))
    query = 'SELECT "transaction", certainty, doubt FROM transactions'
    if form == "sqlite":
        with sqlite3.connect(out) as base:
            base.row_factory = sqlite3.Row
            return [dict(row) for row in base.execute(query)]
    duckdb = pytest.importorskip("duckdb")
    if form == "duckdb":
        with duckdb.connect(str(out), read_only=True) as base:
            names = ("transaction", "certainty", "doubt")
            return [dict(zip(names, row, strict=True)) for row in base.execute(query).fetchall()]
    if form == "arrow":
        return list(pytest.importorskip("pyarrow.feather").read_table(out).to_pylist())
    return list(pytest.importorskip("pyarrow.parquet").read_table(out).to_pylist())


def ecs(fd: Capture, folder: Path) -> Told:
    assert run(fd, "export", CAPTURE, "-o", f"ecs:{folder / 'ecs'}").code == 0
    lines = (folder / "ecs" / "transactions.ndjson").read_text(encoding="ascii").splitlines()
    documents = [json.loads(line) for line in lines]
    unsure = [one for one in documents if one["s7dissect"].get("certainty")]
    assert {one["event"]["outcome"] for one in unsure} == {"unknown"}
    assert not [one for one in unsure if "duration" in one["event"] or "end" in one["event"]]
    return by_keys((one["s7dissect"] for one in documents), "transaction")


def zeek(form: str) -> Callable[[Capture, Path], Told]:
    def told(fd: Capture, folder: Path) -> Told:
        assert run(fd, "export", CAPTURE, "-o", f"{form}:{folder / form}").code == 0
        lines = (folder / form / "s7comm_transaction.log").read_text(encoding="utf-8").splitlines()
        if form == "zeek-json":
            return by_columns([{"certainty": "", "doubt": "", **json.loads(line)} for line in lines], "transaction")
        names = next(line for line in lines if line.startswith("#fields")).split("\t")[1:]
        rows = [dict(zip(names, line.split("\t"), strict=True)) for line in lines if not line.startswith("#")]
        return by_columns(
            [{key: "" if cell == "-" else cell for key, cell in row.items()} for row in rows], "transaction"
        )

    return told


def rewritten(command: str, *options: str) -> Callable[[Capture, Path], Told]:
    """What is said of a capture that a command wrote anew."""

    def told(fd: Capture, folder: Path) -> Told:
        out = folder / "out.pcapng"
        assert run(fd, command, CAPTURE, "-o", out, *options).code == 0
        found = [event for event in dissect.open(out, pdus=False) if isinstance(event, Transaction)]
        return {one.number: (one.certainty, one.doubt) for one in found}

    return told


#: By what it is called in the lists it has to be complete against.
FACES: Final[dict[str, Callable[[Capture, Path], Told]]] = {
    "text": text,
    "jsonl": jsonl,
    "csv": csv_rows,
    "fields": fields,
    "several files": several_files,
    "-Y": selection,
    "where": python_where,
    "golden": golden,
    "monitor": monitor_lines,
    "monitor jsonl": monitor_json,
    "screen rows": screen_rows,
    "screen details": screen_details,
    "page": page_rows,
    "frames": frames,
    "sql": sql,
    "items": items,
    "anonymize": rewritten("anonymize"),
    "cut": rewritten("cut"),
    "export ecs": ecs,
    "export zeek": zeek("zeek"),
    "export zeek-json": zeek("zeek-json"),
    **{f"export {form}": table_export(form) for form in ("parquet", "duckdb", "sqlite", "csv", "arrow")},
}
#: Forms of export that have no transactions, and what they have.
NO_TRANSACTIONS: Final = {"stix": "findings"}


@pytest.mark.parametrize("face", FACES)
def test_every_output_tells_the_same_certainty(capfdbinary: Capture, tmp_path: Path, face: str) -> None:
    assert dict(sorted(FACES[face](capfdbinary, tmp_path).items())) == dict(sorted(truth().items()))


def test_no_output_is_left_out() -> None:
    assert {row.name for row in FORMATS.values() if TRANSACTIONS in row.writers} <= FACES.keys()
    exported = {name.removeprefix("export ") for name in FACES if name.startswith("export ")}
    assert exported | NO_TRANSACTIONS.keys() == FORMS.keys()
    assert all("transactions" not in FORMS[name].names() for name in NO_TRANSACTIONS)


# ---- what counts answer times ---------------------------------------------------------------------------------------


def observed(observer: Observer) -> Run:
    session = Run([CAPTURE], observer, Options(strict=True))
    session.read()
    return session


def watched() -> Model:
    model = Model()
    model.take(taken(of_capture("crafted/certainty"), never))
    return model


def test_analyze_counts_them_beside_the_answer_times(capfdbinary: Capture) -> None:
    analysis = dissect.analyze(CAPTURE)
    assert (analysis.answered, analysis.latencies.count, dict(analysis.likely)) == (
        ANSWERED,
        SURE,
        {"gaps": 1, "alike": 1},
    )
    assert (analysis.missed, analysis.not_captured) == (1, len(MISSING))
    assert not {one.number for one in [*analysis.slowest(), *analysis.failed]} & {*LIKELY, *MISSING}
    sentence = left_out({"gaps": 1, "alike": 1})
    assert sentence.startswith("2 pairs are only likely and left out of answer times: ")
    assert values_left_out({"gaps": 1, "alike": 1}) == (
        sentence.replace("pairs", "transactions").replace("answer times", "values")
    )
    told = json.loads(run(capfdbinary, "analyze", "-T", "json", CAPTURE).out)
    counts = told["transactions"]
    assert (counts["likely"], counts["likely_text"]) == (2, f"{sentence}.")
    assert counts["likely_doubts"] == {"alike": 1, "gaps": 1}
    assert counts["answers_not_captured"] == counts["unanswered_reasons"]["hole"] == len(MISSING)
    assert [row["likely"] for row in told["functions"] if "likely" in row] == [2]
    lines = run(capfdbinary, "analyze", CAPTURE).out.splitlines()
    assert f"  {sentence}" in lines
    assert "Transactions: 16 answered (2 only likely), 1 unanswered, 3 answers not captured" in lines
    brief = run(capfdbinary, "analyze", "--brief", CAPTURE).out
    assert "20 transactions, 1 unanswered, 3 without a captured answer, 2 pairs only likely" in brief


def test_devices_metrics_and_baseline_leave_them_out() -> None:
    inventory, metrics, learner = Inventory(), Metrics(), Learner()
    for observer in (inventory, metrics, learner):
        session = observed(observer)
        if observer is inventory:
            inventory.take(session.pipeline, session.files)
    (server,) = [device for device in inventory.devices if device.asked_by]
    assert (server.latencies.count, server.asked.answered, server.asked.likely) == (SURE, ANSWERED, len(LIKELY))
    assert sum(sum(row.buckets) for row in metrics.functions.rows.values()) == SURE
    assert (metrics.likely, metrics.not_captured) == ({"gaps": 1, "alike": 1}, {"sure": 1, "likely": 2})
    ((_, learned),) = learner._pairs.items()
    assert (learned.answers.count, learned.transactions) == (SURE, 20)


def test_the_page_leaves_them_out_and_says_so() -> None:
    gathered = gathered_of([CAPTURE])
    assert sum(spread.latencies.count for spread in gathered.spreads.values()) == SURE
    assert sum(spread.times.count for spread in gathered.spreads.values()) == SURE
    assert len(gathered.slowest()) == SURE
    made = Data(gathered, "x").as_dict()
    functions = next(table for table in made["tables"] if table["name"] == "functions")
    names = [name for name, _ in functions["columns"]]
    row = dict(zip(names, functions["rows"][0]["cells"], strict=True))
    assert (row["function"], row["count"], row["answered"]) == ("Read Var", 18, 14)
    assert (row["no answer"], row["not captured"], row["only likely"]) == (1, len(MISSING), len(LIKELY))
    page = page_of(CAPTURE)
    assert left_out({"gaps": 1, "alike": 1}) in page
    assert "3 answers not captured" in page


def test_the_screens_leave_them_out_and_say_so() -> None:
    model = watched()
    facts = model.connections(0)
    assert sorted([dict(one.doubts) for one in facts], key=str) == [{"alike": 1}, {"gaps": 1}]
    for one in facts:
        lines = [line.text.strip() for line in connection_details(one, model.entries)]
        assert left_out(one.doubts) in lines
    of_two = next(one for one in facts if one.key == 2)
    assert of_two.latency_ns == 500_000  # of the setup, not of the read behind it


# ---- values ---------------------------------------------------------------------------------------------------------


def test_values_leave_them_out_and_say_how_many(capfdbinary: Capture) -> None:
    plain = run(capfdbinary, "values", CAPTURE)
    assert plain.err.splitlines() == [f"s7dissect: {values_left_out({'gaps': 1, 'alike': 1})}; --likely lists them"]
    marked = run(capfdbinary, "values", "--likely", CAPTURE)
    assert marked.err == ""
    more = [line for line in marked.out.splitlines() if line not in plain.out.splitlines()]
    assert [line[line.rindex("(likely: ") :] for line in more] == [f"(likely: {SHORT[one]})" for one in LIKELY.values()]
    summary = run(capfdbinary, "values", "--summary", CAPTURE)
    assert summary.err == plain.err
    assert "only likely" in summary.out.splitlines()[1]
    refused = run(capfdbinary, "values", "--summary", "--likely", CAPTURE)
    assert (refused.code, "--summary only counts values that are only likely" in refused.err) == (2, True)


@pytest.mark.parametrize("form", [row.name for row in FORMATS.values() if VALUES in row.writers])
def test_each_format_of_values_marks_them(capfdbinary: Capture, form: str) -> None:
    lines = run(capfdbinary, "values", "--likely", "-T", form, CAPTURE).out.splitlines()
    if form == "csv":
        rows = list(csv.DictReader(lines))
        assert {int(row["frame"]) for row in rows if row["certainty"] == "likely"} == LIKELY_FRAMES
        assert {row["doubt"] for row in rows if row["certainty"] == "sure"} == {""}
    elif form == "jsonl":
        found = [json.loads(line) for line in lines]
        assert {one["frame"]: one["doubt"] for one in found if "certainty" in one} == dict(
            zip(sorted(LIKELY_FRAMES), LIKELY.values(), strict=True)
        )
    else:
        assert len([line for line in lines if "(likely: " in line]) == len(LIKELY_FRAMES)


def test_a_likely_value_is_never_the_value_before() -> None:
    rows = list(dissect.values(CAPTURE, likely=True))
    assert {int(row.frame) for row in rows if row.doubt} == LIKELY_FRAMES
    after = [row for row in rows if row.frame > 30 and row.address == "DB1.DBB0" and not row.doubt]
    assert after
    assert {(str(row.value), str(row.previous), bool(row.changed)) for row in after} == {("[0, 1]", "[0, 1]", False)}
    assert [row for row in dissect.values(CAPTURE) if row.doubt] == []
    assert [int(row.frame) for row in dissect.values(CAPTURE)] == [int(row.frame) for row in rows if not row.doubt]


def test_files_by_themselves_say_it_too(capfdbinary: Capture) -> None:
    ran = run(capfdbinary, "values", "--separate", "-j", "1", CAPTURE, CAPTURE)
    assert values_left_out({"gaps": 2, "alike": 2}) in ran.err
    both = json.loads(run(capfdbinary, "analyze", "--separate", "-T", "json", CAPTURE, CAPTURE).out)["transactions"]
    assert (both["likely"], both["answers_not_captured"]) == (2 * len(LIKELY), 2 * len(MISSING))


def test_the_table_of_values_and_the_questions_leave_them_out(capfdbinary: Capture) -> None:
    lines = run(capfdbinary, "sql", "-T", "jsonl", 'SELECT DISTINCT frame FROM "values"', CAPTURE).out.splitlines()
    assert not {json.loads(line)["frame"] for line in lines} & LIKELY_FRAMES
    slowest = run(capfdbinary, "sql", "-T", "jsonl", "slowest", CAPTURE).out.splitlines()
    assert [(json.loads(line)["what"], json.loads(line)["times"]) for line in slowest] == [("DB1.DBB0 x2", SURE - 2)]


# ---- differences ----------------------------------------------------------------------------------------------------


def test_certainty_is_no_difference_and_marks_those_that_there_are() -> None:
    session = read_session(CAPTURE)
    written = golden_text(session)
    surer = re.sub(r"  likely: .*\n", "", written).replace("hole, perhaps", "hole")
    assert surer != written
    assert diff_sessions(parse_golden(written), parse_golden(surer)) == []
    (found,) = diff_sessions(parse_golden(written), parse_golden(written.replace("<00 44>", "<00 45>")))
    assert found.text.endswith(f"(likely: {SHORT['gaps']})")
