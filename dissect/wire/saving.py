"""Writing a file that a person named: one way for every command.

A regular file, or one that is not there yet, is written beside its place under a name that ends with ``.part`` and takes its
place when it is whole; so it is there whole or not at all. A symbolic link stays, and what it points to is replaced. Anything
else, a device, a FIFO, a socket of the system, is opened and written to: it is never replaced.
"""

from __future__ import annotations

import itertools
import os
import shutil
import stat
from pathlib import Path
from types import TracebackType
from typing import Final, Self

#: What a file that is not finished ends with.
PART: Final = ".part"
#: Octets of a file's name that its unfinished name keeps: names may be 255 octets long.
_KEPT: Final = 100
_numbers: Final = itertools.count(1)


def is_special(path: str | os.PathLike[str]) -> bool:
    """Return whether ``path`` is there and no regular file: a device or a FIFO, which is written to and never replaced.

    A folder is none: it cannot be written to. Raises `OSError` where that cannot be found out, unless nothing is there.
    """
    try:
        mode = os.stat(path).st_mode  # noqa: PTH116 - text or path alike
    except FileNotFoundError:
        return False
    return not stat.S_ISREG(mode) and not stat.S_ISDIR(mode)


class Saving:
    """An output while it is written, as a context: write to ``path``, which takes its place when the block ends well.

    When the block raises, nothing is left of it and what was there before stays. ``mode`` are the rights of a new file, less
    the umask; one that is replaced keeps its own. Raises `OSError`, which names the output as the user did.
    """

    def __init__(self, output: str | os.PathLike[str], mode: int = 0o666) -> None:
        self.output = os.fspath(output)
        self.special = is_special(self.output)
        self._mode = mode
        if self.special:
            self.path = self.output
            return
        if not self.output:  # which would stand for the folder where one is
            raise FileNotFoundError(2, "the name is empty; was a variable of the shell not set?", "OUT")
        self._target = os.path.realpath(self.output)
        folder, name = os.path.split(self._target)
        if not name or os.path.isdir(self._target):  # noqa: PTH112 - a text from realpath
            raise IsADirectoryError(21, "Is a directory", self.output)
        short = os.fsdecode(os.fsencode(name)[:_KEPT])
        self.path = os.path.join(folder, f".{short}.{os.getpid()}-{next(_numbers)}{PART}")  # noqa: PTH118

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        if self.special:
            return
        if kind is None:
            try:
                self._take_its_place()
            except OSError as why:
                self._remove()
                raise OSError(why.errno, why.strerror, self.output) from None
        else:
            self._remove()

    def _take_its_place(self) -> None:
        try:
            mode = stat.S_IMODE(os.stat(self._target).st_mode)  # noqa: PTH116
        except FileNotFoundError:
            mask = os.umask(0)
            os.umask(mask)
            mode = self._mode & ~mask
        Path(self.path).chmod(mode)
        Path(self.path).replace(self._target)

    def _remove(self) -> None:
        Path(self.path).unlink(missing_ok=True)


def save(output: str | os.PathLike[str], octets: bytes, mode: int = 0o666) -> None:
    """Write ``octets`` to ``output`` as `Saving` does, to the disk before it takes its place. Raises `OSError`."""
    with Saving(output, mode) as saving:
        try:
            flags = os.O_WRONLY | getattr(os, "O_BINARY", 0) | getattr(os, "O_CLOEXEC", 0)
            if not saving.special:
                flags |= os.O_CREAT | os.O_EXCL
            descriptor = os.open(saving.path, flags, 0o600)
            try:
                rest = memoryview(octets)
                while rest:
                    rest = rest[os.write(descriptor, rest) :]
                if not saving.special:
                    os.fsync(descriptor)
            finally:
                os.close(descriptor)
        except OSError as why:
            raise OSError(why.errno, why.strerror, saving.output) from None


def expect_place(output: str | os.PathLike[str]) -> None:
    """Raise the `OSError` that `save` would raise, before a long capture is read for it: its folder is not there, or read-only.

    Only making a file tells for sure; it is gone at once. A device or FIFO is not opened: that alone may do something.
    """
    saving = Saving(output)
    if saving.special:
        return
    try:
        os.close(os.open(saving.path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_CLOEXEC", 0), 0o600))
        os.unlink(saving.path)  # noqa: PTH108 - a text
    except OSError as why:
        raise OSError(why.errno, why.strerror, saving.output) from None


class SavingFolder:
    """A folder of outputs while it is written, as a context: make files in ``path``, which takes its place when all went well.

    When the block raises, nothing is left of it and what was there before stays. A folder that was there is replaced as a
    whole; whether it may be is up to the caller. Raises `OSError`, which names the output as the user did.
    """

    def __init__(self, output: str | os.PathLike[str]) -> None:
        self.output = os.fspath(output)
        self._target = Path(os.path.realpath(self.output))
        if self._target.exists() and not self._target.is_dir():
            raise NotADirectoryError(20, "Not a directory", self.output)
        short = os.fsdecode(os.fsencode(self._target.name)[:_KEPT])
        self._number = f"{os.getpid()}-{next(_numbers)}"
        self._old = self._target.with_name(f".{short}.{self._number}.old{PART}")
        self._new = self._target.with_name(f".{short}.{self._number}{PART}")
        self.path = str(self._new)

    def __enter__(self) -> Self:
        try:
            self._new.mkdir()
        except OSError as why:
            raise OSError(why.errno, why.strerror, self.output) from None
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        if kind is not None:
            shutil.rmtree(self._new, ignore_errors=True)
            return
        try:
            if self._target.exists():
                self._target.rename(self._old)
            self._new.rename(self._target)
        except OSError as why:
            if self._old.exists() and not self._target.exists():
                self._old.rename(self._target)
            shutil.rmtree(self._new, ignore_errors=True)
            raise OSError(why.errno, why.strerror, self.output) from None
        shutil.rmtree(self._old, ignore_errors=True)
