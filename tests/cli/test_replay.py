"""`s7dissect replay`: what it refuses before anything is sent, what it tells, and its exit codes."""

from __future__ import annotations

import json
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest

from dissect.testing.golden import golden_text, read_session
from dissect.testing.playback.server.service import Server
from tests.cli.support import run
from tests.testing.playback.client.support import CAPTURES, changed, free_port, mixed
from tests.testing.playback.client.test_schedule import two

Capture = pytest.CaptureFixture[bytes]


def test_the_same_answers_are_exit_code_0_and_what_was_withheld_is_told(capfdbinary: Capture, tmp_path: Path) -> None:
    path = mixed(tmp_path / "mixed.pcapng")
    with Server(path) as server:
        told = run(capfdbinary, "replay", path, "--to", f"127.0.0.1:{server.port}")
        arrived = [request.octets[10] for request in server.requests]
    assert (told.code, told.out) == (0, "")
    assert arrived == [0xF0, 0x04, 0x04]
    assert told.err.splitlines() == [
        "s7dissect: 3 requests sent on 1 connection, 3 answers",
        "s7dissect: withheld: 1 transaction, writes are only sent with --allow-write (transaction 3)",
        "s7dissect: withheld: 1 transaction, control requests are only sent with --allow-control (transaction 4)",
    ]


@pytest.mark.parametrize(
    ("options", "arrives"),
    [
        (["--allow-write"], [0xF0, 0x04, 0x05, 0x04]),
        (["--allow-control"], [0xF0, 0x04, 0x29, 0x04]),
        (["--allow-control", "--allow-write"], [0xF0, 0x04, 0x05, 0x29, 0x04]),
    ],
)
def test_writes_and_control_are_sent_when_each_is_allowed(
    options: list[str], arrives: list[int], capfdbinary: Capture, tmp_path: Path
) -> None:
    path = mixed(tmp_path / "mixed.pcapng")
    with Server(path) as server:
        told = run(capfdbinary, "replay", path, "--to", f"localhost:{server.port}", *options)
        arrived = [request.octets[10] for request in server.requests]
    assert (told.code, arrived) == (0, arrives)


def test_another_answer_is_exit_code_1_and_told_in_words(capfdbinary: Capture, tmp_path: Path) -> None:
    path = mixed(tmp_path / "mixed.pcapng")
    with Server(changed(path, 0, 4, b"\x04\xd2", b"\x04\xd3")) as server:
        told = run(capfdbinary, "replay", path, "--to", f"127.0.0.1:{server.port}")
        ignored = run(capfdbinary, "replay", path, "--to", f"127.0.0.1:{server.port}", "--ignore", "values:DB10.*")
    assert (told.code, told.out) == (1, "transaction 5, READ DB10.DBW4: was 1234, is 1235\n")
    assert (ignored.code, ignored.out) == (0, "")


def test_the_report_as_json_and_as_junit(capfdbinary: Capture, tmp_path: Path) -> None:
    path = mixed(tmp_path / "mixed.pcapng")
    with Server(changed(path, 0, 4, b"\x04\xd2", b"\x04\xd3")) as server:
        to = ("--to", f"127.0.0.1:{server.port}")
        as_json = run(capfdbinary, "replay", path, *to, "-T", "json")
        as_junit = run(capfdbinary, "replay", path, *to, "-T", "junit")
    values = json.loads(as_json.out)
    assert (as_json.code, values["schema"], values["same"], values["count"]) == (1, "s7dissect.replay/1", False, 1)
    assert values["a"] == str(path)
    assert values["b"].startswith("127.0.0.1:")
    assert values["differences"][0]["transaction"] == 5
    assert [one["transaction"] for one in values["replay"]["withheld"]] == [3, 4]
    assert (values["replay"]["requests"], values["replay"]["answered"]) == (3, 3)
    suite = ElementTree.fromstring(as_junit.out.partition("\n")[2])
    assert (as_junit.code, suite.get("tests"), suite.get("failures")) == (1, "1", "1")


