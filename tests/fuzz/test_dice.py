"""Targets fed by the throw of dice."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.fuzz import __main__ as runner
from tests.fuzz import dice
from tests.fuzz.dice import ROUND, Notes, Thrown, corpus_of, rounds, throw
from tests.fuzz.turns import Turns
from tests.meaning.report.support import ROOT


def test_seeds_come_first_and_the_same_seed_does_the_same(tmp_path: Path) -> None:
    runs = []
    for seed in (1, 1, 2):
        taken: list[bytes] = []
        thrown = throw("any", taken.append, [b"one", b"two", b"much too long"], 8, 0.0, seed, tmp_path)
        assert thrown.executions == len(taken) == 50
        assert taken[:2] == [b"one", b"two"]
        assert max(map(len, taken)) <= 8
        assert len(set(taken)) > 20
        runs.append(taken)
    assert runs[0] == runs[1] != runs[2]


def test_what_fails_is_kept_once_for_each_kind(tmp_path: Path) -> None:
    def picky(octets: bytes) -> None:
        if octets != b"good":
            raise KeyError(octets)

    thrown = throw("picky", picky, [b"good"], 8, 0.0, 0, tmp_path)
    assert [kind.split(":")[0] for kind in thrown.kinds] == ["KeyError in test_dice.py"]
    assert len(list(tmp_path.glob("picky-*.bin"))) == 1
    assert "picky: 50 executions in " in thrown.line("picky", 0)
    assert "1 kinds of failure; seed 0" in thrown.line("picky", 0)


def test_a_corpus_is_read_in_order(tmp_path: Path) -> None:
    for name in ("b", "a"):
        (tmp_path / name).write_bytes(name.encode())
    assert corpus_of(tmp_path) == [b"a", b"b"]
    assert corpus_of(tmp_path / "none") == corpus_of(None) == []


def test_the_runner_starts_it_where_the_installed_package_is_found_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """What is installed where tests of the tree run may be an older version, so the line that it is given runs here."""
    (tmp_path / "streams").mkdir()
    (tmp_path / "streams" / "one").write_bytes(b"\x03\x00\x00\x07\x02\xf0\x80")
    monkeypatch.setenv("PYTHONPATH", "of the tree")

    def run(arguments: list[str], cwd: Path, env: dict[str, str], check: bool) -> subprocess.CompletedProcess[bytes]:
        assert arguments[1:3] == ["-P", "-c"]
        assert (cwd / "tests" / "fuzz").is_dir()
        assert "PYTHONPATH" not in env
        assert not check
        return subprocess.CompletedProcess(arguments, dice.main(arguments[4:]))

    monkeypatch.setattr(subprocess, "run", run)
    arguments = ["streams", "--installed", "--seconds", "0", "--seed", "7", "--artifacts", str(tmp_path / "found")]
    assert runner.main([*arguments, "--corpus", str(tmp_path)]) == 0
    said = capsys.readouterr().out
    assert said.startswith("streams: ")
    assert said.endswith("0 kinds of failure; seed 7\n")


def _counted(name: str, target: object, begun: object, *_: object) -> Thrown:
    raise AssertionError("a round that is noted runs again")


def test_a_long_run_goes_on_after_the_rounds_that_are_noted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Rounds have inputs of their own, which are the same in whatever order and process they run."""
    file = tmp_path / "done"

    def run(count: int, jobs: int = 1, seed: int = 3, noted: Path | None = file) -> Thrown:
        return rounds("streams", count, seed, tmp_path / "found", None, jobs, Notes(noted, "streams", seed), 40)

    first = run(1)
    assert first.executions >= 40  # the seeds, or as many as a round has
    assert (first.kinds, len(file.read_text().splitlines())) == ((), 1)
    with file.open("a") as cut:
        cut.write('{"target": "streams", "se')  # stopped while it wrote
    file.write_text(file.read_text() + "\n")
    assert run(3, 2).executions == first.executions + 80
    assert sorted(Notes(file, "streams", 3).done()) == [0, 1, 2]
    assert not Notes(file, "streams", 4).done()
    assert not Notes(file, "pdus", 3).done()
    monkeypatch.setattr(dice, "throw", _counted)
    again = run(3, 2)
    assert again.executions == first.executions + 80
    assert again.longest_s > 0
    with pytest.raises(AssertionError, match="noted runs again"):
        run(1, seed=4)


def test_rounds_differ_and_each_is_always_the_same(tmp_path: Path) -> None:
    def round_of(number: int) -> list[bytes]:
        taken: list[bytes] = []
        throw("any", taken.append, [b"one", b"two"], 8, 0.0, 1, tmp_path, number)
        return taken

    assert ROUND == len(round_of(0)) == len(round_of(1))
    assert round_of(0)[:2] == [b"one", b"two"]
    assert round_of(1) == round_of(1) != round_of(2)
    assert round_of(1)[:2] != [b"one", b"two"]


def test_all_targets_have_their_share_of_a_long_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert tuple(runner.SHARES) == runner.NAMES
    given: dict[str, int] = {}

    def run(arguments: list[str], cwd: Path, env: dict[str, str], check: bool) -> subprocess.CompletedProcess[bytes]:
        given[arguments[4]] = int(arguments[arguments.index("--executions") + 1])
        assert arguments[arguments.index("--done") + 1] == str(tmp_path / "done")
        return subprocess.CompletedProcess(arguments, 1 if arguments[4] == "plus" else 0)

    monkeypatch.setattr(subprocess, "run", run)
    wanted = ["all", "--installed", "--executions", "1000000", "--jobs", "2", "--done", str(tmp_path / "done")]
    assert runner.main(wanted) == 1
    assert tuple(given) == runner.NAMES
    assert 1_000_000 <= sum(given.values()) < 1_000_010


def test_make_finds_the_tests() -> None:
    """The recipe forbids the current folder on the path, as all recipes do, and has to name it."""
    python = Path(sys.prefix)
    asked = ["make", "-n", "-o", "test-environment", f"VENV={python}", "fuzz-installed"]
    told = subprocess.run(asked, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    (recipe,) = [line for line in told.splitlines() if "-m tests.fuzz" in line]
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"} | {"PYTHONSAFEPATH": "1"}
    done = subprocess.run(
        [f"{recipe} --help"], shell=True, cwd=ROOT, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert "--executions" in done.stdout


def test_in_turns_one_thing_is_made_of_an_input_and_all_of_many() -> None:
    turns = Turns()
    inputs = [bytes((first, second)) for first in range(16) for second in range(16)]
    assert all(turns.has(octets, number, 4) for octets in inputs for number in range(4))
    turns.one = True
    made = [[number for number in range(4) if turns.has(octets, number, 4)] for octets in inputs]
    assert {len(numbers) for numbers in made} == {1}
    assert {number for numbers in made for number in numbers} == set(range(4))
