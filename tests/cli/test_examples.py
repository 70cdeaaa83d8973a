"""Every example in a help text runs: in a folder with files of those names, a peer where one is asked for, and what is not
here (another machine, an interface) replaced by what gives the same."""

from __future__ import annotations

import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
from contextlib import nullcontext
from pathlib import Path
from typing import Final

import pytest

from dissect.cli.examples import EXAMPLES
from dissect.engine.observer import Observer
from dissect.engine.pipeline import Pipeline
from dissect.files.recording.ring_buffer import RingBuffer, RingLimits
from dissect.online.live.evidence import RingCompanion
from dissect.testing.playback.server import Server
from tests.cli.support import Ran, run
from tests.cli.test_outputs import commands
from tests.meaning.report.schemas import ROOT
from tests.meaning.tags.support import example_files

CAPTURE: Final = ROOT / "captures" / "transfer.pcapng"
#: Their examples need a cluster, or packages of npm and PyPI: tests/files/cluster/test_cluster.py and tests/output/browser have
#: them.
WITH_MORE: Final = ("cluster-check", "browser")
ALL: Final = [(command, line) for command, lines in EXAMPLES.items() if command not in WITH_MORE for line in lines]
#: Examples that may end with 1: what they are for is a finding, a difference or something new.
ONE: Final = (
    "analyze --fail-on",
    "baseline --against",
    "baseline --rules",
    "diff",
    "blocks --diff",
    "scd diff",
    "evidence verify evidence --head",
    "replay trace.pcapng --to",
)
#: What another machine would write.
ELSEWHERE: Final = {
    "ssh gateway cat trace.pcap.gz": "gzip -c trace.pcapng",
    "/etc/s7dissect/alerts.toml": "alerts.toml",
    "/var/lib/s7dissect": "evidence",
    "ssh gateway tcpdump -U -w - tcp port 102": "cat trace.pcapng",
}
FOR_EVER: Final = ("serve", "proxy")
DEVICE: Final = b"[1000]\nParameterName=\xcd\xe0\xf1\xee\xf1\nDataType=7\nAccessType=ro\n"  # a pump, in cp1251
ALERTS: Final = '[[rule]]\nname = "all"\nwhen = "finding"\nfinding = "note"\n'


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the files that the examples name, and `s7dissect` on the path of its ``bin``."""
    here = tmp_path_factory.mktemp("examples")
    for name in ("trace.pcapng", "old.pcapng", "ring_1.pcapng", "ring_2.pcapng"):
        shutil.copy(CAPTURE, here / name)
    shutil.copy(ROOT / "captures" / "item-errors.pcapng", here / "new.pcapng")
    (here / "captures").mkdir()
    shutil.copy(CAPTURE, here / "captures" / "trace.pcapng")
    shutil.copy(ROOT / "captures" / "nodes7-write.pcapng", here / "press.pcapng")
    (here / "plant.key").write_bytes(bytes(range(32)))
    (here / "session.keys").write_text(f"CLIENT_RANDOM {32 * '00'} {48 * '00'}\n", encoding="ascii")
    (here / "alerts.toml").write_text(ALERTS, encoding="utf-8")
    (here / "device.eds").write_bytes(DEVICE)
    example_files(here)
    evidence = RingBuffer(here / "evidence", RingLimits(octets=1000))
    companion = RingCompanion(evidence, about={"host": "probe"})
    companion.begin(Pipeline(Observer()))
    companion.packet(1_795_924_860_000_000_000, bytes(60), 60, 1, "eth0")
    companion.close()
    (here / "bin").mkdir()
    program = here / "bin" / "s7dissect"
    program.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m dissect "$@"\n', encoding="utf-8")
    program.chmod(0o755)
    fake = here / "bin" / "wireshark"  # where there is one, no window opens
    fake.write_text('#!/bin/sh\necho wireshark "$@" >&2\n', encoding="utf-8")
    fake.chmod(0o755)
    return here


def shell(folder: Path, line: str, **more: str) -> subprocess.CompletedProcess[str]:
    """Run a line in a shell of its own, in the folder."""
    environment = {**os.environ, "PATH": f"{folder / 'bin'}{os.pathsep}{os.environ['PATH']}", **more}
    return subprocess.run(
        ["bash", "-c", f"set -o pipefail; {line}"],
        cwd=folder, env=environment, stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False, timeout=120,
    )  # fmt: skip


def prepared(capfdbinary: pytest.CaptureFixture[bytes], folder: Path, command: str, line: str) -> str:
    """Return a line as it can be run here; the files it needs are made by the examples of other commands."""
    for theirs, ours in ELSEWHERE.items():
        line = line.replace(theirs, ours)
    if command.startswith("scd"):
        shutil.copy(ROOT / "captures" / "scd" / "plant.toml", folder / "plant.toml")
        assert here(capfdbinary, "s7dissect scd compile plant.toml -o plant.scd --force").code == 0
    if "--against plant.toml" in line:
        (folder / "plant.toml").unlink(missing_ok=True)
        assert here(capfdbinary, "s7dissect baseline old.pcapng -o plant.toml").code == 0
    if "session.s7.txt" in line:
        assert here(capfdbinary, "s7dissect golden trace.pcapng -o session.s7.txt --force").code == 0
    for name in re.findall(r"(?:-o|-w|>) (\S+)", line):
        if (folder / name).is_file():
            (folder / name).unlink()
    return line


@pytest.mark.parametrize(("command", "line"), ALL, ids=[line for _, line in ALL])
def test_an_example_runs(
    folder: Path, command: str, line: str, capfdbinary: pytest.CaptureFixture[bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    if command == "verify" and not shutil.which("tshark"):
        pytest.skip("needs tshark")
    monkeypatch.chdir(folder)
    monkeypatch.setenv("HOME", str(folder))  # `extcap --install` asks tshark for its folder
    monkeypatch.delenv("XDG_CONFIG_HOME", raising=False)
    monkeypatch.setenv("PATH", f"{folder / 'bin'}{os.pathsep}{os.environ['PATH']}")
    line = prepared(capfdbinary, folder, command, line)
    if command in FOR_EVER:
        until_listening(folder, line)
        return
    if " -i eth0" in line:
        # Not every user has the right to capture. That the command understands the rest of the line shows in what it refuses:
        # the interface, which comes last, and nothing else.
        ran = here(capfdbinary, line.replace("eth0", "none0"))
        assert ran.code == 2
        assert "none0" in ran.err.split("\n")[0]
        return
    with Server(CAPTURE, port=0) if " --to " in line else nullcontext() as server:
        line = line.replace(":10102", f":{server.port}") if server is not None else line
        ran = here(capfdbinary, line)
    codes = {0, 1} if line.removeprefix("s7dissect ").startswith(ONE) else {0}
    if command == "scd diff":
        codes.add(2)  # they decode differently
    assert ran.code in codes, ran.err
    assert "Usage:" not in ran.err
    assert "Traceback" not in ran.err
    made = [folder / name for name in re.findall(r"(?:-o|>) (\S+)", line)]
    assert all([path.stat().st_size for path in made])
    assert ran.out or made or server is not None or "wireshark -r " in ran.err


def here(capfdbinary: pytest.CaptureFixture[bytes], line: str) -> Ran:
    """Run a line: in this process, or in a shell where it takes one."""
    if line.startswith("s7dissect ") and not set(line) & set("|>*"):
        return run(capfdbinary, *shlex.split(line)[1:])
    ran = shell(Path.cwd(), line)
    return Ran(ran.returncode, ran.stdout, ran.stderr)


def until_listening(folder: Path, line: str) -> None:
    """Start what goes on until a signal, wait until it says that it listens, and end it by that signal."""
    line = line.replace("--to 192.168.0.10", "--to 127.0.0.1").replace("serve ", "serve --listen 127.0.0.1:0 ")
    if "--listen" not in line:
        line += " --listen 127.0.0.1:0"
    environment = {**os.environ, "PATH": f"{folder / 'bin'}{os.pathsep}{os.environ['PATH']}"}
    with subprocess.Popen(
        ["bash", "-c", f"exec {line}"],
        cwd=folder, env=environment, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
    ) as process:  # fmt: skip
        assert process.stdout is not None
        try:
            told = process.stdout.readline()
            assert "listening on 127.0.0.1:" in told
            process.send_signal(signal.SIGTERM)
            assert process.wait(30) == 0, process.stdout.read()
        finally:
            process.kill()


def test_every_command_has_two_to_four_examples_that_fit_a_terminal() -> None:
    every = {**commands(), "scd": None, "tags": None}
    assert set(EXAMPLES) == set(every)
    for command, lines in EXAMPLES.items():
        assert 2 <= len(lines) <= 4, command
        assert [line for line in lines if len(line) > 76] == []
        assert all([f"s7dissect {command}" in line for line in lines]), command


def test_the_help_shows_them_as_they_are_typed() -> None:
    for name, command in commands().items():
        epilog = command.epilog or ""
        assert epilog.startswith("\b\nExamples:\n"), name
        assert [line[2:] for line in epilog.split("\n\n")[0].split("\n")[2:]] == list(EXAMPLES[name])
