"""`s7dissect monitor`: lines while it happens, and an end in order, whatever ends it."""

from __future__ import annotations

import json
import os
import re
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any

import pytest

from dissect.files.recording import event_capture
from dissect.packets.source.files import open_capture
from tests.cli.support import WITHOUT_CACHE, run, simple, started
from tests.forked import Forked
from tests.meaning.report.schemas import complaints
from tests.meaning.report.support import WORD, begun, read, saved
from tests.meaning.report.test_many_pairs import stops
from tests.online.live.support import client, plc
from tests.packets.source.craft import Pcapng, drain
from tests.packets.source.live_support import ENGINES
from tests.properties import messages
from tests.properties.messages import dt

Told = dict[str, Any]


def lines(stream: IO[bytes] | None, until: str) -> Iterator[str]:
    """Read lines up to the first with ``until`` in it."""
    assert stream is not None
    for line in stream:
        text = line.decode()
        yield text.rstrip("\n")
        if until in text:
            return
    raise AssertionError(f"{until!r} never came")


# ---- files and pipes ------------------------------------------------------------------------------------------------


def test_a_file_is_told_line_by_line(capfdbinary: pytest.CaptureFixture[bytes], tmp_path: Path) -> None:
    ran = run(capfdbinary, "monitor", simple(tmp_path / "a.pcapng"))
    assert ran.code == 0
    told = ran.out.splitlines()
    assert sum("opened" in line for line in told) == 1
    assert sum("Read Var" in line and "#" in line for line in told) == 3
    assert sum("transaction.item_error" in line for line in told) == 1
    assert ran.err == "s7dissect: 13 packets, 1 connection, 4 transactions (1 with errors), 1 finding\n"


def test_what_is_odd_about_a_file_is_told(capfdbinary: pytest.CaptureFixture[bytes], tmp_path: Path) -> None:
    file = Pcapng()
    file.interface(options=file.resolution(0xFF))
    file.packet(0, 0, bytes(60))
    path = tmp_path / "odd.pcapng"
    dropped = b"\x05\0\x08\0" + (7).to_bytes(8, "little")  # isb_ifdrop
    statistics = bytes(12) + dropped + bytes(4)
    size = (12 + len(statistics)).to_bytes(4, "little")
    path.write_bytes(bytes(file.octets) + b"\x05\0\0\0" + size + statistics + size)
    ran = run(capfdbinary, "monitor", path)
    assert ran.code == 0
    assert f"s7dissect: {path}: an interface claims a time resolution of 10 or 2 to the minus 127" in ran.err
    assert f"capture.dropped  packet 1: {path}: 7 packets dropped by the interface, as the file states" in ran.out


def test_json_lines_are_the_schemas(capfdbinary: pytest.CaptureFixture[bytes], tmp_path: Path) -> None:
    ran = run(capfdbinary, "monitor", simple(tmp_path / "a.pcapng"), "-T", "jsonl")
    told: list[Told] = [json.loads(line) for line in ran.out.splitlines()]
    for line in told:
        name = line["schema"].removeprefix("s7dissect.").removesuffix("/1")
        assert complaints(name, line, exact=True) == []
    assert told[-1]["event"] == "summary"
    assert told[-1]["summary"]["transactions"] == 4


@pytest.mark.parametrize(
    ("only", "kinds"),
    [
        ("findings", {"finding", "summary"}),
        ("connections,operations", {"connection_opened", "connection_closed", "s7dissect.operation/1", "summary"}),
    ],
)
def test_only_what_is_asked_for(
    capfdbinary: pytest.CaptureFixture[bytes], tmp_path: Path, only: str, kinds: set[str]
) -> None:
    ran = run(capfdbinary, "monitor", simple(tmp_path / "a.pcapng"), "-T", "jsonl", "--only", only)
    told: list[Told] = [json.loads(line) for line in ran.out.splitlines()]
    assert {line.get("event", line["schema"]) for line in told} == kinds


