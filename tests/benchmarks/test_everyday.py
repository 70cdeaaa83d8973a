"""The table of everyday lines and commands: each pair is measured in turn, and what misses its bar is told by the exit code."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from benchmarks.everyday import Meter, Row, Side, captures, measure, rows
from benchmarks.links import KINDS

if TYPE_CHECKING:
    import pytest


class Scripted(Meter):
    """Notes what it was asked to run; costs are the packets in the name of the capture."""

    def __init__(self) -> None:
        super().__init__([], Path(), instructions=False)
        self.asked: list[str] = []

    def _once(self, words: tuple[str, ...], path: Path) -> float:  # type: ignore[override]
        self.asked.append(f"{words[0]} {path.name}")
        return float(path.name.split(".")[0].split("-")[0])


def test_a_row_is_measured_in_turn_and_less_its_start() -> None:
    meter = Scripted()
    row = Row("golden", Side(("golden",), Path("100.pcap"), Path("10.pcap")), Side(("analyze",), Path("40.pcap")), 2)
    assert measure(meter, row, 2) == (90.0, 40.0)
    assert meter.asked == ["golden 100.pcap", "golden 10.pcap", "analyze 40.pcap"] * 2


def test_there_is_a_row_for_every_link_and_a_capture_for_every_row(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    made = captures(tmp_path, 600)
    capsys.readouterr()
    found = rows(made, made["few"])
    assert [row.label for row in found[: len(KINDS) - 1]] == [f"analyze, {kind}" for kind in KINDS if kind != "plain"]
    for row in found:
        for side in (row.one, row.other):
            assert side.path.exists()
            assert side.few is None or side.few.exists()
    assert captures(tmp_path, 600) == made
    assert capsys.readouterr().err == ""
