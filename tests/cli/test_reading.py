"""How captures are read is one thing for all commands and for the library."""

from __future__ import annotations

import ast
import json
from typing import Final

import pytest

import dissect
from dissect.cli.main import COMMANDS
from tests.cases import each
from tests.cli.support import run
from tests.meaning.report.schemas import ROOT

Capture = pytest.CaptureFixture[bytes]

CAPTURES: Final = ROOT / "captures"
TWO: Final = (str(CAPTURES / "read-areas.pcapng"), str(CAPTURES / "write-areas-python.pcapng"))
TRANSFER: Final = str(CAPTURES / "transfer.pcapng")


@each("where", ["frame <= 20", "time in {..+0.005s}", "connection == 2"])
def test_the_library_selects_values_as_the_command_does(capfdbinary: Capture, where: str) -> None:
    """The packets of several files are numbered in each, times count from the first packet of all."""
    told = [json.loads(line) for line in run(capfdbinary, "values", "-T", "jsonl", "-Y", where, *TWO).out.splitlines()]
    rows = [(row.connection, row.how, row.address, row.data) for row in dissect.values(*TWO, where=where)]
    assert rows
    assert rows == [(one["connection"], one["how"], one["address"], bytes.fromhex(one["octets"])) for one in told]


@each("where", ["time in {..+10s}", "time in {..+0.001s}", "frame <= 20", "kind == upload"])
def test_the_library_selects_blocks_as_the_command_does(capfdbinary: Capture, where: str) -> None:
    told = json.loads(run(capfdbinary, "blocks", "-T", "json", "-Y", where, TRANSFER).out)["blocks"]
    found = dissect.blocks(TRANSFER, where=where)
    assert [(one.label, one.direction, one.operation and int(one.operation.number)) for one in found] == [
        (one["label"], one["direction"], one["operation"]) for one in told
    ]
    if where == "time in {..+10s}":
        assert len(found) == 4


#: How captures are read: what a command whose options make a `Reading` leaves to that.
OF_READING: Final = frozenset(
    ("check_jobs", "current", "drive", "indexed_option", "may_match", "separate_options", "separately")
)


def test_no_command_knows_how_captures_are_read() -> None:
    """Of those that get a `Reading`, which are all that select from captures, none asks or says it once more."""
    reading = set()
    for name in COMMANDS:
        tree = ast.parse((ROOT / "dissect" / "cli" / f"{name.replace('-', '_')}.py").read_text(encoding="utf-8"))
        names = {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}
        if "reading_options" in names:
            reading.add(name)
            assert names.isdisjoint(OF_READING), (name, names & OF_READING)
    assert reading >= {
        "analyze", "transactions", "values", "operations", "blocks", "devices", "show", "report", "sql", "open", "cut",
        "export", "baseline", "golden", "diff", "verify",
    }  # fmt: skip
