"""`analyze --brief` and `--per-file`: findings first, everything counted, and never more lines than promised."""

from __future__ import annotations

import itertools
import json
from pathlib import Path

import pytest

from dissect.engine.findings.catalogue import CATALOGUE
from dissect.engine.findings.reporter import MAX_DETAILED, Finding
from dissect.engine.pipeline import Options, Pipeline
from dissect.files.session import Run
from dissect.meaning.report.analysis import Analysis
from dissect.meaning.report.brief import MOST, brief_lines
from dissect.meaning.report.per_file import PerFile
from dissect.meaning.report.text import analysis_lines
from dissect.packets.source.packet import SourceFile
from tests.cases import each
from tests.cli.support import run
from tests.engine.stations.answers import components, identification, mode, szl
from tests.engine.transactions.talk import Talk, dbw, read
from tests.meaning.report.schemas import ROOT
from tests.meaning.report.support import OWN, UNSAFE, WORD, begun, saved
from tests.meaning.report.support import read as read_item

Capture = pytest.CaptureFixture[bytes]
CAPTURES = ROOT / "captures"


def many(clients: int, servers: int) -> Analysis:
    """Every client asks every server twice, once without an answer; each server says who it is; every finding was made."""
    analysis = Analysis()
    pipeline = Pipeline(analysis, Options(strict=True))
    talks = [Talk()]
    talks[0].pipeline = pipeline
    for number, (client, server) in enumerate(itertools.product(range(clients), range(servers))):
        talk = talks[0] if not number else Talk(50000 + number, beside=talks[0])
        talk.hosts = [10 + client, 100 + server]
        talk.open()
        szl(talk, 1, identification(f"6ES7 {server}", (3, 2, 6)))
        szl(talk, 2, components(station=f"\x1b[31m{server}"))
        szl(talk, 3, mode(8))
        talk.ask(read(4, dbw(1, 0)))
    pipeline.finish()
    for slug in CATALOGUE:
        pipeline.finding_counts[slug] = 7
        analysis.finding(Finding(CATALOGUE[slug], 1, [1, 2], 0, "what " * 100))
    files = [SourceFile(f"file{number}.pcapng\x1b", 1) for number in range(30)]
    for file in files[3:]:
        file.damage = "cut off"
        file.octets = 0 if file.name == "file7.pcapng\x1b" else 12
    analysis.take(pipeline, files)
    return analysis


def test_it_never_has_more_lines_than_promised() -> None:
    analysis = many(6, 9)
    lines = [line.text for line in brief_lines(analysis, interrupted=True)]
    assert len(lines) <= MOST == 40
    assert not any(UNSAFE.search(line) for line in lines)
    assert "and 27 more files: 0 packets, 26 damaged, 1 not read" in lines
    assert f"  and {len(CATALOGUE) - 11} more kinds of findings" in lines
    assert "  and 3 more; `s7dissect devices` lists them" in lines
    assert lines[-2] == "  and 46 more"
    assert any("INTERRUPTED" in line for line in lines)
    assert lines.index("Findings") < lines.index("PLCs") < lines.index("Connections: 54")


def test_a_row_a_plc_and_a_line_a_connection() -> None:
    analysis = many(2, 1)
    lines = [line.text for line in brief_lines(analysis, hosts={"10.0.0.100": "Press"})]
    at = lines.index("PLCs")
    assert lines[at + 1].split() == ["connections", "PDUs", "answered", "errors", "no", "answer", "still", "open"]
    assert lines[at + 2].split() == ["Press", "6ES7", "0", "V3.2.6", "RUN", "2", "18", "8", ".", ".", "2"]
    begin = lines.index("Connections: 2")
    assert lines[begin + 1].startswith("  1  10.0.0.10:50000 → Press:102")


def test_the_report_lists_devices_that_say_what_they_are() -> None:
    lines = [line.text for line in analysis_lines(many(1, 2), hosts={"10.0.0.100": "Press"})]
    at = lines.index("Devices")
    assert lines[at + 1].split("  ")[1] == "address"
    assert lines[at + 2].split()[:4] == ["Press", "6ES7", "0", "V3.2.6"]
    assert lines[at + 3].split()[:4] == ["10.0.0.101", "6ES7", "1", "V3.2.6"]
    assert any("10.0.0.10:50000 → Press:102" in line for line in lines)
    assert not any(UNSAFE.search(line) for line in lines)


def test_nobody_says_what_it_is(capfdbinary: Capture) -> None:
    out = run(capfdbinary, "analyze", CAPTURES / "item-errors.pcapng").out
    assert "Devices" not in out.splitlines()
    told = json.loads(run(capfdbinary, "analyze", CAPTURES / "item-errors.pcapng", "-T", "json").out)
    assert told["devices"] == []
    told = json.loads(run(capfdbinary, "analyze", CAPTURES / "szl.pcapng", "-T", "json").out)
    assert [(one["address"], one["serial_number"]) for one in told["devices"]] == [("127.0.0.1", "S C-C2UR28922012")]


