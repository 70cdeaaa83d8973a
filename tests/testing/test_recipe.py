"""The recipe of docs/pytest.md, done as it stands there."""

from __future__ import annotations

import contextlib
import re
import shlex
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import pytest

from tests.testing.projects import PLUGIN, ROOT

pytest_plugins = ["pytester"]

PATIENCE_S: Final = 60.0
TEXT: Final = (ROOT / "docs" / "pytest.md").read_text(encoding="utf-8").partition("\n## Fixtures")[0]


def blocks(text: str) -> list[tuple[str, str]]:
    """Return (what stands behind the fence, contents) of all blocks."""
    return re.findall(r"```(\S+(?: \S+)?)\n(.*?)```", text, re.DOTALL)


def commands(block: str) -> list[tuple[list[str], list[str]]]:
    """Return commands and the lines they print."""
    told = re.split(r"^\$ ", block, flags=re.MULTILINE)[1:]
    return [(shlex.split(lines[0]), lines[1:]) for lines in [one.rstrip("\n").split("\n") for one in told]]


def steady(lines: list[str]) -> list[str]:
    """Return what is printed without what is another each time."""
    return [re.sub(r"\S*/(?=recorded-)", "…/", re.sub(r"in \d+\.\d+s", "in …s", line)) for line in lines]


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as one:
        return int(one.getsockname()[1])


@contextlib.contextmanager
def started(port: int, end: signal.Signals, *arguments: str) -> Iterator[None]:
    """Run a Python program that listens on ``port``; end it by a signal."""
    with subprocess.Popen([sys.executable, *arguments], stderr=subprocess.PIPE, stdout=subprocess.DEVNULL) as process:
        try:
            deadline = time.monotonic() + PATIENCE_S
            while not listens(port):
                assert process.poll() is None
                assert time.monotonic() < deadline
                time.sleep(0.02)
            yield
        finally:
            process.send_signal(end)
            process.communicate(timeout=PATIENCE_S)


def listens(port: int) -> bool:
    """Tell whether somebody listens on a port of this machine, without being a client."""
    with socket.socket() as one:
        one.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            one.bind(("127.0.0.1", port))
            one.listen()
        except OSError:
            return True
    return False


def test_the_recipe_is_true(pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "dont_write_bytecode", True)  # files are changed within a second
    monkeypatch.setenv("COLUMNS", "80")
    for name in ("CI", "BUILD_NUMBER"):  # where pytest shortens nothing
        monkeypatch.delenv(name, raising=False)
    text = TEXT
    ports = {number: free_port() for number in ("10102", "11102")}
    for number, port in ports.items():
        assert number in text
        text = text.replace(number, str(port))
    found = blocks(text)
    for name, contents in [(kind.split(" ")[1], contents) for kind, contents in found if " " in kind]:
        Path(name).parent.mkdir(exist_ok=True)
        Path(name).write_text(contents)
    (_, shell), (_, first), (_, keep), (_, change) = [block for block in found if block[0] in {"sh", "console"}]
    make, proxy = [shlex.split(line) for line in shell.splitlines()]
    assert make[:2] == ["mkdir", "-p"]
    Path(make[2]).mkdir(parents=True)
    assert proxy[0] == "s7dissect"
    with started(ports["11102"], signal.SIGTERM, "plc.py"):  # noqa: SIM117 - one needs the other
        with started(ports["10102"], signal.SIGINT, "-m", "dissect", *proxy[1:]):
            ((asked, told),) = commands(first)
            ran = subprocess.run([sys.executable, *asked[1:]], capture_output=True, text=True, check=True)
            assert ran.stdout.splitlines() == told
    for asked, told in commands(keep):
        follow(pytester, asked, told)
    instead = re.search(r"\*\*4\. Change the program\*\*, `(.*?)` to `(.*?)`", text)
    assert instead is not None
    program = Path("pump.py").read_text()
    assert program.count(instead[1]) == 1
    Path("pump.py").write_text(program.replace(instead[1], instead[2]))
    for asked, told in commands(change):
        follow(pytester, asked, told)


def follow(pytester: pytest.Pytester, asked: list[str], told: list[str]) -> None:
    """Do what a command says and expect what it prints."""
    if asked[0] == "cat":
        assert Path(asked[1]).read_text().splitlines() == told
        return
    assert asked[0] == "pytest"
    result = pytester.runpytest_inprocess(*PLUGIN, *asked[1:])
    assert steady([line for line in result.stdout.lines if line]) == steady(told)
