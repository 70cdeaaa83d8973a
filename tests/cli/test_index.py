"""`s7dissect index`: a folder of captures at a glance, and which of them can answer a question."""

from __future__ import annotations

import json
import os
import shutil
import sqlite3
from pathlib import Path
from typing import Any

import pytest

import dissect
from dissect.cli.main import EXIT_INTERRUPTED
from dissect.cli.run import drive
from dissect.files.index.facts import FileFacts
from dissect.files.index.lookup import Indexes
from dissect.files.index.place import cached
from dissect.files.index.store import NAME
from dissect.files.session import Run
from tests.cli.support import run
from tests.meaning.report import schemas

CAPTURES = Path(__file__).resolve().parents[2] / "captures"
Capture = pytest.CaptureFixture[bytes]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with four captures, one of them cut, and a file that is none."""
    place = tmp_path / "ring"
    (place / "day 2").mkdir(parents=True)
    for name in ("item-errors.pcapng", "two-clients.pcapng"):
        shutil.copy(CAPTURES / name, place / name)
    shutil.copy(CAPTURES / "crafted" / "refusals.pcapng", place / "day 2" / "refusals.pcapng")
    whole = (CAPTURES / "answer-lost.pcapng").read_bytes()
    (place / "cut.pcapng").write_bytes(whole[:-10])
    return place


def test_each_file_has_what_analyze_says_of_it(capfdbinary: Capture, folder: Path) -> None:
    ran = run(capfdbinary, "index", folder, "-T", "json")
    listed = json.loads(ran.out)
    assert (ran.code, ran.err.count("cut.pcapng: ")) == (3, 1)
    assert ran.err.count("\n") == 1
    assert schemas.complaints("index", listed, exact=True) == []
    assert sorted(listed["update"]["read"]) == [
        "cut.pcapng", "day 2/refusals.pcapng", "item-errors.pcapng", "two-clients.pcapng"
    ]  # fmt: skip
    for file in listed["files"]:
        of: dict[str, Any] = dissect.analyze(folder / file["name"]).as_dict()
        assert file["packets"] == of["packets"]["read"]
        assert (file["first_time"], file["last_time"]) == (of["first_time"], of["last_time"])
        assert file["connections"] == len(of["connections"])
        counts = of["transactions"]
        assert (file["transactions"], file["with_errors"]) == (counts["total"], counts["with_errors"])
        assert file["unanswered"] == counts["unanswered"] - counts["still_open"]
        assert file["findings"] == of["findings"]
        ends = {one[end].rpartition(":")[0] for one in of["connections"] for end in ("client", "server")}
        assert file["hosts"] == sorted(ends)
        assert bool(file["damage"]) is (file["name"] == "cut.pcapng")


def test_a_second_run_reads_nothing_and_says_so(capfdbinary: Capture, folder: Path) -> None:
    first = run(capfdbinary, "index", folder)
    again = run(capfdbinary, "index", folder)
    assert first.out.splitlines()[-1] == "4 files: 4 read, 0 unchanged since the last time"
    assert again.out.splitlines()[-1] == "4 files: 0 read, 4 unchanged since the last time"
    assert first.out.splitlines()[:-1] == again.out.splitlines()[:-1]
    assert run(capfdbinary, "index", folder, "--no-update").out.splitlines()[-1] == "4 files"


def test_an_expression_names_the_files_that_can_have_it(capfdbinary: Capture, folder: Path) -> None:
    wanted = "slug == security.plc_stop"
    ran = run(capfdbinary, "index", folder, "-Y", wanted)
    assert ran.out.splitlines() == [str(folder / "day 2" / "refusals.pcapng")]
    raw = run(capfdbinary, "index", folder, "-Y", wanted, "-0")
    assert raw.out == f"{folder / 'day 2' / 'refusals.pcapng'}\0"
    assert run(capfdbinary, "index", folder, "-Y", "host == 203.0.113.9").out == ""
    listed = json.loads(run(capfdbinary, "index", folder, "-Y", wanted, "-T", "json").out)
    assert [file["name"] for file in listed["files"]] == ["day 2/refusals.pcapng"]


def test_what_cannot_be_read_is_told_and_the_rest_is_there(capfdbinary: Capture, folder: Path) -> None:
    (folder / "no\x1b[31m.pcap").write_bytes(b"no capture")
    ran = run(capfdbinary, "index", folder)
    assert ran.code == 3
    assert ran.err.count("\n") == 2
    assert "s7dissect: no\\x1b[31m.pcap: not a capture file " in ran.err  # with its name once
    assert "\x1b" not in ran.err + ran.out
    assert ran.out.splitlines()[-1].startswith("4 files: 4 read, 0 unchanged since the last time; 1 file could not be")


def test_interrupted_it_keeps_what_was_read_and_goes_on_there(
    capfdbinary: Capture, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[str] = []

    def broken_off(read: Run, files: tuple[str, ...]) -> int:
        asked.extend(files)
        return EXIT_INTERRUPTED if len(asked) == 3 else drive(read, files)

    monkeypatch.setattr("dissect.cli.index.drive", broken_off)
    ran = run(capfdbinary, "index", folder)
    assert ran.code == 130
    assert ran.err.endswith("s7dissect: interrupted; the index covers the files that were read so far\n")
    assert ran.out.splitlines()[-1].startswith("2 files: 2 read")
    monkeypatch.undo()
    assert run(capfdbinary, "index", folder).out.splitlines()[-1] == "4 files: 2 read, 2 unchanged since the last time"


def test_wrong_use_is_one_line(capfdbinary: Capture, folder: Path) -> None:
    other = folder / "no-index"
    other.write_bytes(b"x" * 5000)
    for words, said in (
        (("-0",), "-0 needs -Y"),
        (("-Y", "hots == 1"), "did you mean host"),
        (("--no-update",), "there is no index yet"),
        (("--file", other), "is not an index of s7dissect"),
        (("--file", folder / "nowhere" / "x"), "cannot be written"),
    ):
        ran = run(capfdbinary, "index", folder, *words)
        assert ran.code == 2, words
        assert said in ran.err
    assert run(capfdbinary, "index", folder / "missing").code == 2
    ran = run(capfdbinary, "index", "")
    assert (ran.code, ran.out) == (2, "")
    assert ran.err == "Error: the name of the folder is empty; was a variable of the shell not set?\n"
    assert other.read_bytes() == b"x" * 5000


# ---- --indexed: commands that do not open the rest ------------------------------------------------------------------


def spoil(path: Path) -> None:
    """Make a capture one that cannot be read, so that nobody can open it unnoticed; the index cannot tell."""
    state = path.stat()
    path.write_bytes(bytes(state.st_size))
    os.utime(path, ns=(state.st_atime_ns, state.st_mtime_ns))


def test_files_that_cannot_answer_are_not_opened(
    capfdbinary: Capture, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By no command and no process: two of four captures would be named if they were."""
    monkeypatch.setattr("dissect.cli.options.jobs.processors", lambda: 2)
    run(capfdbinary, "index", folder)
    names = sorted(map(str, folder.rglob("*.pcapng")))
    wanted = [name for name in names if name.endswith(("item-errors.pcapng", "refusals.pcapng"))]
    for name in set(names) - set(wanted):
        spoil(Path(name))
    where = ("--separate", "-Y", "port in {45840, 49152}")
    said = "s7dissect: 2 of 4 files are not opened: the index has nothing in them that -Y selects\n"
    for command in (
        ("analyze", "-T", "json"), ("analyze", "-T", "json", "-j", "2"), ("devices", "-T", "json"), ("transactions",),
        ("values", "-T", "csv"), ("export", "--force", "-o", folder / "out.sqlite"),
    ):  # fmt: skip
        ran = run(capfdbinary, *command, *where, *names, "--indexed")
        few = run(capfdbinary, *command, *where, *wanted)
        assert (ran.out, ran.err) == (few.out, said + few.err)
        assert ran.code == few.code == 0
    assert run(capfdbinary, "analyze", *where, *names).code == 3
    # Nothing can answer: one is opened, for a result in which nothing is. What changed since, or is not known, is opened.
    ran = run(capfdbinary, "transactions", "--separate", "-Y", "port == 1", *wanted, "--indexed", "-T", "csv")
    assert (ran.code, ran.out.count("\n")) == (0, 1)
    assert ran.err == (
        f"s7dissect: the index has nothing that -Y selects in any of 2 files; only {wanted[0]} is opened, "
        "to write an empty result\ns7dissect: no transaction matches port == 1\n"
    )
    ran = run(capfdbinary, "transactions", "--separate", "-Y", "port == 1", wanted[0], "--indexed", "-T", "csv")
    assert ran.err == (
        f"s7dissect: the index has nothing that -Y selects in {wanted[0]}; it is opened all the same, "
        "to write an empty result\ns7dissect: no transaction matches port == 1\n"
    )
    for path in (Path(wanted[0]), folder / "new.pcapng"):
        path.write_bytes(b"no capture, but long enough to be looked at")
        ran = run(capfdbinary, "analyze", *where, *wanted, str(path), "--indexed")
        assert (ran.code, f"{path}: " in ran.err) == (3, True)


