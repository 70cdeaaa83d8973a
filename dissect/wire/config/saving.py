"""Writes a file that the user named, in the same way for every command.

A regular file, or a new one, is written under a temporary name in the same folder, which ends with ``.part``, and then renamed;
so the file is either complete or not there at all. A symbolic link stays; the file that it points to is replaced. Anything
else, such as a device or a FIFO, is opened and written to, and never replaced.
"""

from __future__ import annotations

import itertools
import os
import shutil
import stat
from pathlib import Path
from types import TracebackType
from typing import Final, Self

#: The end of the name of an unfinished file.
PART: Final = ".part"
#: How many octets of a file's name its temporary name keeps: a name may have at most 255.
_KEPT: Final = 100
_numbers: Final = itertools.count(1)


def is_special(path: str | os.PathLike[str]) -> bool:
    """Return whether ``path`` is a device, a FIFO or another file that is written to but never replaced.

    False for a regular file, a folder, and a missing file. Raises `OSError` if that cannot be found out.
    """
    try:
        mode = os.stat(path).st_mode  # noqa: PTH116 - text or path alike
    except FileNotFoundError:
        return False
    return not stat.S_ISREG(mode) and not stat.S_ISDIR(mode)


class Saving:
    """A context in which an output is written: write to ``path``, which is renamed to the output when the block ends well.

    If the block raises, ``path`` is removed, and an existing file stays. ``mode`` is the mode of a new file, less the umask; a
    file that is replaced keeps its mode. An `OSError` names the output as the user did.
    """

    def __init__(self, output: str | os.PathLike[str], mode: int = 0o666) -> None:
        self.output = os.fspath(output)
        self.special = is_special(self.output)
        self._mode = mode
        if self.special:
            self.path = self.output
            return
        if not self.output:  # an empty path would mean the current folder
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
    """Write ``octets`` to ``output`` as `Saving` does, and sync them to the disk before the rename. Raises `OSError`."""
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
    """Raise the `OSError` that `save` would raise, before a long capture is read: for a missing or read-only folder.

    The only proof is to create a file; it is removed at once. A device or FIFO is not opened, because that alone may have an
    effect.
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
    """A context in which a folder of outputs is written: make files in ``path``, which is renamed when the block ends well.

    If the block raises, ``path`` is removed, and an existing folder stays. Otherwise that folder is replaced as a whole; the
    caller decides whether it may be. An `OSError` names the output as the user did.
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
