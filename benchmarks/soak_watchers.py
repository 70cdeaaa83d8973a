"""The watchers of the line in the soak: our own monitor by either engine, Scapy's AsyncSniffer, pyshark's LiveCapture.

Each is a process that captures until it gets SIGINT, and whose last line of output then states what it saw.
"""

from __future__ import annotations

import importlib.util
import json
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, Final

from benchmarks.engines import MissingError, mode_of

if TYPE_CHECKING:
    from collections.abc import Sequence

FILTER: Final = "tcp port 102"
MONITORS: Final = ("ring", "dumpcap")
OTHERS: Final = ("scapy", "pyshark")
NAMES: Final = MONITORS + OTHERS

#: Counts packets, and those that begin a TPKT. The number of packets that the kernel dropped is read before the socket is
#: closed.
_SCAPY: Final = """
import json, signal, struct, sys, threading
from scapy.all import TCP, AsyncSniffer, conf
counts = [0, 0]
def count(packet):
    counts[0] += 1
    if TCP in packet and bytes(packet[TCP].payload)[:2] == b"\\x03\\x00":
        counts[1] += 1
ended = threading.Event()
signal.signal(signal.SIGINT, lambda *_: ended.set())
line = conf.L2listen(iface=sys.argv[1], filter=sys.argv[2])
sniffer = AsyncSniffer(opened_socket=line, store=False, prn=count)
sniffer.start()
ended.wait()
_, dropped = struct.unpack("=II", line.ins.getsockopt(263, 6, 8))
print(json.dumps({"packets": counts[0], "s7": counts[1], "kernel": dropped}), flush=True)
"""
#: pyshark does not report drops, and leaves its tshark behind when interrupted: the caller ends the process group.
_PYSHARK: Final = """
import json, os, signal, sys
import pyshark
counts = [0, 0]
def end(*_):
    os.write(1, (json.dumps({"packets": counts[0], "s7": counts[1], "kernel": None}) + "\\n").encode())
    os._exit(0)
signal.signal(signal.SIGINT, end)
capture = pyshark.LiveCapture(interface=sys.argv[1], bpf_filter=sys.argv[2])
for packet in capture.sniff_continuously():
    counts[0] += 1
    counts[1] += "S7COMM" in packet
"""


class Watcher:
    """One way to watch ``interface``. ``begin_rate`` is where a search begins, ``settle_s`` how long it takes to begin.

    ``own`` means that it is our monitor, whose output has a summary.
    """

    __slots__ = ("begin_rate", "command", "environment", "label", "name", "own", "settle_s")

    def __init__(
        self, name: str, label: str, command: list[str], begin_rate: int, settle_s: float, *, own: bool = False
    ) -> None:
        self.name = name
        self.label = label
        self.command = command
        self.begin_rate = begin_rate
        self.settle_s = settle_s
        self.own = own
        self.environment: dict[str, str] | None = None


def monitor_call(python: str, path: str, directory: Path) -> tuple[list[str], dict[str, str], str]:
    """Return call and environment of the monitor of ``python``, with the package in ``path`` if given, and its build."""
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    script = Path(python).parent / "s7dissect"
    call = [str(script)] if script.exists() and not path else [python, "-P", "-m", "dissect"]
    if path:
        environment["PYTHONPATH"] = str(Path(path).absolute())
    return call, environment, mode_of(call, environment, directory)


def monitor(
    call: Sequence[str],
    environment: dict[str, str],
    build: str,
    engine: str,
    interface: str,
    only: str,
    beside: Sequence[str] = (),
) -> Watcher:
    """Return our monitor by ``engine`` as a watcher that writes lines of ``only``; ``beside`` are further options."""
    if engine == "dumpcap" and shutil.which("dumpcap") is None:
        raise MissingError("no dumpcap (of Wireshark) here")
    words = ["monitor", "-i", interface, "-f", FILTER, "--engine", engine, "-T", "jsonl", "--only", only, *beside]
    watcher = Watcher(engine, f"s7dissect monitor, {engine}, {build}", [*call, *words], 60_000, 1.0, own=True)
    watcher.environment = environment
    return watcher


