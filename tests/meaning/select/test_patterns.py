"""Regular expressions that would never end are refused; those that people write are not."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from dissect.meaning.select.patterns import takes_too_long
from tests.cli.support import run, simple


@pytest.mark.parametrize(
    "pattern",
    [
        "(a+)+$",
        "(a*)*",
        "(a|a)*b",
        "(.*)*x",
        "([a-z]+)*=",
        "(?:a+){50}",
        "(a?){100}",
        "(\\w+\\s?)*$",
        "((a+)b?)+$",
        ".*a.*b.*c.*d",
        "(?=(a+)+$)",
        "(x)?(?(1)(a+)+|b)$",
        "(?>(a+)+)$",
    ],
)
def test_refused(pattern: str) -> None:
    re.compile(pattern)
    assert takes_too_long(pattern)


@pytest.mark.parametrize(
    "pattern",
    [
        "^security",
        "DB[0-9]+",
        "stop|start",
        "(foo|bar)+",
        "(\\d{1,3}\\.){3}\\d{1,3}",
        ".*",
        ".*tank.*level",
        "^(DB|M)\\d+\\.?",
        "[a-z]+_\\d*$",
        "(ab)+c",
        "",
        "(?i:read) .{0,20}var",
    ],
)
def test_taken(pattern: str) -> None:
    re.compile(pattern)
    assert not takes_too_long(pattern)


def test_it_is_told_where(capfdbinary: pytest.CaptureFixture[bytes], tmp_path: Path) -> None:
    path = simple(tmp_path / "a.pcapng")
    ran = run(capfdbinary, "transactions", path, "-Y", 'calling_tsap matches "(a+)+$"')
    assert ran.code == 2
    assert "this regular expression may take forever" in ran.err
