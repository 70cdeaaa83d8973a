"""The measuring: what a run costs, what is held against the truth, how the tables look."""

from __future__ import annotations

import copy
import json
import sys
from pathlib import Path
from typing import Any

import pytest

from benchmarks import compare, growth
from benchmarks.check import check_analysis, check_transactions, count_tshark
from benchmarks.measure import CommandFailedError, Cost, middle, run
from benchmarks.tables import Row, columns, markdown, text

TRUTH: dict[str, Any] = {
    "packets": 10,
    "tpdus": {"CR": 1, "DT": 6},
    "s7": {"pdus": 6, "rosctr": {"1": 3, "3": 3}, "functions": {"0x04": 6}},
    "transactions": {"answered": 3, "unanswered": 0, "orphan_answers": 0, "unsolicited": 0, "with_errors": 1},
    "items": 4,
    "latency_ns": {"min": 900, "median": 1000, "p95": 2000, "p99": 2000, "max": 2100},
}
TOLD: dict[str, Any] = {
    "packets": {"read": 10},
    "tpdus": {"CR": 1, "DT": 6, "ED": 0},
    "s7": TRUTH["s7"],
    "transactions": {**TRUTH["transactions"], "total": 3},
    "latency_ns": TRUTH["latency_ns"],
}


def test_a_run_is_measured(tmp_path: Path) -> None:
    out = tmp_path / "out"
    code = "held = bytearray(64 * 1024 * 1024); print(sum(range(2_000_000)))"
    cost = run([sys.executable, "-c", code], output=out)
    assert out.read_text() == f"{sum(range(2_000_000))}\n"
    assert cost.code == 0
    assert 0.005 < cost.cpu_s < 20
    assert cost.peak_mb > 60


def test_a_failing_command_says_why() -> None:
    command = [sys.executable, "-c", "import sys; sys.exit('no such luck')"]
    with pytest.raises(CommandFailedError, match="no such luck"):
        run(command)
    assert run(command, fine=(0, 1)).code == 1


def test_the_middle_of_several_runs() -> None:
    cost = middle([Cost(3.0, 9.0, 50.0, 0), Cost(1.0, 7.0, 70.0, 0), Cost(2.0, 8.0, 60.0, 3)])
    assert (cost.cpu_s, cost.wall_s, cost.peak_mb, cost.code) == (2.0, 8.0, 60.0, 3)


def test_the_truth_is_recognised() -> None:
    assert check_analysis(TOLD, TRUTH) == []


@pytest.mark.parametrize(
    ("keys", "value"),
    [
        (("packets", "read"), 9),
        (("s7", "pdus"), 7),
        (("s7", "rosctr"), {"1": 3, "3": 2}),
        (("s7", "functions"), {}),
        (("tpdus", "DT"), 5),
        (("transactions", "answered"), 2),
        (("transactions", "with_errors"), 0),
        (("latency_ns", "median"), 1100),
    ],
)
def test_every_untruth_is_told(keys: tuple[str, str], value: object) -> None:
    told = copy.deepcopy(TOLD)
    told[keys[0]][keys[1]] = value
    wrong = check_analysis(told, TRUTH)
    assert len(wrong) == 1
    assert wrong[0].startswith(".".join(keys))


def test_lines_are_held_against_the_truth(tmp_path: Path) -> None:
    path = tmp_path / "lines"
    line = {"outcome": "answered", "items": [{}], "errors": [], "request_frame": 1}
    lines = [line, {**line, "items": [{}, {}]}, {**line, "errors": [{}]}]
    path.write_text("".join(json.dumps(one) + "\n" for one in lines))
    assert check_transactions(path, TRUTH) == []
    path.write_text("".join(json.dumps(one) + "\n" for one in lines[:2]))
    assert len(check_transactions(path, TRUTH)) == 3


def test_pdus_in_lines_of_tshark(tmp_path: Path) -> None:
    path = tmp_path / "lines"
    path.write_text("1.0\ta\tb\t1\t5\n1.1\tb\ta\t3,3\t5,6\n")
    assert count_tshark(path) == 3


def test_tables_stand_in_columns() -> None:
    rows = [
        Row("this", 1_000_000, Cost(0.5, 0.6, 36.4, 0), 50.0),
        Row("that one", 1_000_000, Cost(25.0, 30.0, 800.0, 0), 1.0),
    ]
    shown = text(rows).splitlines()
    assert len({len(line) for line in shown}) == 1
    assert "2,000" in shown[1]
    assert "40.0" in shown[2]
    assert markdown(rows).count("|\n") == 4
    assert columns(("a", "b"), [("xx", "1")]) == "a   b\nxx  1"


def test_the_command_makes_measures_and_prints(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["--sizes", "2k", "--runs", "1", "--engines", "plain", "--data", str(tmp_path)]
    assert compare.main([*arguments, "--markdown", str(tmp_path / "t.md"), "--json", str(tmp_path / "t.json")]) == 0
    assert "plain pass" in capsys.readouterr().out
    assert (tmp_path / "2000.pcap").exists()
    assert (tmp_path / "t.md").read_text().startswith("| engine |")
    assert json.loads((tmp_path / "t.json").read_text())["rows"][0]["packets"] == 2_000


def test_an_engine_that_is_not_compiled_is_not_measured_as_such(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["--sizes", "2k", "--runs", "1", "--engines", "plain", "analyze-compiled", "--data", str(tmp_path)]
    assert compare.main([*arguments, "--compiled", "/nonexistent/python"]) == 2
    assert "does not run" in capsys.readouterr().out


def test_promises_that_are_broken_are_told() -> None:
    half = {"cpu_ns": {"all": 100, "finish": 0}}
    good = {
        "resident_kb": [1000, 1010, 1020, 1040], "peak_kb": 1100, "cpu_ns": {"half": 100, "all": 210, "finish": 5},
        "worst_ns": 1_000_000, "packets": 50, "accounted": 50,
    }  # fmt: skip
    assert growth.faults(half, good) == []
    for key, value, said in (
        ("resident_kb", [1000, 1010, 1020, 1060], "memory grew 1.06"),
        ("peak_kb", 260_000, "peak 266 MB"),
        ("cpu_ns", {"half": 100, "all": 240, "finish": 5}, "2.45 times"),
        ("worst_ns", 60_000_000, "60 ms"),
        ("accounted", 49, "1 packets"),
    ):
        broken = growth.faults(half, {**good, key: value})
        assert len(broken) == 1
        assert said in broken[0]
