"""`s7dissect export`: what it refuses, what it leaves behind, and what it says."""

from __future__ import annotations

import json
import os
import resource
import signal
import subprocess
import sys
from pathlib import Path
from typing import Final

import pytest

from tests.cli.support import WITHOUT_CACHE, run
from tests.meaning.report.support import ROOT, WORD, begun, read, saved

Capture = pytest.CaptureFixture[bytes]
ERRORS: Final = ROOT / "captures" / "item-errors.pcapng"


def test_an_output_is_not_overwritten_unless_forced(capfdbinary: Capture, tmp_path: Path) -> None:
    for out in (tmp_path / "a.csv", tmp_path / "a.sqlite"):
        assert run(capfdbinary, "export", ERRORS, "-o", out).code == 0
        ran = run(capfdbinary, "export", ERRORS, "-o", out)
        assert (ran.code, "exists; --force overwrites it" in ran.err) == (2, True)
        assert run(capfdbinary, "export", ERRORS, "-o", out, "--force").code == 0
    other = tmp_path / "other.csv"
    other.mkdir()
    assert run(capfdbinary, "export", ERRORS, "-o", other).code == 0  # an empty folder is no loss
    (other / "s7dissect.json").unlink()
    ran = run(capfdbinary, "export", ERRORS, "-o", other, "--force")
    assert (ran.code, "holds files that no export wrote" in ran.err) == (2, True)
    assert (other / "items.csv").exists()


def test_what_cannot_be_an_output(capfdbinary: Capture, tmp_path: Path) -> None:
    copy = tmp_path / "a.db"
    copy.write_bytes(ERRORS.read_bytes())
    for words, told in (
        ((copy, "-o", copy, "--force"), "both input and output"),
        ((ERRORS, "-o", f"csv:{copy}", "--force"), "is a file, and this export writes a folder"),
        ((ERRORS, "-o", f"sqlite:{tmp_path}"), "is a folder, and this export writes a file"),
        ((ERRORS, "-o", "sqlite:/dev/null"), "device or pipe"),
        ((ERRORS, "-o", tmp_path / "a.xlsx"), "form of"),
        ((ERRORS, "-o", tmp_path / "a.csv", "--only", "finding"), "Did you mean findings or finding_counts?"),
        ((ERRORS, "-o", tmp_path / "none" / "a.csv"), "No such file or directory"),
        ((ERRORS, "-o", tmp_path / "none" / "a.db"), "a.db: No such file or directory"),
        ((ERRORS, "-o", tmp_path / "b.csv", "-Y", "hots == 1"), "host"),
    ):
        ran = run(capfdbinary, "export", *words)
        assert (ran.code, told in ran.err) == (2, True), ran
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.db"]
    assert copy.read_bytes() == ERRORS.read_bytes()


def test_a_selection_and_tags(capfdbinary: Capture, tmp_path: Path) -> None:
    out = tmp_path / "items.csv"
    tags = ROOT / "captures" / "tags" / "valve.csv"
    capture = ROOT / "captures" / "nodes7-write.pcapng"
    ran = run(capfdbinary, "export", capture, "-o", out, "--only", "items", "-Y", "function == write", "--tags", tags)
    assert (ran.code, ran.out) == (0, "")
    lines = out.read_text(encoding="utf-8").splitlines()
    assert f"{len(lines) - 1} items written to" in ran.err
    assert any(",write,sure,Valve.pressure,DB," in line for line in lines)
    assert not any(",read," in line for line in lines)


def test_findings_in_detail_are_told_from_all(capfdbinary: Capture, tmp_path: Path) -> None:
    talk = begun()
    for ref in range(1, 301):
        read(talk, ref, WORD, 0x0A)
    many = saved(tmp_path / "many.pcapng", talk.packets())
    ran = run(capfdbinary, "export", many, "-o", tmp_path / "a.db")
    assert "100 of 300 findings in detail, 2 finding counts" in ran.err
    few = run(capfdbinary, "export", ERRORS, "-o", tmp_path / "b.db")
    assert "15 findings, " in few.err


@pytest.mark.parametrize(("package", "form"), [("pyarrow", "parquet"), ("pyarrow", "arrow"), ("duckdb", "duckdb")])
def test_a_missing_library_is_named_with_what_to_type(
    capfdbinary: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, package: str, form: str
) -> None:
    for name in [name for name in sys.modules if name.partition(".")[0] == package]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, package, None)
    ran = run(capfdbinary, "export", ERRORS, "-o", tmp_path / f"a.{form}")
    assert ran.code == 2
    assert f"this export needs {package}: pip install 's7dissect[data]'" in ran.err
    assert not list(tmp_path.iterdir())
    ran = run(capfdbinary, "sql", "SELECT 1 FROM items", ERRORS)
    assert (ran.code, f"needs {package}: pip install 's7dissect[data]'" in ran.err) == (2, True)