def test_findings_may_fail_it(capfdbinary: pytest.CaptureFixture[bytes], tmp_path: Path) -> None:
    path = simple(tmp_path / "a.pcapng")
    assert run(capfdbinary, "monitor", path, "--fail-on", "warning").code == 1
    assert run(capfdbinary, "monitor", path, "--fail-on", "security.*").code == 0


def test_it_ends_after_so_many_packets(capfdbinary: pytest.CaptureFixture[bytes], tmp_path: Path) -> None:
    ran = run(capfdbinary, "monitor", simple(tmp_path / "a.pcapng"), "-c", "9")
    assert ran.err.startswith("s7dissect: 9 packets, 1 connection, 2 transactions,")


def test_a_damaged_file_is_told(capfdbinary: pytest.CaptureFixture[bytes], tmp_path: Path) -> None:
    path = simple(tmp_path / "a.pcapng")
    path.write_bytes(path.read_bytes()[:-7])
    ran = run(capfdbinary, "monitor", path)
    assert ran.code == 3
    assert "cut off at byte" in ran.err
    assert "capture.damaged" in ran.out


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ([], "Nothing to watch"),
        (["-i", "lo", "file"], "-i and FILE cannot be combined."),
        (["file", "-f", "tcp"], "need an interface (-i)"),
        (["file", "-Z", "root"], "need an interface (-i)"),
        (["-i", "lo", "-Z", "nobody", "--engine", "dumpcap"], "-Z USER needs --engine ring: "),
        (["-i", "lo", "-i", "lo"], "name each interface once."),
        (["-i", "lo", "-i", "-"], "standard input is watched alone."),
        (["-i", "lo", "--duration", "0"], "expected more than 0 and at most 1000000000 seconds, got '0'."),
        (["-i", "lo", "--duration", "x"], "expected seconds, got 'x'"),
        (
            ["-i", "lo", "--only", "nothing"],
            "expected connections, transactions, operations, findings, devices, scd, got 'nothing'",
        ),
        (["-i", "lo", "--only", ""], "devices, scd, got ''"),
        (["-i", "lo", "-b", "files:3"], "files:N limits"),
        (["-i", "lo", "-b", "filesize:3"], "need -w, where"),
        (["-i", "lo", "--keep-around", "error", "30s"], "need -w, where"),
        (
            ["-i", "lo", "-w", "x", "--keep-around", "error", "soon"],
            "expected a time such as 500ms, 30s or 2min, got 'soon'",
        ),
        (["-i", "lo", "-w", "x.pcapng", "--keep-around", "error", "1s"], "name a folder for -w"),
        (["-i", "lo", "-w", "-"], "name a file or a folder"),
        (["-i", "lo", "--buffer", "2000"], "1<=x<=1024"),
        (["a.pcapng", "--buffer", "64"], "need an interface (-i)"),
        (["-i", "lo", "-w", "x", "--keep-around", "nonsense", "1s"], "'nonsense' is neither a severity nor a finding"),
        (["file", "--export-every", "1s"], "--export-every needs --export, the folder"),
        (["-i", "lo", "--baseline", "plant.toml"], "needs --alerts"),
        (["file", "--allow-remote"], "--allow-remote needs --metrics HOST:PORT"),
        (["file", "--only", "scd"], "--only scd needs --scd DICT and --bind BINDINGS"),
        (["file", "--plain", "--watch", "DB1.DBW0"], "--watch is for the screens"),
        (["file", "-T", "jsonl", "--watch", "DB1.DBW0"], "--watch is for the screens"),
    ],
)
def test_wrong_use_is_told(capfdbinary: pytest.CaptureFixture[bytes], arguments: list[str], said: str) -> None:
    ran = run(capfdbinary, "monitor", *arguments)
    assert ran.code == 2
    assert said in ran.err
    assert "Traceback" not in ran.err


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["nowhere.pcap"], "no such file"),
        (["-i", "nosuch0"], "there is no interface 'nosuch0'"),
        (["-i", "no\x1b[2Jsuch"], "there is no interface"),
    ],
)
def test_what_cannot_be_opened_is_told(
    capfdbinary: pytest.CaptureFixture[bytes], arguments: list[str], said: str
) -> None:
    ran = run(capfdbinary, "monitor", *arguments)
    assert (ran.code, ran.out) == (2, "")
    assert said in ran.err
    assert "\x1b" not in ran.err
    assert "Traceback" not in ran.err


