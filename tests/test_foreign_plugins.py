"""Plugins of pytest that are installed for something else change no run of these tests."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Final

import pytest

from tests.foreign import install
from tests.test_make import ROOT, commands

#: Warns when it is configured, as one for asynchronous tests does, and warnings are errors here; leaves one test, and stops a
#: fixture of all.
MEDDLING: Final = """
import warnings
import pytest

def pytest_configure(config):
    warnings.warn(pytest.PytestDeprecationWarning("an option of mine is unset"))

def pytest_collection_modifyitems(items):
    del items[1:]

@pytest.fixture(autouse=True)
def _meddling():
    raise RuntimeError("a foreign fixture")
"""
#: Was installed without what it needs.
BROKEN: Final = "import a_module_that_is_missing\n"
#: A file with few tests that need little.
TRIED: Final = "tests/wire/test_hexdump.py"


def run(site: Path, folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """Run pytest where foreign plugins are installed, in an environment that does not forbid them."""
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTEST_")}
    environment["PYTHONPATH"] = os.pathsep.join(filter(None, [environment.get("PYTHONPATH"), str(site)]))
    command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", *words]
    return subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, check=False, timeout=120
    )


def options(target: str) -> list[str]:
    """Return the options of a target of make, without the files that it chooses."""
    (first, *_) = commands(target)
    return [word for word in first if not word.startswith(("tests", "--ignore"))]


@pytest.mark.parametrize("chosen", ["test-installed", "test-interpreted", "-n 2"])
def test_foreign_plugins_do_no_harm(tmp_path: Path, chosen: str) -> None:
    words = options(chosen) if chosen.startswith("test-") else chosen.split()
    ran = run(install(tmp_path, meddling=MEDDLING, broken=BROKEN), ROOT, *words, TRIED)
    assert ran.returncode == 0, ran.stdout + ran.stderr
    assert " 6 passed in " in ran.stdout


@pytest.mark.parametrize(("name", "source"), [("meddling", MEDDLING), ("broken", BROKEN)])
def test_elsewhere_they_would_be_loaded(tmp_path: Path, name: str, source: str) -> None:
    folder = tmp_path / "elsewhere"
    folder.mkdir()
    (folder / "test_nothing.py").write_text("def test_nothing():\n    pass\n", encoding="utf-8")
    ran = run(install(tmp_path, **{name: source}), folder, "-W", "error")
    assert ran.returncode != 0
    assert "an option of mine is unset" in ran.stdout + ran.stderr or "a_module_that_is_missing" in ran.stderr
