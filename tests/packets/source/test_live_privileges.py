"""Rights given up once the interface is open: seen from outside, in /proc, while packets are parsed."""

from __future__ import annotations

import contextlib
import os
import pwd
import re
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from dissect.packets.source.files import open_capture
from dissect.packets.source.live import privileges
from dissect.packets.source.live.privileges import User, check_writable, give, heir, missing
from dissect.packets.source.live.reader import LiveError
from tests.conftest import ROOT
from tests.packets.source.live_support import Sink, in_namespace, needs_dumpcap, needs_ring, sender

needs_root = pytest.mark.skipif(not privileges.is_root(), reason="only root has rights to give up")

#: Every kind of request there is in the captures, so that whatever is imported late would be.
PLAYED = ("read-areas", "szl", "transfer", "password", "plc-control", "blocks", "clock", "bsend", "item-errors")


@contextlib.contextmanager
def monitor(*arguments: str | Path, **environment: str) -> Iterator[subprocess.Popen[str]]:
    kept = {name: value for name, value in os.environ.items() if not name.startswith("SUDO_")}
    with subprocess.Popen(
        [sys.executable, "-X", "importtime", "-m", "dissect", "monitor", "-i", "vb", "--duration", "30", *arguments],
        env={**kept, **environment},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        try:
            yield process
        finally:
            process.kill()


def told(process: subprocess.Popen[str], pattern: str) -> str:
    """Read stderr up to a line with ``pattern``."""
    assert process.stderr is not None
    for line in process.stderr:
        if re.search(pattern, line):
            return line
    raise AssertionError(f"{pattern!r} never came, exit code {process.wait(10)}")


def play() -> None:
    with sender("va") as out:
        for name in PLAYED:
            sink = Sink()
            reader = open_capture(str(ROOT / "captures" / f"{name}.pcapng"))
            while reader.step(sink):
                pass
            for number, packet in enumerate(sink.got):
                out.send(packet.octets)
                if number % 64 == 0:
                    time.sleep(0.001)


def until(true: Callable[[], bool]) -> None:
    end = time.monotonic() + 60
    while not true():
        assert time.monotonic() < end
        time.sleep(0.02)


def statuses(process: subprocess.Popen[str]) -> list[dict[str, list[str]]]:
    found = []
    for path in Path(f"/proc/{process.pid}/task").glob("*/status"):
        fields = [line.split(":", 1) for line in path.read_text().splitlines()]
        found.append({name: value.split() for name, value in fields})
    return found


@needs_ring
@needs_root
@pytest.mark.parametrize("metrics", [(), ("--metrics", "127.0.0.1:0")], ids=["", "metrics"])
def test_every_thread_is_nobody_before_the_first_packet(tmp_path: Path, metrics: tuple[str, ...]) -> None:
    if metrics:
        pytest.importorskip("prometheus_client")
    tmp_path.chmod(0o755)

    def task() -> None:
        with monitor("--plain", *metrics) as process:
            line = told(process, "interface opened")
            assert "now running as nobody (" in line
            nobody = pwd.getpwnam("nobody")
            play()
            assert process.stdout is not None
            assert process.stdout.readline()  # it reads, parses and tells
            found = statuses(process)
            assert len(found) == 2 + bool(metrics)
            for status in found:
                assert status["Uid"] == [str(nobody.pw_uid)] * 4
                assert status["Gid"] == [str(nobody.pw_gid)] * 4
                assert "0" not in status["Groups"]
                assert {int(status[name][0], 16) for name in ("CapEff", "CapPrm", "CapInh", "CapAmb")} == {0}
                assert status["NoNewPrivs"] == ["1"]
            process.terminate()
            out, err = process.communicate(timeout=60)
            assert process.returncode == 130
            assert "Traceback" not in err
            assert all(word in out for word in ("Read Var", "Request download", "password", "SZL"))
            imported = re.findall(r"import time:.*\| +(\S+)", err)
            assert imported == []  # a Python below /root could not be imported from any more

    in_namespace(task)


@contextlib.contextmanager
def open_folder(tmp_path: Path) -> Iterator[Path]:
    """Let others pass through the folders of the tests, which are only for whoever runs them."""
    changed = []
    for path in (tmp_path, *tmp_path.parents):
        mode = path.stat().st_mode & 0o777
        if not mode & 0o001:
            path.chmod(mode | 0o011)
            changed.append((path, mode))
    yield tmp_path
    for path, mode in changed:
        path.chmod(mode)


@needs_ring
@needs_root
def test_files_belong_to_who_called_sudo(tmp_path: Path) -> None:
    """A ring of files, and those around a finding, in a folder that is made for them."""

    def task() -> None:
        kept = folder / "new" / "evidence"
        arguments = ("--plain", "-w", kept, "-b", "filesize:20", "--keep-around", "security.*", "100ms")
        with monitor(*arguments, SUDO_UID="12345", SUDO_GID="23456") as process:
            assert "now running as user 12345 " in told(process, "interface opened")
            play()
            until(lambda: bool(list(kept.glob("security.*.pcapng*"))) and len(list(kept.glob("s7dissect_*"))) > 1)
            process.terminate()
            _, err = process.communicate(timeout=60)
            assert process.returncode == 130
            assert "failed" not in err
        made = [kept.parent, kept, *kept.iterdir()]
        assert {(path.stat().st_uid, path.stat().st_gid) for path in made} == {(12345, 23456)}
        assert list(kept.glob("*.part")) == []
        for path in kept.iterdir():
            sink = Sink()
            reader = open_capture(str(path))
            while reader.step(sink):
                pass
            assert (len(sink.got) > 0, reader.damage) == (True, "")

    with open_folder(tmp_path) as folder:
        in_namespace(task)


@needs_ring
@needs_root
def test_a_folder_of_root_is_refused_before_anything_is_read(tmp_path: Path) -> None:
    def task() -> None:
        with monitor("--plain", "-w", tmp_path) as process:
            out, err = process.communicate(timeout=60)
        assert process.returncode == 2
        assert out == ""
        assert f"{tmp_path}: nobody (" in err
        assert "chown nobody DIR" in err
        assert list(tmp_path.iterdir()) == []

    in_namespace(task)


@needs_ring
@needs_root
def test_root_stays_root_only_where_that_is_said(tmp_path: Path) -> None:
    def task() -> None:
        with monitor("--plain", "-w", tmp_path, "--engine", "ring", "-Z", "root", "-c", "1") as process:
            until(
                lambda: "s7dissect-live" in [status["Name"][0] for status in statuses(process)] or socket_open(process)
            )
            play_until_it_ends(process)
            assert process.wait(60) == 0
        assert [path.stat().st_uid for path in tmp_path.iterdir()] == [0]

    in_namespace(task)


def socket_open(process: subprocess.Popen[str]) -> bool:
    return len(statuses(process)) > 1


def play_until_it_ends(process: subprocess.Popen[str]) -> None:
    with sender("va") as out:
        end = time.monotonic() + 60
        while process.poll() is None and time.monotonic() < end:
            out.send(bytes(60))
            time.sleep(0.02)


@needs_dumpcap
@needs_root
def test_dumpcap_as_root_is_told(tmp_path: Path) -> None:
    def task() -> None:
        with monitor("--plain", "--engine", "dumpcap", "-c", "1") as process:
            assert "--engine ring drops all privileges" in told(process, "run as root")
            play_until_it_ends(process)
            assert process.wait(60) == 0

    in_namespace(task)


@needs_dumpcap
@needs_root
def test_what_the_ring_cannot_capture_is_dumpcaps_and_never_as_a_user_who_was_named() -> None:
    command = [sys.executable, "-m", "dissect", "monitor", "-i", "any", "-f", "port 1", "--plain", "--duration", "0.1"]
    only = "any: only dumpcap can capture on it"

    def task() -> None:
        ran = subprocess.run(command, capture_output=True, text=True, check=False)
        assert ran.returncode == 0
        assert f"run as root; the ring, which drops all privileges, cannot be used: {only}\n" in ran.stderr
        ran = subprocess.run([*command, "-Z", "nobody"], capture_output=True, text=True, check=False)
        assert ran.returncode == 2
        assert ran.stderr == f"s7dissect: {only}\n    -Z nobody needs the ring; -Z root keeps all privileges\n"

    in_namespace(task)


#: A user other than root with CAP_NET_RAW, as a unit with AmbientCapabilities runs it.
_CAPABLE = """
import ctypes, os
from dissect.packets.source.live import privileges
from dissect.packets.source.live.opening import open_live
library = ctypes.CDLL(None)
library.prctl(8, 1, 0, 0, 0)
os.setgroups([])
os.setresgid(65534, 65534, 65534)
os.setresuid(65534, 65534, 65534)
library.capset((ctypes.c_uint32 * 2)(0x20080522, 0), (ctypes.c_uint32 * 6)(1 << 13, 1 << 13))
reader = open_live("vb", "", "ring")
print(privileges.rights_left())
privileges.relinquish(None)
print(privileges.rights_left() or "none", os.getresuid())
reader.stop()
reader.close()
"""


@needs_ring
@needs_root
def test_capabilities_of_another_user_go_too() -> None:
    def task() -> None:
        ran = subprocess.run([sys.executable, "-c", _CAPABLE], capture_output=True, text=True, check=True)
        assert ran.stdout.splitlines() == ["capabilities, in a thread", "none (65534, 65534, 65534)"]

    in_namespace(task)


# ---- who, and where -------------------------------------------------------------------------------------------------


def test_who_root_becomes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("SUDO_UID", raising=False)
    monkeypatch.delenv("SUDO_GID", raising=False)
    nobody = heir()
    assert nobody.uid != 0
    monkeypatch.setenv("SUDO_UID", "0")  # root called sudo
    assert heir() == nobody
    for wrong in ("", "-5", "1; 0", "٣"):
        monkeypatch.setenv("SUDO_UID", wrong)
        assert heir() == nobody
    monkeypatch.setenv("SUDO_UID", "987654")
    assert heir() == User("", 987654, 987654)
    monkeypatch.setenv("SUDO_GID", "42")
    assert heir() == User("", 987654, 42)
    monkeypatch.setenv("SUDO_UID", str(nobody.uid))
    assert heir() == User(nobody.name, nobody.uid, 42)
    assert heir(nobody.name)._replace(gid=nobody.gid) == nobody
    assert heir(str(nobody.uid)).uid == nobody.uid
    for unknown in ("no such user", "987654321", "9999999999"):
        with pytest.raises(LiveError, match="there is no user"):
            heir(unknown)


def test_folders_that_are_made(tmp_path: Path) -> None:
    assert missing(str(tmp_path)) == []
    assert missing(str(tmp_path / "a" / "b")) == [tmp_path / "a", tmp_path / "a" / "b"]
    (tmp_path / "a").symlink_to(tmp_path / "nowhere")
    assert missing(str(tmp_path / "a" / "b")) == [tmp_path / "a" / "b"]
    with pytest.raises(OSError, match="a"):
        give([tmp_path / "a"], User("", 1, 1))  # a link is never followed


def test_where_nobody_may_write(tmp_path: Path) -> None:
    check_writable(str(tmp_path), None)
    with pytest.raises(LiveError, match="this user may not write there"):
        check_writable(str(tmp_path / "gone"), None)
    with pytest.raises(LiveError, match=r"alice \(1000\), who this program becomes") as refused:
        check_writable(str(tmp_path / "gone"), User("alice", 1000, 1000))
    assert "chown alice DIR" in refused.value.advice[0]
