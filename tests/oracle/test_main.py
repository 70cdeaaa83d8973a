"""The comparison from the command line."""

from __future__ import annotations

from pathlib import Path
from random import Random

import pytest
from click.testing import CliRunner, Result

from dissect.oracle import __main__ as program
from dissect.oracle.compare import Comparison, Difference
from dissect.oracle.facts import PDU
from tests.oracle.traffic import conversation, write_capture


def run(*arguments: str) -> Result:
    return CliRunner().invoke(program.main, arguments)


def test_all_is_explained(tmp_path: Path) -> None:
    path = str(write_capture(tmp_path / "made.pcap", conversation(Random(3), 1)))
    ran = run(path, path)
    assert ran.exit_code == 0
    first, second, total, *known = ran.output.splitlines()
    assert first == second
    assert first.startswith(f"{path}: ")
    assert total.startswith("2 captures, ")
    assert total.endswith("; 0 differences not explained")
    assert all(int(line.split()[0]) % 2 == 0 for line in known)


def test_what_is_not_explained_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def compare(path: str, read: object, reorder: bool) -> Comparison:
        comparison = Comparison()
        comparison.differences = [Difference(PDU, 3, "s7comm.header.pduref", 1, 2, "")]
        return comparison

    monkeypatch.setattr(program, "compare", compare)
    ran = run(str(tmp_path))
    assert ran.exit_code == 1
    assert "  frame 3 PDU s7comm.header.pduref: ours 1 (0x01), theirs 2 (0x02) (not explained)\n" in ran.output
    assert "; 1 differences not explained" in ran.output


@pytest.mark.parametrize("name", ["nothing.pcap", "text.pcap"])
def test_an_unreadable_file(tmp_path: Path, name: str) -> None:
    (tmp_path / "text.pcap").write_text("this is no capture")
    ran = run(str(tmp_path / name))
    assert ran.exit_code == 2
    assert "s7dissect: " in ran.output