def test_csv_and_sqlite_need_no_library(tmp_path: Path) -> None:
    code = "import sys\nfor name in ('pyarrow', 'duckdb'): sys.modules[name] = None\nfrom dissect.cli.main import run\n"
    calls = [["export", str(ERRORS), "-o", str(tmp_path / out)] for out in ("a.csv", "a.sqlite")]
    ran = subprocess.run(
        [sys.executable, "-c", f"{code}sys.exit(sum(map(run, {calls!r})))"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert ran.returncode == 0, ran.stderr


@pytest.mark.parametrize("form", ["csv", "sqlite", "parquet"])
def test_a_full_disk_is_one_line_and_leaves_nothing(tmp_path: Path, form: str) -> None:
    """A limit on the size of files stands for a disk without room."""
    capture = ROOT / "captures" / "transfer.pcapng"

    def limited() -> None:
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (3000, 3000))

    ran = subprocess.run(
        [sys.executable, "-m", "dissect", "export", capture, "-o", tmp_path / f"out.{form}"],
        preexec_fn=limited, capture_output=True, text=True, check=False, timeout=60, env=WITHOUT_CACHE,
    )  # fmt: skip
    assert ran.returncode in ({5} if form != "sqlite" else {2, 5}), ran.stderr  # which calls it an I/O error
    assert len(ran.stderr.splitlines()) == 1, ran.stderr
    assert f"out.{form}" in ran.stderr
    assert not list(tmp_path.iterdir())


def test_a_killed_run_leaves_nothing_under_the_final_name(tmp_path: Path) -> None:
    fifo = tmp_path / "in.pcapng"
    os.mkfifo(fifo)
    process = subprocess.Popen(
        [sys.executable, "-m", "dissect", "export", fifo, "-o", tmp_path / "out.csv"], stderr=subprocess.DEVNULL
    )
    with fifo.open("wb") as feed:
        feed.write(ERRORS.read_bytes())
        feed.flush()
        process.kill()
        assert process.wait(30) == -signal.SIGKILL
    assert not (tmp_path / "out.csv").exists()


def test_what_is_written_is_said(capfdbinary: Capture, tmp_path: Path) -> None:
    out = tmp_path / "a.csv"
    ran = run(capfdbinary, "export", ERRORS, "-o", out, "--only", "findings", "--only", "connections")
    told = json.loads((out / "s7dissect.json").read_text(encoding="utf-8"))
    assert told["schema"] == "s7dissect-export/1"
    assert list(told["rows"]) == ["connections", "findings"]
    assert ran.err.startswith(
        f"s7dissect: {told['rows']['connections']} connection, {told['rows']['findings']} findings"
    )


@pytest.mark.parametrize("form", ["parquet", "duckdb"])
def test_a_disk_that_was_full_from_the_beginning_is_one_line_and_leaves_nothing(tmp_path: Path, form: str) -> None:
    """What makes the files fails already: a file that was made before has nobody to close it then."""
    code = (
        "import sys, pyarrow.parquet as parquet\nimport duckdb\nfrom dissect.cli.main import run\n"
        "class Writer(parquet.ParquetWriter):\n"
        "    made = 0\n"
        "    def __init__(self, *given, **named):\n"
        "        Writer.made += 1\n"
        "        if Writer.made == 3: raise OSError(28, 'No space left on device')\n"
        "        super().__init__(*given, **named)\n"
        "    def close(self):\n"
        "        if self.is_open: raise OSError(28, 'No space left on device')\n"
        "parquet.ParquetWriter = Writer\n"
        "class Base:\n"
        "    def __init__(self, path):\n"
        "        self.base = duckdb_connect()\n"
        "        open(path + '.wal', 'w').close()\n"
        "    def execute(self, text):\n"
        "        if text.startswith('COMMENT'): raise duckdb.Error('Could not write file: No space left on device')\n"
        "        self.base.execute(text)\n"
        "    def __getattr__(self, name): return getattr(self.base, name)\n"
        "duckdb_connect, duckdb.connect = duckdb.connect, Base\n"
        f"sys.exit(run({['export', str(ERRORS), '-o', str(tmp_path / f'out.{form}')]!r}))"
    )
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert ran.returncode == 5, ran.stderr
    assert ran.stderr.splitlines() == [f"s7dissect: cannot write {tmp_path / f'out.{form}'}: No space left on device"]
    assert not list(tmp_path.iterdir())
