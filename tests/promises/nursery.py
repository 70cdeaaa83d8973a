"""Fast processes that run a command and may be ended at any moment: one process imports everything, and is copied."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Final

import pytest

#: Reads requests, one JSON object per line, and answers each with a line: the number of a new process, or an exit code.
_MOTHER: Final = """
import importlib, json, os, signal, sys
for name in ("engine", "files.anonymize.rewriter", "files.anonymize.survey", "files.recording.cutter",
             "files.recording.ring_buffer", "meaning.report.tree", "online.alerts", "online.live.evidence",
             "online.live.json_lines", "online.live.lines", "online.live.session", "output.baseline",
             "output.baseline.loading", "packets.source.live.opening", "scd.codec", "scd.loading",
             "testing.golden.reading", "testing.golden_check", "testing.oracle.verification",
             "testing.playback.client", "testing.playback.client.run"):
    importlib.import_module("dissect." + name)
from dissect.cli.main import COMMANDS, group, main
for name in COMMANDS:
    group.get_command(None, name)
def run(call):
    try:
        main(call)
    except SystemExit as end:
        sys.stdout.flush()
        sys.stderr.flush()
        return int(end.code or 0)
def tripped(path, times):
    left = [times]
    def hook(event, arguments):
        if event == "open" and str(arguments[0]) == path:
            left[0] -= 1
            if not left[0]:
                signal.raise_signal(signal.SIGINT)
    return hook
for line in sys.stdin:
    request = json.loads(line)
    if "wait" in request:
        print(os.waitstatus_to_exitcode(os.waitpid(request["wait"], 0)[1]), flush=True)
        continue
    child = os.fork()
    if child:
        print(child, flush=True)
        continue
    try:
        signal.signal(signal.SIGINT, signal.default_int_handler)  # a background job of a script ignores it from birth
        for number, (path, flags) in enumerate(((request["stdin"], os.O_RDONLY),
                (request["stdout"], os.O_WRONLY | os.O_CREAT), (request["stderr"], os.O_WRONLY | os.O_CREAT))):
            opened = os.open(path, flags, 0o600)
            os.dup2(opened, number)
            os.close(opened)
        sys.stdin, sys.stdout = open(0), open(1, "w", encoding="utf-8", errors="backslashreplace")
        if request["trip"]:
            sys.addaudithook(tripped(*request["trip"]))
        code = run(request["call"])
        while request["again"]:
            run(request["call"])
    except BaseException:
        sys.excepthook(*sys.exc_info())
        code = 99
    finally:
        sys.stderr.flush()
    os._exit(code)
"""


class Nursery:
    """Makes processes that run a command of s7dissect."""

    def __init__(self, mother: subprocess.Popen[str]) -> None:
        self._mother = mother

    def start(
        self,
        *call: str | Path,
        stdin: str | Path = "/dev/null",
        stdout: str | Path = "/dev/null",
        stderr: str | Path = "/dev/null",
        again: bool = False,
        trip: tuple[Path, int] | None = None,
    ) -> int:
        """Start a process and return its number; with ``again`` it begins again whenever it is done.

        ``trip`` is a file and a number: SIGINT is sent when it opens that file for this time.
        """
        words = [str(word) for word in call]
        return self._ask(
            {
                "call": words,
                "stdin": str(stdin),
                "stdout": str(stdout),
                "stderr": str(stderr),
                "again": again,
                "trip": [str(trip[0]), trip[1]] if trip is not None else None,
            }
        )

    def wait(self, process: int) -> int:
        """Return the exit code of a process, less than 0 for a signal."""
        return self._ask({"wait": process})

    def _ask(self, request: dict[str, object]) -> int:
        stdin, stdout = self._pipes()
        stdin.write(json.dumps(request) + "\n")
        stdin.flush()
        return int(stdout.readline())

    def _pipes(self) -> tuple[IO[str], IO[str]]:
        assert self._mother.stdin is not None
        assert self._mother.stdout is not None
        return self._mother.stdin, self._mother.stdout


@pytest.fixture(scope="package")
def nursery() -> Iterator[Nursery]:
    """Give the nursery of these tests."""
    with subprocess.Popen(
        [sys.executable, "-c", _MOTHER], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as mother:
        made = Nursery(mother)
        made.wait(made.start("--version"))  # everything is imported now
        yield made
