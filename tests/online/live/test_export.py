"""Tables written while a line is watched: whole files, new ones when it is time, also after a kill."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Final

import duckdb
import pytest

import dissect
from dissect import analyze
from dissect.engine.observer import Observer
from dissect.online.live.export import ExportCompanion
from dissect.online.live.run import LiveRun
from dissect.output.export.tables import TABLES
from dissect.packets.source.files import open_capture
from dissect.packets.source.live.reader import Drops
from tests.cli.support import run
from tests.meaning.report.support import ROOT

Capture = pytest.CaptureFixture[bytes]
TRANSFER: Final = ROOT / "captures" / "transfer.pcapng"
_MINUTE: Final = 60_000_000_000


def counted(folder: Path, table: str) -> int:
    files = list((folder / table).glob("**/*.parquet")) if (folder / table).exists() else []
    if not files:
        return 0
    ((count,),) = duckdb.sql(f"SELECT count(*) FROM read_parquet('{folder}/{table}/**/*.parquet')").fetchall()
    return int(count)


def test_a_watched_line_is_in_the_tables(capfdbinary: Capture, tmp_path: Path) -> None:
    folder = tmp_path / "plant"
    ran = run(capfdbinary, "monitor", "--plain", TRANSFER, "--export", f"parquet:{folder}")
    assert ran.code == 0, ran.err
    analysis = analyze(TRANSFER)
    assert counted(folder, "transactions") == analysis.total
    assert counted(folder, "findings") == len(analysis.findings)
    assert counted(folder, "connections") == len(analysis.connections)
    assert not [path for path in folder.rglob("*") if path.name.startswith(".")]
    assert {path.name for path in folder.iterdir()} <= set(TABLES)


def test_files_get_their_names_when_their_time_is_over(tmp_path: Path) -> None:
    companion = ExportCompanion(tmp_path, 5 * _MINUTE, "eth0", "0")
    reading = LiveRun(open_capture(str(TRANSFER)), Observer(), companions=[companion])
    start = 1_700_000_000_000_000_000
    companion.tick(start, Drops(0, 0))
    while reading.step():
        pass
    assert counted(tmp_path, "transactions") == analyze(TRANSFER).total  # the end of the run ends the files
    names = {path.name for path in tmp_path.glob("transactions/**/*.parquet")}
    companion = ExportCompanion(tmp_path, 5 * _MINUTE, "eth0", "0")
    for event in [*reading_transactions()]:
        companion.transaction(event)
    companion.tick(start, Drops(0, 0))
    companion.tick(start + 4 * _MINUTE, Drops(0, 0))
    assert {path.name for path in tmp_path.glob("transactions/**/*.parquet")} == names
    waiting = [path for path in tmp_path.glob("transactions/**/.*") if path.is_file()]
    assert [path.suffix for path in waiting] == [".part"]
    companion.tick(start + 5 * _MINUTE, Drops(0, 0))
    assert len(list(tmp_path.glob("transactions/**/*.parquet"))) == len(names) + 1
    companion.close()


def reading_transactions() -> list[dissect.Transaction]:
    return [event for event in dissect.open(TRANSFER, pdus=False) if isinstance(event, dissect.Transaction)]


def test_a_killed_run_leaves_whole_files_only(tmp_path: Path) -> None:
    folder = tmp_path / "plant"
    words = [
        sys.executable,
        "-m",
        "dissect",
        "monitor",
        "--plain",
        "-",
        "--export",
        f"parquet:{folder}",
        "--export-every",
        "1s",
    ]
    with subprocess.Popen(
        words, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    ) as process:
        assert process.stdin is not None
        process.stdin.write(TRANSFER.read_bytes())
        process.stdin.flush()
        deadline = time.monotonic() + 60
        while not list(folder.glob("transactions/**/*.parquet")) and time.monotonic() < deadline:
            time.sleep(0.05)
        process.kill()
        assert process.wait(30) == -signal.SIGKILL
    total = analyze(TRANSFER).total
    for name in TABLES:
        for file in (folder / name).glob("**/*.parquet"):
            duckdb.sql(f"SELECT * FROM '{file}'").fetchall()  # it is whole
    assert 0 < counted(folder, "transactions") <= total


def test_what_is_wrong_is_told_before_anything_is_watched(capfdbinary: Capture, tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.write_text("", encoding="utf-8")
    for words, told in (
        (("--export", "csv:x"), "only Parquet is written live"),
        (("--export", "parket:x"), "Did you mean parquet"),
        (("--export", f"parquet:{file}"), "is not a folder"),
        (("--export", "parquet:x", "--export-every", "0s"), "expected a time"),
    ):
        ran = run(capfdbinary, "monitor", "--plain", TRANSFER, *words)
        assert (ran.code, told in ran.err) == (2, True), ran.err
    assert list(tmp_path.iterdir()) == [file]
