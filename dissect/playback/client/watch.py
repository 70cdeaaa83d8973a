"""All sockets of a replay: while one is waited for, what comes on any of them is taken, and so recorded when it came."""

from __future__ import annotations

import selectors
import socket
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Final

#: How soon it is noticed that nothing is to be waited for any more, in seconds.
_NOTICE_S: Final = 0.2


class Watch:
    """Looks at sockets. Whoever adds one says what to do when something has come there.

    Once ``halted``, nothing is waited for any more.
    """

    def __init__(self) -> None:
        self.halted = False
        self._selector = selectors.DefaultSelector()

    def add(self, one: socket.socket, arrived: Callable[[], None]) -> None:
        """Look at a socket from now on."""
        self._selector.register(one, selectors.EVENT_READ, arrived)

    def remove(self, one: socket.socket) -> None:
        """Look at it no more; it may be one that nobody looks at."""
        with suppress(KeyError, ValueError):  # it was paused, or is closed
            self._selector.unregister(one)

    def halt(self) -> None:
        """Wait no more, now and later. May be called from a signal handler."""
        self.halted = True

    def read(self, until: float) -> bool:
        """Take what is there, or what comes first before ``until`` (monotonic, seconds); False when nothing came."""
        while True:
            left = until - time.monotonic() if not self.halted else 0.0
            ready = self._selector.select(min(max(left, 0), _NOTICE_S))
            if ready or left <= _NOTICE_S:
                break
        for key, _ in ready:
            key.data()
        return bool(ready)

    def sleep(self, until: float, stops: Callable[[], bool]) -> None:
        """Take what comes up to ``until``, or until ``stops``."""
        while time.monotonic() < until and not self.halted and not stops():
            self.read(until)

    def close(self) -> None:
        """Look no more. Sockets stay as they are."""
        self._selector.close()
