"""--separate for exports: the same bytes whoever does the tasks, nothing half written, numbers that join."""

from __future__ import annotations

import mmap
import os
import shutil
import sqlite3
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import Future
from pathlib import Path
from typing import Any, Final

import pytest

from dissect.cli import separate, task
from dissect.cli.separate_export import NUMBERS
from dissect.files.jobs.tasks import FileError
from dissect.output.export.extras import MissingLibraryError
from tests.cases import each
from tests.cli.support import run
from tests.cli.test_separate import CAPTURES, CUT, FILES, SZL, Dying
from tests.cli.test_separate_rows import Spooling

Capture = pytest.CaptureFixture[bytes]

READ: Final = str(CAPTURES / "read-areas.pcapng")
#: Bytes that a file of this disk takes at least.
PAGE: Final = mmap.PAGESIZE

#: Columns that count over all files.
COUNTED: Final = {"connection", "transaction", "operation", "act", "finding", "pdu", "transactions"}


@pytest.fixture(autouse=True)
def _three_processors(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[None]:
    """Nothing is left in the folder of temporary files, and no output that is not whole."""
    monkeypatch.setattr("dissect.cli.options.jobs.processors", lambda: 3)
    monkeypatch.setattr("dissect.files.jobs.pool.Pool", Spooling)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    yield
    assert not [
        path for path in tmp_path.rglob("*") if path.name.startswith("s7dissect-rows-") or ".part" in path.name[1:]
    ]


def content(path: Path) -> dict[str, bytes]:
    """Return an output as its files."""
    if path.is_file():
        return {"": path.read_bytes()}
    return {str(file.relative_to(path)): file.read_bytes() for file in sorted(path.rglob("*")) if file.is_file()}


def rows_of(path: Path, table: str) -> list[dict[str, Any]]:
    """Return the rows of a table in a folder of Parquet."""
    parquet = pytest.importorskip("pyarrow.parquet")
    return [
        row
        for file in sorted((path / table).rglob("*.parquet"))
        for row in parquet.ParquetFile(file).read().to_pylist()
    ]


def test_outputs_are_the_same(capfdbinary: Capture, tmp_path: Path) -> None:
    """With a file that is cut and one that is no capture, which are named."""
    text = tmp_path / "text.pcap"
    text.write_text("this is no capture, but long enough to be looked at")
    for form in ("parquet:out", "csv:out", "out.sqlite", "arrow:out"):
        outputs, prefix = [], form.partition(":")
        for jobs in ("1", "2", "3"):
            name = str(tmp_path / f"{jobs}-{prefix[2] or form}")
            ran = run(
                capfdbinary, "export", "--separate", "-j", jobs, *FILES, str(text), CUT,
                "-o", f"{prefix[0]}:{name}" if prefix[2] else name, "--force",
            )  # fmt: skip
            assert ran.code == 3
            assert [sum([name in line for line in ran.err.splitlines()]) for name in ("text.pcap: ", "cut-pcap")] == [
                1,
                1,
            ]
            outputs.append(content(Path(name)))
        assert outputs[1] == outputs[0]
        assert outputs[2] == outputs[0]
        assert len(outputs[0]) > 1 or form == "out.sqlite"


def test_rows_are_those_of_one_run_but_their_numbers(capfdbinary: Capture, tmp_path: Path) -> None:
    """A number is a thousand million times the place of the file, and the number there; so tables can still be joined."""
    whole, apart = tmp_path / "whole", tmp_path / "apart"
    run(capfdbinary, "export", *FILES, "-o", f"parquet:{whole}")
    assert run(capfdbinary, "export", "--separate", "-j", "2", *FILES, "-o", f"parquet:{apart}").code == 0
    for table in ("connections", "transactions", "items", "values", "operations", "acts", "pdus"):

        def plain(path: Path, table: str = table) -> list[str]:
            return sorted([str({key: row[key] for key in row if key not in COUNTED}) for row in rows_of(path, table)])

        assert plain(apart) == plain(whole), table
    places = {name: place for place, name in enumerate(FILES)}
    for table in ("transactions", "findings", "operations", "acts", "pdus"):
        own = table.removesuffix("s")
        rows = rows_of(apart, table)
        assert {row[own] // NUMBERS for row in rows} == {places[row["file"]] for row in rows}
        assert len({row[own] for row in rows}) == len(rows)
    known = {row["connection"]: row["client_port"] for row in rows_of(apart, "connections")}
    assert all([known[row["connection"]] == row["client_port"] for row in rows_of(apart, "transactions")])


def test_rows_that_are_sent_keep_their_types(capfdbinary: Capture, tmp_path: Path) -> None:
    """Bytes, numbers and nulls are in SQLite what they are there without --separate."""
    found = []
    for options in ((), ("--separate", "-j", "2")):
        out = tmp_path / f"{len(options)}.sqlite"
        assert run(capfdbinary, "export", *options, *FILES, "-o", str(out)).code == 0
        database = sqlite3.connect(out)
        rows = database.execute("SELECT typeof(data), data, typeof(number), number, text FROM items").fetchall()
        found.append(sorted([repr(row) for row in rows]))
        database.close()
    assert found[0] == found[1]
    assert "'blob'" in found[0][0]


def test_one_file_is_exported_as_ever(capfdbinary: Capture, tmp_path: Path) -> None:
    for options in ((), ("--separate", "-j", "2")):
        run(capfdbinary, "export", SZL, *options, "-o", f"csv:{tmp_path / str(len(options))}")
    assert content(tmp_path / "0") == content(tmp_path / "3")


@each(("options", "why"), [
    (("-o", "zeek:logs"), "zeek is written in one run"),
    (("-o", "findings.stix"), "stix is written in one run"),
    (("-o", "a.sqlite", "--connection", "2"), "the field connection counts over all files"),
])  # fmt: skip
def test_what_needs_one_run_is_refused(capfdbinary: Capture, options: tuple[str, ...], why: str) -> None:
    ran = run(capfdbinary, "export", SZL, CUT, "--separate", *options)
    assert (ran.code, ran.out) == (2, "")
    assert f"--separate: {why}" in ran.err


def test_j_needs_separate(capfdbinary: Capture, tmp_path: Path) -> None:
    ran = run(capfdbinary, "export", SZL, "-j", "2", "-o", str(tmp_path / "a.sqlite"))
    assert ran.code == 2
    assert "needs --separate" in ran.err


class Leaving(Dying):
    """Its processes die when they have written something already."""

    def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Do a task, or die of it."""
        future = super().submit(fn, *args, **kwargs)
        if future.exception() is not None:
            left = Path(args[-3], f".task-{args[-2]}.part", "transactions", "day=2026-11-21")
            left.mkdir(parents=True, exist_ok=True)
            (left / "part-0001.parquet").write_bytes(b"PAR1 and no end")
        return future


def test_nothing_is_left_of_a_process_that_died(
    capfdbinary: Capture, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """What it left is not read as its result; the others are there, each once."""
    monkeypatch.setattr("dissect.files.jobs.pool.Pool", Leaving)
    ran = run(capfdbinary, "export", "--separate", "-j", "2", *FILES, "-o", f"parquet:{tmp_path / 'a'}")
    assert ran.code == 3
    assert "clock.pcapng: the process that read it ended" in ran.err
    run(capfdbinary, "export", "--separate", *FILES[:-1], "-o", f"parquet:{tmp_path / 'b'}")
    died, alone = content(tmp_path / "a"), content(tmp_path / "b")
    assert {name: octets for name, octets in died.items() if name != "s7dissect.json"}.keys() == alone.keys() - {
        "s7dissect.json"
    }
    assert rows_of(tmp_path / "a", "transactions") == rows_of(tmp_path / "b", "transactions")


def test_an_interrupted_export_leaves_nothing(
    capfdbinary: Capture, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    import signal

    read = separate.read_file

    def interrupting(of: Any, *each: Any) -> None:
        read(of, *each)
        signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr("dissect.cli.separate_export.read_file", interrupting)
    for out in ("parquet:a", "b.sqlite"):
        form, colon, name = out.partition(":")
        path = tmp_path / (name or out)
        ran = run(capfdbinary, "export", "--separate", *FILES, "-o", f"{form}:{path}" if colon else str(path))
        assert ran.code == 130
        assert ran.err == f"s7dissect: interrupted; {path} was not written\n"
        assert not path.exists()


#: Runs a command where the folder $0 is a disk of $1 bytes, which no other process sees.
SMALL_DISK: Final = 'mount -t tmpfs -o size="$1" small "$0" && shift && "$@"; code=$?; find "$0" -type f; exit $code'


def test_a_full_disk_costs_the_capture_that_does_not_fit(capfdbinary: Capture, tmp_path: Path) -> None:
    """It is one line with the words of the system; the other is there, whole, and nothing else is."""
    apart = [shutil.which("unshare") or "unshare", "--mount", "sh", "-c"]
    if shutil.which("unshare") is None or subprocess.run([*apart, "true"], check=False, capture_output=True).returncode:
        pytest.skip("a file system of its own for one process takes rights")
    files, options = (SZL, READ), ("--separate", "--only", "transactions", "-o")
    assert run(capfdbinary, "export", *files, *options, tmp_path / "all.parquet").code == 0
    first, second = (path.stat().st_size for path in sorted((tmp_path / "all.parquet").rglob("part-*")))
    disk = tmp_path / "disk"
    disk.mkdir()
    out = disk / "out.parquet"
    export = [sys.executable, "-m", "dissect", "export", *files, *options, str(out)]
    command = [*apart, SMALL_DISK, str(disk), str(-(-first // PAGE) * PAGE + second // 2), *export]
    ran = subprocess.run(command, check=False, capture_output=True, text=True)
    names = [str(Path(path).relative_to(out)) for path in ran.stdout.splitlines()]
    assert (ran.returncode, [name.partition("/")[0] for name in sorted(names)]) == (
        3,
        ["s7dissect.json", "transactions"],
    )
    said = ran.stderr.splitlines()
    assert said[0] == f"s7dissect: {READ}: its rows cannot be written to {out}: No space left on device"
    assert said[-1] == f"s7dissect: 16 transactions written to {out}"


def test_a_full_folder_for_temporary_files_is_not_taken_for_the_output(tmp_path: Path) -> None:
    apart = [shutil.which("unshare") or "unshare", "--mount", "sh", "-c"]
    if shutil.which("unshare") is None or subprocess.run([*apart, "true"], check=False, capture_output=True).returncode:
        pytest.skip("a file system of its own for one process takes rights")
    disk, out = tmp_path / "disk", tmp_path / "out.sqlite"
    disk.mkdir()
    export = [sys.executable, "-m", "dissect", "export", SZL, READ, "--separate", "-o", str(out)]
    ran = subprocess.run(
        [*apart, SMALL_DISK, str(disk), str(PAGE), *export],
        check=False,
        capture_output=True,
        text=True,
        env={**os.environ, "TMPDIR": str(disk)},
    )
    said = ran.stderr.splitlines()
    assert (ran.returncode, len(said)) == (3, 3)
    for line, file in zip(said, (SZL, READ), strict=False):
        assert line.startswith(f"s7dissect: {file}: its rows cannot be written to {disk}{os.sep}s7dissect-rows-")
        assert line.endswith(": No space left on device; TMPDIR names another place for them")


def test_a_library_that_is_missing_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As on a worker that does not have it, where it is here."""

    def missing(*_arguments: object, **_options: object) -> None:
        raise MissingLibraryError("Parquet needs pyarrow: pip install 's7dissect[data]'")

    monkeypatch.setattr("dissect.cli.separate_export.ParquetSink", missing)
    arguments = ["export", "--separate", SZL, SZL, "-o", str(tmp_path / "out.parquet")]
    with pytest.raises(FileError, match=r"^Parquet needs pyarrow: pip install 's7dissect\[data\]'$"):
        task.work(arguments, True, None, str(tmp_path), 0, SZL)
