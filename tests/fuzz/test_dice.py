"""Targets fed by the throw of dice."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from tests.fuzz import __main__ as runner
from tests.fuzz import dice
from tests.fuzz.dice import corpus_of, throw


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
    assert thrown.kinds == 1
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
