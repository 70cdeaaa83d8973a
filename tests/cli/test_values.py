"""`s7dissect values`: rows, summaries, formats, what is wrong with what was asked for."""

from __future__ import annotations

import csv
import io
import json
import re
import struct
from pathlib import Path
from typing import Any

import pytest

from tests.cases import each
from tests.cli.support import on_terminal, run
from tests.cli.test_outputs import lines_of
from tests.meaning.report.support import ROOT, begun, saved
from tests.meaning.tags.support import tank_file
from tests.output.variables.support import BYTE, REAL, WORD, db, reads, real, writes

Capture = pytest.CaptureFixture[bytes]


def tank(path: Path) -> Path:
    """Write a capture in which a level rises, is written once, is refused once, and a temperature stays."""
    talk = begun()
    for ref, level in enumerate((1.0, 2.0, 2.0, 4.0), 1):
        reads(talk, ref, (db(BYTE, 0, 10), struct.pack(">fBBhh", level, 1, 0, 215, 0)))
    writes(talk, 5, (db(REAL, 0), real(8.0), 0xFF))
    writes(talk, 6, (db(REAL, 0), real(9.0), 0x05))
    reads(talk, 7, (db(WORD, 90), 0x0A))
    return saved(path / "tank.pcapng", talk.packets())


def test_a_row_for_each_value(capfdbinary: Capture, tmp_path: Path) -> None:
    told = run(capfdbinary, "values", tank(tmp_path), "DB1.DBD0:REAL", "--changes")
    assert (told.code, told.err) == (0, "")
    assert [line.partition(":102  ")[2] for line in told.out.splitlines()] == [
        "read   DB1.DBD0 REAL = 1.0",
        "read   DB1.DBD0 REAL = 2.0  was 1.0",
        "read   DB1.DBD0 REAL = 4.0  was 2.0",
        "write  DB1.DBD0 REAL = 8.0  was 4.0",
    ]
    assert re.fullmatch(r"\S+ \S+ UTC +9  [0-9.]+ → [0-9.]+:102  read   DB1.DBD0 REAL = 1.0", told.out.splitlines()[0])


def test_tags_choose_and_name(capfdbinary: Capture, tmp_path: Path) -> None:
    path, tags = tank(tmp_path), tank_file(tmp_path)
    told = run(capfdbinary, "values", "--tags", tags, path, "Tank.Temp", "tank.pump", "--changes")
    assert [line.split("  ")[-1].strip() for line in told.out.splitlines()] == [
        "Tank.Pump (DB1.DBX4.0) BOOL = true", "Tank.Temp (DB1.DBW6) INT = 21.5 °C",
    ]  # fmt: skip
    whole = lines_of(run(capfdbinary, "values", "--tags", tags, path, "Tank", "-T", "jsonl"))
    assert {line["tag"] for line in whole} == {"Tank.Level", "Tank.Pump", "Tank.Temp"}
    assert [line["value"] for line in whole if line["tag"] == "Tank.Level"] == [1.0, 2.0, 2.0, 4.0, 8.0]


def test_json_and_csv_say_the_same(capfdbinary: Capture, tmp_path: Path) -> None:
    path = tank(tmp_path)
    lines = lines_of(run(capfdbinary, "values", path, "-T", "jsonl"))
    ran = run(capfdbinary, "values", path, "-T", "csv")
    rows = list(csv.DictReader(io.StringIO(ran.out)))
    for key in ("time", "frame", "connection", "client", "plc", "how", "address", "type", "octets"):
        assert [row[key] for row in rows] == [str(line[key]) for line in lines], key
    assert [row["changed"] for row in rows] == [
        "" if line["changed"] is None else str(line["changed"]).lower() for line in lines
    ]
    assert rows[0]["value"] == "3f 80 00 00 01 00 00 d7 00 00"
    assert json.loads(rows[-1]["value"]) == lines[-1]["value"] == 8.0
    # Several files: the packet within its own, and which one.
    pair = lines_of(run(capfdbinary, "values", path, path, "-T", "jsonl"))
    assert {line["file"] for line in pair} == {str(path)}
    assert [line["frame"] for line in pair] == 2 * [line["frame"] for line in lines]
    assert next(csv.reader(io.StringIO(run(capfdbinary, "values", path, path, "-T", "csv").out)))[2] == "file"