def everything(folder: Path) -> list[str]:
    """Return the options that let a monitor write and serve everything: evidence, tables, pages, alerts, metrics.

    It keeps its rights: the folder is that of the trial, which no other user may enter.
    """
    rules = folder / "everything.toml"
    rules.write_text(
        '[[rule]]\nname = "p"\nwhen = "problem"\n[[rule]]\nname = "f"\nwhen = "finding"\nfinding = "warning"\n'
    )
    out = folder / "everything"
    bounds = ["-Z", "root", "-w", str(out), "-b", "filesize:100000", "-b", "files:4", "--manifest"]
    tables = ["--export", f"parquet:{out}/tables", "--report", f"{out}/pages"]
    return [*bounds, *tables, "--alerts", str(rules), "--metrics", "127.0.0.1:0"]


def other(name: str, interface: str) -> Watcher:
    """Return Scapy or pyshark as a watcher; MissingError if it is not installed."""
    if importlib.util.find_spec(name) is None:
        raise MissingError(f"{name} is not installed for {sys.executable}")
    if name == "scapy":
        return Watcher(name, "Scapy AsyncSniffer", [sys.executable, "-c", _SCAPY, interface, FILTER], 2000, 2.0)
    if shutil.which("tshark") is None:
        raise MissingError("pyshark needs tshark, which is not here")
    return Watcher(name, "pyshark LiveCapture", [sys.executable, "-c", _PYSHARK, interface, FILTER], 150, 4.0)


class Watch:
    """A watcher at work.

    ``seen`` are the lines that contain ``mark``, each with the time (wall clock, ns) at which it was written.
    """

    def __init__(self, watcher: Watcher, work: Path, mark: bytes = b"") -> None:
        self._watcher = watcher
        self._mark = mark
        self._rest = b""
        self.seen: list[tuple[int, bytes]] = []
        self.last = b""
        self.cpu_s = 0.0
        self._said = (work / "stderr").open("w+b")
        self._child = subprocess.Popen(
            watcher.command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=self._said,
            env=watcher.environment,
            cwd=work,
            process_group=0,
        )
        assert self._child.stdout is not None
        self._thread = threading.Thread(target=self._listen, args=(self._child.stdout,), daemon=True)
        self._thread.start()

    @property
    def pid(self) -> int:
        """The process id."""
        return self._child.pid

    def _listen(self, out: IO[bytes]) -> None:
        while piece := os.read(out.fileno(), 1 << 18):
            now = time.time_ns()
            gathered = self._rest + piece
            lines = gathered.split(b"\n")
            self._rest = lines.pop()
            if lines:
                self.last = lines[-1]
            if self._mark and self._mark in gathered:
                self.seen += [(now, line) for line in lines if self._mark in line]

    def end(self, limit_s: float) -> dict[str, Any]:
        """Interrupt it and return its last report; empty if it did not end in time or reported nothing."""
        self._child.send_signal(signal.SIGINT)
        end = time.monotonic() + limit_s
        done = False
        while not done and time.monotonic() < end:
            pid, status, usage = os.wait4(self._child.pid, os.WNOHANG)
            done = pid != 0
            if done:
                self._child.returncode = os.waitstatus_to_exitcode(status)
                self.cpu_s = usage.ru_utime + usage.ru_stime
            time.sleep(0.005)
        self._kill()
        self._thread.join(10)
        try:
            told: dict[str, Any] = json.loads(self.last) if done else {}
        except ValueError:
            told = {}
        return told

    def close(self) -> str:
        """Release it, end it if it runs, and return the last lines of its stderr. May be called twice."""
        if self._said.closed:
            return ""
        self._kill()
        self._thread.join(10)
        if self._child.stdout is not None:
            self._child.stdout.close()
        self._said.seek(0)
        said = self._said.read().decode("utf-8", "replace").strip()[-2000:]
        self._said.close()
        return said

    def _kill(self) -> None:
        """End the rest of the group: a tshark whose python is gone, or all of it."""
        try:
            os.killpg(self._child.pid, signal.SIGKILL)
        except ProcessLookupError:
            return
        if self._child.returncode is None:
            self._child.wait()


def cpu_s(pid: int) -> float:
    """Return the CPU seconds, user and system, of a process and its children so far."""
    ticks = 0
    for entry in Path("/proc").iterdir():
        if not entry.name.isdecimal():
            continue
        try:
            fields = (entry / "stat").read_text(encoding="utf-8", errors="replace").rpartition(")")[2].split()
        except OSError:
            continue
        if int(entry.name) == pid or int(fields[1]) == pid:
            ticks += int(fields[11]) + int(fields[12])
    return ticks / os.sysconf("SC_CLK_TCK")
