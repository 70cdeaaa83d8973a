"""A project of a user of the plugin: its folder, its tests, its runs."""

from __future__ import annotations

import importlib.metadata
import re
import shutil
from pathlib import Path
from typing import Final

import pytest

ROOT: Final = Path(__file__).resolve().parents[2]
#: If the package is installed, pytest finds the plugin by the name of its entry point.
INSTALLED: Final = any(entry.name == "s7dissect" for entry in importlib.metadata.entry_points(group="pytest11"))
PLUGIN: Final = ["-p", "s7dissect" if INSTALLED else "dissect.testing.plugin"]
#: The beginning of a module of tests: a client that disconnects.
CLIENT: Final = """
import contextlib
import snap7

@contextlib.contextmanager
def connected(to):
    client = snap7.client.Client()
    client.connect(to.host, 0, 1, to.port)
    try:
        yield client
    finally:
        client.disconnect()
"""


class Project:
    """An empty folder with an ini file and the capture ``pump`` in tests/captures."""

    def __init__(self, pytester: pytest.Pytester) -> None:
        self.pytester = pytester
        self.path = pytester.path
        self.captures = self.path / "tests" / "captures"
        self.goldens = self.path / "tests" / "goldens"
        self.captures.mkdir(parents=True)
        self.add_capture("multi-items-python", "pump")
        self.ini("")

    def ini(self, text: str) -> None:
        (self.path / "pytest.ini").write_text(f"[pytest]\n{text}\n")

    def add_capture(self, ours: str, name: str) -> Path:
        copied = self.captures / f"{name}.pcapng"
        shutil.copy(ROOT / "captures" / f"{ours}.pcapng", copied)
        return copied

    def test(self, body: str, name: str = "tests/test_pump.py") -> None:
        path = self.path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(body)

    def run(self, *arguments: str) -> pytest.RunResult:
        with pytest.MonkeyPatch.context() as patch:
            patch.delenv("CI", raising=False)  # there pytest says everything twice
            return self.pytester.runpytest_inprocess("-p", "no:cacheprovider", *PLUGIN, *arguments)

    def golden(self, name: str = "test_pump/test_pump") -> Path:
        return self.goldens / f"{name}.s7.txt"

    def listed(self) -> list[str]:
        """Return all files in the folder of goldens."""
        return sorted([one.relative_to(self.goldens).as_posix() for one in self.goldens.rglob("*") if one.is_file()])

    def change(self, was: str, is_: str, name: str = "test_pump/test_pump") -> str:
        """Change a golden at the first ``was``; return its text before."""
        text = self.golden(name).read_text()
        assert was in text
        self.golden(name).write_text(text.replace(was, is_, 1))
        return text


def section(result: pytest.RunResult) -> list[str]:
    """Return the lines of the plugin's section in the summary."""
    found = re.search(r"=+ s7dissect goldens =+\n(.*?)\n(?:=|\d)", result.stdout.str() + "\n", re.DOTALL)
    return found[1].splitlines() if found else []
