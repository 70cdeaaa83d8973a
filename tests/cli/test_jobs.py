"""-j: how many processes there may be, and that they read files which stand for themselves."""

from __future__ import annotations

from typing import Final

import pytest

from tests.cases import each
from tests.cli.support import run
from tests.meaning.report.schemas import ROOT

Capture = pytest.CaptureFixture[bytes]

SZL: Final = str(ROOT / "captures" / "szl.pcapng")


@each(("jobs", "why"), [
    ("0", "0 processes can do nothing"), ("-3", "-3 processes"), ("65", "65 is too many, there are 64 processors here"),
    ("many", "expected a number of processes or auto, got 'many'"), ("1.5", "got '1.5'"),
])  # fmt: skip
def test_a_wrong_number_is_one_line(capfdbinary: Capture, monkeypatch: pytest.MonkeyPatch, jobs: str, why: str) -> None:
    monkeypatch.setattr("dissect.cli.options.jobs.processors", lambda: 64)
    ran = run(capfdbinary, "transactions", "--separate", SZL, "-j", jobs)
    assert (ran.code, ran.out) == (2, "")
    assert why in ran.err.splitlines()[-1]


def test_one_run_is_one_process(capfdbinary: Capture, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("dissect.cli.options.jobs.processors", lambda: 64)
    for command in ("analyze", "devices", "transactions", "values", "verify"):
        ran = run(capfdbinary, command, SZL, "-j", "2")
        assert (ran.code, ran.out) == (2, "")
        assert "-j reads several files at the same time, and needs --separate" in ran.err
