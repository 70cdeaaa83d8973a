"""SQL over captures: the ten questions, what a query may not do, and how mistakes are told."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import pytest

from dissect.files.session import Run
from dissect.output.export.feed import TableFeed
from dissect.output.export.questions import QUESTIONS
from dissect.output.export.result_lines import QueryOutcome, csv_lines, json_lines
from dissect.output.export.sql import MemorySink, Query, SqlError, named_tables
from tests.cli.support import run
from tests.meaning.report.support import ROOT, UNSAFE, begun, saved
from tests.promises import hostile
from tests.properties import messages
from tests.properties.messages import Item, dt
from tests.properties.packets import Flow

Capture = pytest.CaptureFixture[bytes]
ERRORS: Final = ROOT / "captures" / "item-errors.pcapng"
TRANSFER: Final = ROOT / "captures" / "transfer.pcapng"
_WORD: Final = Item(0x04, 1, 10, 0x84, 4 * 8)  # DB10.DBW4


@pytest.fixture(scope="module")
def plant(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two clients at 5 in the morning: both write a word, one polls faster than it is answered, one is never answered."""
    packets = []
    for number in (1, 2):
        talk = begun(Flow(ports=(40000 + number, 102)))
        for ref in range(1, 5):
            talk.send(0, dt(messages.read_job(ref, [_WORD])))
            if number == 1:
                talk.send(1, dt(messages.read_answer(ref, [_WORD], [ref.to_bytes(2, "big")])))
        if number == 2:
            for ref in range(1, 4):
                talk.send(1, dt(messages.read_answer(ref, [_WORD], [b"\x00\x07"])))
        talk.send(0, dt(messages.write_job(9, [_WORD], [bytes((0, number))])))
        talk.send(1, dt(messages.write_answer(9, [0xFF]))).close()
        packets += talk.packets()
    return saved(tmp_path_factory.mktemp("plant") / "plant.pcapng", packets)


def ask(capfdbinary: Capture, query: str, *files: Path) -> list[dict[str, Any]]:
    ran = run(capfdbinary, "sql", "-T", "jsonl", query, *files)
    assert ran.code == 0, ran.err
    return [json.loads(line) for line in ran.out.splitlines()]


def test_what_was_refused_as_a_whole_is_refused_and_not_written(capfdbinary: Capture, tmp_path: Path) -> None:
    """An answer with an error in its header has no return code for the items; it says why in the place of one."""
    talk = begun()
    for ref, content, code in ((1, 7, 0), (2, 9, 0x8104), (3, 8, 0), (4, 9, -1), (5, 7, -2)):
        talk.send(0, dt(messages.write_job(ref, [_WORD], [content.to_bytes(2, "big")])))
        if code >= 0:
            answer = messages.write_answer(ref, [0xFF])
            refusal = b"\x32\x02\0\0" + ref.to_bytes(2, "big") + bytes(4) + code.to_bytes(2, "big")
            talk.send(1, dt(refusal if code else answer))
        elif code == -1:
            talk.send(1, dt(messages.write_answer(ref, [0x05])))
    path = saved(tmp_path / "refused.pcapng", talk.packets())
    (whole, item) = sorted(ask(capfdbinary, "refused", path), key=lambda row: "header" not in row["return_name"])
    assert (whole["return_name"], whole["times"]) == ("header: Service not implemented or frame error", 1)
    assert (item["return_name"], item["times"]) == ("Invalid address", 1)
    (changed,) = ask(capfdbinary, "changes", path)
    assert (changed["highest"], changed["different"]) == (8.0, 2)
    asked = "SELECT item, refused FROM items ORDER BY transaction"
    assert [row["refused"] for row in ask(capfdbinary, asked, path)] == [False, True, False, True, False]
    assert ask(capfdbinary, "unanswered", path) == []  # the answer to the last one was not due yet