def test_what_is_still_open_is_not_without_answer(capfdbinary: Capture) -> None:
    path = CAPTURES / "crafted" / "reference-examples.pcapng"
    told = json.loads(run(capfdbinary, "analyze", path, "-T", "json").out)
    still_open = told["transactions"]["still_open"]
    assert still_open == told["transactions"]["unanswered"] == 11
    assert sum([one["still_open"] for one in told["functions"]]) == still_open
    assert sum([one["still_open"] for one in told["connections"]]) == still_open
    lines = run(capfdbinary, "analyze", path).out.splitlines()
    (head,) = [line for line in lines if line.startswith("  function ")]
    (row,) = [line for line in lines if line.startswith("  Read Var ")]
    assert head.split()[1:9] == ["count", "errors", "no", "answer", "still", "open", "no", "request"]
    assert row.split()[2:6] == ["9", "1", ".", "4"]
    brief = run(capfdbinary, "analyze", "--brief", path).out.splitlines()
    assert brief[1].endswith("; 48 transactions, 7 with errors, 11 still open")
    (row,) = [line for line in brief if line.startswith("  192.0.2.20 ")]
    assert row.split()[-2:] == [".", "11"]
    assert (
        len([line for line in brief if line.endswith(" 75 PDUs, 7 with errors, 11 still open, closed by the server")])
        == 1
    )


def test_the_row_of_a_plc_counts_connections_without_messages(capfdbinary: Capture) -> None:
    out = run(capfdbinary, "analyze", "--brief", CAPTURES / "refused-full.pcapng").out.splitlines()
    assert "Connections: 2" in out
    (row,) = [line.split() for line in out if line.startswith("  127.0.0.1 ")]
    assert row == ["127.0.0.1", "2", "4", "2", ".", "."]


@each("vlan", [0, 7])
def test_in_a_vlan_as_well(vlan: int) -> None:
    analysis = Analysis()
    talk = Talk()
    talk.pipeline = Pipeline(analysis, Options(strict=True))
    talk.vlan = vlan
    talk.open()
    silent = Talk(50001, beside=talk)
    silent.vlan = vlan
    silent.hello()
    silent.connect()
    talk.pipeline.finish()
    analysis.take(talk.pipeline, [SourceFile("plant.pcapng", 1)])
    lines = [line.text.split() for line in brief_lines(analysis)]
    (row,) = [line for line in lines if line[:1] == ["10.0.0.2"]]
    assert row[-5:] == ["2", "2", "1", ".", "."]


def test_a_row_a_file_adds_up(capfdbinary: Capture) -> None:
    files = [*OWN[:11], CAPTURES / "crafted" / "ip-headers.pcapng"]
    out = run(capfdbinary, "analyze", "--per-file", *files).out.splitlines()
    rows = [line.split() for line in out[1:-2]]
    assert len(rows) == len(files)
    told = json.loads(run(capfdbinary, "analyze", *files, "-T", "json").out)
    names = out[0].replace("no answer", "no_answer").split()[1:]
    total = dict(zip(names, [0 if cell == "." else int(cell) for cell in out[-2].split()[2:]], strict=False))
    assert total["packets"] == told["packets"]["read"]
    assert total["transactions"] == told["transactions"]["total"]
    assert total["errors"] == told["transactions"]["with_errors"]
    assert total["connections"] == len(told["connections"])
    found = sum(told["findings"].values())
    assert total["error"] + total["warning"] + total["note"] == found > len(told["finding_details"])
    out = run(capfdbinary, "analyze", "--per-file", "-Y", "connection == 1", *files).out.splitlines()
    told = json.loads(run(capfdbinary, "analyze", "-Y", "connection == 1", *files, "-T", "json").out)
    cells = [0 if cell == "." else int(cell) for cell in out[-2].split()[2:]]
    assert sum(cells[-3:]) == len(told["finding_details"])  # of the others it is not known whether they are selected


def test_findings_beyond_the_details_are_counted_where_they_are(tmp_path: Path) -> None:
    """The first file has more of one kind than are detailed, the second one more of them."""
    talk = begun()
    for number in range(1, MAX_DETAILED + 6):
        read_item(talk, number, WORD, 0x0A)
    packets = list(talk.packets())
    paths = [saved(tmp_path / "1.pcapng", packets[:-4]), saved(tmp_path / "2.pcapng", packets[-4:])]
    rows = PerFile()
    both = Run([str(path) for path in paths], rows)
    rows.files = both.files
    while both.step():
        pass
    assert len(list(rows.lines())) == 5
    assert [rows.of(index).findings["warning"] for index in (0, 1)] == [MAX_DETAILED + 3, 2]


def test_what_happens_in_a_file_is_counted_there() -> None:
    paths = [CAPTURES / name for name in ("szl.pcapng", "item-errors.pcapng")]
    rows = PerFile()
    both = Run(paths, rows)
    rows.files = both.files
    while both.step():
        pass
    for index, path in enumerate(paths):
        alone = PerFile()
        one = Run([path], alone)
        alone.files = one.files
        while one.step():
            pass
        for name in ("connections", "transactions", "errors", "missed", "findings"):
            assert getattr(rows.of(index), name) == getattr(alone.of(0), name)


def test_forms_that_exclude_each_other(capfdbinary: Capture) -> None:
    path: Path = CAPTURES / "szl.pcapng"
    for options in (("--brief", "-T", "json"), ("--per-file", "-T", "json"), ("--brief", "--per-file")):
        ran = run(capfdbinary, "analyze", path, *options)
        assert (ran.code, ran.out) == (2, "")
        assert options[0] in ran.err
    assert run(capfdbinary, "analyze", path, "--brief", "--fail-on", "note").code == 1
    assert run(capfdbinary, "analyze", path, "--per-file", "--fail-on", "note").code == 1
