from __future__ import annotations

import csv
import io
import json
from pathlib import Path

import pytest

from dissect.meaning.report.writers.csv import CSV_COLUMNS
from tests.cli.support import halves, run, simple
from tests.meaning.report.schemas import complaints
from tests.meaning.report.support import WORD, begun, read, saved
from tests.properties import messages
from tests.properties.messages import dt
from tests.properties.packets import MS, Flow, Talk
from tests.properties.packets import capture as packets_of

Capture = pytest.CaptureFixture[bytes]


@pytest.fixture
def mixed(tmp_path: Path) -> Path:
    """Reference 1 is fine, 2 is refused, 3 takes 50 ms, 4 is refused after 50 ms, 5 is never answered."""
    talk = read(read(read(read(begun(), 1), 2, WORD, 0x0A), 3), 4, WORD, 0x0A)
    packets = talk.send(0, dt(messages.read_job(5, [WORD]))).reset(1).packets()
    late = {13: 50, 14: 50, 15: 100}
    late.update(dict.fromkeys(range(16, 19), 100))
    moved = [
        packet._replace(time_ns=packet.time_ns + late.get(number, 0) * MS) for number, packet in enumerate(packets, 1)
    ]
    return saved(tmp_path / "mixed.pcapng", moved)


def references(output: str) -> list[int]:
    return [json.loads(line)["pdu_ref"] for line in output.splitlines()]


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ([], [0, 1, 2, 3, 4, 5]),
        (["--failed"], [2, 4, 5]),
        (["--slow", "20"], [3, 4]),
        (["--slow", "51"], []),
        (["--slow", "0"], [0, 1, 2, 3, 4]),
        (["--failed", "--slow", "20"], [2, 3, 4, 5]),
    ],
)
def test_only_what_is_asked_for(capfdbinary: Capture, mixed: Path, options: list[str], expected: list[int]) -> None:
    assert references(run(capfdbinary, "transactions", "-T", "jsonl", *options, mixed).out) == expected
    assert run(capfdbinary, "transactions", *options, mixed).out.count("\n") == len(expected)
    table = run(capfdbinary, "transactions", "-T", "csv", *options, mixed).out
    assert [row["pdu_ref"] for row in csv.DictReader(io.StringIO(table))] == [str(ref) for ref in expected]


def test_failed_lists_what_does_not_fit_its_request(capfdbinary: Capture, tmp_path: Path) -> None:
    talk = begun()
    for reference, octets in ((1, 2), (2, 4)):
        talk.send(0, dt(messages.read_job(reference, [WORD])))
        talk.send(1, dt(messages.read_answer(reference, [WORD], [bytes(octets)])))
    path = saved(tmp_path / "a.pcapng", talk.packets())
    (line,) = run(capfdbinary, "transactions", "--failed", path).out.splitlines()
    assert line.endswith("Read Var  MISMATCH (item size)  DB10.DBW4 = 00 00 00 00 (4 bytes instead of 2)")


def test_text(capfdbinary: Capture, mixed: Path) -> None:
    lines = run(capfdbinary, "transactions", mixed).out.splitlines()
    assert [line[30:].split()[:2] for line in lines] == [
        ["#1", "6→7"],
        ["#2", "8→9"],
        ["#3", "10→11"],
        ["#4", "12→13"],
        ["#5", "14→15"],
        ["#6", "16→?"],
    ]
    assert lines[1].endswith("  1.00 ms  Read Var  DB10.DBW4 = 1234")
    assert lines[2].endswith("Read Var  DB10.DBW4: Object does not exist")
    assert lines[5].endswith("NO ANSWER (connection closed)  DB10.DBW4")


def test_jsonl_holds_the_schema(capfdbinary: Capture, mixed: Path) -> None:
    for line in run(capfdbinary, "transactions", "-T", "jsonl", mixed).out.splitlines():
        assert complaints("transaction", json.loads(line), exact=True) == []


