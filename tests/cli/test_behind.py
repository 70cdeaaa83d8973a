"""What is behind malformed TPDU headers, in every output: marked, counted apart, listed once."""

from __future__ import annotations

import csv
import io
import json
import re
import sqlite3
from pathlib import Path

import pytest

from tests.cli.support import run
from tests.meaning.report.schemas import complaints
from tests.meaning.report.support import WORD, begun, read, saved
from tests.properties import messages
from tests.properties.messages import dt, tpkt

Capture = pytest.CaptureFixture[bytes]

STOP = messages.pdu(messages.JOB, 9, b"\x29" + bytes(5) + b"\x09P_PROGRAM")
MARK = "BEHIND A MALFORMED TPDU HEADER cotp: length indicator at byte 0 is 0, expected 1 to 254"


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """A STOP without answer (packet 8), a read and its answer (9, 10), an answer without request (11), a read (12, 13)."""
    talk = begun().send(0, tpkt(b"\x00\xf0\x80" + STOP))
    talk.send(0, tpkt(b"\x00\xf0\x80" + messages.read_job(5, [WORD])))
    talk.send(1, dt(messages.read_answer(5, [WORD], [b"\0\7"])))
    talk.send(1, tpkt(b"\xff\xf0\x80" + messages.read_answer(66, [WORD], [b"\0\x08"])))
    return saved(tmp_path / "a.pcapng", read(talk, 7).close().packets())


def lines(capfdbinary: Capture, *arguments: str | Path) -> list[str]:
    ran = run(capfdbinary, *arguments)
    assert ran.code == 0, ran.err
    return ran.out.splitlines()


def objects(capfdbinary: Capture, *arguments: str | Path) -> list[dict[str, object]]:
    return [json.loads(line) for line in lines(capfdbinary, *arguments)]


def test_analyze_counts_them_apart(capfdbinary: Capture, path: Path) -> None:
    told = lines(capfdbinary, "analyze", path)
    assert "  5 S7 PDUs, 3 more behind malformed headers" in told
    assert any(line.startswith("     5 PDUs, 3 answered, 3 more behind malformed headers; ") for line in told)
    assert "Transactions: 3 answered, 2 more behind malformed headers" in told
    (row,) = [line.split() for line in told if line.startswith("  PLC stop")]
    assert row == ["PLC", "stop", "1", ".", ".", "1", "-", "-", "-"]
    assert "Failed transactions" not in told
    brief = lines(capfdbinary, "analyze", "--brief", path)
    assert any("5 transactions, 2 behind malformed headers" in line for line in brief)


def test_several_processes_count_them_as_one(capfdbinary: Capture, path: Path) -> None:
    other = path.with_name("other.pcapng")
    other.write_bytes(path.read_bytes())
    told = lines(capfdbinary, "analyze", "--separate", path, other)
    assert "  10 S7 PDUs, 6 more behind malformed headers" in told
    assert lines(capfdbinary, "analyze", "--separate", "-j", "2", path, other) == told


def test_the_analysis_in_json(capfdbinary: Capture, path: Path) -> None:
    told = json.loads("\n".join(lines(capfdbinary, "analyze", "-T", "json", path)))
    assert complaints("analysis", told, exact=True) == []
    assert told["s7"]["pdus"] == 5
    assert told["s7"]["behind_malformed"] == 3
    assert told["connections"][0]["behind_malformed"] == 3
    assert told["transactions"]["total"] == 5
    assert told["transactions"]["behind_malformed"] == 2
    assert (told["transactions"]["answered"], told["transactions"]["unanswered"]) == (3, 0)
    assert (told["transactions"]["orphan_answers"], told["transactions"]["unsolicited"]) == (0, 0)
    assert {one["name"]: one.get("behind_malformed") for one in told["functions"]} == {
        "PLC stop": 1,
        "Read Var": 1,
        "Setup communication": None,
    }


def test_a_capture_without_any_says_nothing_of_them(capfdbinary: Capture, tmp_path: Path) -> None:
    path = saved(tmp_path / "b.pcapng", read(begun(), 1).close().packets())
    for face in (
        ["analyze"],
        ["analyze", "-T", "json"],
        ["show"],
        ["show", "-T", "jsonl"],
        ["transactions", "-T", "jsonl"],
    ):
        assert "behind" not in "\n".join(lines(capfdbinary, *face, path))


def test_each_is_one_transaction(capfdbinary: Capture, path: Path) -> None:
    text = lines(capfdbinary, "transactions", path)
    marked = [line for line in text if "behind a malformed TPDU header" in line]
    assert [re.split(r"  +", line)[2] for line in marked] == ["9→10", "?→11", "8→?"]
    assert marked[0].endswith("Read Var  behind a malformed TPDU header  DB10.DBW4 = 7")
    told = objects(capfdbinary, "transactions", "-T", "jsonl", path)
    assert [complaints("transaction", one, exact=True) for one in told] == [[]] * 5
    found = {(one["outcome"], one["reason"], one["request_frame"], one["response_frame"]) for one in told}
    assert found == {
        ("answered", None, 6, 7),
        ("answered", "malformed_header", 9, 10),
        ("behind_malformed", "malformed_header", None, 11),
        ("answered", None, 12, 13),
        ("behind_malformed", "malformed_header", 8, None),
    }
    rows = list(csv.DictReader(io.StringIO("\n".join(lines(capfdbinary, "transactions", "-T", "csv", path)))))
    assert sorted((row["outcome"], row["reason"]) for row in rows) == sorted(
        (str(one["outcome"]), str(one["reason"] or "")) for one in told
    )