# ---- while it happens -----------------------------------------------------------------------------------------------


def test_a_pipe_is_told_as_it_is_written_and_silence_is_noticed(tmp_path: Path) -> None:
    """As `tcpdump -U -w -` over ssh; the request in the last packet is told while the pipe stays open and empty."""
    talk = read(begun(), 1)
    octets = saved(tmp_path / "a", talk.send(0, dt(messages.read_job(2, [WORD]))).packets()).read_bytes()
    with started("monitor", "-", "--plain", "--overdue", "300") as process:
        assert process.stdin is not None
        for at in range(0, len(octets), 700):
            process.stdin.write(octets[at : at + 700])
            process.stdin.flush()
        told = list(lines(process.stdout, "transaction.overdue"))
        assert re.search(r"packet 10: Read Var DB10\.DBW4: sent \d{3} ms ago in packet 10, still unanswered$", told[-1])
        process.stdin.close()
        rest = list(lines(process.stdout, "connection 1 "))
        assert process.wait(20) == 0
    assert "with 1 request pending: Read Var DB10.DBW4 (packet 10)" in rest[-1]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_it_with_all_that_is_known(tmp_path: Path, number: signal.Signals) -> None:
    octets = saved(tmp_path / "a", read(begun(), 1).packets()).read_bytes()
    with started("monitor", "-", "--plain") as process:
        assert process.stdin is not None
        assert process.stderr is not None
        process.stdin.write(octets)
        process.stdin.flush()
        list(lines(process.stdout, "Read Var"))
        process.send_signal(number)
        list(lines(process.stdout, "still open at the end of the capture"))
        assert process.wait(20) == 130
        assert process.stderr.read().decode().startswith("s7dissect: 9 packets, 1 connection, 2 transactions,")


def test_nobody_reads_any_more(tmp_path: Path) -> None:
    octets = saved(tmp_path / "a", read(begun(), 1).packets()).read_bytes()
    with started("monitor", "-", "--plain") as process:
        assert process.stdin is not None
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdin.write(octets[:600])
        process.stdin.flush()
        process.stdout.close()
        process.stdin.write(octets[600:])
        process.stdin.flush()
        assert process.wait(20) == 0
        assert process.stderr.read() == b""


def test_what_is_no_capture_is_told_in_a_line() -> None:
    with started("monitor", "-", "--plain") as process:
        out, err = process.communicate(b"hello, this is no capture at all", 20)
        assert process.returncode == 2
    assert out == b""
    assert err.startswith(b"s7dissect: standard input: not a capture file")


@pytest.mark.parametrize("engine", ENGINES)
def test_an_interface_is_watched(engine: str) -> None:
    """Real traffic; what is told must come while the connection is still there."""
    with plc() as server:
        expression = f"tcp port {server.port}"
        with started("monitor", "-i", "lo", "-f", expression, "--engine", engine, "-T", "jsonl") as process:
            assert process.stderr is not None
            wait_for_capture(server.port, process)
            with client(server.port) as panel:
                panel.db_read(1, 0, 4)
                told = [json.loads(line) for line in lines(process.stdout, '"name":"Read Var"')]
            assert {line["schema"] for line in told} >= {"s7dissect.event/1", "s7dissect.transaction/1"}
            process.send_signal(signal.SIGTERM)
            summary = json.loads(list(lines(process.stdout, '"summary"'))[-1])["summary"]
            assert process.wait(20) == 130
            assert "packets lost while capturing: 0 by the kernel, 0 by the interface" in process.stderr.read().decode()
        assert summary["dropped"] == {"kernel": 0, "interface": 0}
        assert summary["packets"] > 10


