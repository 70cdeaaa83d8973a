"""Checks whether the terminal can show the screens, and reads keys from it when standard input is a capture."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final


class NoKeyboardError(Exception):
    """There is no terminal to read keys from."""


_TERMINAL: Final = "/dev/tty"


def will_do() -> bool:
    """Return whether screens can be shown: textual draws on standard error, and a dumb terminal cannot place anything."""
    if sys.stdout is None or sys.stderr is None or os.environ.get("TERM", "dumb") == "dumb":
        return False
    return sys.stdout.isatty() and sys.stderr.isatty()


@contextmanager
def keyboard() -> Iterator[None]:
    """A context in which keys are read from the terminal although standard input is something else, such as a pipe.

    In the context, `sys.stdin` is the original standard input under another descriptor, and descriptor 0, from which textual
    reads keys, is the terminal. Raises `NoKeyboardError` when there is no terminal.
    """
    standing = sys.stdin
    if standing is None or standing.isatty():
        yield
        return
    try:
        terminal = os.open(_TERMINAL, os.O_RDWR | getattr(os, "O_CLOEXEC", 0))
    except OSError as error:
        raise NoKeyboardError(f"{_TERMINAL}: {error.strerror or error}") from error
    piped = os.dup(0)
    os.dup2(terminal, 0)
    os.close(terminal)
    moved = os.fdopen(os.dup(piped), "r", encoding="utf-8", errors="replace")
    sys.stdin = moved
    try:
        yield
    finally:
        sys.stdin = standing
        os.dup2(piped, 0)
        os.close(piped)
        moved.close()
