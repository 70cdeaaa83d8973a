"""Runs inside the page, in its worker: the unchanged commands, with their output passed to the page.

This is Python in a browser: the chosen files are mounted, and the script that starts this receives the output.
"""

from __future__ import annotations

import gc
import io
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

from dissect.wire.text import printable

#: Commands that need something that a browser does not have.
_ELSEWHERE: Final = {
    "cluster-check": "other machines",
    "completion": "a shell",
    "extcap": "Wireshark",
    "interfaces": "network interfaces",
    "monitor": "network interfaces",
    "open": "Wireshark",
    "proxy": "the network",
    "replay": "the network",
    "serve": "the network",
    "alerts": "the network",
    "sql": "DuckDB, which is compiled",
    "verify": "tshark",
    "browser": "npm and PyPI",
}
#: Options with the same need.
_OPTIONS: Final = {
    "--tls-keys": "the package cryptography, which is compiled",
    "--cluster": "other machines",
    "--interface": "network interfaces",
}
#: Number of bytes that are written at once.
_CHUNK: Final = 1 << 20
EXIT_USAGE: Final = 2
EXIT_BUG: Final = 70


class _Sink(io.RawIOBase):
    """Hands each piece that is written to a function."""

    def __init__(self, take: Callable[[Any], object]) -> None:
        super().__init__()
        self._take = take

    def writable(self) -> bool:
        """Return True: this is what it is for."""
        return True

    def write(self, octets: Any, /) -> int:
        """Hand a piece on."""
        self._take(octets)
        return len(octets)


class Bridge:
    """Runs commands one after the other, in a folder with the chosen files and the files that the commands write."""

    def __init__(self, run: Callable[[list[str]], int], folder: str) -> None:
        self._run = run
        self._folder = Path(folder)
        gc.disable()  # the engine makes no cycles; those of other code are collected between two commands

    def run(self, argv: list[str], take: Callable[[Any], object]) -> tuple[int, str]:
        """Run ``s7dissect ARGV``; return its exit code and its standard error. ``take`` gets its output."""
        refusal = refused(argv)
        if refusal:
            return EXIT_USAGE, refusal
        os.chdir(self._folder)
        told = io.BytesIO()
        with _streams(take, told):
            try:
                code = self._run(list(argv))
            except Exception as error:  # noqa: BLE001 - the page says so and goes on
                code = EXIT_BUG
                sys.stderr.write(
                    f"s7dissect: a fault of this program: {type(error).__name__}: {printable(str(error))}\n"
                )
        gc.collect()
        return code, told.getvalue().decode("utf-8", "replace")

    def written(self) -> list[str]:
        """Return the names of the files that commands wrote, below the folder."""
        found = [path for path in sorted(self._folder.rglob("*")) if path.is_file() and not path.is_symlink()]
        return [path.relative_to(self._folder).as_posix() for path in found]


def refused(argv: list[str]) -> str:
    """Return why a command line cannot run in a browser, empty if it can."""
    command = argv[0] if argv else ""
    needs = _ELSEWHERE.get(command, "")
    what = command
    for option, need in _OPTIONS.items():
        if not needs and any([word.partition("=")[0] == option for word in argv]):
            what, needs = option, need
    if command == "export" and not needs and not _is_plain_export(argv):
        what, needs = "export to this format", "a compiled package"
    return (
        f"s7dissect: {what} needs {needs}: use the installed s7dissect for it (s7dissect help browser)\n"
        if needs
        else ""
    )


def _is_plain_export(argv: list[str]) -> bool:
    """Return whether the requested format needs neither DuckDB nor Arrow."""
    return not {"parquet", "arrow", "duckdb", "feather"} & {word.lower().rpartition(".")[2] for word in argv}


@contextmanager
def _streams(take: Callable[[Any], object], told: io.BytesIO) -> Iterator[None]:
    """Redirect standard output and error to the page; standard input is empty."""
    before = sys.stdin, sys.stdout, sys.stderr
    output = io.TextIOWrapper(io.BufferedWriter(_Sink(take), _CHUNK), encoding="utf-8", errors="backslashreplace")
    errors = io.TextIOWrapper(told, encoding="utf-8", errors="backslashreplace", write_through=True)
    sys.stdin, sys.stdout, sys.stderr = io.TextIOWrapper(io.BytesIO()), output, errors
    try:
        yield
    finally:
        sys.stdin, sys.stdout, sys.stderr = before
        output.flush()
        errors.flush()
        errors.detach()


def markup(text: str) -> str:
    """Return a manual page as HTML; markup in it stays text."""
    from markdown_it import MarkdownIt

    return str(MarkdownIt("js-default", {"linkify": False, "html": False}).render(text))
