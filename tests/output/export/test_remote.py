"""Folders of other machines: what is in them while an export is written, and after it. The machine is fsspec's in memory."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import pytest

from dissect.cli.remote_export import close_wanted, saved_remotely
from dissect.files.jobs.tasks import FileError
from dissect.output.export.forms import Target, target_of
from dissect.output.export.remote import UNFINISHED, RemoteFolder
from tests.cli.support import run
from tests.meaning.report.schemas import ROOT

fsspec = pytest.importorskip("fsspec", reason="no fsspec: pip install 's7dissect[test]'")

SZL: Final = ROOT / "captures" / "szl.pcapng"
CLOCK: Final = ROOT / "captures" / "clock.pcapng"
URL: Final = "memory://plant/out.parquet"


@pytest.fixture(autouse=True)
def files() -> Iterator[Any]:
    """The file system, which all of a process share."""
    system = fsspec.filesystem("memory")
    yield system
    system.store.clear()
    system.pseudo_dirs[:] = [""]


def test_a_file_is_there_when_it_is_closed_and_not_when_it_is_discarded(files: Any) -> None:
    folder = RemoteFolder(f"{URL}/")
    assert folder.names() == []
    for end in ("close", "discard"):
        file = folder.create(Path("table", f"{end}.parquet"))
        assert (file.write(b"abc"), file.write(memoryview(b"de")), file.tell()) == (3, 2, 5)
        assert (file.readable(), file.writable(), file.seekable()) == (False, True, False)
        getattr(file, end)()
        file.discard()
        file.close()
    assert files.find("/plant") == ["/plant/out.parquet/table/close.parquet"]
    assert files.cat("/plant/out.parquet/table/close.parquet") == b"abcde"
    folder.remove_matching("*/clo*.parquet")
    assert files.find("/plant") == []


def test_what_is_not_whole_says_so_and_goes_when_it_fails(files: Any) -> None:
    target = target_of(URL, (), 2)
    with saved_remotely(target, False, "mark") as folder:
        assert folder.names() == [UNFINISHED]
        folder.write("mark", b"")
    assert folder.names() == ["mark"]
    with pytest.raises(KeyError):
        _break_off(target)
    assert files.find("/plant") == []


def _break_off(target: Target) -> None:
    with saved_remotely(target, True, "mark") as folder:
        assert folder.names() == [UNFINISHED]
        folder.write("table/x.parquet", b"row")
        raise KeyError


def test_who_still_writes_when_the_export_was_broken_off_leaves_nothing() -> None:
    folder = RemoteFolder(URL)
    export: Any = object()  # of which nothing may be asked
    with pytest.raises(FileError, match=r"^memory://plant/out\.parquet: the export was broken off meanwhile$"):
        close_wanted(folder, export)


def test_the_command(capfdbinary: pytest.CaptureFixture[bytes], files: Any) -> None:
    """With --separate and without, of one capture and of several; a table without rows is there with its columns."""
    parquet = pytest.importorskip("pyarrow.parquet")
    made = []
    for options, captures in ((("--separate",), [SZL, CLOCK]), ((), [SZL, CLOCK]), ((), [SZL])):
        ran = run(capfdbinary, "export", *options, *captures, "-o", URL, "--force")
        assert (ran.code, ran.err.splitlines()[-1].endswith(f" written to {URL}")) == (0, True)
        rows: dict[str, int] = {}
        for path in files.find("/plant"):
            if path.endswith(".parquet"):
                table = path.split("/")[3].removesuffix(".parquet")
                with files.open(path, "rb") as file:
                    rows[table] = rows.get(table, 0) + parquet.ParquetFile(file).metadata.num_rows
        made.append(rows)
        assert UNFINISHED not in RemoteFolder(URL).names()
    devices = [rows.pop("devices") for rows in made]  # each of the captures by itself has them
    assert made[0] == made[1]
    assert set(made[2]) == set(made[0])
    assert 0 < made[2]["transactions"] < made[0]["transactions"]
    assert 0 in made[0].values()
    assert devices == [2, 1, 1]
    # A capture that cannot be read leaves nothing of the export.
    ran = run(capfdbinary, "export", "no-such.pcap", "-o", "memory://plant/other.parquet")
    assert ran.code == 2
    assert [path for path in files.find("/plant") if "other" in path] == []