def test_the_index_of_a_folder_is_read_once(
    capfdbinary: Capture, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its order and --indexed ask for the same facts."""
    run(capfdbinary, "index", folder)
    read = Indexes._read
    asked: list[Path] = []

    def counted(indexes: Indexes, at: Path) -> dict[str, FileFacts] | None:
        asked.append(at)
        return read(indexes, at)

    monkeypatch.setattr(Indexes, "_read", counted)
    assert run(capfdbinary, "transactions", "--separate", "-Y", "port == 45840", folder, "--indexed").code == 0
    assert len(asked) == len(set(asked)) > 0


def test_indexed_needs_an_index_and_a_question(capfdbinary: Capture, folder: Path) -> None:
    name = str(folder / "two-clients.pcapng")
    where = ("-Y", "port == 1")
    for options, why in (
        (where, "Usage: "),
        (("--separate",), "Error: --indexed needs -Y: without it every file has something that is wanted."),
        (
            ("--separate", *where),
            "Error: no file has an index in its folder or one above: s7dissect index DIR makes one",
        ),
    ):
        ran = run(capfdbinary, "analyze", name, *options, "--indexed")
        assert (ran.code, ran.out) == (2, "")
        assert why in ran.err
    run(capfdbinary, "index", folder)
    index = cached(folder)
    with sqlite3.connect(index) as base:
        base.execute("UPDATE about SET value = '0.0.1' WHERE name = 'version'")
    base.close()
    before = index.read_bytes()
    ran = run(capfdbinary, "analyze", name, "--separate", *where, "--indexed")
    assert (ran.code, ran.out) == (2, "")
    assert ran.err == f"Error: {index} is not of this version: `s7dissect index` brings it up to date\n"
    assert index.read_bytes() == before
    # Nor is it taken for one that has nothing.
    ran = run(capfdbinary, "index", folder, "--no-update", *where)
    assert (ran.code, ran.out) == (2, "")
    assert ran.err == f"Error: {index} is not of this version: `s7dissect index` brings it up to date\n"
    assert index.read_bytes() == before
    # Where another index can be used, the files of this one are opened.
    other = folder / "day 2"
    run(capfdbinary, "index", other)
    ran = run(capfdbinary, "analyze", name, str(other / "refusals.pcapng"), "--separate", *where, "--indexed")
    assert ran.code == 0
    assert f"{index} is not of this version: `s7dissect index` brings it up to date; the files of this" in ran.err
    assert "1 of 2 files is not opened: the index has nothing in it that -Y selects\n" in ran.err


@pytest.mark.skipif(os.name == "nt", reason="names are text there")
def test_a_name_that_is_no_text(capfdbinary: Capture, tmp_path: Path) -> None:
    try:
        shutil.copy(CAPTURES / "item-errors.pcapng", tmp_path / os.fsdecode(b"m\xfcnchen.pcapng"))
    except OSError:
        pytest.skip("this file system takes text alone")
    shutil.copy(CAPTURES / "two-clients.pcapng", tmp_path / "z.pcapng")
    ran = run(capfdbinary, "index", tmp_path)
    assert ran.code == 0
    assert "m\\xfcnchen.pcapng\n" in ran.out
    assert "2 files: 2 read, 0 unchanged since the last time" in ran.out
    assert "2 files: 0 read, 2 unchanged since the last time" in run(capfdbinary, "index", tmp_path).out


@pytest.mark.skipif(os.name == "nt" or os.geteuid() == 0, reason="root may read anywhere")
def test_a_folder_that_may_not_be_read_is_named_and_its_files_stay(capfdbinary: Capture, folder: Path) -> None:
    run(capfdbinary, "index", folder)
    (folder / "day 2").chmod(0)
    try:
        ran = run(capfdbinary, "index", folder)
    finally:
        (folder / "day 2").chmod(0o700)
    assert (ran.code, ran.err) == (3, "s7dissect: day 2/: Permission denied\n")
    assert "4 files: 0 read, 3 unchanged since the last time; 1 folder could not be read" in ran.out


def test_the_index_is_beside_captures_only_where_that_was_asked_for(capfdbinary: Capture, folder: Path) -> None:
    before = sorted(folder.iterdir())
    run(capfdbinary, "index", folder)
    assert sorted(folder.iterdir()) == before
    assert cached(folder).is_file()
    assert cached(folder).parent.stat().st_mode & 0o777 == 0o700
    here = run(capfdbinary, "index", "--here", folder)
    assert "4 files: 4 read" in here.out
    assert (folder / NAME).is_file()
    cached(folder).unlink()
    again = run(capfdbinary, "index", folder)
    assert "4 files: 0 read, 4 unchanged since the last time" in again.out
    assert not cached(folder).exists()
    assert run(capfdbinary, "index", "--here", "--file", folder / "x", folder).code == 2
