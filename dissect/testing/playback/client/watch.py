"""All sockets of a replay: while one waits, data on all of them are read, and so recorded at their time of arrival."""

from __future__ import annotations

import selectors
import socket
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Final

#: Longest time until a halt is noticed, in seconds.
_NOTICE_S: Final = 0.2


class Watch:
    """Watches sockets. Each is added with a function that is called when data have arrived.

    Once ``halted``, nothing waits any longer.
    """

    def __init__(self) -> None:
        self.halted = False
        self._selector = selectors.DefaultSelector()

    def add(self, one: socket.socket, arrived: Callable[[], None]) -> None:
        """Watch a socket from now on."""
        self._selector.register(one, selectors.EVENT_READ, arrived)

    def remove(self, one: socket.socket) -> None:
        """Stop watching a socket; it need not be watched."""
        with suppress(KeyError, ValueError):  # it was paused, or is closed
            self._selector.unregister(one)

    def halt(self) -> None:
        """Stop waiting, now and later. May be called from a signal handler."""
        self.halted = True

    def read(self, until: float) -> bool:
        """Read what has arrived, or the first data before ``until`` (monotonic, seconds); return False if there were none."""
        while True:
            left = until - time.monotonic() if not self.halted else 0.0
            ready = self._selector.select(min(max(left, 0), _NOTICE_S))
            if ready or left <= _NOTICE_S:
                break
        for key, _ in ready:
            key.data()
        return bool(ready)

    def sleep(self, until: float, stops: Callable[[], bool]) -> None:
        """Read arriving data up to ``until``, or until ``stops``."""
        while time.monotonic() < until and not self.halted and not stops():
            self.read(until)

    def close(self) -> None:
        """Stop watching. The sockets stay open."""
        self._selector.close()