def test_csv_is_a_table(capfdbinary: Capture, mixed: Path, tmp_path: Path) -> None:
    rows = list(csv.reader(io.StringIO(run(capfdbinary, "transactions", "-T", "csv", mixed).out)))
    assert rows[0] == CSV_COLUMNS
    assert {len(row) for row in rows} == {len(CSV_COLUMNS)}
    two = list(csv.DictReader(io.StringIO(run(capfdbinary, "transactions", "-T", "csv", *halves(tmp_path)).out)))
    assert [(row["request_frame"], row["response_frame"]) for row in two] == [
        ("6", "7"),
        ("8", "9"),
        ("10", "1"),
        ("2", ""),
    ]
    assert [Path(row["request_file"]).name for row in two] == ["first.pcapng"] * 3 + ["second.pcapng"]
    assert two[3]["response_file"] == ""


def test_csv_of_nothing_has_its_columns(capfdbinary: Capture, tmp_path: Path) -> None:
    path = saved(tmp_path / "none.pcapng", begun().packets()[:3])
    assert run(capfdbinary, "transactions", "-T", "csv", path).out == ",".join(CSV_COLUMNS) + "\n"
    assert run(capfdbinary, "transactions", path).out == ""


def test_docs_list_the_columns() -> None:
    text = (Path(__file__).resolve().parents[2] / "docs" / "json.md").read_text(encoding="utf-8")
    part = text.split("## Transactions as CSV")[1]
    assert [column for column in (*CSV_COLUMNS, "request_file", "response_file") if f"`{column}`" not in part] == []


def test_a_ring_buffer_is_one_conversation(capfdbinary: Capture, tmp_path: Path) -> None:
    whole = simple(tmp_path / "whole.pcapng")
    single = references(run(capfdbinary, "transactions", "-T", "jsonl", whole).out)
    packets = read(read(read(begun(), 1), 2, WORD, 0x0A), 3).packets()
    for cut in range(1, len(packets)):
        parts = [saved(tmp_path / "1.pcapng", packets[:cut]), saved(tmp_path / "2.pcapng", packets[cut:])]
        assert references(run(capfdbinary, "transactions", "-T", "jsonl", *parts).out) == single


def test_help_says_what_a_person_needs(capfdbinary: Capture) -> None:
    told = run(capfdbinary, "transactions", "--help").out
    for word in ("FILE", "UTC", "--failed", "--slow MS", "jsonl", "csv", "Exit code:"):
        assert word in told


def test_a_capture_without_s7_says_what_was_there(capfdbinary: Capture, tmp_path: Path) -> None:
    talk = Talk().handshake()
    path = saved(tmp_path / "x.pcapng", talk.packets())
    ran = run(capfdbinary, "transactions", path)
    assert (ran.code, ran.out) == (0, "")
    assert ran.err == "s7dissect: no S7 transaction: 3 packets\n"


def test_a_capture_that_is_not_opened_says_so(capfdbinary: Capture, tmp_path: Path) -> None:
    path = saved(tmp_path / "x.pcapng", packets_of([Flow().wrap(0, 50, bytes(40))] * 3))
    for separate in ([], ["--separate"]):
        ran = run(capfdbinary, "transactions", path, *separate)
        assert ran.err == (
            "s7dissect: no S7 transaction: 3 packets (3 not TCP); 3 wrapped in something that is not opened "
            "(s7dissect analyze names it)\n"
        )


def test_a_capture_without_s7_names_the_protocols_that_were_there(capfdbinary: Capture, corpus: Path) -> None:
    ran = run(capfdbinary, "transactions", corpus / "rdp-proprietary-encryption.pcap")
    assert (ran.code, ran.out) == (0, "")
    assert (
        ran.err == "s7dissect: no S7 transaction: 542 packets (355 of other protocols over TCP); connections: 2 RDP\n"
    )


def test_transactions_behind_gaps_stand_in_the_order_of_the_capture(capfdbinary: Capture, corpus: Path) -> None:
    """Thirty-two of them waited for empty TPDUs that the filter of this capture left out."""
    path = corpus / "faults" / "wincc_s400_first_part.pcapng"
    told = [json.loads(line) for line in run(capfdbinary, "transactions", "-T", "jsonl", path).out.splitlines()]
    packets = [max(one["request_frame"] or 0, one["response_frame"] or 0) for one in told]
    assert len(packets) == 582
    assert packets == sorted(packets)
