from __future__ import annotations

import csv
import io
import json
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from tests.cli.support import run, simple
from tests.meaning.report.schemas import complaints
from tests.meaning.report.support import begun, of_files, read, report, saved
from tests.properties.packets import MS

if TYPE_CHECKING:
    from tests.conftest import Command

Capture = pytest.CaptureFixture[bytes]


def test_text_is_the_report(capfdbinary: Capture, tmp_path: Path) -> None:
    path = simple(tmp_path / "a.pcapng")
    ran = run(capfdbinary, "analyze", path)
    assert ran.out.split("\n")[:-1] == report(of_files(path))


def test_json_is_the_contract(s7dissect: Command, tmp_path: Path) -> None:
    path = simple(tmp_path / "a.pcapng")
    ran = s7dissect("analyze", "-T", "json", path)
    told = json.loads(ran.stdout)
    assert complaints("analysis", told, exact=True) == []
    assert ran.stdout.isascii()
    assert told["files"][0]["name"] == str(path)
    assert told["interrupted"] is False
    assert told["transactions"] == {
        "total": 4,
        "answered": 4,
        "unanswered": 0,
        "orphan_answers": 0,
        "unsolicited": 0,
        "one_way": 0,
        "still_open": 0,
        "with_errors": 1,
        "unanswered_reasons": {},
    }


@pytest.mark.parametrize(("limit", "found"), [("0", 2), ("0.5", 2), ("29", 1), ("30", 0), ("1000", 0)])
def test_what_is_slow_is_for_the_user_to_say(capfdbinary: Capture, tmp_path: Path, limit: str, found: int) -> None:
    packets = read(begun(), 1).packets()
    packets[-1] = packets[-1]._replace(time_ns=packets[-1].time_ns + 29 * MS)
    path = saved(tmp_path / "slow.pcapng", packets)
    told = json.loads(run(capfdbinary, "analyze", "-T", "json", "--slow", limit, path).out)
    assert told["findings"].get("transaction.slow", 0) == found


@pytest.mark.parametrize("limit", ["-1", "nan", "inf", "1e10", "soon", ""])
@pytest.mark.parametrize("command", ["analyze", "transactions"])
def test_a_limit_that_is_none_is_wrong_use(capfdbinary: Capture, tmp_path: Path, command: str, limit: str) -> None:
    ran = run(capfdbinary, command, "--slow", limit, simple(tmp_path / "a.pcapng"))
    assert (ran.code, ran.out) == (2, "")
    assert "Invalid value for '--slow'" in ran.err


def test_without_slow_a_second_is_the_limit(capfdbinary: Capture, tmp_path: Path) -> None:
    packets = read(read(begun(), 1), 2).packets()
    packets[-1] = packets[-1]._replace(time_ns=packets[-1].time_ns + 1000 * MS)
    path = saved(tmp_path / "slow.pcapng", packets)
    told = json.loads(run(capfdbinary, "analyze", "-T", "json", path).out)
    assert told["findings"] == {"transaction.slow": 1}


def test_analysis_agrees_with_transactions_and_show(capfdbinary: Capture, corpus: Path) -> None:
    for path in sorted(corpus.glob("*.pcap*")):
        told = json.loads(run(capfdbinary, "analyze", "-T", "json", path).out)
        for face in ("text", "jsonl"):
            lines = run(capfdbinary, "transactions", "-T", face, path).out.count("\n")
            assert lines == told["transactions"]["total"], path.name
        rows = list(csv.DictReader(io.StringIO(run(capfdbinary, "transactions", "-T", "csv", path).out)))
        assert len({row["number"] for row in rows}) == told["transactions"]["total"], path.name
        shown = run(capfdbinary, "show", "-T", "jsonl", path).out
        pdus = [line for line in shown.splitlines() if '"protocol":"cotp"' not in line]
        assert len(pdus) == told["s7"]["pdus"] + told["s7plus"]["pdus"], path.name


def test_help_says_what_a_person_needs(capfdbinary: Capture) -> None:
    told = run(capfdbinary, "analyze", "--help").out
    for word in ("FILE", "pcapng", "gzip", "standard input", "--slow MS", "1000", "Exit code:", "130"):
        assert word in told