def test_another_machine_is_refused_before_any_packet(
    capfdbinary: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = mixed(tmp_path / "mixed.pcapng")
    monkeypatch.setattr(socket, "socket", _never)
    told = run(capfdbinary, "replay", path, "--to", "192.0.2.1", "-w", tmp_path / "out.pcapng")
    assert (told.code, told.out) == (2, "")
    assert "192.0.2.1:102 is not a loopback address of this machine: nothing was sent; add --allow-remote" in told.err
    assert not (tmp_path / "out.pcapng").exists()


def test_a_name_of_another_machine_is_refused_before_any_packet(
    capfdbinary: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = mixed(tmp_path / "mixed.pcapng")
    there = [(socket.AF_INET, socket.SOCK_STREAM, 6, "", ("192.0.2.7", 102))]
    monkeypatch.setattr(socket, "getaddrinfo", lambda *_, **__: there)
    monkeypatch.setattr(socket, "socket", _never)
    told = run(capfdbinary, "replay", path, "--to", "plc-7", "-w", tmp_path / "out.pcapng")
    assert told.code == 2
    assert "plc-7:102 is 192.0.2.7, not a loopback address of this machine" in told.err
    assert not (tmp_path / "out.pcapng").exists()


def _never(*_: Any, **__: Any) -> Any:
    raise AssertionError("a socket was opened")


def test_another_machine_is_reached_when_that_is_allowed(
    capfdbinary: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As far as the sockets: what would go out is turned to a port of this machine where nobody listens."""
    asked: list[Any] = []

    class Turned(socket.socket):
        def connect(self, address: Any) -> None:
            asked.append(address)
            super().connect(("127.0.0.1", port))

    port = free_port()
    monkeypatch.setattr(socket, "socket", Turned)
    told = run(
        capfdbinary,
        "replay",
        mixed(tmp_path / "m.pcapng"),
        "--to",
        "192.0.2.1:1102",
        "--allow-remote",
        "--retries",
        "1",
    )
    assert asked == [("192.0.2.1", 1102)] * 2
    assert told.code == 2
    assert "no connection: 192.0.2.1:1102: Connection refused" in told.err
    assert "not sent: 3 transactions" in told.err


def test_over_ipv6_and_by_name(capfdbinary: Capture, tmp_path: Path) -> None:
    path = mixed(tmp_path / "mixed.pcapng")
    with Server(path, host="::1") as server:
        told = run(capfdbinary, "replay", path, "--to", f"[::1]:{server.port}", "-w", tmp_path / "out.pcapng")
    assert told.code == 0
    assert read_session(tmp_path / "out.pcapng").links[0].addresses[1].startswith("[::1]:")


def test_a_dry_run_opens_nothing_and_lists_everything(
    capfdbinary: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = mixed(tmp_path / "mixed.pcapng")
    with socket.create_server(("127.0.0.1", 0)) as listener:
        to = f"127.0.0.1:{listener.getsockname()[1]}"
        monkeypatch.setattr(socket, "socket", _never)
        monkeypatch.setattr(socket, "getaddrinfo", _never)
        told = run(capfdbinary, "replay", path, "--to", to, "--dry-run", "-w", tmp_path / "out.pcapng")
        named = run(capfdbinary, "replay", path, "--to", "plc-7", "--dry-run", "--allow-write")
        alone = run(capfdbinary, "replay", path, "--dry-run", "--allow-control", "--tsap", "03.01")
        listener.settimeout(0.05)
        with pytest.raises(TimeoutError):
            listener.accept()
    assert (told.code, told.err) == (0, "")
    assert told.out.splitlines() == [
        "connection 1: connect 01.00 -> 01.02, TPDU size 1024",
        "  send transaction 1, SETUP",
        "  send transaction 2, READ DB10.DBW4",
        "  withhold transaction 3, WRITE DB10.DBW4: writes are only sent with --allow-write",
        "  withhold transaction 4, PLC stop P_PROGRAM: control requests are only sent with --allow-control",
        "  send transaction 5, READ DB10.DBW4",
    ]
    assert "  send transaction 3, WRITE DB10.DBW4" in named.out
    assert "  withhold transaction 4" in named.out
    assert "connect 01.00 -> 03.01" in alone.out
    assert "  send transaction 4, PLC stop P_PROGRAM" in alone.out
    assert not (tmp_path / "out.pcapng").exists()


def test_a_dry_run_refuses_another_machine_too(capfdbinary: Capture, tmp_path: Path) -> None:
    told = run(capfdbinary, "replay", mixed(tmp_path / "m.pcapng"), "--to", "192.0.2.1", "--dry-run")
    assert (told.code, told.out) == (2, "")
    assert "is not a loopback address of this machine" in told.err


def test_what_is_exchanged_is_kept_and_never_overwrites_what_is_there(capfdbinary: Capture, tmp_path: Path) -> None:
    path, out = CAPTURES / "nodes7-poll.pcapng", tmp_path / "out.pcapng"
    with Server(path) as server:
        to = ("--to", f"127.0.0.1:{server.port}")
        told = run(capfdbinary, "replay", path, *to, "-w", out)
        kept = out.read_bytes()
        again = run(capfdbinary, "replay", path, *to, "-w", out)
        assert out.read_bytes() == kept
        forced = run(capfdbinary, "replay", path, *to, "-w", out, "--force")
    assert (told.code, again.code, forced.code) == (0, 2, 0)
    assert again.err.endswith(f"Error: {out} exists; --force overwrites it.\n")
    assert golden_text(read_session(out)) == golden_text(read_session(path))


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_it_in_order_and_what_was_sent_until_then_is_told(number: int, tmp_path: Path) -> None:
    """Requests may have written: who breaks a replay off has to know how far it came."""
    path, out = CAPTURES / "nodes7-poll.pcapng", tmp_path / "out.pcapng"
    with Server(path, faults=["drop:3"]) as server:
        to = ["--to", f"127.0.0.1:{server.port}", "--timeout", "60"]
        command = [sys.executable, "-m", "dissect", "replay", str(path), *to, "-w", str(out)]
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
            end = time.monotonic() + 60
            while len(server.requests) < 3:
                assert time.monotonic() < end
                time.sleep(0.01)
            process.send_signal(number)
            told, said = process.communicate(timeout=60)
    assert process.returncode == 130
    assert said.splitlines() == [
        "s7dissect: 3 requests sent on 1 connection, 2 answers",
        "s7dissect: not sent: 3 transactions, interrupted (transactions 4, 5, 6)",
        "s7dissect: interrupted",
    ]
    assert told.splitlines()[0].endswith(
        "was answered, is unanswered: the replay was interrupted before an answer came"
    )
    assert [each.outcome for each in read_session(out).links[0].transactions] == ["answered", "answered", "unanswered"]


def test_an_answer_that_was_waited_for_in_vain_says_so(capfdbinary: Capture) -> None:
    """It is us who end the connection then, so its end is no reason."""
    path = CAPTURES / "nodes7-poll.pcapng"
    with Server(path, faults=["drop:3", "drop:4", "drop:5"]) as server:
        told = run(capfdbinary, "replay", path, "--to", f"127.0.0.1:{server.port}", "--timeout", "0.1")
    assert told.code == 1
    lines = told.out.splitlines()
    assert [line.partition(": ")[2] for line in lines] == [
        *["was answered, is unanswered: no answer within 0.1 s"] * 3,
        "missing (was answered)",
    ]


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ([], "missing --to HOST:PORT"),
        (["--to", "127.0.0.1:x"], "is not an address"),
        (["--to", "127.0.0.1", "--connection", "9"], "there is no connection 9: it has 1"),
        (["--to", "127.0.0.1", "--rack", "0"], "--rack and --slot must be given together"),
        (["--to", "127.0.0.1", "--rack", "0", "--slot", "1", "--tsap", "01.01"], "and without --tsap"),
        (["--to", "127.0.0.1", "--tsap", ""], "expected a TSAP"),
        (["--to", "127.0.0.1", "--timing", "soon"], "expected asap, recorded or a factor"),
        (["--to", "127.0.0.1", "--timing", "nan"], "expected asap, recorded or a factor"),
        (["--to", "127.0.0.1", "--ignore", "nonsense"], "is not a kind of"),
        (["--to", "127.0.0.1", "--latency", "fast"], "is not a tolerance"),
        (["--to", "127.0.0.1", "-w", "-"], "-w needs a file"),
    ],
)
def test_wrong_use_is_told(arguments: list[str], says: str, capfdbinary: Capture, tmp_path: Path) -> None:
    told = run(capfdbinary, "replay", mixed(tmp_path / "mixed.pcapng"), *arguments)
    assert (told.code, told.out) == (2, "")
    assert says in told.err


def test_the_recording_is_not_written_over(capfdbinary: Capture, tmp_path: Path) -> None:
    path = mixed(tmp_path / "mixed.pcapng")
    before = path.read_bytes()
    told = run(capfdbinary, "replay", path, "--to", "127.0.0.1:1", "-w", path, "--force")
    assert told.code == 2
    assert "mixed.pcapng is both input and output; choose another OUT." in told.err
    assert path.read_bytes() == before


def test_a_golden_has_no_times_to_keep(capfdbinary: Capture, tmp_path: Path) -> None:
    golden = tmp_path / "a.s7.txt"
    golden.write_text(golden_text(read_session(mixed(tmp_path / "mixed.pcapng"))), "utf-8")
    told = run(capfdbinary, "replay", golden, "--to", "127.0.0.1:1", "--timing", "recorded")
    assert told.code == 2
    assert "has no times, so --timing must be asap" in told.err


def test_answer_times_are_compared_when_asked_for(capfdbinary: Capture, tmp_path: Path) -> None:
    path = mixed(tmp_path / "mixed.pcapng")
    with Server(path, faults=["delay:2:150"]) as server:
        told = run(capfdbinary, "replay", path, "--to", f"127.0.0.1:{server.port}", "--latency", "100ms")
    assert told.code == 1
    assert told.out.startswith("transaction 2, READ DB10.DBW4: answer time was 1.00 ms, is ")


def test_connections_are_played_together_or_one_by_one(capfdbinary: Capture, tmp_path: Path) -> None:
    path = two(tmp_path / "two.pcapng")
    orders = []
    for options in ([], ["--one-by-one"], ["--pipelined"], ["--timing", "0"]):
        with Server(path) as server:
            told = run(capfdbinary, "replay", path, "--to", f"127.0.0.1:{server.port}", *options)
            orders.append([request.connection for request in server.requests])
        assert (told.code, told.out) == (0, "")
    assert orders == [[1, 2, 1, 2, 1, 2, 1], [1, 1, 1, 1, 2, 2, 2], *[[1, 2, 1, 2, 1, 2, 1]] * 2]


@pytest.mark.parametrize("dry", [[], ["--dry-run"]])
def test_too_many_connections_at_once_are_refused_before_any_packet(
    dry: list[str], capfdbinary: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = two(tmp_path / "two.pcapng")
    monkeypatch.setattr("dissect.testing.playback.client.schedule.MAX_OPEN", 1)
    monkeypatch.setattr(socket, "socket", _never)
    told = run(capfdbinary, "replay", path, "--to", "127.0.0.1:1", *dry, "-w", tmp_path / "out.pcapng")
    assert (told.code, told.out) == (2, "")
    assert "2 connections were open at once in the recording, at most 1 can be replayed together" in told.err
    assert "nothing was sent; add --one-by-one" in told.err
    assert not (tmp_path / "out.pcapng").exists()


def test_what_is_not_played_is_told(capfdbinary: Capture) -> None:
    path = CAPTURES / "crafted" / "netlink-faults.pcapng"
    with Server(path) as server:
        told = run(capfdbinary, "replay", path, "--to", f"127.0.0.1:{server.port}")
    assert told.code == 0
    assert (
        "s7dissect: withheld: 10 transactions, only S7comm and S7comm-plus over TCP are replayed (transactions "
        in told.err
    )
