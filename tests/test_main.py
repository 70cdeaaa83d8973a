"""How a process begins and ends: what is registered for its end is done, all that was printed is there, the code is told."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Final

import pytest

CAPTURES: Final = Path(__file__).resolve().parent.parent / "captures"
ONE: Final = str(CAPTURES / "szl.pcapng")
#: With this nothing would be left to write at the end.
UNBUFFERED: Final = "PYTHONUNBUFFERED"
#: As if there were no `_End`.
PLAIN: Final = "begin._End.__call__ = lambda end: None"


def program(before: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run ``main`` in a process in which ``before`` stands first."""
    code = (
        f"import sys\nfrom dissect import __main__ as begin\n{before}\nsys.argv[1:] = {list(arguments)!r}\nbegin.main()"
    )
    environment = {name: value for name, value in os.environ.items() if name != UNBUFFERED}
    call = [sys.executable, "-c", code]
    return subprocess.run(call, env=environment, capture_output=True, text=True, check=False, timeout=60)


@pytest.mark.parametrize(
    ("arguments", "code"), [(("analyze", ONE), 0), (("analyze", "no.pcap"), 2), (("analyze", "--no-such"), 2)]
)
def test_the_code_and_all_that_was_said(arguments: tuple[str, ...], code: int) -> None:
    plain = program(PLAIN, *arguments)
    ended = program("", *arguments)
    assert ended.returncode == plain.returncode == code
    assert ended.stdout == plain.stdout
    assert ended.stderr == plain.stderr


def test_what_is_registered_for_the_end_is_done_before_it() -> None:
    before = """
import atexit, tempfile, threading, time, weakref
import dissect.cli.main as cli
class Thing: pass
thing = Thing()
def late():
    time.sleep(0.2)
    print("thread over")
def run():
    weakref.finalize(thing, print, "finalized")
    atexit.register(print, "registered")
    threading.Thread(target=late).start()
    return 7
cli.run = run
"""
    ended = program(before)
    assert ended.returncode == 7
    assert ended.stdout.splitlines() == ["thread over", "registered", "finalized"]


def test_objects_are_not_taken_apart() -> None:
    before = """
class Thing:
    def __del__(self): print("taken apart")
thing = Thing()
"""
    assert "taken apart" not in program(before, "--version").stdout
    assert "taken apart" in program(f"{before}\n{PLAIN}", "--version").stdout


def test_a_debugger_sees_the_end() -> None:
    before = "begin.atexit.register = lambda end: print('registered')"
    assert "registered" in program(before, "--version").stdout
    assert "registered" not in program(f"{before}\nsys.settrace(lambda *of: None)", "--version").stdout


def test_an_exception_is_told_by_python() -> None:
    before = "import dissect.cli.main as cli\ncli.run = lambda: 1 / 0"
    ended = program(before)
    assert ended.returncode == 1
    assert "ZeroDivisionError" in ended.stderr


def test_output_that_cannot_be_written_at_the_end() -> None:
    before = """
import os, dissect.cli.main as cli
def ran():
    print("left in the buffer")
    os.dup2(os.open("/dev/full", os.O_WRONLY), 1)
    return 0
cli.run = ran
"""
    ended = program(before)
    assert ended.returncode == 120, "as Python has it"
    assert "No space left on device" in ended.stderr
