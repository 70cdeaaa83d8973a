"""Rows of a task on their way to the process that writes the output: there may be too many for memory, so they wait in a file.

If both sides can reach a folder, the file is in it, and the result of the task is its name. Otherwise, as with a worker on
another machine, the rows are in the result itself, compressed and limited.
"""

from __future__ import annotations

import gzip
import io
import struct
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Final, NamedTuple

from dissect.files.jobs.tasks import FileError

#: Prefix of folders for such rows, in the folder for temporary files.
ROWS_FOLDER: Final = "s7dissect-rows-"
#: Maximum size of compressed rows in a result.
MOST_CARRIED: Final = 64 * 1024 * 1024
#: Bytes that are read at once.
_BLOCK: Final = 1024 * 1024
#: Larger rows are written to their file directly.
_SMALL: Final = 16 * 1024
#: Prefix of spare files, which can be reused for new rows.
_SPARE: Final = "spare-"
#: The sizes of the rows and of their index.
_PAIR: Final = struct.Struct("<QQ")


class Spooled(NamedTuple):
    """Rows: in the file ``path``, or compressed with gzip in ``carried``."""

    path: str
    carried: bytes


class Spool:
    """Takes the rows of one task; writes them to the file ``name`` in ``folder``, or into the result if that is empty."""

    def __init__(self, folder: str, name: str) -> None:
        self._path = str(Path(folder, name)) if folder else ""
        self._memory = io.BytesIO()
        self._file: IO[bytes] = (
            _begun(Path(self._path)) if folder else gzip.GzipFile("", "wb", 1, self._memory, 0)  # type: ignore[assignment]  # it writes bytes as a file does
        )

    @property
    def file(self) -> IO[bytes]:
        """The file to write to. Raises OSError if the disk is full."""
        return self._file

    def write(self, octets: bytes) -> None:
        """Take rows. Raises `FileError` if they exceed the size of a result, OSError if the disk is full."""
        try:
            self._file.write(octets)
        except OSError as error:
            raise OSError(error.errno, error.strerror, self._path) from None
        if self._memory.tell() > MOST_CARRIED:
            raise FileError(
                f"its rows are more than {MOST_CARRIED // 1024**2} MiB compressed; read it on the machine that writes them"
            )

    def write_indexed(self, octets: bytes, index: bytes) -> None:
        """Take rows and the positions of their numbers (`dissect.files.jobs.spots`), for `indexed`. Raises as `write` does."""
        for part in (_PAIR.pack(len(octets), len(index)), octets, index):
            self.write(part)

    def done(self) -> Spooled:
        """Return the rows and end the spool. Raises OSError if the disk is full."""
        if self._path:
            self._file.truncate()  # the reused file may have been longer
        self._file.close()
        return Spooled(self._path, self._memory.getvalue())

    def abandon(self) -> None:
        """Drop the rows; may be called in every state."""
        try:
            self._file.close()
        except OSError:
            self._memory.close()  # the disk is full: the partial file is deleted as well
        if self._path:
            Path(self._path).unlink(missing_ok=True)


def _begun(path: Path) -> IO[bytes]:
    """Return an empty file, if possible a spare one: space that is already allocated costs half as much to write."""
    for spare in path.parent.glob(f"{_SPARE}*"):
        try:
            spare.rename(path)
        except FileNotFoundError:  # another task took it
            continue
        return path.open("r+b", _SMALL)
    return path.open("wb", _SMALL)


@contextmanager
def opened(spooled: Spooled, spare: bool = False) -> Iterator[IO[bytes]]:
    """Return the file with the rows, which can be read once; with ``spare``, later rows may reuse its space."""
    if not spooled.path:
        with gzip.GzipFile(fileobj=io.BytesIO(spooled.carried)) as packed:
            yield packed  # type: ignore[misc]  # it reads as a file does
        return
    try:
        with Path(spooled.path).open("rb") as file:
            yield file
    finally:
        path = Path(spooled.path)
        if spare:
            with suppress(FileNotFoundError):  # the file is gone, which the reader reports
                path.replace(path.with_name(f"{_SPARE}{path.name}"))
        else:
            path.unlink(missing_ok=True)


def indexed(file: IO[bytes]) -> Iterator[tuple[bytes, bytes]]:
    """Yield rows and their index, as they were passed to `Spool.write_indexed`."""
    while head := file.read(_PAIR.size):
        octets, index = _PAIR.unpack(head)
        yield file.read(octets), file.read(index)


def whole_lines(file: IO[bytes]) -> Iterator[bytes]:
    """Yield the contents of a file in pieces that end at line ends."""
    while block := file.read(_BLOCK):
        yield block if block.endswith(b"\n") else block + file.readline()
