"""Options that select, on the command line: -Y, --connection, --time, -c, -T fields -e, and the command `fields`."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Final

import pytest

from dissect.files.session import analyze
from tests.cli.support import Ran, run
from tests.meaning.report.schemas import ROOT, validator

Capture = pytest.CaptureFixture[bytes]
ERRORS: Final = str(ROOT / "captures" / "item-errors.pcapng")
TRANSFER: Final = str(ROOT / "captures" / "transfer.pcapng")
LINKS: Final = str(ROOT / "captures" / "crafted" / "link-types.pcapng")


def numbers(ran: Ran) -> list[int]:
    assert ran.code == 0, ran.err
    return [json.loads(line)["number"] for line in ran.out.splitlines()]


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        (["-Y", "error == 0x0a and function == read"], [2, 5]),
        (["--where", "latency > 79us"], [2]),
        (["-Y", "failed", "-c", "2"], [2, 3]),
        (["-c", "3"], [1, 2, 3]),
        (["--failed", "-Y", "function == write", "-c", "2"], [6, 7]),
        (["--time", "0.005..0.008"], [5, 6]),
        (["--time", "01:31:05.7..", "-Y", "number < 8"], [6, 7]),
        (["--connection", "1", "-Y", "number == 1"], [1]),
        (["-Y", "number in 2..4 and not number in 3"], [2, 4]),
        (["--time", "2026-11-21", "-Y", "number in {2..3}"], [2, 3]),
        (["--time", "01:31", "-c", "1"], [1]),
        (["--time", "02:31:05.694+01:00..+1.7ms"], [1, 2]),
        (["-Y", "time == 01:31:05 and number < 3"], [1, 2]),
    ],
)
def test_transactions_are_selected(capfdbinary: Capture, options: list[str], expected: list[int]) -> None:
    assert numbers(run(capfdbinary, "transactions", ERRORS, "-T", "jsonl", *options)) == expected


@pytest.mark.parametrize("command", ["transactions", "operations", "values", "blocks", "show", "analyze", "devices"])
@pytest.mark.parametrize(
    ("options", "why"),
    [
        (["--connection", "98", "--connection", "99"], "no connection 98, 99; the capture has 1"),
        (
            ["--time", "100.."],
            "no packet within 100..; what was read begins at 2026-11-21 01:31:05.693204 UTC and lasts 11.01 ms",
        ),
        (
            ["--time", "..2016-01-01T00:00:00"],
            (
                "no packet within ..2016-01-01T00:00:00 (UTC); "
                "what was read begins at 2026-11-21 01:31:05.693204 UTC and lasts 11.01 ms"
            ),
        ),
    ],
)
def test_a_selection_that_nothing_can_match_is_told(
    capfdbinary: Capture, command: str, options: list[str], why: str
) -> None:
    ran = run(capfdbinary, command, ERRORS, *options)
    assert (ran.code, ran.err) == (2 if "--connection" in options else 0, f"s7dissect: {why}\n")


@pytest.mark.parametrize(
    ("call", "why"),
    [
        (["transactions", "-Y", "latency > 20s"], "no transaction matches latency > 20s"),
        (["transactions", "--failed", "--connection", "1", "--time", "..0.001"],
         "no transaction matches --failed and (connection in {1}) and (time in {..0.001})"),
        (["operations", "--kind", "upload"], "no operation matches --kind upload"),
        (["operations", "-T", "jsonl", "--kind", "upload"], "no operation matches --kind upload"),
        (["values", "-T", "csv", "-Y", "function == 0x99"], "no value matches function == 0x99"),
        (["values", "--summary", "-T", "csv", "-Y", "function == 0x99"], "no value matches function == 0x99"),
        (["show", "-Y", "function == 0x99"], "no message matches function == 0x99"),
    ],
)  # fmt: skip
def test_why_nothing_is_shown(capfdbinary: Capture, call: list[str], why: str) -> None:
    ran = run(capfdbinary, *call, ERRORS)
    assert (ran.code, ran.err) == (0, f"s7dissect: {why}\n")
    assert len(ran.out.splitlines()) == ("csv" in call)


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("Valve.presure", "Valve.presure: no such tag; close to it: Valve.pressure, Valve.open, Valve.cycles"),
        ("valve.Pressure", "valve.Pressure: the tag is called Valve.pressure"),
        ("Typo", "Typo: not an address such as DB10.DBD4, DB10.DBD4:REAL, MW20 or I0.1, nor a tag of the files of --tags"),
        ("'Typo'", "Typo: not an address such as DB10.DBD4, DB10.DBD4:REAL, MW20 or I0.1, nor a tag of the files of --tags"),
        ("Valve.pressure", ""), ("DB99.DBW2", ""), ("DB99", ""), ("DB1.\"level\"", ""),
    ],
)  # fmt: skip
def test_a_variable_that_there_is_not_is_told(capfdbinary: Capture, name: str, why: str) -> None:
    tags = ROOT / "captures" / "tags" / "valve.csv"
    expression = f"value[{name}] > 1e30"
    ran = run(capfdbinary, "transactions", ERRORS, "--tags", tags, "-Y", expression)
    lines = [f"s7dissect: no transaction matches {expression}", *([f"s7dissect: {why}"] if why else [])]
    assert (ran.code, ran.err.splitlines()) == (0, lines)
    without = run(capfdbinary, "transactions", ERRORS, "-Y", "value[Valve.pressure] > 1").err.splitlines()
    assert without[1].endswith("MW20 or I0.1, and without --tags there are no names")


@pytest.mark.parametrize("begin", ["2026-11-21T01:31:05.699", "2026-11-21 01:31:05.699", "2026-11-21 01:31:05.699 UTC"])
def test_a_time_is_taken_as_reports_write_it(capfdbinary: Capture, begin: str) -> None:
    ran = run(capfdbinary, "transactions", "-T", "jsonl", "--time", f"{begin}..2026-11-21 01:31:05.7007", ERRORS)
    assert numbers(ran) == [5, 6]


def test_of_a_capture_without_any_the_commands_say_so(capfdbinary: Capture) -> None:
    refused = str(ROOT / "captures" / "refused-port.pcapng")
    assert run(capfdbinary, "operations", refused).err == "s7dissect: no operation in what was read\n"
    assert run(capfdbinary, "values", refused).err == "s7dissect: no value in what was read\n"
    assert run(capfdbinary, "operations", "--connection", "1", refused, refused).err == (
        "s7dissect: no connection 1; the captures have none\n"
    )


def test_operations_are_selected(capfdbinary: Capture) -> None:
    every = numbers(run(capfdbinary, "operations", TRANSFER, "-T", "jsonl"))
    some = numbers(run(capfdbinary, "operations", TRANSFER, "-T", "jsonl", "-Y", "kind == download and result == done"))
    rest = numbers(
        run(capfdbinary, "operations", TRANSFER, "-T", "jsonl", "-Y", "not (kind == download and result == done)")
    )
    assert some
    assert sorted(some + rest) == sorted(every)
    assert numbers(run(capfdbinary, "operations", TRANSFER, "-T", "jsonl", "-c", "2")) == every[:2]


def test_messages_are_selected(capfdbinary: Capture) -> None:
    def frames(*options: str) -> list[int]:
        ran = run(capfdbinary, "show", ERRORS, "-T", "jsonl", *options)
        assert ran.code == 0, ran.err
        return [json.loads(line)["frame"] for line in ran.out.splitlines()]

    assert frames("-Y", "db == 99 or return_code == 0x0a") == [10, 11, 16, 17, 18, 19, 22, 23]
    assert frames("-Y", "protocol == cotp") == [4, 6]
    assert frames("-Y", "src == 127.0.0.1:102", "-c", "2") == [6, 9]
    assert sorted(frames("-Y", "rosctr == job") + frames("-Y", "not rosctr == job")) == frames()


def test_an_analysis_says_that_it_is_of_a_selection(capfdbinary: Capture) -> None:
    ran = run(capfdbinary, "analyze", ERRORS, "-Y", "function == write", "--time", "..1")
    assert "  SELECTION: (function == write) and (time in {..1})\n" in ran.out
    assert "  selected: 3 transactions, 1 connection, 0 operations, 9 findings\n" in ran.out
    assert "  left out: 5 transactions, 1 operation, 6 findings; counts of packets" in ran.out
    assert "Transactions: 3 answered, 3 with errors" in ran.out
    told = json.loads(run(capfdbinary, "analyze", LINKS, "-T", "json", "--connection", "3").out)
    assert list(validator("analysis", exact=True).iter_errors(told)) == []
    assert [one["number"] for one in told["connections"]] == [3]
    assert told["selection"]["connections_not_read"] == len(analyze(LINKS).connections) - 1
    assert told["packets"]["ignored"]["left_out"] > 0


def test_the_gate_counts_what_is_selected(capfdbinary: Capture) -> None:
    for command in ("analyze", "transactions"):
        assert run(capfdbinary, command, ERRORS, "-Y", "function == write", "--fail-on", "security.*").code == 1
        assert run(capfdbinary, command, ERRORS, "-Y", "function == read", "--fail-on", "security.*").code == 0


def test_packets_are_cut(capfdbinary: Capture, tmp_path: Path) -> None:
    ran = run(capfdbinary, "cut", ERRORS, "-o", tmp_path / "a.pcapng", "-Y", "function == write")
    assert "6 of 26 packets written" in ran.err
    ran = run(capfdbinary, "cut", ERRORS, "-o", tmp_path / "b.pcapng", "-Y", "not function == write")
    assert "20 of 26 packets written" in ran.err
    ran = run(
        capfdbinary, "cut", ERRORS, "-o", tmp_path / "c.pcapng", "--transaction", "6", "-Y", "dst == 127.0.0.1:102"
    )
    assert "1 of 26 packets written" in ran.err
    assert analyze(tmp_path / "a.pcapng").total == 3
    ran = run(capfdbinary, "cut", ERRORS, "-o", tmp_path / "d.pcapng", "-Y", "function == download")
    assert ran.code == 2


def test_goldens_are_of_what_is_selected(capfdbinary: Capture, tmp_path: Path) -> None:
    golden = tmp_path / "all.s7.txt"
    assert run(capfdbinary, "golden", ERRORS, "-o", golden).code == 0
    ran = run(capfdbinary, "golden", ERRORS, "-Y", "function == write")
    assert ran.out.count("client WRITE") == 3
    assert "client READ" not in ran.out
    assert run(capfdbinary, "diff", ERRORS, ERRORS, "-Y", "number in {1..3}").code == 0
    ran = run(capfdbinary, "diff", golden, ERRORS, "-Y", "number == 1")
    assert ran.code == 2
    assert "is a golden, and only captures can be selected from" in ran.err


def test_lines_of_the_monitor_are_selected(capfdbinary: Capture) -> None:
    ran = run(capfdbinary, "monitor", "-T", "jsonl", ERRORS, "-Y", "error == 0x0a and function == read")
    told = [json.loads(line) for line in ran.out.splitlines()]
    kinds = [line.get("event", line["schema"]) for line in told]
    assert kinds.count("s7dissect.transaction/1") == 2
    assert kinds.count("finding") == 4
    assert kinds.count("connection_closed") == 1
    assert kinds[-1] == "summary"
    ran = run(capfdbinary, "monitor", "-T", "jsonl", ERRORS, "-Y", "host == 10.0.0.1")
    assert [json.loads(line)["event"] for line in ran.out.splitlines()] == ["summary"]


def test_fields_are_written_as_tshark_does(capfdbinary: Capture) -> None:
    columns = ["-e", "frame", "-e", "function", "-e", "address", "-e", "value", "-e", "error"]
    ran = run(capfdbinary, "transactions", ERRORS, "-T", "fields", *columns, "-Y", "number in {1, 2, 6}")
    assert ran.out == (
        "8,9\tSetup communication\t\t\t\n"
        "10,11\tRead Var\tDB99.DBB0 x4\t\tObject does not exist\n"
        "18,19\tWrite Var\tDB99.DBB0 x2\t1;2\tObject does not exist\n"
    )
    ran = run(capfdbinary, "show", ERRORS, "-T", "fields", "-e", "protocol", "-e", "src", "-e", "time", "-c", "1")
    assert ran.out == "cotp\t127.0.0.1:45840\t2026-11-21T01:31:05.693304306Z\n"
    ran = run(capfdbinary, "operations", ERRORS, "-T", "fields", "-e", "KIND", "-e", "failed")
    assert ran.out == "connect\tfalse\n"


@pytest.mark.parametrize(
    ("call", "told"),
    [
        (["transactions", ERRORS, "-T", "fields"], "-T fields needs -e FIELD"),
        (["transactions", ERRORS, "-e", "frame"], "-e needs -T fields"),
        (["transactions", ERRORS, "-T", "fields", "-e", "latncy"], "no field 'latncy'. Did you mean latency"),
        (["transactions", ERRORS, "-T", "fields", "-e", "slug"], "'slug' is a field of findings."),
        (["transactions", ERRORS, "-Y", "slug == x"], "transactions have no field 'slug'"),
        (["show", ERRORS, "-Y", "latency > 1ms"], "messages have no field 'latency'; transactions have it"),
        (["operations", ERRORS, "-Y", ""], "the expression is empty"),
        (["analyze", ERRORS, "--time", "5"], "'5' is not of the form BEGIN..END"),
        (["analyze", ERRORS, "--connection", "0"], "0 is not in the range"),
        (["fields", "latncy"], "Did you mean latency"),
    ],
)
def test_wrong_use_is_told_and_nothing_is_read(capfdbinary: Capture, call: list[str], told: str) -> None:
    ran = run(capfdbinary, *call)
    assert (ran.code, ran.out) == (2, "")
    assert told in ran.err


def test_a_mistake_is_marked_below_the_expression(capfdbinary: Capture) -> None:
    for command in ("analyze", "transactions", "operations", "show", "golden", "monitor"):
        ran = run(capfdbinary, command, ERRORS, "-Y", "host == 10.0.0.1 and port = 102")
        assert ran.code == 2
        assert ran.err.splitlines()[-2:] == ["  host == 10.0.0.1 and port = 102", "                            ^"]


def test_several_files_number_packets_within_each(capfdbinary: Capture) -> None:
    ran = run(capfdbinary, "transactions", ERRORS, TRANSFER, "-T", "jsonl", "-Y", "request_frame == 10")
    assert {json.loads(line)["request_frame"] for line in ran.out.splitlines()} == {10}
    assert len(ran.out.splitlines()) == 2


def test_the_fields_are_listed(capfdbinary: Capture) -> None:
    text = run(capfdbinary, "fields").out
    assert "latency " in text
    told = json.loads(run(capfdbinary, "fields", "-T", "json").out)
    assert list(validator("fields", exact=True).iter_errors(told)) == []
    assert len(told["fields"]) == len(text.splitlines())
    assert "names:   done, refused, failed, unfinished, running" in run(capfdbinary, "fields", "result").out


@pytest.mark.parametrize(
    ("line", "offered"),
    [
        ("sql|slow", "slowest"),
        ("help|sca", "scale"),
        ("help|oper", "operations"),
        ("export|--only|val", "values"),
        (f"transactions|{ERRORS}|--connection|", "1"),
        (f"cut|{ERRORS}|--connection|", "1"),
        (f"sql|talkers|{ERRORS}|--connection|", "1"),
        (f"values|{ERRORS}|DB1.DBB0|--connection|", "1"),
        (f"diff|{ERRORS}|{ERRORS}|--connection|", "1"),
        ("analyze|--fail-on|transaction.sl", "transaction.slow"),
        ("analyze|--fail-on|wa", "warning"),
        ("cut|--finding|security.plc_sto", "security.plc_stop"),
        ("schema|anal", "analysis"),
        ("golden|--with|time,ref", "time,refs"),
        ("diff|--ignore|val", "values"),
    ],
)
def test_the_shell_completes_names_and_connections(line: str, offered: str) -> None:
    assert offered in completed(f"s7dissect|{line}")


@pytest.mark.parametrize(
    "line",
    ["export|--only|items,val", "analyze|--fail-on|error,transaction.sl", "cut|--finding|warning,security.plc_sto", "sql|a,t",
     "schema|a,anal", "help|a,sca"],
)  # fmt: skip
def test_nothing_is_offered_behind_a_comma_where_it_would_be_refused(line: str) -> None:
    assert completed(f"s7dissect|{line}") in ([], [""])


def test_no_connection_is_offered_of_what_is_no_capture() -> None:
    assert completed(f"s7dissect|transactions|{Path(__file__)}|--connection|") == [""]
    assert completed("s7dissect|transactions|missing.pcap|--connection|") == [""]


def test_each_capture_of_diff_has_connections_of_its_own() -> None:
    assert completed(f"s7dissect|diff|{ERRORS}|{ERRORS}|--connection|") == ["1"]


def completed(line: str) -> list[str]:
    """Return what the shell offers for the last of the words of a line, which stand between bars."""
    words = line.split("|")
    quoted = [f"'{word}'" if " " in word else word for word in words]
    environment = {
        **os.environ,
        "_S7DISSECT_COMPLETE": "bash_complete",
        "COMP_WORDS": " ".join(quoted),
        "COMP_CWORD": str(len(words) - 1),
    }
    code = "from dissect.cli.main import main; main()"
    ran = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=False, timeout=60
    )
    return [one.partition(",")[2] for one in ran.stdout.splitlines()]


def test_the_shell_completes_fields() -> None:
    assert completed("s7dissect|transactions|-Y|lat") == ["latency", "latency_ns"]
    assert completed("s7dissect|transactions|-Y|failed and lat") == ["failed and latency", "failed and latency_ns"]
    assert completed("s7dissect|operations|-e|res") == ["result"]
    assert "slug" not in completed("s7dissect|transactions|-Y|sl")
    assert "slug" in completed("s7dissect|analyze|-Y|sl")


def test_packets_are_chosen_by_ranges(capfdbinary: Capture) -> None:
    one_by_one = run(capfdbinary, "show", ERRORS, "--frame", "10", "--frame", "11", "--frame", "12")
    for asked in ("10-12", "10..12"):
        assert run(capfdbinary, "show", ERRORS, "--frame", asked) == one_by_one
    assert len(one_by_one.out.splitlines()) == 3
    ran = run(capfdbinary, "show", ERRORS, "--frame", "1-3")
    assert (ran.code, ran.err) == (0, "s7dissect: packets 1 to 3 complete no message\n")
    ran = run(capfdbinary, "show", ERRORS, "--frame", "20-27")
    assert (ran.code, ran.err) == (2, "s7dissect: no packet 27; the last one is 26\n")
    for wrong in ("0", "12-10", "1,2", "x"):
        ran = run(capfdbinary, "show", ERRORS, "--frame", wrong)
        assert ran.code == 2
        assert "a range such as 10-12" in ran.err


def test_a_kind_is_found_by_a_word_of_what_it_is(capfdbinary: Capture) -> None:
    for word in ("stop", "stops"):
        ran = run(capfdbinary, "operations", ERRORS, "--kind", word)
        assert ran.code == 2
        assert f"there is no '{word}', but --kind control: A client stops or starts the PLC" in ran.err
    assert "is not one of" in run(capfdbinary, "operations", ERRORS, "--kind", "xyzzy").err


@pytest.mark.parametrize(
    "command", ["analyze --per-file", "sql|select 1", "golden", "report", "diff", "export", "values|MW20"]
)
def test_a_number_that_nothing_has_is_wrong_use(capfdbinary: Capture, tmp_path: Path, command: str) -> None:
    name, *words = command.replace(" ", "|").replace("select|1", "select 1").split("|")
    files = [*words, ERRORS] if name == "sql" else [ERRORS, *words]
    out = tmp_path / "out.csv"
    outputs: dict[str, list[object]] = {
        "golden": ["-o", out],
        "report": ["-o", out],
        "diff": [ERRORS],
        "export": ["-o", out],
    }
    ran = run(capfdbinary, name, *files, *map(str, outputs.get(name, [])), "--connection", "9")
    assert ran.code == 2
    assert "no connection 9; the capture has 1" in ran.err
    assert not out.exists()
