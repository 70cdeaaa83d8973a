"""`s7dissect proxy`: a process between a python-snap7 client and a python-snap7 server."""

from __future__ import annotations

import contextlib
import json
import os
import re
import resource
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import IO

import pytest
import snap7
import snap7.error

from dissect.cli.main import COMMANDS
from dissect.online.proxy.source import RelayReader
from dissect.online.proxy.tap import Passed
from tests.cli.support import Ran, run
from tests.conftest import Command
from tests.online.live.support import client, plc
from tests.online.proxy.support import WRONG, eventually, port_of_nobody, tshark

PATIENCE_S = 60


class Proxy:
    """A proxy that listens: its process, its port."""

    def __init__(self, process: subprocess.Popen[bytes]) -> None:
        self.process = process
        assert process.stderr is not None
        first = process.stderr.readline().decode()
        found = re.fullmatch(r"s7dissect: listening on (?:127\.0\.0\.1|\[::1\]):(\d+), relaying to (\S+)\n", first)
        assert found is not None, first + process.stderr.read().decode()
        self.port = int(found[1])

    def ended(self, number: int = signal.SIGTERM) -> tuple[int, list[str], str]:
        """End it by a signal: its exit code, what it wrote, what it said."""
        self.process.send_signal(number)
        out, told = self.process.communicate(timeout=PATIENCE_S)
        return self.process.returncode, (out or b"").decode().splitlines(), told.decode()


@contextlib.contextmanager
def proxy(port: int, *arguments: str | Path, stdout: int | IO[bytes] = subprocess.PIPE) -> Iterator[Proxy]:
    command = [sys.executable, "-m", "dissect", "proxy", "--listen", "127.0.0.1:0", "--to", f"127.0.0.1:{port}"]
    with subprocess.Popen(
        [*command, *map(str, arguments)], stdin=subprocess.DEVNULL, stdout=stdout, stderr=subprocess.PIPE
    ) as process:
        try:
            yield Proxy(process)
        finally:
            process.kill()


def used(port: int) -> None:
    """Read, write, and ask for what is not there."""
    with client(port) as panel:
        assert panel.db_read(1, 4, 4) == bytes((4, 5, 6, 7))
        panel.db_write(1, 0, bytearray(b"\x2a"))
        with pytest.raises(snap7.error.S7Error):
            panel.db_read(99, 0, 4)


def test_what_passes_is_told_and_written(tmp_path: Path, s7dissect: Command) -> None:
    path = tmp_path / "out.pcapng"
    with plc() as server, proxy(server.port, "-w", path) as made:
        used(made.port)
        code, lines, told = made.ended()
        assert code == 0
        joined = "\n".join(lines)
        assert re.search(
            r"#\d+ +\S+ +127\.0\.0\.1:\d+ → 127\.0\.0\.1:\d+ .* Read Var  DB1\.DBB4 x4 = 04 05 06 07", joined
        )
        assert re.search(r"Write Var  DB1\.DBB0(?: x1)? = ", joined)
        assert "Read Var  DB99.DBB0 x4: Object does not exist" in joined
        assert re.search(r"WARNING  transaction\.item_error", joined)
        assert "opened" in joined
        assert "s7dissect: 1 connection relayed; " in told
        assert "bytes from the PLC\n" in told
        assert re.search(
            r"s7dissect: \d+ packets, 1 connection, 4 transactions \(1 with errors\), \d+ findings\n", told
        )
        transactions = [line for line in lines if re.match(r"\S+ \S+ UTC  #\d+ .*(Read Var|Write Var|Setup)", line)]
        again = s7dissect("transactions", path)
        assert again.stdout.decode().splitlines() == transactions
        assert len(transactions) == 4
        assert tshark(path, WRONG, port=server.port) == []
        assert tshark(path, "s7comm", port=server.port) != []


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_json_lines_end_with_a_summary(number: int) -> None:
    with plc() as server, proxy(server.port, "-T", "jsonl", "--only", "transactions,findings") as made:
        used(made.port)
        code, lines, _ = made.ended(number)
    assert code == 0
    told = [json.loads(line) for line in lines]
    assert {one["schema"].partition("/")[0] for one in told} <= {"s7dissect.transaction", "s7dissect.event"}
    assert "connection_opened" not in {one.get("event") for one in told}
    summary = told[-1]["summary"]
    assert (told[-1]["event"], summary["transactions"], summary["with_errors"]) == ("summary", 4, 1)
    assert summary["dropped"] == {"kernel": 0, "interface": None}


