"""What the tests of the commands share: captures on disk, a command in this process, and one on a terminal."""

from __future__ import annotations

import contextlib
import fcntl
import os
import pty
import struct
import subprocess
import sys
import termios
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Final, NamedTuple

import pytest

from dissect.cli.main import main
from tests.forked import Forked
from tests.meaning.report.support import WORD, begun, read, saved
from tests.properties import messages
from tests.properties.messages import dt
from tests.properties.packets import Flow, Packet

#: The environment of a process that may not write large files: it must not leave half a compiled module in the source tree.
WITHOUT_CACHE: Final = {**os.environ, "PYTHONDONTWRITEBYTECODE": "1"}


class Ran(NamedTuple):
    """What a command did."""

    code: int
    out: str
    err: str


def run(capfdbinary: pytest.CaptureFixture[bytes], *arguments: str | Path) -> Ran:
    """Run a command in this process."""
    with pytest.raises(SystemExit) as end:
        main([str(argument) for argument in arguments])
    sys.stdout.flush()
    told = capfdbinary.readouterr()
    assert isinstance(end.value.code, int)
    return Ran(end.value.code, told.out.decode(), told.err.decode())


def on_terminal(
    *arguments: str | Path, columns: int = 80, environment: Mapping[str, str] | None = None, stdout: bool = True
) -> Ran:
    """Run a command whose stderr, and ``stdout`` unless that is a pipe, is a terminal with this many columns."""
    ours, theirs = pty.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 24, columns, 0, 0))
    cleared = {key: value for key, value in os.environ.items() if key not in {"NO_COLOR", "COLUMNS", "LINES"}}
    with (
        Path(os.devnull).open("rb") as nothing,
        Forked(
            list(map(str, arguments)),
            stdin=nothing.fileno(),
            stdout=theirs if stdout else subprocess.PIPE,
            stderr=theirs,
            environment={**cleared, "TERM": "xterm-256color", **(environment or {})},
        ) as process,
    ):
        os.close(theirs)
        seen = _drain(ours)
        piped = process.stdout.read() if process.stdout is not None else b""
        code = process.wait(60)
    os.close(ours)
    text = seen.decode().replace("\r\n", "\n")
    return Ran(code, text if stdout else piped.decode(), "" if stdout else text)


def _drain(descriptor: int) -> bytes:
    """Return the output on a terminal until no process has it open any longer."""
    pieces = []
    while True:
        try:
            piece = os.read(descriptor, 65536)
        except OSError:  # EIO: Linux's sign that the other end is closed
            break
        if not piece:
            break
        pieces.append(piece)
    return b"".join(pieces)


def simple(path: Path, count: int = 3) -> Path:
    """Write a capture of a connection with ``count`` reads, the second of them refused."""
    talk = begun()
    for ref in range(1, count + 1):
        read(talk, ref, WORD, 0x0A if ref == 2 else b"\x04\xd2")
    return saved(path, talk.packets())


def halves(directory: Path) -> list[Path]:
    """Write a capture in two files: a request is the last packet of the first, its answer the first packet of the second."""
    packets = read(read(begun(), 1), 2).send(0, dt(messages.read_job(3, [WORD]))).reset(1).packets()
    return [saved(directory / "first.pcapng", packets[:10]), saved(directory / "second.pcapng", packets[10:])]


def large(path: Path, octets: int) -> Path:
    """Write a capture of at least this many octets that is quick to read: large packets that are not TCP."""
    packet = Packet(1, Flow().wrap(0, 17, bytes(60000)), 60034)
    return saved(path, [packet] * (octets // 60034 + 1))


@contextlib.contextmanager
def started(*arguments: str | Path) -> Iterator[Forked]:
    """Start a command that gets its input bit by bit, and make sure that it ends."""
    with Forked(list(map(str, arguments))) as process:
        try:
            yield process
        finally:
            process.kill()
