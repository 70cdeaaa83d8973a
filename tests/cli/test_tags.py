"""Tags from the command line: names and values in every output, and what happens to files that are wrong."""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path

import pytest

import dissect
from dissect.engine.transactions.naming import named_values
from dissect.engine.transactions.transaction import Transaction
from tests.cli.support import run
from tests.meaning.report import schemas
from tests.meaning.tags.support import tank_capture, tank_file, write_captures

Capture = pytest.CaptureFixture[bytes]


def test_text_names_what_is_read_whole_in_part_and_refused(capfdbinary: Capture, tmp_path: Path) -> None:
    ran = run(capfdbinary, "transactions", tank_capture(tmp_path), "--tags", tank_file(tmp_path))
    assert (ran.code, ran.err) == (0, "")
    said = [line.partition("Read Var  ")[2] for line in ran.out.splitlines()[1:]]
    assert said == [
        "DB1.DBB0 x10 {Tank.Level = 3.5 m, Tank.Pump = true, DB1.DBB5 = 00, Tank.Temp = 21.5 °C, DB1.DBB8 x2 = 00 07}",
        "Tank.Pump (DB1.DBX4.0) = true",
        "Tank.Level (DB1.DBD0): Object does not exist",
    ]


def test_json_has_tags_and_the_bytes_between_them_and_keeps_to_its_schema(capfdbinary: Capture, tmp_path: Path) -> None:
    ran = run(capfdbinary, "transactions", tank_capture(tmp_path), "--tags", tank_file(tmp_path), "-T", "jsonl")
    validator = schemas.validator("transaction", exact=True)
    rows = [json.loads(line) for line in ran.out.splitlines()]
    for row in rows:
        validator.validate(row)
    first = rows[1]["items"][0]
    assert [(tag["name"], tag["type"], tag["value"], tag["unit"]) for tag in first["tags"]] == [
        ("Tank.Level", "REAL", 3.5, "m"),
        ("Tank.Pump", "BOOL", True, None),
        ("Tank.Temp", "INT", 21.5, "°C"),
    ]
    assert (first["tags"][2]["raw"], first["tags"][0]["comment"]) == (215, "level")
    assert first["untagged"] == [
        {"address": "DB1.DBB5", "offset": 5, "data": "00"},
        {"address": "DB1.DBB8", "offset": 8, "data": "0007"},
    ]


def test_csv_has_a_row_for_each_tag(capfdbinary: Capture, tmp_path: Path) -> None:
    ran = run(capfdbinary, "transactions", tank_capture(tmp_path), "--tags", tank_file(tmp_path), "-T", "csv")
    rows = [row for row in csv.DictReader(io.StringIO(ran.out)) if row["function_name"] == "Read Var"]
    assert [(row["address"], row["name"], row["value"], row["unit"]) for row in rows] == [
        ("DB1.DBD0", "Tank.Level", "3.5", "m"),
        ("DB1.DBX4.0", "Tank.Pump", "true", ""),
        ("DB1.DBB5", "", "", ""),
        ("DB1.DBW6", "Tank.Temp", "21.5", "°C"),
        ("DB1.DBB8", "", "", ""),
        ("DB1.DBX4.0", "Tank.Pump", "true", ""),
        ("DB1.DBD0", "Tank.Level", "", "m"),
    ]


def test_without_tags_nothing_changes(capfdbinary: Capture, tmp_path: Path) -> None:
    path = tank_capture(tmp_path)
    ran = run(capfdbinary, "transactions", path, "-T", "jsonl")
    assert '"tags"' not in ran.out
    assert '"value":[64,96,0,0,1,0,0,215,0,7]' in ran.out


