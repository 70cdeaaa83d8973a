"""An export in a folder of another machine: ``s3://BUCKET/KEY``, ``sftp://HOST/DIR`` and where else fsspec can write.

Files are written under their own names, because an object store cannot rename. What is not whole has the file `UNFINISHED`,
which is there before all others and goes when all of them are written.
"""

from __future__ import annotations

import errno
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, Final, TypeVar

from dissect.source.remote import explained, file_system, shown

#: Is in a folder as long as its export is being written.
UNFINISHED: Final = "s7dissect-unfinished"
#: Bytes that are sent at once. Object stores want 5 MiB at least, and take 10,000 such pieces.
_PIECE: Final = 8 * 1024 * 1024
#: Transports whose folders are made, where those of others exist as soon as something is in them.
_WITH_FOLDERS: Final = frozenset(("file", "local", "sftp", "ssh", "smb", "ftp", "hdfs"))

T = TypeVar("T")


class RemoteFolder:
    """The folder that ``url`` names. All methods raise OSError, in words for a person, with the name as it may be shown."""

    def __init__(self, url: str) -> None:
        self.name = shown(url.rstrip("/"))
        self._with_folders = url.partition("://")[0].lower() in _WITH_FOLDERS
        self._files, path = self._asked(lambda: file_system(url.rstrip("/")))
        self._path = str(path).rstrip("/")

    def create(self, path: Path) -> Any:
        """Return a new file that can be written to, closed and discarded; ``path`` is relative to the folder."""
        place = f"{self._path}/{path.as_posix()}"

        def opened() -> Any:
            if self._with_folders:
                self._files.makedirs(place.rpartition("/")[0], exist_ok=True)
            return self._files.open(place, "wb", block_size=_PIECE)

        return _Writing(self, self._asked(opened), path.as_posix())

    def write(self, name: str, octets: bytes) -> None:
        """Write a small file."""
        file = self.create(Path(name))
        file.write(octets)
        file.close()

    def names(self) -> list[str]:
        """Return the files and folders in the folder, none where it is not there."""

        def listed() -> list[str]:
            self._files.invalidate_cache()
            if not self._files.exists(self._path):
                return []
            found = self._files.ls(self._path, detail=False)
            return [str(each).rstrip("/").rpartition("/")[2] for each in found if str(each).rstrip("/") != self._path]

        return self._asked(listed)

    def has(self, name: str) -> bool:
        """Return whether there is a file, as things are now."""

        def there() -> bool:
            self._files.invalidate_cache()
            return bool(self._files.exists(f"{self._path}/{name}"))

        return self._asked(there)

    def clear(self) -> None:
        """Remove all that is in the folder; `UNFINISHED` goes first, so that whoever still writes sees that nobody wants it."""
        if UNFINISHED in self.names():
            self.remove(UNFINISHED)
        for name in self.names():
            self.remove(name)

    def remove(self, name: str) -> None:
        """Remove a file, or a folder with what is in it."""
        self._asked(lambda: self._files.rm(f"{self._path}/{name}", recursive=True))

    def remove_matching(self, pattern: str) -> None:
        """Remove the files that a pattern finds, ``*`` for one name of a path."""

        def removed() -> None:
            self._files.invalidate_cache()
            for path in self._files.glob(f"{self._path}/{pattern}"):
                self._files.rm(path)

        self._asked(removed)

    def _asked(self, ask: Callable[[], T]) -> T:
        try:
            return ask()
        except Exception as error:  # noqa: BLE001 - each transport has errors of its own
            raise self.refused(error) from None

    def refused(self, error: Exception) -> OSError:
        """Return what an error of a transport is."""
        return OSError(errno.EIO, explained(error, writing=True), self.name)


class _Writing:
    """A file of a `RemoteFolder` while it is written, as pyarrow takes it."""

    def __init__(self, folder: RemoteFolder, stream: Any, name: str) -> None:
        self._folder = folder
        self._stream = stream
        self._name = name
        self._octets = 0
        self.closed = False

    def write(self, octets: Any) -> int:
        """Write bytes."""
        count = len(memoryview(octets).cast("B"))
        try:
            self._stream.write(bytes(octets))
        except Exception as error:  # noqa: BLE001 - each transport has errors of its own
            raise self._folder.refused(error) from None
        self._octets += count
        return count

    def tell(self) -> int:
        """Return how many bytes were written."""
        return self._octets

    def flush(self) -> None:
        """What waits is sent in pieces."""

    def readable(self) -> bool:
        """It is for writing."""
        return False

    def writable(self) -> bool:
        """It is."""
        return True

    def seekable(self) -> bool:
        """It is written from its beginning to its end."""
        return False

    def close(self) -> None:
        """Send the rest; the file is there then."""
        if self.closed:
            return
        self.closed = True
        try:
            self._stream.close()
        except Exception as error:  # noqa: BLE001 - each transport has errors of its own
            raise self._folder.refused(error) from None

    def discard(self) -> None:
        """Leave nothing of the file; may be called whatever became of it."""
        if self.closed:
            return
        self.closed = True
        with suppress(Exception):  # where the connection is lost, there is nothing that could be done
            discard = getattr(self._stream, "discard", None)
            if discard is not None:
                discard()
                self._stream.closed = True  # else it is sent when it is forgotten
            else:
                self._stream.close()
        with suppress(Exception):  # most often it is not there
            self._folder.remove(self._name)