def test_selecting_them(capfdbinary: Capture, path: Path) -> None:
    for command, field, where, frames in (
        ("transactions", "request_frame", "behind_malformed", ["", "8", "9"]),
        ("transactions", "request_frame", "reason == malformed_header", ["", "8", "9"]),
        ("transactions", "request_frame", "outcome == behind_malformed", ["", "8"]),
        ("show", "frame", "behind_malformed", ["11", "8", "9"]),
        ("show", "frame", "not behind_malformed and protocol == s7comm", ["10", "12", "13", "6", "7"]),
    ):
        told = lines(capfdbinary, command, "-T", "fields", "-e", field, "-Y", where, path)
        assert sorted(told) == frames, (command, where)
    told = lines(capfdbinary, "show", "-T", "fields", "-e", "frame", "-e", "behind_malformed", path)
    assert [line.split("\t") for line in told[4:8]] == [["8", "true"], ["9", "true"], ["10", "false"], ["11", "true"]]


def test_show_lists_each_once(capfdbinary: Capture, path: Path) -> None:
    told = lines(capfdbinary, "show", path)
    assert [int(line.split()[0]) for line in told] == list(range(4, 14))
    assert [line.endswith(MARK) for line in told[4:6]] == [True, True]
    assert "  PLC stop  P_PROGRAM  BEHIND" in told[4]
    assert told[7].endswith("cotp: length indicator at byte 0 is 255, expected 1 to 254")
    as_json = objects(capfdbinary, "show", "-T", "jsonl", path)
    assert [complaints("pdu", one, exact=True) for one in as_json] == [[]] * len(as_json)
    assert [one["frame"] for one in as_json if "tpdu" in one] == [8, 9, 11]
    (one,) = [one["tpdu"] for one in as_json if one["frame"] == 8]
    assert isinstance(one, dict)
    assert one["behind_malformed"] is True
    assert [fault["field"] for fault in one["malformed"]] == ["li"]


def spans(tree: list[str]) -> list[int]:
    """Return the octets that the fields of a tree cover, without those that share an octet as two parts of it."""
    covered: list[int] = []
    latest = ""
    for line in tree:
        found = re.match(r" {4} {0,11}(\d+)(?:-(\d+))? {2}\S", line)
        if found is None or re.match(r" {4} *\d+ {2}[0-9a-f]{2} ", line):
            continue
        place = f"{found[1]}-{found[2]}"
        if place != latest:
            covered += range(int(found[1]), int(found[2] or found[1]) + 1)
        latest = place
    return covered


def test_no_two_headers_lie_over_the_same_octets(capfdbinary: Capture, tmp_path: Path) -> None:
    """For each length indicator, behind a malformed header and in a DT that is read."""
    path = tmp_path / "c.pcapng"
    talk = begun()
    for li in range(256):
        talk.send(0, tpkt(bytes((li, 0xF0, 0x80)) + STOP))
    saved(path, talk.packets())
    tree = lines(capfdbinary, "show", "-V", path)
    starts = [at for at, line in enumerate(tree) if re.match(r" *\d+ {2}2", line)]
    trees = {int(tree[at].split()[0]): tree[at:end] for at, end in zip(starts, [*starts[1:], len(tree)], strict=True)}
    assert len(starts) == 4 + 256
    for li in range(256):
        covered = spans(trees[8 + li][1:])
        assert covered == list(range(4 + 3 + len(STOP))), (li, trees[8 + li])


def test_a_golden_keeps_it(capfdbinary: Capture, path: Path) -> None:
    text = run(capfdbinary, "golden", path).out
    assert text.count("  no answer: malformed_header\n") == 1
    assert text.count("  answer without request: malformed_header\n") == 1
    assert text.count("  behind a malformed header\n") == 1
    golden = path.with_name("a.s7.txt")
    golden.write_text(text, encoding="utf-8")
    assert run(capfdbinary, "diff", path, golden).code == 0
    assert run(capfdbinary, "golden", golden).out == text
    changed = golden.with_name("b.s7.txt")
    changed.write_text(text.replace("  behind a malformed header\n", ""), encoding="utf-8")
    assert run(capfdbinary, "diff", golden, changed).code == 1


def test_replay_withholds_what_nobody_answered(capfdbinary: Capture, path: Path) -> None:
    ran = run(capfdbinary, "replay", "--dry-run", "--allow-control", path)
    assert "PLC stop" not in [line for line in (ran.out + ran.err).splitlines() if line.startswith("  send")]
    assert "it follows a malformed TPDU header and was not answered" in ran.out + ran.err


def test_tables_say_so(capfdbinary: Capture, path: Path) -> None:
    out = path.with_name("out.sqlite")
    assert run(capfdbinary, "export", "-o", out, path).code == 0
    with sqlite3.connect(out) as opened:
        found = opened.execute(
            "SELECT outcome, reason, count(*) FROM transactions GROUP BY 1, 2 ORDER BY 1, 2"
        ).fetchall()
    assert found == [
        ("answered", None, 2),
        ("answered", "malformed_header", 1),
        ("behind_malformed", "malformed_header", 2),
    ]
