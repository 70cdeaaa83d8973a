"""A folder in the place of files: its captures one by one, in the order of time, and what else is in it."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Final

import pytest

from dissect.packets.source.order import first_ns
from tests.cli.support import halves, run, simple
from tests.meaning.report.schemas import ROOT

Capture = pytest.CaptureFixture[bytes]
CAPTURES: Final = ROOT / "captures"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with two captures, one below it, an empty file, one that is no capture, a cut one and a text."""
    place = tmp_path / "plant"
    (place / "line 2").mkdir(parents=True)
    simple(place / "z.pcapng", 2)
    simple(place / "line 2" / "b.pcapng", 3)
    whole = simple(tmp_path / "whole.pcapng", 4).read_bytes()
    (place / "cut.pcapng").write_bytes(whole[:-30])
    (place / "empty.pcap").write_bytes(b"")
    (place / "foreign.pcap").write_bytes(b"no capture at all, but a long text" * 3)
    (place / "notes.txt").write_text("hello")
    (place / ".hidden.pcap").write_bytes(b"")
    return place


def rows(out: str) -> dict[str, list[str]]:
    """Return the cells of each row by the name of its file."""
    lines = [line for line in out.splitlines()[1:] if line.strip()]
    return {
        line.strip().rsplit("/", 1)[-1].split()[0]: line.split() for line in lines if ".pcap" in line or "notes" in line
    }


def test_each_file_of_a_folder_has_a_row(capfdbinary: Capture, folder: Path) -> None:
    ran = run(capfdbinary, "analyze", folder)
    assert ran.code == 3
    found = rows(ran.out)
    assert sorted(found) == ["b.pcapng", "cut.pcapng", "empty.pcap", "foreign.pcap", "notes.txt:", "z.pcapng"]
    assert "UNREAD: empty" in ran.out
    assert "UNREAD: not a capture file" in ran.out
    assert "DAMAGED: cut off" in ran.out
    assert "notes.txt: not a capture by its name, not read" in ran.out
    assert ".hidden" not in ran.out
    assert "5 files" in ran.out
    for name in ("empty.pcap: empty", "foreign.pcap: not a capture", "cut.pcapng: cut off"):
        assert name in ran.err


def test_a_row_has_what_the_file_alone_has(capfdbinary: Capture, folder: Path) -> None:
    together = rows(run(capfdbinary, "analyze", folder).out)
    for name in ("z.pcapng", "cut.pcapng"):
        alone = rows(run(capfdbinary, "analyze", "--per-file", folder / name).out)[name]
        assert together[name][1:9] == alone[1:9]


@pytest.mark.parametrize("jobs", ["1", "2"])
def test_per_file_goes_with_separate(capfdbinary: Capture, folder: Path, jobs: str) -> None:
    files = [folder / "z.pcapng", folder / "empty.pcap", folder / "cut.pcapng"]
    ran = run(capfdbinary, "analyze", "--per-file", "--separate", "-j", jobs, *files)
    one_run = run(capfdbinary, "analyze", "--per-file", *files)
    assert (ran.code, one_run.code) == (3, 3)
    apart, joined = rows(ran.out), rows(one_run.out)
    assert list(apart) == list(joined) == ["z.pcapng", "empty.pcap", "cut.pcapng"]
    for name in apart:
        assert apart[name][1:9] == joined[name][1:9]


@pytest.mark.parametrize(
    "command",
    ["transactions", "values", "operations", "show", "devices", "golden", "blocks", "report", "export", "sql"],
)
def test_every_command_reads_a_folder(capfdbinary: Capture, tmp_path: Path, folder: Path, command: str) -> None:
    outputs: dict[str, list[str | Path]] = {
        "report": ["-o", tmp_path / "out.html"],
        "export": ["-o", tmp_path / "out.sqlite"],
    }
    out = outputs.get(command, [])
    first = ["select count(*) as n from transactions"] if command == "sql" else []
    ran = run(capfdbinary, command, *first, folder, *out)
    assert ran.code == 3
    assert "empty.pcap: empty" in ran.err
    assert "cut.pcapng: cut off" in ran.err
    if command == "transactions":
        assert len(ran.out.splitlines()) == 3 + 4 + 5
    if command == "sql":
        assert "12" in ran.out


