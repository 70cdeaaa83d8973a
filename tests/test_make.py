"""What `make test` runs: every test once with the wheel, those of the engine once more on the sources."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
from collections import Counter
from pathlib import Path
from typing import Final

import pytest

ROOT: Final = Path(__file__).resolve().parent.parent
#: Files that hold tests.
FILES: Final = frozenset((ROOT / "tests").rglob("test_*.py"))

#: Rooms in wings of the engine that are tested with the wheel only, but for what is skipped there.
WITH_THE_WHEEL: Final = ("wire/config", "engine/acts", "engine/program", "engine/stations")
#: What tests the engine itself.
PLACES: Final = (
    *(
        "wire",
        "packets/source",
        "packets/tcp",
        "protocols/iso",
        "protocols/s7",
        "engine",
        "meaning/report",
        "properties",
    ),
    *("test_session.py", "test_leaving.py", "test_sources.py"),
)


def commands(target: str) -> list[list[str]]:
    """Return what make starts pytest with for a target, without doing it."""
    environment = {name: value for name, value in os.environ.items() if not name.startswith(("MAKE", "MFLAGS"))}
    told = subprocess.run(
        ["make", "-n", "--no-print-directory", target],
        cwd=ROOT,
        env=environment,
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    return [shlex.split(line.partition("/bin/pytest ")[2]) for line in told.splitlines() if "/bin/pytest " in line]


def chosen(words: list[str]) -> set[Path]:
    """Return the files of tests that a command chooses."""

    def below(names: list[str]) -> set[Path]:
        paths = [ROOT / name for name in names]
        assert [str(path) for path in paths if not path.exists()] == []
        return {file for file in FILES if any(file.is_relative_to(path) for path in paths)}

    return below([word for word in words if word.startswith("tests")]) - below(
        [word.partition("=")[2] for word in words if word.startswith("--ignore=")]
    )


@pytest.mark.parametrize("target", ["test-installed", "test-interpreted"])
def test_no_file_is_in_two_parts_and_no_part_is_empty(target: str) -> None:
    parts = [chosen(words) for words in commands(target)]
    assert len(parts) > 1
    assert all(parts)
    assert [file for file, count in Counter(file for part in parts for file in part).items() if count > 1] == []


def test_every_file_is_tested_with_the_wheel() -> None:
    assert set().union(*map(chosen, commands("test-installed"))) == FILES


def uncompiled() -> set[Path]:
    """Return the files of which something is tested on the sources only."""
    tested = re.compile(r"skipif\(COMPILED,|skip\(\"compiled constants")
    return {file for file in FILES if tested.search(file.read_text(encoding="utf-8"))}


def test_what_is_skipped_when_compiled_is_tested_on_the_sources() -> None:
    files = set().union(*map(chosen, commands("test-interpreted")))
    assert len(uncompiled()) > 4
    assert uncompiled() - files == set()


def test_the_engine_is_tested_on_its_sources_too() -> None:
    files = set().union(*map(chosen, commands("test-interpreted")))
    rooms = {place for file in files - uncompiled() for place in PLACES if file.is_relative_to(ROOT / "tests" / place)}
    assert rooms == set(PLACES)
    inside = {file for file in FILES if any(file.is_relative_to(ROOT / "tests" / place) for place in PLACES)}
    inside -= {file for file in inside if any(file.is_relative_to(ROOT / "tests" / room) for room in WITH_THE_WHEEL)}
    assert files - uncompiled() - inside == set()
    left = {file.name for file in inside - files}
    assert all(name.startswith(("test_live_", "test_growing", "test_pcapng_writer", "test_remote")) for name in left)


def test_what_has_a_size_for_a_release_is_run_before_one() -> None:
    sized = re.compile(r"^from tests\.cases import .*\bRELEASE\b", re.MULTILINE)
    (words,) = commands("release-tests")
    assert chosen(words) == {file for file in FILES if sized.search(file.read_text(encoding="utf-8"))}
