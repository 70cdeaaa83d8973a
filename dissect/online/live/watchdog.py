"""The heartbeat of a service: notifies systemd that packets are still read and judged (sd_notify(3), ``WatchdogSec=``).

The thread that captures beats, with the time of the last packet as the status. One that hangs does not beat, and systemd starts
the service again.
"""

from __future__ import annotations

import os
import socket
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Final

from dissect.engine.pipeline import Pipeline
from dissect.online.live.run import Companion
from dissect.packets.source.live.reader import Drops
from dissect.wire.text import Clock

#: A beat comes this many times within the time after which systemd acts.
_OFTEN: Final = 3
#: Interval of status messages without a watchdog, in seconds.
_STATUS_S: Final = 10.0


def of_environment(clock: Callable[[], float] = time.monotonic) -> Watchdog | None:
    """Return the heartbeat that systemd requests, None if this is not a service with notifications."""
    address = os.environ.get("NOTIFY_SOCKET", "")
    if not address.startswith(("/", "@")):
        return None
    given = os.environ.get("WATCHDOG_USEC", "")
    mine = os.environ.get("WATCHDOG_PID", str(os.getpid())) == str(os.getpid())
    beats = given.isdecimal() and len(given) < 16 and int(given) > 0 and mine
    return Watchdog(address, int(given) / 1e6 / _OFTEN if beats else 0.0, clock)


class Watchdog(Companion):
    """Beats every ``every_s`` seconds, 0 for never, and sends the status to the socket at ``address``."""

    name = "the watchdog"

    def __init__(self, address: str, every_s: float, clock: Callable[[], float] = time.monotonic) -> None:
        super().__init__()
        self._address = "\0" + address[1:] if address.startswith("@") else address
        self._beats = every_s > 0
        self._every_s = every_s or _STATUS_S
        self._clock = clock
        self._due = 0.0
        self._times = Clock()
        self._pipeline: Pipeline | None = None

    def begin(self, pipeline: Pipeline) -> None:
        """Report that the service is ready."""
        self._pipeline = pipeline
        self._send(["READY=1"])

    def tick(self, now_ns: int, drops: Drops) -> None:
        """Beat, and report when the last packet came."""
        now = self._clock()
        if now < self._due or self._pipeline is None:
            return
        self._due = now + self._every_s
        frames = int(self._pipeline.frames)
        last = self._times.iso(int(self._pipeline.now_ns))[:19] + "Z" if frames else "none yet"
        self._send([*(["WATCHDOG=1"] if self._beats else []), f"STATUS={frames} packets, the last at {last}"])

    def close(self) -> None:
        """Report that the service ends."""
        self._send(["STOPPING=1"])

    def _send(self, lines: list[str]) -> None:
        """Send a message; a failure is ignored: the next message repeats it."""
        if sys.platform == "win32":  # which has no systemd
            return
        with suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as channel:
            channel.setblocking(False)
            channel.sendto("\n".join(lines).encode("ascii"), self._address)