def wait_for_capture(port: int, process: Forked) -> None:
    """Connect until the monitor sees it: the interface is open then."""
    assert process.stdout is not None
    os.set_blocking(process.stdout.fileno(), False)
    end = time.monotonic() + 60
    try:
        while time.monotonic() < end:
            with client(port):
                pass
            time.sleep(0.3)
            if process.stdout.read():
                return
    finally:
        os.set_blocking(process.stdout.fileno(), True)
    raise AssertionError("the monitor sees nothing")


# ---- beside ---------------------------------------------------------------------------------------------------------


def test_packets_are_kept(capfdbinary: pytest.CaptureFixture[bytes], tmp_path: Path) -> None:
    path = simple(tmp_path / "a.pcapng", 40)
    kept = tmp_path / "kept"
    ran = run(capfdbinary, "monitor", path, "-w", kept, "-b", "filesize:4", "-b", "files:100")
    assert ran.code == 0
    files = sorted(kept.iterdir())
    assert len(files) > 2
    assert all(file.suffix == ".pcapng" for file in files)
    frames = [frame for file in files for frame in drain(open_capture(str(file))).frames]
    assert frames == drain(open_capture(str(path))).frames


def test_a_name_with_an_extension_is_a_file(capfdbinary: pytest.CaptureFixture[bytes], tmp_path: Path) -> None:
    path = simple(tmp_path / "a.pcapng", 40)
    kept = tmp_path / "kept.pcapng"
    assert run(capfdbinary, "monitor", path, "-w", kept).code == 0
    assert drain(open_capture(str(kept))).frames == drain(open_capture(str(path))).frames
    octets = kept.read_bytes()
    ran = run(capfdbinary, "monitor", path, "-w", kept)
    assert (ran.code, ran.out, kept.read_bytes()) == (2, "", octets)
    assert "kept.pcapng: File exists; choose another name" in ran.err


def test_a_ring_in_the_place_of_a_file(capfdbinary: pytest.CaptureFixture[bytes], tmp_path: Path) -> None:
    path = simple(tmp_path / "a.pcapng", 40)
    ran = run(capfdbinary, "monitor", path, "-w", tmp_path / "line.pcapng", "-b", "filesize:4", "-b", "files:3")
    assert ran.code == 0
    names = [file.name for file in tmp_path.iterdir() if file != path]
    assert len(names) == 3
    assert all(name.startswith("line_0") and name.endswith(".pcapng") for name in names)


def test_a_folder_with_a_dot_is_a_folder(capfdbinary: pytest.CaptureFixture[bytes], tmp_path: Path) -> None:
    folder = tmp_path / "site.north"
    folder.mkdir()
    assert run(capfdbinary, "monitor", simple(tmp_path / "a.pcapng"), "-w", folder).code == 0
    assert [file.suffix for file in folder.iterdir()] == [".pcapng"]


def test_a_file_that_fails_later_is_told(tmp_path: Path) -> None:
    path = simple(tmp_path / "a.pcapng", 300)
    ran = subprocess.run(
        [sys.executable, "-m", "dissect", "monitor", path, "-w", tmp_path / "kept.pcapng"],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
        env=WITHOUT_CACHE,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000)),
    )
    assert ran.returncode == 5
    assert re.search(
        r"the capture file: 607 packets \([0-9]+ bytes\) not written in .*kept.pcapng: File too large", ran.stderr
    )
    assert ran.stdout.count("Read Var") >= 300


