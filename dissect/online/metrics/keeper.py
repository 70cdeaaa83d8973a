"""Keeps the server of the metrics running: if it cannot listen, or ends, this is reported and retried after 1, 2, 4 … 60 s."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Final

from dissect.meaning.report import words
from dissect.online.alerts.problems import METRICS
from dissect.online.live.problems import Recovery
from dissect.online.live.run import Companion
from dissect.online.metrics.server import Door, Server
from dissect.online.net.addresses import AddressError
from dissect.packets.source.live.reader import Drops

_ENDED: Final = "its thread ended"


class MetricsKeeper(Companion):
    """Accompanies a run and restarts the server of ``door``, which the run may have opened already."""

    name = "the metrics server"

    def __init__(self, door: Door, clock: Callable[[], float] = time.monotonic) -> None:
        super().__init__()
        self.recovery = Recovery(clock)
        self._door = door
        self._server: Server | None = None
        self._why = ""
        self._begun = False

    def open(self) -> Server:
        """Listen. Raises `AddressError`."""
        self._server = self._door.open()
        return self._server

    def start(self) -> None:
        """Answer from now on; a failure to open is tried again later. Call it when there may be threads."""
        self._begun = True
        if self._server is not None:
            self._server.start()

    def missed(self, why: str) -> None:
        """Note that it could not listen at the start."""
        self._why = why
        self.recovery.failed()

    def tick(self, now_ns: int, drops: Drops) -> None:
        """Check whether it still answers; retry if it failed."""
        if not self._begun:
            return
        if self._server is not None and not self._server.alive:
            self._server.close()
            self._server = None
            self._fail(_ENDED)
        elif self._server is None and self._why:
            self._tell()
        if self._server is None and self.recovery.due:
            try:
                self.open().start()
            except AddressError as error:
                self._fail(str(error))
            else:
                lasted = words.duration(int(self.recovery.worked() * 1e9))
                self.problems.tell(METRICS, f"{self.name} answers again after {lasted}", True)

    def _fail(self, why: str) -> None:
        if self.recovery.failed():
            self._why = why
            self._tell()

    def _tell(self) -> None:
        self.problems.tell(METRICS, f"{self.name} does not answer: {self._why}; it will be tried again")
        self._why = ""

    def close(self) -> None:
        """Stop listening."""
        if self._server is not None:
            self._server.close()
