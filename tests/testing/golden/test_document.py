"""docs/golden.md: its example is a golden, its table is the program's, its program runs."""

from __future__ import annotations

import re

import pytest

from dissect.testing.golden import golden_text, parse_golden
from dissect.testing.golden.difference import KINDS
from tests.testing.golden.support import ROOT

TEXT = (ROOT / "docs" / "golden.md").read_text(encoding="utf-8")


def block(language: str) -> str:
    found = re.search(rf"```{language}\n(.*?)```", TEXT, re.DOTALL)
    assert found is not None
    return found[1]


def test_the_example_is_written_as_it_stands() -> None:
    assert golden_text(parse_golden(block("s7"))) == block("s7")


def test_everything_that_can_be_ignored_is_listed() -> None:
    assert dict(re.findall(r"^\| `([a-z]+)` \| (.*) \|$", TEXT, re.MULTILINE)).items() >= KINDS.items()


def test_the_program_runs(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(ROOT)
    exec(block("python"), {})
    assert "DB1.DBB0" in capfd.readouterr().out