def test_every_mistake_of_a_file_is_listed_and_nothing_of_it_is_used(capfdbinary: Capture, tmp_path: Path) -> None:
    wrong = tank_file(tmp_path, "address,type,name\nDB1.DBX4.9,BOOL,a\nDB1.DBW6,REEL,b\nDB1.DBD0,REAL,c\n")
    ran = run(capfdbinary, "transactions", tank_capture(tmp_path), "--tags", wrong)
    assert (ran.code, ran.out) == (2, "")
    assert f"{wrong}:2: a: DB1.DBX4.9: bits are 0-7" in ran.err
    assert f"{wrong}:3: b: type 'REEL' is not a type of S7; close to it: REAL" in ran.err


def test_a_name_from_a_file_cannot_steer_a_terminal(capfdbinary: Capture, tmp_path: Path) -> None:
    path = tank_file(tmp_path, "address,type,name,unit\nDB1.DBD0,REAL,\x1b[31mred\u202e,\x1b[0m\n")
    for format_ in ("text", "jsonl", "csv"):
        ran = run(capfdbinary, "transactions", tank_capture(tmp_path), "--tags", path, "-T", format_)
        assert ran.code == 0
        assert not {"\x1b", "\u202e"} & set(ran.out)


def test_python_gets_values_by_name(tmp_path: Path) -> None:
    path, tags = tank_capture(tmp_path), tank_file(tmp_path)
    seen = [
        (number, value.name, value.value)
        for event in dissect.open(path, tags=tags, pdus=False)
        if isinstance(event, Transaction)
        for number, value in named_values(event)
    ]
    assert seen == [
        (1, "Tank.Level", 3.5),
        (1, "Tank.Pump", True),
        (1, "Tank.Temp", 21.5),
        (1, "Tank.Pump", True),
        (1, "Tank.Level", None),
    ]


def test_a_difference_is_told_tag_by_tag_and_can_be_ignored_by_name(capfdbinary: Capture, tmp_path: Path) -> None:
    a, b = write_captures(tmp_path)
    tags = tank_file(tmp_path)
    ran = run(capfdbinary, "diff", a, b, "--tags", tags)
    assert ran.out.splitlines() == [
        "transaction 2, READ Tank.Level (DB1.DBD0): was 3.5 m, is 4.0 m",
        "transaction 2, READ DB1.DBB8: was 00 07, is 00 09",
        "transaction 3, WRITE Tank.Temp (DB1.DBW6): was 80.0 °C, is 95.0 °C",
    ]
    ran = run(capfdbinary, "diff", a, b, "--tags", tags, "--ignore", "values:Tank.*")
    assert ran.out.splitlines() == ["transaction 2, READ DB1.DBB8: was 00 07, is 00 09"]


def test_a_golden_has_tags_as_remarks_and_reads_back_to_the_same(capfdbinary: Capture, tmp_path: Path) -> None:
    a, _ = write_captures(tmp_path)
    golden = tmp_path / "a.s7.txt"
    assert run(capfdbinary, "golden", a, "--tags", tank_file(tmp_path), "-o", golden).code == 0
    assert "    # Tank.Temp = 80.0 °C\n" in golden.read_text(encoding="utf-8")
    assert run(capfdbinary, "diff", golden, a).code == 0


def test_a_finding_names_what_was_written(capfdbinary: Capture, tmp_path: Path) -> None:
    a, _ = write_captures(tmp_path)
    ran = run(capfdbinary, "monitor", a, "--tags", tank_file(tmp_path), "--plain")
    told = [line for line in ran.out.splitlines() if "security.write" in line]
    assert len(told) == 1
    assert told[0].endswith("Write Var Tank.Temp = 80.0 °C (DB1.DBW6)")


def test_live_lines_and_single_messages_name_tags(capfdbinary: Capture, tmp_path: Path) -> None:
    a, _ = write_captures(tmp_path)
    tags = tank_file(tmp_path)
    assert "Tank.Temp (DB1.DBW6) = 80.0 °C" in run(capfdbinary, "monitor", "--plain", a, "--tags", tags).out
    assert "Tank.Temp (DB1.DBW6) = 80.0 °C" in run(capfdbinary, "show", a, "--tags", tags).out


