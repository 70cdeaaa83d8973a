"""`DumpcapReader`: reads pcapng from ``dumpcap``, a child process that may capture, so that this one needs no privileges.

dumpcap 4.0 (as tried) writes the section and the interface at once, then packets whenever the kernel hands over a buffer (every
250 ms at the latest), and only at its end one Interface Statistics Block with the packets lost. While it runs, the packets
dropped by the kernel are not known; those lost by the interface can be read at any time.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from contextlib import suppress
from typing import Any, Final

from dissect.packets.source import wireshark
from dissect.packets.source.live import advice
from dissect.packets.source.live.advice import shown
from dissect.packets.source.live.interfaces import ask, find_interface
from dissect.packets.source.live.pipe import PipeReader, PipeSource, read_pipe
from dissect.packets.source.live.reader import Drops, LiveError, UnavailableError
from dissect.packets.source.packet import PacketSink
from dissect.packets.source.pcapng import PcapngReader
from dissect.packets.source.statistics import read_lost
from dissect.wire.text import printable

PROGRAM: Final = "dumpcap"

#: How long dumpcap may take to open an interface, and to end on request, in seconds.
_START_S: Final = 10.0
_END_S: Final = 2.0
#: How many of the last octets of its stderr are kept.
_MAX_SAID: Final = 8192
#: The size of the pipe in octets, the most that an unprivileged process may set, so that dumpcap need not wait.
_PIPE_SIZE: Final = 1 << 20
# dumpcap gets a process group of its own, so that Ctrl-C does not reach it: this process ends it by the means that dumpcap
# expects.
_APART: dict[str, Any]
if sys.platform == "win32":
    _APART = {"creationflags": subprocess.CREATE_NEW_PROCESS_GROUP}
    _END = signal.CTRL_BREAK_EVENT
else:
    _APART = {"process_group": 0}
    _END = signal.SIGTERM
#: Beginnings of lines of stderr that are not errors.
_CHATTER: Final = ("Capturing on ", "File: ", "Packets captured: ", "Packets received/dropped ", "Packets: ")


def find_program() -> str:
    """Return the path of dumpcap; `UnavailableError` when there is none, or none that this user may run."""
    path = wireshark.find_program(PROGRAM)
    if path:
        return path
    unusable = advice.find_unusable(PROGRAM)
    if unusable:
        raise UnavailableError(f"{unusable}: no permission to run it", advice.dumpcap_permission(unusable))
    raise UnavailableError("dumpcap (of Wireshark) is not installed", advice.dumpcap_missing())


def trouble(interface: str) -> LiveError | None:
    """Return why dumpcap cannot capture on ``interface``, None if it can; to find out, dumpcap opens the interface."""
    try:
        program = find_program()
    except LiveError as error:
        return error
    answer = ask(program, "-L", "-i", interface)
    return _explain(program, interface, "", _said(answer.stderr)) if answer.returncode else None


def _widen(descriptor: int) -> None:
    """Make a pipe larger where the system can; the default size works as well."""
    with suppress(ImportError, AttributeError, OSError):
        import fcntl

        if sys.platform == "linux":
            fcntl.fcntl(descriptor, fcntl.F_SETPIPE_SZ, _PIPE_SIZE)


class DumpcapReader(PipeReader):
    """Reads packets of ``interface`` from dumpcap. `open_dumpcap` makes one."""

    def __init__(self, child: subprocess.Popen[bytes], interface: str, wait_ms: int) -> None:
        pipe = child.stdout
        errors = child.stderr
        assert pipe is not None
        assert errors is not None
        _widen(pipe.fileno())
        super().__init__(PipeSource(pipe.fileno(), owned=False), interface, PROGRAM, wait_ms)
        self._child = child
        self._errors = read_pipe(errors.fileno())
        self._said = b""
        self._asked_at: float | None = None
        described = find_interface(interface)
        self._lost_before = described.lost if described is not None else None
        self._lost_here = None if self._lost_before is None else 0
        self._lost: Drops | None = None

    @property
    def pid(self) -> int:
        """The process id of dumpcap."""
        return self._child.pid

    @property
    def drops(self) -> Drops:
        """The losses so far; those of the kernel are only known once dumpcap has ended."""
        if self._lost is not None:
            return self._lost
        described = find_interface(self._name)
        if described is not None and described.state == "down":  # dumpcap waits without a message
            self.went_down()
        elif described is not None:
            self.is_up()
        if described is not None and described.lost is not None and self._lost_before is not None:
            self._lost_here = max(described.lost - self._lost_before, 0)
        return Drops(None, self._lost_here)

    def begun(self, program: str, expression: str) -> None:
        """Wait until dumpcap has opened the interface; `LiveError` when it could not."""
        source = self._source
        source.deadline = time.monotonic() + _START_S
        gathered = source.gather_head()
        if gathered and source.starts_timed():
            return
        if gathered:
            with suppress(subprocess.TimeoutExpired):
                self._child.wait(_END_S)
        self._listen()
        raise _explain(program, self._name, expression, _said(self._said), timeout=not gathered)

    def step(self, sink: PacketSink) -> bool:
        """Deliver what arrives within ``wait_ms``, about 64 KiB at most; return False when dumpcap has ended."""
        more = super().step(sink)
        self._listen()
        if more and self._asked_at is not None and time.monotonic() > self._asked_at + _END_S:
            self.close()  # it was asked to end, and does not
            return False
        return more

    def stop(self) -> None:
        """Ask dumpcap to end: it writes what it has read, then its count of lost packets. May be called twice.

        Packets that the kernel still holds for it at that time (of the last 250 ms) are neither read nor counted.
        """
        if self._asked_at is None:
            self._asked_at = time.monotonic()
        if self._child.poll() is None:
            self._child.send_signal(_END)

    def close(self) -> None:
        """End dumpcap, by force if it does not end when asked, and release the pipe. May be called twice."""
        if self._child.stdout is None or self._child.stdout.closed:
            return
        drops = self.drops
        if self._child.poll() is None and not self._ended:
            self.stop()
        # Once the pipe is closed, a dumpcap that still writes packets ends by itself.
        super().close()
        self._child.stdout.close()
        try:
            self._child.wait(_END_S)
        except subprocess.TimeoutExpired:
            self._child.kill()
            self._child.wait()
        self._listen()
        self._errors.close()
        if self._child.stderr is not None:
            self._child.stderr.close()
        self._settle(drops)

    def _settle(self, drops: Drops) -> None:
        """Take dumpcap's final count of lost packets, and why it ended if that was not requested."""
        inner = self._inner
        kernel = None
        if isinstance(inner, PcapngReader) and inner.statistics:
            lost = read_lost(next(iter(inner.statistics.values())))
            # dumpcap 4.0 writes packets dropped by the kernel as drops of the interface.
            kernel = lost.kernel if lost.kernel is not None else lost.interface
        self._lost = Drops(kernel, drops.interface)
        if self._asked_at is None and not self.damage:
            why = "; ".join(_said(self._said)) or f"exit code {self._child.returncode}"
            self.damage = f"dumpcap ended: {why}"
        elif self._asked_at is not None:
            self.damage = ""

    def _listen(self) -> None:
        """Read dumpcap's stderr, and keep the end of it."""
        if self._child.stderr is None or self._child.stderr.closed:
            return
        while piece := self._errors.read(_MAX_SAID, 0):
            self._said = (self._said + piece)[-_MAX_SAID:]


