"""An export to a folder on another machine: ``s3://BUCKET/KEY``, ``sftp://HOST/DIR`` and all other targets of fsspec.

Files are written under their final names, because an object store cannot rename. Therefore the file `UNFINISHED` is written
before all others, and removed when all of them are complete.
"""

from __future__ import annotations

import errno
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, Final, TypeVar

from dissect.packets.source.remote import explained, file_system, shown

#: The file that marks a folder while its export is being written.
UNFINISHED: Final = "s7dissect-unfinished"
#: Bytes that are sent at once. Object stores require pieces of at least 5 MiB, and accept at most 10,000 of them.
_PIECE: Final = 8 * 1024 * 1024
#: Transports on which a folder must be made first; on others it exists as soon as it contains something.
_WITH_FOLDERS: Final = frozenset(("file", "local", "sftp", "ssh", "smb", "ftp", "hdfs"))

T = TypeVar("T")


class RemoteFolder:
    """The folder that ``url`` names. All methods raise OSError with a text for users, and the URL without secrets."""

    def __init__(self, url: str) -> None:
        self.name = shown(url.rstrip("/"))
        self._with_folders = url.partition("://")[0].lower() in _WITH_FOLDERS
        self._files, path = self._asked(lambda: file_system(url.rstrip("/")))
        self._path = str(path).rstrip("/")

    def create(self, path: Path) -> Any:
        """Return a new file with the methods write, close and discard; ``path`` is relative to the folder."""
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
        """Return the names of the files and folders in the folder; empty if it does not exist."""

        def listed() -> list[str]:
            self._files.invalidate_cache()
            if not self._files.exists(self._path):
                return []
            found = self._files.ls(self._path, detail=False)
            return [str(each).rstrip("/").rpartition("/")[2] for each in found if str(each).rstrip("/") != self._path]

        return self._asked(listed)

    def has(self, name: str) -> bool:
        """Return whether there is a file with this name now (not according to a cache)."""

        def there() -> bool:
            self._files.invalidate_cache()
            return bool(self._files.exists(f"{self._path}/{name}"))

        return self._asked(there)

    def clear(self) -> None:
        """Remove everything in the folder; `UNFINISHED` first, so that a run that still writes there notices."""
        if UNFINISHED in self.names():
            self.remove(UNFINISHED)
        for name in self.names():
            self.remove(name)

    def remove(self, name: str) -> None:
        """Remove a file, or a folder with its contents."""
        self._asked(lambda: self._files.rm(f"{self._path}/{name}", recursive=True))

    def remove_matching(self, pattern: str) -> None:
        """Remove the files that match a pattern, in which ``*`` matches one part of a path."""

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
        """Return the OSError for an error of a transport."""
        return OSError(errno.EIO, explained(error, writing=True), self.name)


class _Writing:
    """A file of a `RemoteFolder` while it is written, with the methods that pyarrow needs."""

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
        """Do nothing: octets are sent when a piece is full."""

    def readable(self) -> bool:
        """Return False."""
        return False

    def writable(self) -> bool:
        """Return True."""
        return True

    def seekable(self) -> bool:
        """Return False: the file is written from its beginning to its end."""
        return False

    def close(self) -> None:
        """Send the rest; only then does the file exist."""
        if self.closed:
            return
        self.closed = True
        try:
            self._stream.close()
        except Exception as error:  # noqa: BLE001 - each transport has errors of its own
            raise self._folder.refused(error) from None

    def discard(self) -> None:
        """Close and remove the file; may be called in any state."""
        if self.closed:
            return
        self.closed = True
        with suppress(Exception):  # if the connection is lost, nothing can be done
            discard = getattr(self._stream, "discard", None)
            if discard is not None:
                discard()
                self._stream.closed = True  # otherwise the stream is sent when it is collected
            else:
                self._stream.close()
        with suppress(Exception):  # mostly the file does not exist
            self._folder.remove(self._name)
