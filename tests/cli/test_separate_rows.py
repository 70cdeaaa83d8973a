"""--separate for rows: what several processes write is what one writes, byte by byte, with the numbers of one run."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import pytest

from dissect.cli import separate
from tests.cases import each
from tests.cli.support import Ran, run
from tests.cli.test_separate import CUT, FILES, SZL, Dying
from tests.meaning.report.schemas import ROOT

Capture = pytest.CaptureFixture[bytes]

WRITES: Final = str(ROOT / "captures" / "write-areas.pcapng")
NO_S7: Final = str(ROOT / "captures" / "refused-port.pcapng")
#: What leaves rows in files, in the same process: as other processes do it, without the time they take to start.
COMMANDS: Final = (
    ("transactions",),
    ("transactions", "-T", "jsonl"),
    ("transactions", "-T", "csv", "--failed", "--slow", "5"),
    ("transactions", "-T", "fields", "-e", "number", "-e", "connection", "-e", "function"),
    ("transactions", "-Y", "function == read", "--color", "always"),
    ("values", "--changes"),
    ("values", "-T", "jsonl", "-Y", "client == 127.0.0.1"),
    ("values", "-T", "csv", "--tags", str(ROOT / "captures" / "tags" / "valve.csv")),
)


class Spooling(separate.Here):
    """Does tasks in this process, and is taken for others."""

    def __init__(self, _count: int, *_: object) -> None:
        super().__init__()


@pytest.fixture(autouse=True)
def _three_processors(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[None]:
    """Nothing is left in the folder of temporary files, whatever happened."""
    monkeypatch.setattr("dissect.cli.options.jobs.processors", lambda: 3)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    yield
    assert not [path for path in tmp_path.iterdir() if path.name.startswith("s7dissect-rows-")]


def same(capfdbinary: Capture, *arguments: str, jobs: int = 2) -> Ran:
    """Run a command with one process and with several, compare, and return what they did."""
    one = run(capfdbinary, *arguments)
    several = run(capfdbinary, *arguments, "-j", str(jobs))
    assert (several.code, several.out, several.err) == (one.code, one.out, one.err)
    return one


def test_rows_are_those_of_one_process(capfdbinary: Capture, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """And those of one run, where nothing goes on; a file that is no capture and one that is cut are named."""
    monkeypatch.setattr("dissect.files.jobs.pool.Pool", Spooling)
    text = tmp_path / "text.pcap"
    text.write_text("this is no capture, but long enough to be looked at")
    for at, command in enumerate(COMMANDS):
        files = (*FILES, str(text), WRITES, CUT, str(tmp_path / "gone.pcap"))
        ran = same(capfdbinary, *command, "--separate", *files, jobs=2 + at % 2)
        said = ran.err.splitlines()
        assert [sum([name in line for line in said]) for name in ("text.pcap: ", "cut-pcapng", "gone.pcap: ")] == [
            1
        ] * 3
        assert ran.code == 3
        if command[0] == "transactions":  # values know the one before, of whatever file
            assert ran.out == run(capfdbinary, *command, *FILES, WRITES, CUT).out


def test_with_processes(capfdbinary: Capture) -> None:
    ran = same(capfdbinary, "transactions", "--separate", "-T", "jsonl", *FILES)
    rows = [json.loads(line) for line in ran.out.splitlines()]
    assert sorted([row["number"] for row in rows]) == list(range(1, len(rows) + 1))
    assert {row["connection"] for row in rows} == set(range(1, 1 + len(FILES)))


def test_findings_fail_the_gate(capfdbinary: Capture, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("dissect.files.jobs.pool.Pool", Spooling)
    for options in ((), ("-Y", "failed")):
        arguments = ("transactions", *FILES, "--fail-on", "note", *options)
        ran = same(capfdbinary, *arguments, "--separate")
        assert ran.code == 1
        assert [line for line in ran.err.splitlines() if "--fail-on" in line] == [
            line for line in run(capfdbinary, *arguments).err.splitlines() if "--fail-on" in line
        ]


def test_what_there_is_instead_is_said_of_all(capfdbinary: Capture, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("dissect.files.jobs.pool.Pool", Spooling)
    whole = run(capfdbinary, "transactions", NO_S7, NO_S7)
    assert "no S7 transaction" in whole.err
    assert (
        same(capfdbinary, "transactions", "--separate", NO_S7, NO_S7).err.splitlines()[-1] == whole.err.splitlines()[-1]
    )
    ran = same(capfdbinary, "values", "--separate", SZL, WRITES, "DB9.DBD4", "DB1.DBX0.0")
    assert "no value of DB9.DBD4" in ran.err


@each(("arguments", "why"), [
    (("transactions", "-c", "3"), "-c counts over all files"),
    (("transactions", "-Y", "number == 2"), "the field number counts over all files"),
    (("values", "--connection", "2"), "the field connection counts over all files"),
    (("values", "--summary"), "--summary adds up one run"),
])  # fmt: skip
def test_what_needs_one_run_is_refused(capfdbinary: Capture, arguments: tuple[str, ...], why: str) -> None:
    ran = run(capfdbinary, arguments[0], SZL, "--separate", *arguments[1:])
    assert (ran.code, ran.out) == (2, "")
    assert f"--separate: {why}" in ran.err


def test_a_process_that_dies_leaves_nothing_out(capfdbinary: Capture, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("dissect.files.jobs.pool.Pool", Dying)
    ran = run(capfdbinary, "transactions", "--separate", "-T", "jsonl", "-j", "2", *FILES)
    assert ran.code == 3
    assert ran.out == run(capfdbinary, "transactions", "--separate", "-T", "jsonl", *FILES[:-1]).out
    assert "clock.pcapng: the process that read it ended" in ran.err


def test_a_full_disk_is_said_of_the_file(capfdbinary: Capture, monkeypatch: pytest.MonkeyPatch) -> None:
    """The rows of the others are written, each once."""
    from dissect.files.jobs import spool

    monkeypatch.setattr("dissect.files.jobs.pool.Pool", Spooling)
    write = spool.Spool.write

    def full(self: spool.Spool, octets: bytes) -> None:
        if self.file.name.endswith("rows-1"):
            raise OSError(28, "No space left on device", self.file.name)
        write(self, octets)

    monkeypatch.setattr(spool.Spool, "write", full)
    ran = run(capfdbinary, "transactions", "--separate", "-T", "csv", "-j", "2", *FILES[:3])
    assert ran.code == 3
    assert re.search(
        r"transfer\.pcapng: its rows cannot be written to \S+: No space left on device; "
        r"TMPDIR names another place for them\n",
        ran.err,
    )
    alone = run(capfdbinary, "transactions", "--separate", "-T", "csv", FILES[0], FILES[2])
    assert ran.out == alone.out


def test_who_interrupts_has_what_was_read(capfdbinary: Capture, monkeypatch: pytest.MonkeyPatch) -> None:
    read = separate.read_file
    begun: list[str] = []

    def interrupting(of: Any, each: Any = None) -> None:
        begun.append("file")
        if len(begun) == 2:
            signal.raise_signal(signal.SIGINT)
        read(of, each)

    monkeypatch.setattr("dissect.cli.separate_rows.read_file", interrupting)
    whole = run(capfdbinary, "transactions", "-T", "csv", *FILES)
    begun.clear()
    ran = run(capfdbinary, "transactions", "--separate", "-T", "csv", *FILES)
    assert ran.code == 130
    assert whole.out.startswith(ran.out)
    assert "szl.pcapng" in ran.out
    assert "s7dissect: interrupted; the results cover what was read so far" in ran.err.splitlines()


def test_nothing_is_left_of_who_was_killed(tmp_path: Path) -> None:
    """Neither after Ctrl-C nor after kill -9: no process, and no file of rows."""
    rows = tmp_path / "temporary"
    rows.mkdir()
    waits = tmp_path / "waits.pcap"
    os.mkfifo(waits)
    shutil.copy(SZL, tmp_path / "szl.pcapng")
    (tmp_path / "two.py").write_text(
        "from dissect.cli.main import main\nimport dissect.cli.options.jobs as jobs\njobs.processors = lambda: 2\n"
        "if __name__ == '__main__':\n    main(['transactions', '--separate', '-j', '2', 'szl.pcapng', 'waits.pcap'])\n"
    )
    environment = {**os.environ, "TMPDIR": str(rows), "PYTHONPATH": os.pathsep.join([str(ROOT), *_inherited()])}
    for number in (signal.SIGINT, signal.SIGKILL):
        with (
            subprocess.Popen(
                [sys.executable, "two.py"], cwd=tmp_path, env=environment, stdout=subprocess.PIPE
            ) as parent,
            waits.open("wb"),  # this file never comes to its end; what was read of the other one is written
        ):
            assert parent.stdout is not None
            assert b"szl.pcapng" in parent.stdout.readline()
            parent.send_signal(number)
            assert parent.wait() == (130 if number == signal.SIGINT else -signal.SIGKILL)
            while any(rows.iterdir()):  # the limit is that of the test run
                time.sleep(0.01)


def _inherited() -> list[str]:
    inherited = os.environ.get("PYTHONPATH")
    return [inherited] if inherited else []
