"""`Error`: the base of the exceptions of this package that a program may want to catch."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any


class Error(Exception):
    """The base of the exceptions about wrong input: a file, an expression, keys, tags, a dictionary.

    A mistake in the program itself (a wrong type, two arguments that exclude each other) is a TypeError or a ValueError.
    """

    def __reduce__(self) -> tuple[Any, ...]:
        return (
            _again,
            (type(self), self.args),
            self.__dict__,
        )  # constructors take other arguments than the message


def _again(kind: type[Error], arguments: tuple[Any, ...]) -> Error:
    return kind.__new__(kind, *arguments)


class CaptureError(Error):
    """The input that the user named cannot be used: not a capture, a decompressor that is not installed."""


class MissingCaptureError(CaptureError, FileNotFoundError):
    """There is no such file."""


class MissingFileError(Error, FileNotFoundError):
    """There is no such file of tags, keys, bindings or a dictionary."""


class UnreadableFileError(Error, OSError):
    """The file exists, but the system does not allow reading it."""


@contextmanager
def of_family() -> Iterator[None]:
    """Turn an error of the system about a file that a program named into an `Error`."""
    try:
        yield
    except Error:
        raise
    except FileNotFoundError as error:
        raise MissingFileError(f"{error.filename}: no such file") from None
    except OSError as error:
        raise UnreadableFileError(f"{error.filename}: {(error.strerror or str(error)).lower()}") from None
