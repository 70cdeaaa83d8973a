"""`s7dissect index`: a folder of captures at a glance, and which of them can answer a question."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import pytest

import dissect
from dissect.cli.main import EXIT_INTERRUPTED
from dissect.cli.run import drive
from dissect.session import Run
from tests.cli.support import run
from tests.report import schemas

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
    assert "no\\x1b[31m.pcap: " in ran.err
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
        (("--file", other), "is no index of s7dissect"),
        (("--file", folder / "nowhere" / "x"), "cannot be written"),
    ):
        ran = run(capfdbinary, "index", folder, *words)
        assert ran.code == 2, words
        assert said in ran.err
    assert run(capfdbinary, "index", folder / "missing").code == 2
    assert other.read_bytes() == b"x" * 5000