def test_findings_fail_the_command_when_asked_to() -> None:
    with plc() as server, proxy(server.port, "--fail-on", "transaction.item_error", "--only", "findings") as made:
        used(made.port)
        code, lines, told = made.ended()
    assert code == 1
    assert "s7dissect: --fail-on: transaction.item_error (1)\n" in told
    assert lines != []
    assert all(re.search(r"(NOTE|WARNING|ERROR)  ", line) for line in lines)


def test_a_capture_on_standard_output(tmp_path: Path) -> None:
    path = tmp_path / "out.pcapng"
    with path.open("wb") as out, plc() as server, proxy(server.port, "-w", "-", stdout=out) as made:
        used(made.port)
        assert made.ended()[0] == 0
    assert tshark(path, WRONG, port=server.port) == []
    assert len(tshark(path, "s7comm", port=server.port)) == 8


def test_a_server_that_is_not_there_is_told() -> None:
    with proxy(port_of_nobody()) as made:
        with pytest.raises((snap7.error.S7Error, OSError)):
            snap7.client.Client().connect("127.0.0.1", 0, 2, made.port)
        code, lines, told = made.ended()
    assert code == 0
    assert any("PROBLEM  127.0.0.1:" in line and "cannot be reached: Connection refused" in line for line in lines)
    assert "s7dissect: 0 connections relayed, 1 failed to connect; " in told


def test_a_client_that_is_connected_when_it_ends_is_disconnected() -> None:
    connect = bytes.fromhex("0300001611e00000000100c0010ac1020100c2020102")
    with contextlib.ExitStack() as held:
        made = held.enter_context(proxy(held.enter_context(plc()).port))
        stream = held.enter_context(socket.create_connection(("127.0.0.1", made.port), PATIENCE_S))
        stream.sendall(connect)
        assert stream.recv(100)[5] == 0xD0
        assert made.ended()[0] == 0
        assert stream.recv(100) == b""


def test_output_that_nobody_takes_does_not_stop_the_relay() -> None:
    reading, writing = os.pipe()
    with plc() as server, proxy(server.port, stdout=writing) as made:
        os.close(writing)
        used(made.port)
        assert os.read(reading, 10)
        os.close(reading)
        used(made.port)
        used(made.port)
        code, _, told = made.ended()
    assert code == 0
    assert "s7dissect: output failed (Broken pipe); traffic is still relayed\n" in told
    assert "s7dissect: 3 connections relayed; " in told


def test_output_that_is_full_does_not_stop_the_relay_either() -> None:
    with Path("/dev/full").open("wb") as full, plc() as server, proxy(server.port, stdout=full) as made:
        used(made.port)
        used(made.port)
        code, _, told = made.ended()
    assert code == 5
    assert "output failed (No space left on device)" in told
    assert "s7dissect: 2 connections relayed; " in told


def test_a_capture_that_cannot_be_written_any_more_does_not_stop_the_relay(tmp_path: Path) -> None:
    path = tmp_path / "out.pcapng"
    with plc() as server, proxy(server.port, "-w", path, "-T", "jsonl") as made:
        resource.prlimit(made.process.pid, resource.RLIMIT_FSIZE, (1000, 1000))
        used(made.port)
        code, lines, told = made.ended()
    problems = [json.loads(line)["text"] for line in lines if json.loads(line).get("event") == "problem"]
    said = f"the capture file cannot be written: {path}: File too large; it will be tried again"
    assert (code, problems) == (5, [said])
    assert re.search(
        rf"s7dissect: the capture file: [0-9]+ packets \([0-9]+ bytes\) not written in .*: {path}: File too", told
    )
    assert "4 transactions" in told
    assert tshark(path, WRONG, port=server.port) == []  # up to the last whole packet


def listens(port: int) -> bool:
    with socket.socket() as one:
        return one.connect_ex(("127.0.0.1", port)) == 0


def run_while(capfdbinary: pytest.CaptureFixture[bytes], use: Callable[[int], None]) -> Ran:
    """Run `proxy` in front of a server until ``use`` has used its port."""
    port = port_of_nobody()
    with plc() as server:

        def work() -> None:
            try:
                eventually(lambda: listens(port))
                use(port)
            finally:
                os.kill(os.getpid(), signal.SIGTERM)

        thread = threading.Thread(target=work)
        thread.start()
        ran = run(capfdbinary, "proxy", "--listen", f"127.0.0.1:{port}", "--to", f"127.0.0.1:{server.port}")
        thread.join()
    return ran