def test_every_question_finds_what_is_there(capfdbinary: Capture, plant: Path) -> None:
    found: dict[str, list[dict[str, Any]]] = {}
    for name in QUESTIONS:
        asked = "who DB10.DBW4" if name == "who" else name
        found[name] = ask(capfdbinary, asked, plant if name not in {"interventions", "refused"} else TRANSFER, ERRORS)
    assert len(found) == 14
    assert [(row["polls"], row["overlapping"]) for row in found["overlaps"] if "DB10.DBW4" in row["what"]] == [(8, 3)]
    assert {row["written"] for row in found["off-shift"]} >= {"DB10.DBW4"}
    assert {row["number"] for row in found["off-shift"] if row["written"] == "DB10.DBW4"} == {1.0, 2.0}
    assert [row["unanswered"] for row in found["unanswered"]] == [1]
    (changed,) = [row for row in found["changes"] if row["what"] == "DB10.DBW4"]
    assert (changed["lowest"], changed["highest"], changed["different"]) == (1.0, 7.0, 5)
    (slow, *_) = [row for row in found["slowest"] if row["what"] == "DB10.DBW4"]
    assert slow["worst_ms"] >= slow["median_ms"] > 0
    assert {row["number"] for row in found["who"]} == {1.0, 2.0}
    assert [row["times"] for row in found["periods"] if row["what"] == "DB10.DBW4"] == [8]
    assert {row["kind"] for row in found["interventions"]} == {"download", "upload"}
    assert {row["return_name"] for row in found["refused"]} >= {"Object does not exist"}
    assert sum(row["connections"] for row in found["talkers"]) == 3


def test_more_than_one_writer_is_found(capfdbinary: Capture, tmp_path: Path) -> None:
    packets = []
    for last in (2, 3):
        talk = begun(Flow(f"192.0.2.{last}", "192.0.2.9", (40000, 102)))
        talk.send(0, dt(messages.write_job(9, [_WORD], [b"\x00\x01"]))).send(1, dt(messages.write_answer(9, [0xFF])))
        packets += talk.packets()
    (row,) = ask(capfdbinary, "writers", saved(tmp_path / "two.pcapng", packets))
    assert (row["address"], row["writers"], row["writes"]) == ("DB10.DBW4", 2, 2)
    assert row["hosts"] == ["192.0.2.2", "192.0.2.3"]


def test_only_tables_that_are_named_are_made(monkeypatch: pytest.MonkeyPatch, capfdbinary: Capture) -> None:
    assert [table.name for table in named_tables("select * from ITEMS join transactions using (transaction)")] == [
        "transactions",
        "items",
    ]
    assert named_tables("select 1") == []
    made: list[list[str]] = []
    real: Callable[..., None] = MemorySink.__init__

    def noted(self: MemorySink, tables: Any, *rest: Any) -> None:
        made.append([table.name for table in tables])
        real(self, tables, *rest)

    monkeypatch.setattr(MemorySink, "__init__", noted)
    assert ask(capfdbinary, "select count(*) as n from operations", TRANSFER) == [{"n": 7}]
    assert made == [["operations"]] * 2  # once to try it, once to run it


def test_a_query_reaches_neither_files_nor_settings(tmp_path: Path) -> None:
    secret = tmp_path / "secret.csv"
    secret.write_text("a\n1\n", encoding="utf-8")
    for sql in (
        f"SELECT * FROM read_csv('{secret}')",
        f"SELECT * FROM '{secret}'",
        f"COPY (SELECT 1) TO '{tmp_path / 'out.csv'}'",
        f"ATTACH '{tmp_path / 'x.duckdb'}'",
        "INSTALL httpfs",
        "SET enable_external_access = true",
        "SELECT * FROM QUESTIONS",  # a variable of this program
    ):
        with pytest.raises(SqlError):
            Query(sql)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["secret.csv"]


def test_a_query_reaches_files_when_it_is_asked_for(capfdbinary: Capture, tmp_path: Path) -> None:
    limits = tmp_path / "limits.csv"
    limits.write_text("address,upper\nDB99.DBB0,1\n", encoding="utf-8")
    sql = f"SELECT count(*) AS n FROM items JOIN '{limits}' USING (address)"
    ran = run(capfdbinary, "sql", "--allow-files", sql, ERRORS, "-T", "csv")
    assert (ran.code, ran.out.splitlines()) == (0, ["n", "4"])


