"""In CI no test is skipped because something is missing."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.conftest import ROOT
from tests.skips import REASONS, refused

TESTS = """
import pytest
def test_a_tool_is_missing():
    pytest.importorskip("no_such_package")
@pytest.mark.skipif(True, reason="tshark is not installed")
def test_another():
    pass
def test_rights():
    pytest.skip("no network namespace: Operation not permitted")
def test_passes():
    pass
def test_a_program_that_is_not_there():
    import subprocess
    subprocess.run(["tshark"])
def test_something_else_that_is_not_there():
    open("tshark.txt")
"""


@pytest.mark.parametrize(
    ("ci", "expected"), [("1", "3 failed, 1 passed, 1 skipped, 1 error"), ("", "1 failed, 1 passed, 4 skipped")]
)
def test_a_skip_for_a_missing_tool_fails_in_ci(tmp_path: Path, ci: str, expected: str) -> None:
    path = tmp_path / "test_some.py"
    path.write_text(TESTS)
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "CI": ci, "PATH": str(tmp_path)}
    command = [sys.executable, "-m", "pytest", "-q", "-p", "tests.skips", "-p", "no:cacheprovider", str(path)]
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert expected in done.stdout
    if ci:
        assert done.stdout.count("(tests/skips.py): tshark is not installed") == 4  # each also in the summary
    else:
        assert "FileNotFoundError" in done.stdout


def test_the_reasons_are_those_of_tests() -> None:
    """A reason that no test gives any longer leaves the list."""
    texts = "\n".join(
        path.read_text(encoding="utf-8") for path in (ROOT / "tests").rglob("*.py") if path.name != "skips.py"
    )
    texts += (ROOT / "benchmarks" / "soak_line.py").read_text(encoding="utf-8")
    for reason in REASONS:
        assert re.search(reason, texts) or re.search(re.escape(reason), texts) or "(" in reason, reason
    assert refused("no packet socket here: Operation not permitted", {"CI": "1"}) == ""
    assert refused("tshark is not installed", {"CI": "1"})
    assert refused("tshark is not installed", {}) == ""
