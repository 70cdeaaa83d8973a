"""How captures are read is one thing for all commands and for the library."""

from __future__ import annotations

import json
from typing import Final

import pytest

import dissect
from tests.cases import each
from tests.cli.support import run
from tests.report.schemas import ROOT

Capture = pytest.CaptureFixture[bytes]

CAPTURES: Final = ROOT / "captures"
TWO: Final = (str(CAPTURES / "read-areas.pcapng"), str(CAPTURES / "write-areas-python.pcapng"))
TRANSFER: Final = str(CAPTURES / "transfer.pcapng")


@each("where", ["frame <= 20", "time in {..+0.005s}", "error", "connection == 2"])
def test_the_library_selects_values_as_the_command_does(capfdbinary: Capture, where: str) -> None:
    """The packets of several files are numbered in each, times count from the first packet of all."""
    told = run(capfdbinary, "values", "-T", "jsonl", "-Y", where, *TWO).out.splitlines()
    rows = list(dissect.values(*TWO, where=where))
    assert len(rows) == len(told)


@each("where", ["time in {..+10s}", "time in {..+0.001s}", "frame <= 20", "kind == upload"])
def test_the_library_selects_blocks_as_the_command_does(capfdbinary: Capture, where: str) -> None:
    told = json.loads(run(capfdbinary, "blocks", "-T", "json", "-Y", where, TRANSFER).out)["blocks"]
    found = dissect.blocks(TRANSFER, where=where)
    assert len(found) == len(told)
    if where == "time in {..+10s}":
        assert len(found) == 4