def test_a_mistake_is_told_in_the_words_of_duckdb_before_anything_is_read(capfdbinary: Capture, tmp_path: Path) -> None:
    ran = run(capfdbinary, "sql", "SELECT foo FROM items", tmp_path / "none.pcapng")
    assert ran.code == 2
    assert 'Referenced column "foo" not found' in ran.err
    assert "LINE 1: SELECT foo FROM items" in ran.err
    assert "               ^^^" in ran.err.splitlines()[-1]
    ran = run(capfdbinary, "sql", "SELEC 1", ERRORS)
    assert "^^^^^" in ran.err
    ran = run(capfdbinary, "sql", "SELECT * FROM transaktions", ERRORS)
    assert "Did you mean transactions" in ran.err
    assert "duckdb_" not in ran.err
    ran = run(capfdbinary, "sql", "SELECT * FROM nonsense9", ERRORS)
    assert "There are connections, transactions, items," in ran.err
    ran = run(capfdbinary, "sql", "slowst", ERRORS)
    assert "Did you mean slowest or slow-items?" in ran.err
    ran = run(capfdbinary, "sql", "SELECT function_name::INT FROM transactions", ERRORS)  # wrong in its values only
    assert (ran.code, ran.out) == (2, "")
    assert "Could not convert" in ran.err


def test_formats_and_what_they_make_of_values(capfdbinary: Capture) -> None:
    sql = """SELECT 1 AS one, 'a' AS text, NULL AS none, [1, 2] AS list, 2.5::DECIMAL(5, 2) AS decimal, true AS yes,
        TIMESTAMP_NS '2026-01-02 03:04:05.123456789' AS time, 'x'::BLOB AS blob, 'nan'::DOUBLE AS nan, '=1+1' AS formula,
        sum(9223372036854775807) AS big, interval 2 hours AS pause, DATE '2026-01-02' AS day, {'k': 1} AS struct
        FROM transactions"""
    (row,) = ask(capfdbinary, sql, ERRORS)
    assert row["time"] == "2026-01-02 03:04:05.123456789"
    assert (row["list"], row["decimal"], row["blob"], row["nan"], row["day"]) == (
        [1, 2],
        2.5,
        "78",
        "nan",
        "2026-01-02",
    )
    assert row["big"] > 2**63
    ran = run(capfdbinary, "sql", "-T", "csv", sql, ERRORS)
    (line,) = csv.DictReader(io.StringIO(ran.out))
    assert (line["formula"], line["list"], line["none"], line["yes"]) == ("'=1+1", "[1, 2]", "", "true")
    text = run(capfdbinary, "sql", "SELECT 'ab' AS a, 10 AS b UNION ALL SELECT NULL, 9 ORDER BY b", ERRORS).out
    assert text.splitlines() == ["a    b", "     9", "ab  10"]


def test_naughty_strings_do_no_harm(tmp_path: Path) -> None:
    path = hostile.write(tmp_path / "hostile.pcapng")
    query = Query("SELECT subject, detail FROM operations, findings LIMIT 3000")
    sink = MemorySink(query.tables)
    feed = TableFeed(query.tables, sink)
    run_ = Run([path], feed)
    while run_.step():
        pass
    feed.flush()
    for lines in (QueryOutcome(query.run(sink.tables())).text(), csv_lines(QueryOutcome(query.run(sink.tables())))):
        told = list(lines)
        assert len(told) == 3001
        assert not [line for line in told if UNSAFE.search(line)]
    rows = [json.loads(line) for line in json_lines(QueryOutcome(query.run(sink.tables())))]
    real = set(sink.tables()["operations"]["subject"].to_pylist())
    assert {row["subject"] for row in rows} <= real


def test_an_empty_query_is_refused(capfdbinary: Capture) -> None:
    ran = run(capfdbinary, "sql", "", "a.pcapng")
    assert (ran.code, ran.out, "QUERY is empty" in ran.err) == (2, "", True)


def test_questions_are_listed_with_their_sql(capfdbinary: Capture) -> None:
    ran = run(capfdbinary, "sql", "--questions")
    assert ran.code == 0
    for question in QUESTIONS.values():
        assert f"{question.name}: {question.sentence}" in ran.out
    assert run(capfdbinary, "sql", "SELECT 1").code == 2  # no file
