"""Shared by the tests of live lines: a simulated line, a controlled clock, a real PLC on loopback."""

from __future__ import annotations

import contextlib
import logging
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Final

import snap7
from snap7.server import Server
from snap7.type import SrvArea

from dissect.online.live.events import Event
from dissect.online.live.session import Session
from dissect.packets.source.live.reader import Drops, LiveReader
from dissect.packets.source.packet import PacketSink
from tests.properties.packets import Packet

SECOND: Final = 1_000_000_000

logging.getLogger("snap7").setLevel(logging.CRITICAL)


class Clock:
    """A monotonic clock that a test sets."""

    def __init__(self) -> None:
        self.now = 5 * SECOND

    def __call__(self) -> int:
        return self.now


class Line(LiveReader):
    """A live source that gives the packets that a test puts on it; each step takes ``step_ns`` of the clock, which is 50 ms."""

    def __init__(self, clock: Clock, batches: Sequence[Sequence[Packet]] = (), ends: bool = False) -> None:
        super().__init__("fake0", "fake", 50)
        self.clock = clock
        self.batches = [list(batch) for batch in batches]
        self.ends = ends
        self.lost = Drops(0, 0)
        self.stopped = 0
        self.closed = 0

    @property
    def drops(self) -> Drops:
        return self.lost

    def step(self, sink: PacketSink) -> bool:
        self.clock.now += 50_000_000
        if not self.batches:
            return not self.ends and not self.stopped
        for packet in self.batches.pop(0):
            self.packets += 1
            self.octets += len(packet.octets)
            octets = packet.octets
            sink.frame(packet.time_ns, octets, 0, len(octets), packet.wire_length, packet.link_type)
        return True

    def stop(self) -> None:
        self.stopped += 1

    def close(self) -> None:
        self.closed += 1


def taken(session: Session, until: Callable[[list[Event]], bool], seconds: float = 60) -> list[Event]:
    """Poll until the taken events suit, or the session is over; fail if neither comes in time."""
    events: list[Event] = []
    end = time.monotonic() + seconds
    while not until(events):
        running = session.running
        fresh = session.poll(0.1)
        events += fresh
        if not fresh and not running:
            break
        assert time.monotonic() < end, [event.kind for event in events]
    return events


def never(events: list[Event]) -> bool:
    """For `taken`: take everything, to the end."""
    return False


# ---- a PLC on loopback ----------------------------------------------------------------------------------------------


class Plc:
    """A python-snap7 server with data block 1 of 64 octets."""

    def __init__(self) -> None:
        self.server = Server(log=False)
        self.server.register_area(SrvArea.DB, 1, bytearray(range(64)))
        self.server.start(0)
        listening = self.server.server_socket
        assert listening is not None
        self.port = int(listening.getsockname()[1])

    def stop(self) -> None:
        self.server.stop()


@contextlib.contextmanager
def plc() -> Iterator[Plc]:
    made = Plc()
    try:
        yield made
    finally:
        made.stop()
        made.server.destroy()


_PROGRAM: Final = """
import time
from snap7.server import Server
from snap7.type import SrvArea
server = Server(log=False)
server.register_area(SrvArea.DB, 1, bytearray(64))
server.start(0)
print(server.server_socket.getsockname()[1], flush=True)
time.sleep(60)
"""


@contextlib.contextmanager
def program() -> Iterator[tuple[int, subprocess.Popen[str]]]:
    """A PLC in a separate process, which a test may kill: (its port, the process)."""
    arguments = [sys.executable, "-c", _PROGRAM]
    with subprocess.Popen(arguments, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as process:
        assert process.stdout is not None
        try:
            yield int(process.stdout.readline()), process
        finally:
            process.kill()


@contextlib.contextmanager
def client(port: int) -> Iterator[snap7.client.Client]:
    made = snap7.client.Client()
    made.connect("127.0.0.1", 0, 2, port)
    try:
        yield made
    finally:
        made.disconnect()
