"""`s7dissect serve`: a process that is a PLC, and python-snap7 as its client."""

from __future__ import annotations

import contextlib
import re
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from captures.record import talk_python
from dissect.cli.main import COMMANDS
from dissect.testing.playback.server import Server
from tests.cli.support import run
from tests.conftest import ROOT, Command

PATIENCE_S = 60
CAPTURES = ROOT / "captures"


class Plc:
    """A process that listens: its port."""

    def __init__(self, process: subprocess.Popen[bytes]) -> None:
        self.process = process
        assert process.stdout is not None
        first = process.stdout.readline().decode()
        found = re.fullmatch(r"listening on 127\.0\.0\.1:(\d+)\n", first)
        if found is None:
            assert process.stderr is not None
            raise AssertionError(first + process.stderr.read().decode())
        self.port = int(found[1])

    def ended(self, number: int = signal.SIGTERM) -> tuple[int, list[str]]:
        """End it by a signal: its exit code, what it said."""
        self.process.send_signal(number)
        out, told = self.process.communicate(timeout=PATIENCE_S)
        assert out == b""
        return self.process.returncode, told.decode().splitlines()


@contextlib.contextmanager
def serving(*arguments: str | Path) -> Iterator[Plc]:
    command = [sys.executable, "-m", "dissect", "serve", "--listen", "127.0.0.1:0", *map(str, arguments)]
    with subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        try:
            yield Plc(process)
        finally:
            if process.poll() is None:
                process.kill()


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_session_as_it_was_recorded(number: int) -> None:
    with serving(CAPTURES / "szl-python.pcapng") as plc:
        talk_python.szl(plc.port)
        code, told = plc.ended(number)
    assert code == 0
    assert told == [
        "s7dissect: 8 requests on 1 connection recorded",
        "s7dissect: 1 connection, 8 requests, 0 unmatched",
    ]


def test_what_was_not_recorded_is_told_and_fails() -> None:
    with serving(CAPTURES / "clock-python.pcapng") as plc:
        client = talk_python.connect(plc.port)
        talk_python.refused(client.db_read, 7, 0, 2)
        client.disconnect()
        code, told = plc.ended()
    assert code == 1
    assert told[1:] == [
        "s7dissect: unmatched: request 2 on connection 1, Read Var DB7.DBB0 x2: not recorded: DB7.DBB0 x2",
        "s7dissect: 1 connection, 2 requests, 1 unmatched",
    ]


def test_memory_faults_and_a_capture_of_it_all(tmp_path: Path) -> None:
    path = tmp_path / "passed.pcapng"
    arguments = ("--memory", "--fault", "refuse:3", "--latency", "1", "--repeat", "cycle", "-w", path)
    with serving(CAPTURES / "read-areas-python.pcapng", *arguments) as plc:
        client = talk_python.connect(plc.port)
        client.mb_write(20, 2, bytearray(b"\xaa\xbb"))
        talk_python.refused(client.mb_read, 20, 2)
        assert client.mb_read(20, 2) == bytearray(b"\xaa\xbb")
        client.disconnect()
        code, told = plc.ended()
    assert code == 0, told
    with Server(path) as server:
        assert server.recording.steps == 4


def test_several_files_are_one_recording(tmp_path: Path) -> None:
    with serving(CAPTURES / "clock-python.pcapng", CAPTURES / "szl-python.pcapng") as plc:
        talk_python.clock(plc.port)
        talk_python.szl(plc.port)
        assert plc.ended()[0] == 0


@pytest.mark.parametrize(
    ("arguments", "why"),
    [
        (["--listen", "0.0.0.0:0"], "0.0.0.0:0 can be reached from other machines, which would mistake it for a PLC"),
        (["--listen", "0.0.0.0:4711"], "listen on 127.0.0.1:4711, or add --allow-remote"),
        (["--listen", "nowhere"], "is not an address"),
        (["--fault", "break:3"], "is not a fault"),
        (["--latency", "soon"], "expected recorded, none, or milliseconds"),
        (["--latency", "-1"], "expected recorded, none, or milliseconds"),
        (["-w", "-"], "needs a file"),
        (["--repeat", "often"], "often"),
    ],
)
def test_wrong_use(s7dissect: Command, arguments: list[str], why: str) -> None:
    told = s7dissect("serve", CAPTURES / "szl.pcapng", *arguments)
    assert told.returncode == 2
    assert why in " ".join(told.stderr.decode().split())
    assert told.stdout == b""


def test_the_recording_and_what_is_there_are_not_written_over(s7dissect: Command, tmp_path: Path) -> None:
    recording, other = tmp_path / "recording.pcapng", tmp_path / "other.pcapng"
    recording.write_bytes((CAPTURES / "szl-python.pcapng").read_bytes())
    before = recording.read_bytes()
    other.write_bytes(b"precious")
    serve = ("serve", recording, "--listen", "127.0.0.1:0", "-w")
    for out, force, says in (
        (recording, ("--force",), "is both input and output; choose another OUT."),
        (other, (), "exists; --force overwrites it."),
    ):
        ran = s7dissect(*serve, out, *force)
        assert ran.returncode == 2
        assert f"{out} {says}" in ran.stderr.decode()
    assert (recording.read_bytes(), other.read_bytes()) == (before, b"precious")


def test_files_that_cannot_be_served(s7dissect: Command, tmp_path: Path) -> None:
    told = s7dissect("serve", CAPTURES / "refused-port.pcapng")
    assert (told.returncode, told.stdout) == (2, b"")
    assert "there is nothing to serve" in told.stderr.decode()
    assert s7dissect("serve", tmp_path / "none.pcapng").returncode == 2
    kept = tmp_path / "kept.pcapng"
    kept.write_bytes(b"mine")
    told = s7dissect("serve", CAPTURES / "szl.pcapng", "--listen", "127.0.0.1:0", "-w", kept)
    assert told.returncode == 2
    assert kept.read_bytes() == b"mine"


def test_a_port_that_is_taken(s7dissect: Command) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        told = s7dissect("serve", CAPTURES / "szl.pcapng", "--listen", f"127.0.0.1:{port}")
    assert told.returncode == 2
    assert told.stderr.decode().endswith(f"cannot listen on 127.0.0.1:{port}: Address already in use\n")


def test_it_is_listed_and_explains_itself(capfdbinary: pytest.CaptureFixture[bytes]) -> None:
    assert "serve" in COMMANDS
    told = run(capfdbinary, "serve", "--help").out
    for word in (
        "--listen",
        "--allow-remote",
        "--memory",
        "--latency",
        "--fault",
        "wrong-ref",
        "--repeat",
        "Exit code",
    ):
        assert word in told