def test_check_lists_files_problems_overlaps_and_coverage(capfdbinary: Capture, tmp_path: Path) -> None:
    text = "address,type,name\nDB1.DBD0,REAL,Level\nDB1.DBW2,WORD,Half\nDB1.DBW6,INTT,x\n"
    path = tank_file(tmp_path, text)
    ran = run(capfdbinary, "tags", "check", path, "--capture", tank_capture(tmp_path))
    assert ran.code == 1
    assert "error: line 4: x: type 'INTT' is not a type of S7; close to it: INT" in ran.out
    assert "note: Level (DB1.DBD0) and Half (DB1.DBW2) share DB1.DBB2" in ran.out
    assert "3 items of the capture, 2 of 2 tags seen" in ran.out
    ran = run(capfdbinary, "tags", "check", path, "-T", "json", "--capture", tank_capture(tmp_path))
    found = json.loads(ran.out)
    assert schemas.complaints("tags-check", found, exact=True) == []
    assert (found["valid"], found["overlaps"]["count"], found["coverage"]["tags_seen"]) == (False, 1, 2)
    good = run(capfdbinary, "tags", "check", tank_file(tmp_path), "-T", "json")
    assert (good.code, json.loads(good.out)["valid"]) == (0, True)


def test_list_and_convert_write_what_was_read(capfdbinary: Capture, tmp_path: Path) -> None:
    path = tank_file(tmp_path)
    listed = json.loads(run(capfdbinary, "tags", "list", path, "-T", "json").out)
    assert schemas.complaints("tags-list", listed, exact=True) == []
    assert [row["address"] for row in listed["tags"]] == ["DB1.DBD0", "DB1.DBX4.0", "DB1.DBW6"]
    assert run(capfdbinary, "tags", "convert", path).out == path.read_text(encoding="utf-8")
    again = tmp_path / "again.csv"
    assert run(capfdbinary, "tags", "convert", path, "-o", again).code == 0
    assert again.read_text(encoding="utf-8") == path.read_text(encoding="utf-8")
    again.write_text("mine", encoding="utf-8")
    kept = run(capfdbinary, "tags", "convert", path, "-o", again)
    assert (kept.code, again.read_text(encoding="utf-8")) == (2, "mine")
    assert "exists; --force overwrites it." in kept.err
    before = path.read_bytes()
    same = run(capfdbinary, "tags", "convert", path, "-o", path, "--force")
    assert (same.code, path.read_bytes(), "both input and output" in same.err) == (2, before, True)
    assert run(capfdbinary, "tags", "convert", path, "-o", again, "--force").code == 0
    assert again.read_bytes() == before


def test_the_number_of_a_block_is_that_of_whichever_plc_has_it(capfdbinary: Capture, tmp_path: Path) -> None:
    source = tmp_path / "tank.awl"
    source.write_text('DATA_BLOCK "Tank"\nSTRUCT\nlevel : REAL;\nEND_STRUCT\nBEGIN\nEND_DATA_BLOCK\n', encoding="utf-8")
    call: list[str | Path] = ["transactions", tank_capture(tmp_path), "--tags", tank_file(tmp_path)]
    call += ["--tags", f"10.0.0.2={source}"]
    ran = run(capfdbinary, *call, "--tags-db", "Tank=1")
    assert ran.code == 0
    assert "Tank.level = 3.5" in ran.out
    ran = run(capfdbinary, *call, "--tags-db", "Tank=1", "--tags-db", "Pump=2")
    assert (ran.code, ran.err) == (2, "Error: --tags-db Pump: no file of tags has a data block of that name\n")
    ran = run(capfdbinary, "transactions", tank_capture(tmp_path), "--tags", f"plc={source}")
    assert ran.code == 2
    assert ran.err.endswith("No such file or directory; the text before '=' has to be the IP address of a PLC\n")