def test_packets_around_a_finding_are_kept(capfdbinary: pytest.CaptureFixture[bytes], tmp_path: Path) -> None:
    kept = tmp_path / "kept"
    ran = run(capfdbinary, "monitor", simple(tmp_path / "a.pcapng", 40), "-w", kept, "--keep-around", "warning", "5ms")
    assert ran.code == 0
    (file,) = kept.iterdir()
    assert file.name.startswith("transaction.item_error_")
    recorder = drain(open_capture(str(file)))
    assert 8 <= len(recorder.frames) <= 12
    assert any("transaction.item_error" in text for _, text in recorder.comments)


def test_files_of_evidence_that_had_to_go_are_counted(
    capfdbinary: pytest.CaptureFixture[bytes], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(event_capture, "MAX_FILES", 3)
    path = saved(tmp_path / "a.pcapng", stops(["10.0.0.2"] * 5 + ["10.0.0.3"] + ["10.0.0.2"] * 4))
    kept = tmp_path / "kept"
    ran = run(capfdbinary, "monitor", path, "-w", kept, "--keep-around", "security.plc_stop", "0s")
    assert ran.code == 0
    assert "keeping packets around findings: 7 of 10 files removed, the oldest of the hosts with most" in ran.err
    assert len(list(kept.iterdir())) == 3


def test_a_place_that_cannot_be_written_to_is_told_first(
    capfdbinary: pytest.CaptureFixture[bytes], tmp_path: Path
) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("")
    ran = run(capfdbinary, "monitor", simple(tmp_path / "a.pcapng"), "-w", blocked)
    assert (ran.code, ran.out) == (2, "")
    assert str(blocked) in ran.err


def test_evidence_that_fails_later_is_told_and_the_rest_goes_on(tmp_path: Path) -> None:
    """The disk is full, here after 20,000 octets."""
    path = simple(tmp_path / "a.pcapng", 300)
    ran = subprocess.run(
        [sys.executable, "-m", "dissect", "monitor", path, "-w", tmp_path / "kept"],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
        env=WITHOUT_CACHE,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000)),
    )
    assert ran.returncode == 5
    assert "PROBLEM  the ring of files cannot be written: " in ran.stdout
    assert ran.stdout.count("Read Var") >= 300
    assert re.search(r"s7dissect: the ring of files: 607 packets \([0-9]+ bytes\) not written in ", ran.stderr)
    assert "Traceback" not in ran.stderr


RULES = """
[[rule]]
name = "refused"
when = "finding"
finding = "transaction.item_error"
"""


def test_rules_that_need_a_baseline_name_the_option(capfdbinary: pytest.CaptureFixture[bytes], tmp_path: Path) -> None:
    rules = tmp_path / "rules.toml"
    rules.write_text('[[rule]]\nname = "n"\nwhen = "new"\n', encoding="utf-8")
    ran = run(capfdbinary, "monitor", simple(tmp_path / "a.pcapng"), "--alerts", rules)
    assert ran.code == 2
    assert ran.err.endswith("\"new\" of 'n' needs a baseline: give one with --baseline.\n")


def test_alerts_are_raised(capfdbinary: pytest.CaptureFixture[bytes], tmp_path: Path) -> None:
    rules = tmp_path / "rules.toml"
    rules.write_text(RULES)
    ran = run(capfdbinary, "monitor", simple(tmp_path / "a.pcapng"), "--alerts", rules)
    assert ran.code == 0
    assert "ALERT warning  refused: An item of a read, write or subscription was refused." in ran.err


def test_rules_that_are_wrong_are_told(capfdbinary: pytest.CaptureFixture[bytes], tmp_path: Path) -> None:
    rules = tmp_path / "rules.toml"
    rules.write_text('[[rule]]\nname = "x"\nwhen = "never"\n')
    ran = run(capfdbinary, "monitor", simple(tmp_path / "a.pcapng"), "--alerts", rules)
    assert ran.code == 2
    assert "rules.toml" in ran.err