def open_dumpcap(
    interface: str, expression: str, wait_ms: int, *, snaplen: int, buffer_mib: int, promiscuous: bool
) -> DumpcapReader:
    """Start dumpcap on ``interface``; `LiveError` with advice when dumpcap is missing, or may not or cannot capture."""
    program = find_program()
    arguments = [program, "-q", "-i", interface, "-s", str(snaplen), "-B", str(buffer_mib), "-w", "-"]
    if expression:
        arguments += ["-f", expression]
    if not promiscuous:
        arguments.append("-p")
    try:
        child = subprocess.Popen(
            arguments,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            env={**os.environ, "LC_ALL": "C"},
            bufsize=0,
            **_APART,
        )
    except OSError as error:
        raise LiveError(f"{program}: cannot be started: {error.strerror}") from None
    reader = DumpcapReader(child, interface, wait_ms)
    try:
        reader.begun(program, expression)
    except BaseException:
        reader.close()
        raise
    return reader


def _said(octets: bytes) -> list[str]:
    """Return the lines of stderr that are messages."""
    lines = octets.decode("utf-8", "backslashreplace").replace("\r", "\n").splitlines()
    return [
        printable(line.removeprefix("dumpcap: ")) for line in lines if line.strip() and not line.startswith(_CHATTER)
    ]


def _explain(program: str, interface: str, expression: str, said: list[str], *, timeout: bool = False) -> LiveError:
    """Return the error, with advice, for the messages of dumpcap."""
    text = " ".join(said)
    lower = text.lower()
    if "permission" in lower or "not permitted" in lower:
        why = f"{interface}: dumpcap has no permission to capture on it"
        return UnavailableError(why, advice.dumpcap_permission(program))
    if expression and "capture filter" in lower:
        why = text[text.find("(") + 1 : text.find(")")] if "(" in text and ")" in text else text
        return LiveError(f"the capture filter {shown(expression)} is not valid: {why}")
    if "not up" in lower or "network is down" in lower:
        return LiveError(f"{interface}: it is down", advice.interface_down(interface))
    if timeout:
        return LiveError(f"{interface}: dumpcap did not start within {_START_S:.0f} s{': ' if text else ''}{text}")
    return LiveError(f"{interface}: dumpcap: {text or 'ended without a message'}")
