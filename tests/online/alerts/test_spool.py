"""Alerts on disk: heavy ones first, never more than fit, taken over by the next run, in memory where there is no disk."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from dissect.online.alerts.spool import Spool, Spooled, default_folder

ERROR, WARNING, NOTE = 0, 1, 2


_open: list[Spool] = []


@pytest.fixture(autouse=True)
def closed() -> Iterator[None]:
    yield
    while _open:
        _open.pop().close()


def opened(folder: Path, most: int = 10, most_octets: int = 1 << 20) -> Spool:
    spool = Spool(folder, "hook", most, most_octets)
    spool.open()
    assert spool.trouble == ""
    _open.append(spool)
    return spool


def put(spool: Spool, rank: int, content: bytes) -> list[Spooled]:
    """Have an alert wait; return those that had to go for it."""
    dropped = spool.keep(spool.write(rank, content))
    for one in dropped:
        spool.remove(one)
    return dropped


def files(folder: Path) -> list[bytes]:
    return [path.read_bytes() for path in sorted(folder.rglob("*.json"))]


def drained(spool: Spool) -> list[bytes]:
    """Return what waits in the order in which it is taken, and deliver it."""
    told = []
    while (taken := spool.take()) is not None:
        content = spool.read(taken)
        assert content is not None
        told.append(content)
        spool.remove(taken)
        spool.done(taken)
    return told


def test_the_heaviest_are_taken_first_and_go_when_they_are_done(tmp_path: Path) -> None:
    spool = opened(tmp_path)
    for rank, content in ((NOTE, b"n1"), (ERROR, b"e1"), (WARNING, b"w1"), (ERROR, b"e2")):
        assert put(spool, rank, content) == []
    assert files(tmp_path) == [b"e1", b"e2", b"w1", b"n1"]
    taken = spool.take()
    assert taken is not None
    spool.put_back(taken)
    assert drained(spool) == [b"e1", b"e2", b"w1", b"n1"]
    assert (files(tmp_path), len(spool)) == ([], 0)


def test_the_next_run_takes_over_what_was_left_also_what_was_under_way(tmp_path: Path) -> None:
    spool = opened(tmp_path)
    for rank, content in ((WARNING, b"w"), (ERROR, b"e")):
        put(spool, rank, content)
    assert spool.take() is not None
    (spool.folder / ".0-1.json.7-1.part").write_bytes(b"half")
    (spool.folder / "notes.txt").write_bytes(b"of a person")
    spool.close()
    again = opened(tmp_path)
    assert drained(again) == [b"e", b"w"]
    assert sorted([path.name for path in again.folder.iterdir()]) == [".lock", "notes.txt"]


@pytest.mark.parametrize(("most", "most_octets"), [(3, 1 << 20), (100, 6)])
def test_the_oldest_of_the_lightest_go_first(tmp_path: Path, most: int, most_octets: int) -> None:
    spool = opened(tmp_path, most, most_octets)
    dropped = []
    for rank, content in (
        (NOTE, b"n1"),
        (NOTE, b"n2"),
        (WARNING, b"w1"),
        (ERROR, b"e1"),
        (ERROR, b"e2"),
        (NOTE, b"n3"),
    ):
        dropped += [one.rank for one in put(spool, rank, content)]
    assert dropped == [NOTE, NOTE, NOTE]
    assert files(tmp_path) == [b"e1", b"e2", b"w1"]


def test_two_processes_do_not_share_a_folder(tmp_path: Path) -> None:
    one, other = opened(tmp_path), opened(tmp_path)
    put(one, ERROR, b"1")
    put(other, ERROR, b"2")
    assert one.folder != other.folder
    assert (drained(one), drained(other)) == ([b"1"], [b"2"])


def test_without_a_disk_alerts_wait_in_memory_and_that_is_told(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"")
    spool = Spool(tmp_path / "file" / "folder", "hook")
    assert spool.prepare() == []
    spool.open()
    assert spool.trouble.endswith("Not a directory")
    put(spool, NOTE, b"n")
    put(spool, ERROR, b"e")
    assert spool.lost_at_end == 2
    assert drained(spool) == [b"e", b"n"]


def test_names_of_actions_make_no_paths(tmp_path: Path) -> None:
    for name in ("../../x", ".", "a/b", "\x1b"):
        assert Spool(tmp_path, name).folder.parent == tmp_path


def test_where_they_wait(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("STATE_DIRECTORY", "/var/lib/s7dissect:/var/lib/other")
    assert default_folder() == Path("/var/lib/s7dissect/alerts")
    monkeypatch.delenv("STATE_DIRECTORY")
    monkeypatch.setenv("XDG_STATE_HOME", "/state")
    assert default_folder() == Path("/state/s7dissect/alerts")
    monkeypatch.delenv("XDG_STATE_HOME")
    monkeypatch.setattr(os, "geteuid", lambda: 0)
    assert default_folder() == Path("/var/lib/s7dissect/alerts")
    monkeypatch.setattr(os, "geteuid", lambda: 1000)
    monkeypatch.setenv("HOME", "/home/op")
    assert default_folder() == Path("/home/op/.local/state/s7dissect/alerts")
