"""`s7dissect extcap`: what it answers Wireshark, how it is installed, and what tshark captures through it."""

from __future__ import annotations

import os
import shutil
import signal
import socket
import stat
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import pytest

import dissect
from dissect.packets.source.live.opening import engine_states
from tests.cli.support import run
from tests.engine.transactions.talk import CONFIRM, CONNECT, ack_data, dbw, dt, granted, setup
from tests.engine.transactions.talk import read as read_job
from tests.meaning.report.support import WORD, begun, read, saved

Capture = pytest.CaptureFixture[bytes]
needs_tshark = pytest.mark.skipif(shutil.which("tshark") is None, reason="tshark is not installed")
MARK: Final = "s7dissect: warning transaction.item_error: An item of a read, write or subscription was refused."


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A home for Wireshark; the wrapper finds the package under test from everywhere."""
    folder = tmp_path / "home"
    folder.mkdir()
    monkeypatch.setenv("HOME", str(folder))
    monkeypatch.delenv("XDG_CONFIG_HOME", raising=False)
    monkeypatch.setenv("PYTHONPATH", str(Path(dissect.__file__).parents[1]))
    return folder


def told(capfdbinary: Capture, *arguments: str) -> list[str]:
    """Return the lines of a question, which nothing else may be on standard output with."""
    ran = run(capfdbinary, "extcap", *arguments)
    assert (ran.code, ran.err) == (0, "")
    return ran.out.splitlines()


def test_what_wireshark_asks(capfdbinary: Capture) -> None:
    assert told(capfdbinary, "--extcap-interfaces", "--extcap-version=4.0") == [
        f"extcap {{version={dissect.__version__}}}{{display=s7dissect: S7 traffic with findings}}",
        "interface {value=s7dissect}{display=S7 with findings (live)}",
        "interface {value=s7dissect-file}{display=S7 with findings (from a file)}",
    ]
    for name in ("s7dissect", "s7dissect-file"):
        assert told(capfdbinary, "--extcap-dlts", "--extcap-interface", name) == [
            "dlt {number=1}{name=EN10MB}{display=Ethernet}"
        ]
    live = told(capfdbinary, "--extcap-config", "--extcap-interface=s7dissect", "--extcap-version", "4.4")
    assert live[0].startswith("arg {number=0}{call=--interface}")
    assert "value {arg=0}{value=lo}{display=lo " in "\n".join(live)
    (slow,) = [line for line in live if "{call=--slow}" in line]
    assert slow.endswith("{type=double}{default=1000}{range=0,1000000000}")
    again = told(
        capfdbinary, "--extcap-config", "--extcap-interface", "s7dissect", "--extcap-reload-option", "interface"
    )
    assert again == [line for line in live if line.startswith("value ")]
    file = told(capfdbinary, "--extcap-interface", "s7dissect-file", "--extcap-config")
    assert [line.split("call=")[1].split("}")[0] for line in file] == ["--file", "--where", "--slow", "--tags"]


def test_a_capture_filter_is_checked(capfdbinary: Capture) -> None:
    for expression in ("tcp port 102", "", "port 102 and not host 192.0.2.1"):
        assert told(capfdbinary, "--extcap-interface", "s7dissect", "--extcap-capture-filter", expression) == []
    for wrong in ("tcp prt 102", "tcp port 102 \x1b[31m"):
        (complaint,) = told(capfdbinary, "--extcap-interface", "s7dissect", "--extcap-capture-filter", wrong)
        assert complaint.isprintable()
    (complaint,) = told(capfdbinary, "--extcap-interface", "s7dissect-file", "--extcap-capture-filter", "tcp")
    assert "does not apply to a file" in complaint


def test_wrong_use_says_what_to_do(capfdbinary: Capture) -> None:
    for arguments, said in (
        ((), "s7dissect extcap --install"),
        (("--extcap-interface", "s7dissect"), "--extcap-dlts"),
        (("--extcap-interface", "s7dissect", "--capture"), "--fifo"),
    ):
        ran = run(capfdbinary, "extcap", *arguments)
        assert (ran.code, ran.out) == (2, "")
        assert said in ran.err


# ---- installing -----------------------------------------------------------------------------------------------------


def test_the_wrapper_is_written_once(capfdbinary: Capture, tmp_path: Path) -> None:
    path = tmp_path / "made" / "extcap" / "s7dissect"
    ran = run(capfdbinary, "extcap", "--install", path.parent)
    assert (ran.code, ran.err) == (0, "")
    assert ran.out.startswith(
        f"wrote {path}\nif that is an extcap folder of Wireshark (Help, About, Folders), it lists after"
    )
    assert path.stat().st_mode & stat.S_IXUSR
    written = path.read_bytes()
    assert run(capfdbinary, "extcap", "--install", path.parent).code == 0
    path.write_text("#!/bin/sh\nanother\n", encoding="utf-8")
    ran = run(capfdbinary, "extcap", "--install", path.parent)
    assert (ran.code, ran.out) == (2, "")
    assert f"{path} exists and differs; --force replaces it." in " ".join(ran.err.split())
    assert "another" in path.read_text(encoding="utf-8")
    assert run(capfdbinary, "extcap", "--install", path.parent, "--force").code == 0
    assert path.read_bytes() == written


@pytest.mark.parametrize(
    ("lines", "folder"),
    [
        ("Personal configuration:\t{}/conf\nPersonal Extcap path:\t{}/lib/extcap", "lib/extcap"),
        ("Personal configuration:\t{}/conf\nExtcap path:\t/usr/lib/extcap", "conf/extcap"),
        ("Temp:\t/tmp", ""),
    ],
)
def test_tshark_knows_the_folder(
    capfdbinary: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, lines: str, folder: str
) -> None:
    program = tmp_path / "tshark"
    program.write_text(f"#!/bin/sh\ncat << END\n{lines.replace('{}', str(tmp_path))}\nEND\n", encoding="utf-8")
    program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}{os.pathsep}{os.environ['PATH']}")
    ran = run(capfdbinary, "extcap", "--install")
    assert ran.code == (0 if folder else 2), ran.err
    if folder:
        assert (tmp_path / folder / "s7dissect").exists()
        named = run(capfdbinary, "extcap", "--install", tmp_path / folder)
        assert "\nWireshark lists it after a restart: " in ran.out
        assert named.out == ran.out
    else:
        assert "--install DIR" in ran.err


def test_without_tshark_the_folder_has_to_be_named(
    capfdbinary: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    ran = run(capfdbinary, "extcap", "--install")
    assert ran.code == 2
    assert "--install DIR" in ran.err


def test_a_tshark_that_cannot_be_started_is_no_crash(
    capfdbinary: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    program = tmp_path / "tshark"
    program.write_text(f"#!{tmp_path}/no-interpreter\n", encoding="utf-8")
    program.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path))
    ran = run(capfdbinary, "extcap", "--install")
    assert ran.code == 2
    assert "--install DIR" in ran.err


# ---- captured by tshark ---------------------------------------------------------------------------------------------


def tshark(*arguments: str | Path) -> list[str]:
    """Return what tshark writes, line by line."""
    program = "tshark"
    ran = subprocess.run([program, *map(str, arguments)], check=False, capture_output=True, text=True, timeout=120)
    assert ran.returncode == 0, ran.stderr
    return ran.stdout.splitlines()


@needs_tshark
def test_tshark_captures_a_file(capfdbinary: Capture, home: Path, tmp_path: Path) -> None:
    assert run(capfdbinary, "extcap", "--install").code == 0
    assert [line.partition(". ")[2] for line in tshark("-D") if "s7dissect" in line] == [
        "s7dissect (S7 with findings (live))",
        "s7dissect-file (S7 with findings (from a file))",
    ]
    packets = read(read(read(begun(), 1), 2, WORD, 0x0A), 3).packets()
    path = saved(tmp_path / "a capture.pcapng", packets, {4: "here before", 10: "here before"})
    run(capfdbinary, "cut", path, "-o", tmp_path / "cut.pcapng")
    shown = (
        "-T",
        "fields",
        "-E",
        "occurrence=a",
        "-e",
        "frame.number",
        "-e",
        "frame.time_epoch",
        "-e",
        "frame.comment",
    )
    through = tshark("-i", "s7dissect-file", "-o", f"extcap.s7dissect_file.file:{path}", *shown)
    assert through == tshark("-r", tmp_path / "cut.pcapng", *shown)
    assert sum(MARK in line for line in through) == 2
    assert [line.split("\t")[0] for line in through if "here before" in line] == ["4", "10"]
    assert f"here before,{MARK}" in through[9]
    selected = tshark(
        "-i", "s7dissect-file", "-o", f"extcap.s7dissect_file.file:{path}", "-o", "extcap.s7dissect_file.where:failed",
        *shown,
    )  # fmt: skip
    assert [line.split("\t")[1] for line in selected] == [line.split("\t")[1] for line in through if MARK in line]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("s7dissect-file", "--file", "missing.pcapng"), "missing.pcapng"),
        (("s7dissect-file",), "choose a capture file"),
        (("s7dissect-file", "--file", "missing.pcapng", "--extcap-capture-filter", "tcp"), "--where"),
        (("s7dissect",), "choose a network interface"),
        (("s7dissect", "--interface", "none0"), "none0"),
    ],
)
def test_whoever_waits_at_the_pipe_is_not_left_waiting(
    capfdbinary: Capture, tmp_path: Path, arguments: tuple[str, ...], said: str
) -> None:
    """What cannot be captured opens and closes the pipe: dumpcap waits for that for ever."""
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    got: list[bytes] = []
    reading = threading.Thread(target=lambda: got.append(pipe.read_bytes()))
    reading.start()
    ran = run(capfdbinary, "extcap", "--capture", "--fifo", pipe, "--extcap-interface", *arguments)
    reading.join(30)
    assert ran.code == 2
    assert said in ran.err
    assert got[0][:4] == b"\x0a\x0d\x0d\x0a"


# ---- live -----------------------------------------------------------------------------------------------------------

needs_live = pytest.mark.skipif(
    all(state.reason for state in engine_states()), reason="ring or dumpcap cannot capture here"
)


@pytest.fixture
def port() -> Iterator[int]:
    """The port of a server that sets up a connection and refuses what is read."""
    listening = socket.create_server(("127.0.0.1", 0))

    def serve() -> None:
        replies = (CONFIRM, dt(granted(0)), dt(ack_data(1, b"\x04\x01", b"\x0a\0\0\0")))
        while True:
            try:
                stream, _ = listening.accept()
            except OSError:
                return
            with stream:
                for reply in replies:
                    if stream.recv(1000):
                        stream.sendall(reply)
                stream.recv(1)

    thread = threading.Thread(target=serve, daemon=True)
    thread.start()
    yield int(listening.getsockname()[1])
    listening.shutdown(socket.SHUT_RDWR)
    listening.close()
    thread.join(10)


def ask(port: int) -> None:
    """Connect and read what is refused."""
    with socket.create_connection(("127.0.0.1", port), 10) as stream:
        for octets in (CONNECT, dt(setup(0)), dt(read_job(1, dbw(99, 0)))):
            stream.sendall(octets)
            assert stream.recv(1000)


@needs_tshark
@needs_live
def test_tshark_captures_live(capfdbinary: Capture, home: Path, port: int) -> None:
    assert run(capfdbinary, "extcap", "--install").code == 0
    program = "tshark"
    stop = threading.Event()

    def talk() -> None:
        while not stop.wait(0.3):
            ask(port)

    talking = threading.Thread(target=talk)
    talking.start()
    command = [program, "-l", "-i", "s7dissect", "-o", "extcap.s7dissect.interface:lo", "-f", f"tcp port {port}"]
    command += ["-T", "fields", "-e", "tcp.port", "-e", "frame.comment"]
    try:
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as child:
            assert child.stdout is not None
            lines = []
            for line in child.stdout:
                lines.append(line)
                if sum(MARK in one for one in lines) >= 4:
                    break
            child.send_signal(signal.SIGINT)
            child.stdout.read()
    finally:
        stop.set()
        talking.join(30)
    assert all(str(port) in line for line in lines)
    assert sum(MARK in line for line in lines) == 4
    assert all("DB99.DBW0" in line for line in lines if MARK in line)


@needs_live
def test_it_ends_when_the_pipe_is_closed_on_a_silent_line(port: int, tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    command = [sys.executable, "-m", "dissect", "extcap", "--capture", "--extcap-interface", "s7dissect"]
    command += ["--fifo", str(pipe), "--interface", "lo", "--extcap-capture-filter", f"tcp port {port}"]
    with subprocess.Popen(command, stderr=subprocess.PIPE) as child:
        try:
            with pipe.open("rb", buffering=0) as reading:
                assert reading.read(4) == b"\x0a\x0d\x0d\x0a"
            assert child.wait(60) == 0
        finally:
            child.kill()
