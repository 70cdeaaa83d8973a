from __future__ import annotations

import os
import stat
import threading
from pathlib import Path

import pytest

from dissect.wire.config.saving import Saving, is_special, save


def names(folder: Path) -> list[str]:
    return sorted([path.name for path in folder.iterdir()])


def test_a_new_file_is_there_whole_or_not_at_all(tmp_path: Path) -> None:
    path = tmp_path / "a"
    with Saving(path) as saving:
        Path(saving.path).write_bytes(b"half")
        assert names(tmp_path) == [Path(saving.path).name]
        assert saving.path.endswith(".part")
        Path(saving.path).write_bytes(b"whole")
    assert (names(tmp_path), path.read_bytes()) == (["a"], b"whole")
    mask = os.umask(0)
    os.umask(mask)
    assert stat.S_IMODE(path.stat().st_mode) == 0o666 & ~mask


def test_what_was_there_stays_when_it_fails(tmp_path: Path) -> None:
    path = tmp_path / "a"
    path.write_bytes(b"before")

    def write() -> None:
        with Saving(path) as saving:
            Path(saving.path).write_bytes(b"half")
            raise KeyError

    with pytest.raises(KeyError):
        write()
    assert (names(tmp_path), path.read_bytes()) == (["a"], b"before")


def test_a_file_that_is_replaced_keeps_its_rights(tmp_path: Path) -> None:
    path = tmp_path / "a"
    path.write_bytes(b"before")
    path.chmod(0o604)
    save(path, b"after")
    assert (path.read_bytes(), stat.S_IMODE(path.stat().st_mode)) == (b"after", 0o604)


@pytest.mark.parametrize("there", [True, False])
def test_a_link_stays_and_its_target_is_written(tmp_path: Path, there: bool) -> None:
    folder = tmp_path / "elsewhere"
    folder.mkdir()
    target = folder / "target"
    if there:
        target.write_bytes(b"before")
    link = tmp_path / "link"
    link.symlink_to("elsewhere/target")
    save(link, b"after")
    assert (link.is_symlink(), target.is_symlink(), target.read_bytes()) == (True, False, b"after")
    assert (names(tmp_path), names(folder)) == (["elsewhere", "link"], ["target"])


@pytest.mark.parametrize("linked", [False, True])
def test_a_fifo_is_written_to(tmp_path: Path, linked: bool) -> None:
    fifo = tmp_path / "fifo"
    os.mkfifo(fifo)
    path = tmp_path / "link" if linked else fifo
    if linked:
        path.symlink_to(fifo)
    came: list[bytes] = []
    reader = threading.Thread(target=lambda: came.append(fifo.read_bytes()))
    reader.start()
    save(path, b"x" * 200_000)
    reader.join(30)
    assert came == [b"x" * 200_000]
    assert stat.S_ISFIFO(fifo.stat().st_mode)
    assert is_special(path)


@pytest.mark.skipif(not hasattr(os, "mknod") or os.geteuid() != 0, reason="only root makes nodes")
def test_a_device_is_written_to_and_stays(tmp_path: Path) -> None:
    device = tmp_path / "null"
    try:
        os.mknod(device, 0o600 | stat.S_IFCHR, os.makedev(1, 3))
        device.open("wb").close()
    except OSError:
        pytest.skip("no device nodes in this folder")
    save(device, b"gone")
    assert stat.S_ISCHR(device.stat().st_mode)
    assert names(tmp_path) == ["null"]


def test_what_cannot_be_written_is_told_by_the_name_the_user_gave(tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "loop").symlink_to("loop")
    for path in (tmp_path / "none" / "a", tmp_path / "folder", tmp_path / "loop"):
        with pytest.raises(OSError, match=r".") as told:
            save(path, b"x")
        assert told.value.filename == str(path)
    assert names(tmp_path) == ["folder", "loop"]


def test_a_name_as_long_as_names_may_be(tmp_path: Path) -> None:
    path = tmp_path / ("ä" * 127)
    save(path, b"x")
    assert path.read_bytes() == b"x"