def test_a_summary(capfdbinary: Capture, tmp_path: Path) -> None:
    path, tags = tank(tmp_path), tank_file(tmp_path)
    lines = lines_of(run(capfdbinary, "values", "--tags", tags, "--summary", "-T", "jsonl", path))
    by_name = {line["tag"] or line["address"]: line for line in lines}
    level = by_name["Tank.Level"]
    assert [level[key] for key in ("count", "changes", "distinct", "first", "last", "min", "max", "mean", "unit")] == [
        5, 3, 4, 1.0, 8.0, 1.0, 8.0, 3.4, "m",
    ]  # fmt: skip
    assert [(one["count"]) for one in level["readers"]] == [4]
    assert [(one["count"]) for one in level["writers"]] == [1]
    assert (level["refused_reads"], level["refused_writes"], level["unconfirmed_writes"]) == (0, 1, 0)
    missing = by_name["DB1.DBW90"]
    assert (missing["count"], missing["first_time"], missing["first"], missing["refused_reads"]) == (0, None, None, 1)
    text = run(capfdbinary, "values", "--tags", tags, "--summary", path).out.splitlines()
    assert text[0].endswith(": 6 variables")
    assert text[1].split()[:3] == ["variable", "type", "count"]
    assert "trend" not in text[1]
    rows = list(csv.DictReader(io.StringIO(run(capfdbinary, "values", "--summary", "-T", "csv", path).out)))
    assert [row["address"] for row in rows] == ["DB1.DBB0", "DB1.DBD0", "DB1.DBW90"]
    assert rows[2]["refused_reads"] == "1"


def test_a_terminal_shows_sparklines(tmp_path: Path) -> None:
    told = on_terminal("values", "--summary", tank(tmp_path), "DB1.DBD0:REAL", columns=200)
    assert told.code == 0
    assert "trend" in told.out
    assert "▁" in told.out
    assert "█" in told.out


def test_every_capture_has_values_and_a_summary_that_counts_them(capfdbinary: Capture) -> None:
    for name in ("nodes7-poll", "write-areas", "crafted/plus-plant", "crafted/coverage-userdata", "crafted/segments"):
        path = ROOT / "captures" / f"{name}.pcapng"
        lines = lines_of(run(capfdbinary, "values", path, "-T", "jsonl"))
        total = lines_of(run(capfdbinary, "values", "--summary", path, "-T", "jsonl"))
        assert len(lines) == sum([line["count"] for line in total]) > 0
        assert {line["schema"] for line in lines} == {"s7dissect.value/1"}
        assert {line["schema"] for line in total} == {"s7dissect.variable/1"}
        first: dict[tuple[Any, ...], Any] = {}
        for line in lines:
            key = (line["plc"], line["address"], line["type"])
            assert (line["changed"] is None) == (key not in first)
            first.setdefault(key, line["value"])
        assert first == {(line["plc"], line["address"], line["type"]): line["first"] for line in total if line["count"]}


def test_selecting_with_an_expression(capfdbinary: Capture, tmp_path: Path) -> None:
    told = run(capfdbinary, "values", tank(tmp_path), "-Y", "function == write")
    assert [line.split("  ")[-1] for line in told.out.splitlines()] == ["DB1.DBD0 REAL = 8.0"]


@each(
    ("words", "said"),
    [
        (["DB1.DBX0.9"], "bits are 0-7"),
        (["Nonsense"], "neither a file nor an address such as DB10.DBD4"),
        (["DB1.DBD4:REEL"], "close to it: REAL"),
        (["--tags", "TAGS", "Tank.Levl"], "no such tag; close to it: Tank.Level"),
        (["--every", "1"], "a duration needs a unit"),
        (["--every", "1parsec"], "unknown unit 'parsec'"),
        (["--every", "0s"], "expected a time above 0"),
        (["--summary", "--changes"], "--summary covers all values"),
        (["other.pcapng"], "other.pcapng"),
    ],
)
def test_what_is_wrong_is_said_on_one_line(capfdbinary: Capture, tmp_path: Path, words: list[str], said: str) -> None:
    tags = tank_file(tmp_path)
    ran = run(capfdbinary, "values", tank(tmp_path), *[str(tags) if word == "TAGS" else word for word in words])
    assert (ran.code, ran.out) == (2, "")
    (told,) = [line for line in ran.err.splitlines() if said in line]
    assert len(told) < 250


def test_what_was_asked_for_and_not_seen_is_named(capfdbinary: Capture, tmp_path: Path) -> None:
    ran = run(capfdbinary, "values", tank(tmp_path), "MW900", "DB1.DBD0:REAL", "DB1.DBW90")
    assert ran.code == 0
    assert ran.err == "s7dissect: no value of MW900 in what was read\n"  # a refusal is an answer
