"""Fast processes that run the command line: one process has imported it, and each of them is a copy of that one.

Most of the time of `python -m dissect` is imports, a sixth of a second. A copy has the given standard streams, folder and
environment, runs the command as its main program, and ends as every Python process does. That `python -m dissect` itself works
is tested separately (tests/test_package.py, tests/test_portable.py, tests/promises).
"""

from __future__ import annotations

import atexit
import contextlib
import json
import os
import select
import signal
import socket
import subprocess
import sys
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from pathlib import Path
from types import TracebackType
from typing import IO, Final, Self

#: Answers each message: one with streams by the number of the new copy, one that names a copy by its exit status.
_MOTHER: Final = """
import gc, json, os, signal, socket, sys, time
from dissect.cli.main import COMMANDS, group, main
for name in COMMANDS:
    group.get_command(None, name)
gc.freeze()
line = socket.socket(fileno=int(sys.argv[1]))
while True:
    message, streams, _, _ = socket.recv_fds(line, 1 << 20, 3)
    if not message:
        os._exit(0)
    told = json.loads(message)
    if isinstance(told, int):
        line.send(b"%d" % os.waitpid(told, 0)[1])
        continue
    child = os.fork()
    if not child:
        break
    for stream in streams:
        os.close(stream)
    line.send(b"%d" % child)
line.close()
for number, stream in enumerate(streams):
    os.dup2(stream, number)
    os.close(stream)
signal.signal(signal.SIGINT, signal.default_int_handler)  # a background job of a script ignores it from birth
signal.signal(signal.SIGHUP, signal.SIG_DFL)  # and one of nohup this
os.environ.clear()
os.environ.update(told["environment"])
time.tzset()
os.chdir(told["folder"])
sys.argv = ["s7dissect", *told["call"]]
sys.stdin = sys.__stdin__ = open(0, closefd=False)
sys.stdout = sys.__stdout__ = open(1, "w", closefd=False)
sys.stderr = sys.__stderr__ = open(2, "w", buffering=1, errors="backslashreplace", closefd=False)
main()
"""


class Forked:
    """A process that runs a command, as `subprocess.Popen` has it. Streams are pipes unless descriptors are given."""

    def __init__(
        self,
        call: Sequence[str],
        stdin: int = subprocess.PIPE,
        stdout: int = subprocess.PIPE,
        stderr: int = subprocess.PIPE,
        environment: Mapping[str, str] | None = None,
    ) -> None:
        self.returncode: int | None = None
        self.stdin: IO[bytes] | None = None
        self.stdout: IO[bytes] | None = None
        self.stderr: IO[bytes] | None = None
        lent: list[int] = []
        theirs = []
        for number, stream in enumerate((stdin, stdout, stderr)):
            if stream != subprocess.PIPE:
                theirs.append(stream)
                continue
            reading, writing = os.pipe()
            lent.append(reading if number == 0 else writing)
            theirs.append(lent[-1])
            if number == 0:
                self.stdin = os.fdopen(writing, "wb")
            elif number == 1:
                self.stdout = os.fdopen(reading, "rb")
            else:
                self.stderr = os.fdopen(reading, "rb")
        told: dict[str, object] = {
            "call": list(call),
            "folder": str(Path.cwd()),
            "environment": dict(environment or os.environ),
        }
        self.pid = _ask(told, theirs)
        for one in lent:
            os.close(one)
        self._ended = os.pidfd_open(self.pid)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for stream in (self.stdout, self.stderr, self.stdin):
            if stream is not None:
                with contextlib.suppress(BrokenPipeError):  # data that it did not want to read any more
                    stream.close()
        self.wait()

    def poll(self) -> int | None:
        """Return how it ended, None while it runs."""
        try:
            return self.wait(0)
        except subprocess.TimeoutExpired:
            return None

    def wait(self, timeout: float | None = None) -> int:
        """Return its exit status, less than 0 for a signal. Raises `subprocess.TimeoutExpired`."""
        if self.returncode is None:
            poll = select.poll()
            poll.register(self._ended, select.POLLIN)
            if not poll.poll(None if timeout is None else timeout * 1000):
                raise subprocess.TimeoutExpired("s7dissect", timeout or 0)
            self.returncode = os.waitstatus_to_exitcode(_ask(self.pid))
            os.close(self._ended)
        return self.returncode

    def communicate(self, given: bytes = b"", timeout: float = 300) -> tuple[bytes, bytes]:
        """Write all data, read until the end, and wait."""
        with ThreadPoolExecutor(3) as pool:
            writing = pool.submit(self._write, given)
            reading = [
                pool.submit(stream.read) if stream is not None else None for stream in (self.stdout, self.stderr)
            ]
            try:
                self.wait(timeout)
            except subprocess.TimeoutExpired:
                self.kill()
                raise
            writing.result()
            out, err = (read.result() if read is not None else b"" for read in reading)
        return out, err

    def _write(self, given: bytes) -> None:
        if self.stdin is not None:
            with contextlib.suppress(BrokenPipeError):  # it ended before it read all
                self.stdin.write(given)
                self.stdin.close()

    def send_signal(self, number: int) -> None:
        """Send a signal to it, unless it ended."""
        if self.poll() is None:
            os.kill(self.pid, number)

    def terminate(self) -> None:
        """Send SIGTERM."""
        self.send_signal(signal.SIGTERM)

    def kill(self) -> None:
        """Send SIGKILL."""
        self.send_signal(signal.SIGKILL)


@cache
def _line() -> socket.socket:
    """Start the process that has imported everything, and return the connection to it. It ends with the line."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with theirs:
        mother = subprocess.Popen(
            [sys.executable, "-c", _MOTHER, str(theirs.fileno())],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            pass_fds=[theirs.fileno()],
        )

    def end() -> None:
        ours.close()
        mother.wait(60)

    atexit.register(end)
    return ours


def _ask(told: dict[str, object] | int, streams: Sequence[int] = ()) -> int:
    line = _line()
    socket.send_fds(line, [json.dumps(told).encode()], streams)
    return int(line.recv(64))
