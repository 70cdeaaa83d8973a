"""Rows of a task on their way to whoever writes the output: too many to be held in memory, so they wait in a file.

Where both can reach a folder, the file is in it, and the result of the task is its name. Where they cannot, as with a worker on
another machine, the rows are in the result itself, compressed and bounded.
"""

from __future__ import annotations

import gzip
import io
import struct
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Final, NamedTuple

from dissect.jobs.tasks import FileError

#: What the name of a folder begins with that holds nothing but rows on their way, in the one for temporary files.
ROWS_FOLDER: Final = "s7dissect-rows-"
#: Compressed bytes of rows that one result may carry.
MOST_CARRIED: Final = 64 * 1024 * 1024
#: Bytes that are taken together.
_BLOCK: Final = 1024 * 1024
#: Rows of more bytes than this go to their file as they are.
_SMALL: Final = 16 * 1024
#: What the name of a file begins with that nobody needs any more, until somebody writes another one.
_SPARE: Final = "spare-"
#: How long rows and their index are.
_PAIR: Final = struct.Struct("<QQ")


class Spooled(NamedTuple):
    """Rows: in the file ``path``, or compressed with gzip in ``carried``."""

    path: str
    carried: bytes


class Spool:
    """Takes the rows of one task; they go to the file ``name`` in ``folder``, or where that is empty into the result."""

    def __init__(self, folder: str, name: str) -> None:
        self._path = str(Path(folder, name)) if folder else ""
        self._memory = io.BytesIO()
        self._file: IO[bytes] = (
            _begun(Path(self._path)) if folder else gzip.GzipFile("", "wb", 1, self._memory, 0)  # type: ignore[assignment]  # it writes bytes as a file does
        )

    @property
    def file(self) -> IO[bytes]:
        """The file to write to. Raises OSError when the disk is full."""
        return self._file

    def write(self, octets: bytes) -> None:
        """Take rows. Raises `FileError` for more than a result may carry, OSError when the disk is full."""
        try:
            self._file.write(octets)
        except OSError as error:
            raise OSError(error.errno, error.strerror, self._path) from None
        if self._memory.tell() > MOST_CARRIED:
            raise FileError(
                f"its rows are more than {MOST_CARRIED // 1024**2} MiB compressed; read it on the machine that writes them"
            )

    def write_indexed(self, octets: bytes, index: bytes) -> None:
        """Take rows and where their numbers stand (`dissect.jobs.spots`), for `indexed`. Raises as `write` does."""
        for part in (_PAIR.pack(len(octets), len(index)), octets, index):
            self.write(part)

    def done(self) -> Spooled:
        """Return the rows; nothing can be written any more. Raises OSError when the disk is full."""
        if self._path:
            self._file.truncate()  # where it was a longer one
        self._file.close()
        return Spooled(self._path, self._memory.getvalue())

    def abandon(self) -> None:
        """Forget the rows; may be called whatever became of them."""
        try:
            self._file.close()
        except OSError:
            self._memory.close()  # the disk is full: what there is of the file goes as well
        if self._path:
            Path(self._path).unlink(missing_ok=True)


def _begun(path: Path) -> IO[bytes]:
    """Return a new file, where there is one to spare that: room that the system already has costs half as much to write."""
    for spare in path.parent.glob(f"{_SPARE}*"):
        try:
            spare.rename(path)
        except FileNotFoundError:  # somebody else has it
            continue
        return path.open("r+b", _SMALL)
    return path.open("wb", _SMALL)


@contextmanager
def opened(spooled: Spooled, spare: bool = False) -> Iterator[IO[bytes]]:
    """Give a file with the rows, which is there for this once; with ``spare`` rows to come may take its place in its folder."""
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
            with suppress(FileNotFoundError):  # it was gone, as whoever reads it is told
                path.replace(path.with_name(f"{_SPARE}{path.name}"))
        else:
            path.unlink(missing_ok=True)


def indexed(file: IO[bytes]) -> Iterator[tuple[bytes, bytes]]:
    """Yield rows and their index, as they went to `Spool.write_indexed`."""
    while head := file.read(_PAIR.size):
        octets, index = _PAIR.unpack(head)
        yield file.read(octets), file.read(index)


def whole_lines(file: IO[bytes]) -> Iterator[bytes]:
    """Yield what a file holds in pieces that end where a line ends."""
    while block := file.read(_BLOCK):
        yield block if block.endswith(b"\n") else block + file.readline()
