"""Outputs that are no regular file, and outputs that have no room, for every command that writes one."""

from __future__ import annotations

import os
import resource
import stat
import subprocess
import sys
import threading
from pathlib import Path
from typing import Final

import pytest

from tests.cli.support import WITHOUT_CACHE, run, simple
from tests.meaning.report.schemas import ROOT

Capture = pytest.CaptureFixture[bytes]
PLANT: Final = str(ROOT / "captures" / "scd" / "plant.toml")
#: A call of every command that writes a file and ends by itself; all of them may overwrite.
CALLS: Final = {
    "golden": "golden GOOD -o OUT --force",
    "cut": "cut GOOD -o OUT --force",
    "anonymize": "anonymize GOOD -o OUT --force",
    "baseline": "baseline GOOD -o OUT",
    "compile": "scd compile PLANT -o OUT --force",
}


def words_of(name: str, folder: Path, out: Path) -> list[str]:
    files = {"GOOD": str(simple(folder / "good.pcapng")), "OUT": str(out), "PLANT": PLANT}
    return [files.get(word, word) for word in CALLS[name].split()]


def content(name: str, capfdbinary: Capture, tmp_path: Path) -> bytes:
    """Return what a command writes to a file that is not there yet."""
    out = tmp_path / "plain"
    assert run(capfdbinary, *words_of(name, tmp_path, out)).code == 0
    return out.read_bytes()


@pytest.mark.parametrize("name", CALLS)
def test_a_fifo_is_written_to_and_stays(capfdbinary: Capture, tmp_path: Path, name: str) -> None:
    fifo = tmp_path / "fifo"
    os.mkfifo(fifo)
    came: list[bytes] = []
    reader = threading.Thread(target=lambda: came.append(fifo.read_bytes()), daemon=True)
    reader.start()
    ran = run(capfdbinary, *words_of(name, tmp_path, fifo))
    assert (ran.code, stat.S_ISFIFO(fifo.stat().st_mode)) == (0, True), ran.err
    reader.join(30)
    assert len(came[0]) == len(content(name, capfdbinary, tmp_path))
    assert not list(tmp_path.glob("*.part"))


@pytest.mark.parametrize("name", sorted(set(CALLS) - {"baseline"}))  # which overwrites only what it updates
def test_a_link_stays_and_its_target_is_replaced(capfdbinary: Capture, tmp_path: Path, name: str) -> None:
    target = tmp_path / "target"
    target.write_bytes(b"before")
    link = tmp_path / "link"
    link.symlink_to("target")
    ran = run(capfdbinary, *words_of(name, tmp_path, link))
    assert (ran.code, link.is_symlink()) == (0, True), ran.err
    assert len(target.read_bytes()) == len(content(name, capfdbinary, tmp_path))


@pytest.mark.parametrize("name", CALLS)
def test_no_room_is_code_5_in_one_line_and_leaves_nothing(tmp_path: Path, name: str) -> None:
    out = tmp_path / "out"
    words = words_of(name, tmp_path, out)
    hard = resource.getrlimit(resource.RLIMIT_FSIZE)[1]
    ended = subprocess.run(
        [sys.executable, "-m", "dissect", *words],
        capture_output=True, check=False, timeout=60, env=WITHOUT_CACHE,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (16, hard)),
    )  # fmt: skip
    assert (ended.returncode, ended.stderr.decode()) == (5, f"s7dissect: cannot write {out}: File too large\n")
    assert [path.name for path in tmp_path.iterdir()] == ["good.pcapng"]


@pytest.mark.parametrize(
    "words",
    [
        "golden BAD -o OUT",
        "cut BAD -o OUT",
        "anonymize BAD -o OUT",
        "baseline BAD -o OUT",
        "report BAD -o OUT",
        "export BAD -o OUT.csv",
    ],
)
@pytest.mark.parametrize(("folder", "why"), [("none", "No such file or directory"), ("bad.pcapng", "Not a directory")])
def test_an_output_without_a_folder_is_told_before_anything_is_read(
    capfdbinary: Capture, tmp_path: Path, words: str, folder: str, why: str
) -> None:
    bad = tmp_path / "bad.pcapng"
    bad.write_bytes(b"no capture")
    out = str(tmp_path / folder / "out")
    ran = run(capfdbinary, *[word.replace("OUT", out).replace("BAD", str(bad)) for word in words.split()])
    assert (ran.code, ran.out) == (2, "")
    assert why in ran.err
    assert out in ran.err
    assert list(tmp_path.iterdir()) == [bad]


@pytest.mark.parametrize("name", CALLS)
def test_an_output_without_a_name_is_wrong_use(
    capfdbinary: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    monkeypatch.chdir(tmp_path)
    words = [word if word != str(tmp_path / "out") else "" for word in words_of(name, tmp_path, tmp_path / "out")]
    ran = run(capfdbinary, *words)
    assert (ran.code, ran.out) == (2, "")
    assert ran.err == "s7dissect: OUT: the name is empty; was a variable of the shell not set?\n"