def test_files_come_in_the_order_of_time(capfdbinary: Capture, tmp_path: Path) -> None:
    first, second = halves(tmp_path)
    for path, name in ((first, "2.pcapng"), (second, "1.pcapng")):
        path.rename(tmp_path / name)
    ran = run(capfdbinary, "analyze", tmp_path)
    assert list(rows(ran.out)) == ["2.pcapng", "1.pcapng"]
    assert "continues the file before; read apart" in ran.out.splitlines()[2]
    assert "Named one by one they are followed." in ran.err
    ran = run(capfdbinary, "analyze", "--per-file", str(tmp_path / "*.pcapng"))
    assert list(rows(ran.out)) == ["2.pcapng", "1.pcapng"]
    assert ran.out.splitlines()[2].endswith("continues the file before")
    given = run(capfdbinary, "analyze", "--per-file", tmp_path / "1.pcapng", tmp_path / "2.pcapng")
    assert list(rows(given.out)) == ["1.pcapng", "2.pcapng"]
    told = json.loads(run(capfdbinary, "analyze", "-T", "json", str(tmp_path / "*.pcapng")).out)
    assert len(told["connections"]) == 1


def test_a_folder_without_a_capture_is_wrong_use(capfdbinary: Capture, tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("hello")
    ran = run(capfdbinary, "analyze", tmp_path)
    assert (ran.code, ran.out) == (2, "")
    assert "a folder without a capture" in ran.err


def test_what_counts_over_all_files_does_not_go_with_a_folder(capfdbinary: Capture, folder: Path) -> None:
    ran = run(capfdbinary, "transactions", folder, "--connection", "1")
    assert ran.code == 2
    assert "the files of a folder are read one by one: the field connection counts over all files" in ran.err


def test_an_index_gives_the_order_of_files_and_none_is_opened_for_it(
    capfdbinary: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    place = tmp_path / "ring"
    place.mkdir()
    for path, name in zip(halves(tmp_path), ("2.pcapng", "1.pcapng"), strict=True):
        path.rename(place / name)
    (place / "none.pcap").write_bytes((CAPTURES / "szl.pcapng").read_bytes()[:200])
    without = run(capfdbinary, "analyze", place)
    run(capfdbinary, "index", place)
    opened: list[str] = []

    def first(path: str) -> int | None:
        opened.append(Path(path).name)
        return first_ns(path)

    monkeypatch.setattr("dissect.packets.source.order.first_ns", first)
    assert run(capfdbinary, "analyze", place) == without
    assert opened == []
    shutil.copy(CAPTURES / "szl.pcapng", place / "2.pcapng")  # one that the index does not know as it is now
    assert list(rows(run(capfdbinary, "analyze", place).out)) == ["1.pcapng", "2.pcapng", "none.pcap"]
    assert opened == ["2.pcapng"]


def test_an_index_says_which_files_continue_each_other(capfdbinary: Capture, tmp_path: Path) -> None:
    for path, name in zip(halves(tmp_path), ("2.pcapng", "1.pcapng"), strict=True):
        path.rename(tmp_path / name)
    shutil.copy(CAPTURES / "szl.pcapng", tmp_path / "szl.pcapng")
    told = json.loads(run(capfdbinary, "index", tmp_path, "-T", "json").out)
    assert {file["name"]: file["continues"] for file in told["files"]} == {
        "1.pcapng": "2.pcapng",
        "2.pcapng": None,
        "szl.pcapng": None,
    }
    lines = run(capfdbinary, "index", tmp_path).out.splitlines()
    assert [line.rpartition("; ")[2] for line in lines if "continues" in line] == ["continues 2.pcapng"]
