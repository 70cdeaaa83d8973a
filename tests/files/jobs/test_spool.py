"""Rows of a task: in a file where both sides reach a folder, else in the result, bounded."""

from __future__ import annotations

import pickle
import random
from pathlib import Path

import pytest

from dissect.files.jobs import spool
from dissect.files.jobs.spool import Spool, indexed, opened, whole_lines
from dissect.files.jobs.tasks import FileError


def rows(count: int) -> bytes:
    return b"".join([b"row %d\n" % number for number in range(count)])


def test_rows_come_as_they_went(tmp_path: Path) -> None:
    for folder in ("", str(tmp_path)):
        for count in (0, 1, 300_000):
            spooled = Spool(folder, "rows")
            spooled.write(rows(count))
            spooled.write(b"")
            with opened(pickle.loads(pickle.dumps(spooled.done()))) as file:
                pieces = list(whole_lines(file))
            assert b"".join(pieces) == rows(count)
            assert all([piece.endswith(b"\n") and len(piece) < 2 * 1024 * 1024 for piece in pieces])
    assert not any(tmp_path.iterdir()), "whoever takes the rows removes the file"


def test_rows_come_with_their_index(tmp_path: Path) -> None:
    """The file of rows that were taken is that of the next ones, whether these are more or fewer."""
    given = [(rows(count), bytes(24 * count)) for count in (3, 1, 9000, 2)]
    for folder in ("", str(tmp_path)):
        for some in (given, given[:2], given[:3]):
            spooled = Spool(folder, "rows")
            for octets, index in some:
                spooled.write_indexed(octets, index)
            with opened(spooled.done(), spare=True) as file:
                assert list(indexed(file)) == some
            assert len(list(tmp_path.iterdir())) == (1 if folder else 0)
    one, other = Spool(str(tmp_path), "one"), Spool(str(tmp_path), "other")
    one.write(b"1\n")
    other.write(b"2\n")
    assert {path.name for path in tmp_path.iterdir()} == {"one", "other"}
    for spooled, octets in ((one, b"1\n"), (other, b"2\n")):
        with opened(spooled.done()) as file:
            assert file.read() == octets


def test_what_a_result_carries_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(spool, "MOST_CARRIED", 1024 * 1024)
    spooled = Spool("", "rows")
    octets = random.Random(1).randbytes(1024 * 1024)
    spooled.write(octets[:512])
    with pytest.raises(FileError, match="more than 1 MiB compressed"):
        spooled.write(octets * 2)


@pytest.mark.parametrize("spare", [False, True])
def test_a_file_that_was_removed_is_told_of_as_that(spare: bool, tmp_path: Path) -> None:
    spooled = Spool(str(tmp_path), "rows").done()
    Path(spooled.path).unlink()
    with pytest.raises(FileNotFoundError) as told, opened(spooled, spare=spare):
        pass
    assert told.value.filename == spooled.path
    assert told.value.__context__ is None


def test_what_is_abandoned_is_gone(tmp_path: Path) -> None:
    spooled = Spool(str(tmp_path), "rows")
    spooled.write(rows(10))
    spooled.abandon()
    assert not any(tmp_path.iterdir())
