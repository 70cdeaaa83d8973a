"""`s7dissect operations`: text, JSON lines held to the schema, kinds, the gate, several files."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Final

import pytest

from tests.cases import each
from tests.cli.support import run
from tests.meaning.report.schemas import ROOT, complaints

Capture = pytest.CaptureFixture[bytes]

TRANSFER: Final = ROOT / "captures" / "transfer.pcapng"
PASSWORD: Final = ROOT / "captures" / "password.pcapng"
#: Captures with operations of every kind between them.
ALL: Final = sorted((ROOT / "captures").glob("*.pcapng")) + sorted((ROOT / "captures" / "crafted").glob("*.pcapng"))


def test_text(capfdbinary: Capture) -> None:
    lines = run(capfdbinary, "operations", TRANSFER).out.splitlines()
    assert [line[30:].split()[:2] for line in lines] == [
        ["#1", "1→9"],
        ["#2", "10→15"],
        ["#3", "16→23"],
        ["#4", "24→25"],
        ["#5", "26→32"],
        ["#6", "33→42"],
        ["#7", "43→45"],
    ]
    assert lines[0].endswith("  connect  PDU 480, AmQ 1/1  done")
    assert lines[2].endswith("  upload  DB 1, active  4 transactions, 636 bytes  done")
    assert lines[3].endswith("  upload  DB 99, active  REFUSED 0xd209 Block not found")


def test_only_some_kinds(capfdbinary: Capture) -> None:
    told = run(capfdbinary, "operations", "-T", "jsonl", "--kind", "upload", "--kind", "connect", TRANSFER).out
    assert [json.loads(line)["kind"] for line in told.splitlines()] == ["connect", "upload", "upload", "upload"]


@each("path", ALL)
def test_every_line_is_as_the_schema_says(capfdbinary: Capture, path: Path) -> None:
    for line in run(capfdbinary, "operations", "-T", "jsonl", path).out.splitlines():
        assert complaints("operation", json.loads(line), exact=True) == []
        assert line.isascii()


def test_several_files_name_their_packets(capfdbinary: Capture) -> None:
    told = run(capfdbinary, "operations", "-T", "jsonl", TRANSFER, PASSWORD).out
    ends = [json.loads(line) for line in told.splitlines()]
    assert {Path(one["first_file"]).name for one in ends} == {"transfer.pcapng", "password.pcapng"}
    assert [one["first_frame"] for one in ends if one["kind"] == "connect"] == [1, 1]
    assert all(complaints("operation", one, exact=True) == [] for one in ends)


def test_no_password_is_shown(capfdbinary: Capture) -> None:
    told = run(capfdbinary, "operations", PASSWORD).out
    assert "  password  done" in told
    assert "secret" not in told.lower()


def test_the_gate(capfdbinary: Capture) -> None:
    assert run(capfdbinary, "operations", "--fail-on", "security.program_change", TRANSFER).code == 1
    assert run(capfdbinary, "operations", "--fail-on", "operation.*", TRANSFER).code == 0
