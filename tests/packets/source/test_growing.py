"""A file that grows while it is read."""

from __future__ import annotations

import gc
import os
from pathlib import Path

import pytest

from dissect.packets.source import growing
from dissect.packets.source.growing import GrowingFile


def test_each_read_gives_what_was_added(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_bytes(b"one")
    file = GrowingFile(path)
    assert (file.more(), file.more()) == (b"one", b"")
    with path.open("ab") as end:
        end.write(b"two")
    assert (file.more(), file.more()) == (b"two", b"")


def test_a_file_that_was_begun_anew(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_bytes(b"a long beginning")
    file = GrowingFile(path)
    file.more()
    path.write_bytes(b"new")
    assert file.more() == b"new"


def test_a_file_that_is_gone_or_that_nobody_may_open_again(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_bytes(b"one")
    file = GrowingFile(path)
    path.unlink()
    assert (file.more(), file.more()) == (b"one", b"")


def test_no_more_than_the_bound_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(growing, "MAX_READ", 10)
    path = tmp_path / "file"
    path.write_bytes(b"0123456")
    file = GrowingFile(path)
    assert file.more() == b"0123456"
    path.write_bytes(b"0123456789abcdef")
    assert (file.more(), file.more()) == (b"789", b"")


def test_the_bound_is_that_of_a_file_not_of_all_that_it_ever_was(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(growing, "MAX_READ", 10)
    path = tmp_path / "file"
    path.write_bytes(b"01234567")
    file = GrowingFile(path)
    read = [file.more()]
    for text in (b"one", b"2", b""):
        path.write_bytes(text)
        read.append(file.more())
    path.write_bytes(b"three")
    assert [*read, file.more(), file.begun] == [b"01234567", b"one", b"2", b"", b"three", 3]


def test_what_cannot_be_read(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        GrowingFile(tmp_path / "nowhere")
    with pytest.raises(OSError, match="directory"):
        GrowingFile(tmp_path)


def test_it_is_closed_when_nobody_needs_it(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_bytes(b"")
    file = GrowingFile(path)
    descriptor = file._descriptor
    os.fstat(descriptor)
    del file
    gc.collect()
    with pytest.raises(OSError, match="Bad file descriptor"):
        os.fstat(descriptor)