def test_a_dissection_that_breaks_off_does_not_stop_the_relay(
    monkeypatch: pytest.MonkeyPatch, capfdbinary: pytest.CaptureFixture[bytes]
) -> None:
    failed = threading.Event()

    def broken(self: RelayReader, passed: Passed) -> list[bytes]:
        failed.set()
        raise RuntimeError("a bug")

    def use(port: int) -> None:
        used(port)
        assert failed.wait(20)
        used(port)

    monkeypatch.setattr(RelayReader, "_frames", broken)
    turn = sys.getswitchinterval()
    ran = run_while(capfdbinary, use)
    assert ran.code == 3
    assert ran.err.count("s7dissect: the dissection failed: RuntimeError('a bug')") == 1
    assert re.search(r"s7dissect: \d connections? relayed; [1-9]\d+ bytes from clients", ran.err)
    assert sys.getswitchinterval() == turn


def test_a_dissection_that_breaks_off_when_the_relay_has_ended_is_reported(
    monkeypatch: pytest.MonkeyPatch, capfdbinary: pytest.CaptureFixture[bytes]
) -> None:
    stopped = threading.Event()
    stop = RelayReader.stop

    def stopping(self: RelayReader) -> None:  # the command does so when it sees that the relay has ended
        stop(self)
        stopped.set()

    def broken(self: RelayReader, passed: Passed) -> list[bytes]:
        stopped.wait(20)
        raise RuntimeError("a bug")

    monkeypatch.setattr(RelayReader, "stop", stopping)
    monkeypatch.setattr(RelayReader, "_frames", broken)
    ran = run_while(capfdbinary, used)
    assert ran.code == 3
    assert ran.err.count("s7dissect: the dissection failed: RuntimeError('a bug')\n") == 1


def refused(capfdbinary: pytest.CaptureFixture[bytes], *arguments: str | Path) -> str:
    ran = run(capfdbinary, "proxy", *arguments)
    assert (ran.code, ran.out) == (2, "")
    assert threading.active_count() == 1
    return ran.err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--to", "127.0.0.1", "--listen", "0.0.0.0:0"), "or add --allow-remote if that is intended"),
        (("--to", "127.0.0.1", "--listen", "[::]:0"), "or add --allow-remote if that is intended"),
        (("--to", "a:b"), "'a:b' is not an address: expected HOST:PORT"),
        (("--to", "127.0.0.1", "--listen", "102"), "'102' is not an address: expected HOST:PORT"),
        (("--to", "127.0.0.1:0", "--listen", "127.0.0.1:0"), "port 0 cannot be connected to"),
        (("--to", "no.such.host.invalid", "--listen", "127.0.0.1:0"), "s7dissect: no.such.host.invalid:102: "),
        (("--to", "127.0.0.1", "--listen", "192.0.2.1:0", "--allow-remote"), "s7dissect: cannot listen on 192.0.2.1:0"),
        (
            (
                "--to",
                "127.0.0.1:10102",
            ),
            "would connect to itself forever",
        ),
        (("--to", "127.0.0.1", "-w", "-", "-T", "jsonl"), "so -T jsonl and --only cannot be used"),
        (("--to", "127.0.0.1", "--only", "nonsense"), "expected connections, transactions,"),
        (("--to", "127.0.0.1", "--only", "scd"), "--only scd needs --scd DICT and --bind BINDINGS"),
        ((), "Missing option '--to'"),
    ],
)
def test_wrong_use_is_told(arguments: Sequence[str], message: str, capfdbinary: pytest.CaptureFixture[bytes]) -> None:
    assert message in refused(capfdbinary, *arguments)


def test_a_file_that_is_there_is_not_overwritten(tmp_path: Path, capfdbinary: pytest.CaptureFixture[bytes]) -> None:
    path = tmp_path / "precious.pcapng"
    path.write_bytes(b"precious")
    told = refused(capfdbinary, "--to", "127.0.0.1", "--listen", "127.0.0.1:0", "-w", path)
    assert told.endswith(f"Error: {path} exists; --force overwrites it.\n")
    assert path.read_bytes() == b"precious"
    with plc() as server, proxy(server.port, "-w", path, "--force") as made:
        used(made.port)
        made.ended()
    assert len(tshark(path, "s7comm", port=server.port)) == 8


def test_the_list_of_commands_names_it() -> None:
    assert "proxy" in COMMANDS
