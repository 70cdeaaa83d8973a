"""`LiveReader` adds to `Reader` what a live source needs: bounded waiting, `stop`, and counts of lost packets."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Iterable
from typing import Final, NamedTuple

from dissect.packets.source.packet import CaptureError, Reader

#: How long `LiveReader.step` waits for packets by default, in milliseconds.
WAIT_MS: Final = 50
#: At most this many sentences about the interface are kept until they are read.
_MAX_OUTAGES: Final = 100


class Drops(NamedTuple):
    """How many packets on the wire were lost since the source was opened.

    ``kernel``: received, but the buffer between kernel and reader was full. ``interface``: lost before the kernel had them (the
    card's ``rx_missed_errors`` and ``rx_fifo_errors``). None means not known (yet), never zero.
    """

    kernel: int | None
    interface: int | None


class LiveError(CaptureError):
    """A live source cannot be opened: the message is one line with the reason, ``advice`` has lines that say what to do."""

    def __init__(self, message: str, advice: tuple[str, ...] = ()) -> None:
        super().__init__(message)
        self.advice = advice


class UnavailableError(LiveError):
    """An engine is missing or may not capture; another engine might."""


def in_all(drops: Iterable[Drops]) -> Drops:
    """Return the sum; a count is not known as long as one of its parts is not."""
    kernel: int | None = 0
    interface: int | None = 0
    for one in drops:
        kernel = None if kernel is None or one.kernel is None else kernel + one.kernel
        interface = None if interface is None or one.interface is None else interface + one.interface
    return Drops(kernel, interface)


class LiveReader(Reader):
    """Reads packets of an interface or a pipe as they come.

    `step` returns after at most about ``wait_ms``, with packets or without, so that its caller can advance the clock of the
    analysis (`Pipeline.tick`). False means that the source has ended; ``damage`` then says why, and is empty when it ended
    because of `stop`. ``engine`` is ``dumpcap``, ``ring`` or ``pipe``.
    """

    def __init__(self, interface: str, engine: str, wait_ms: int) -> None:
        super().__init__()
        self.interface = interface
        self.engine = engine
        self.wait_ms = wait_ms
        self._down_at: float | None = None
        self._down_before = 0.0
        self._outages: deque[tuple[str, bool]] = deque(maxlen=_MAX_OUTAGES)

    @property
    def down_seconds(self) -> float:
        """How long the interface was down since the source was opened, as far as that is known."""
        return self._down_before + (time.monotonic() - self._down_at if self._down_at is not None else 0.0)

    def went_down(self) -> None:
        """Note that the interface is down."""
        if self._down_at is None:
            self._down_at = time.monotonic()
            self._outages.append(
                (f"the interface {self.interface} went down; nothing is captured until it is up", False)
            )

    def is_up(self) -> None:
        """Note that the interface is up: if it was down, say for how long nothing was captured."""
        if self._down_at is not None:
            lasted = time.monotonic() - self._down_at
            self._down_at = None
            self._down_before += lasted
            self._outages.append(
                (f"the interface {self.interface} is up again; nothing was captured for {lasted:.1f} s", True)
            )

    def take_outages(self) -> list[tuple[str, bool]]:
        """Return the events of the interface since the last call: sentences, and for each whether it ends an outage."""
        taken: list[tuple[str, bool]] = []
        while self._outages:
            taken.append(self._outages.popleft())
        return taken

    @property
    def drops(self) -> Drops:
        """The losses so far. May be read at any time, even after the end."""
        return Drops(None, None)

    @property
    def drops_of(self) -> dict[str, Drops]:
        """The losses so far, by interface."""
        return {self.interface: self.drops}

    def stop(self) -> None:
        """End the source: `step` delivers what it still has, then returns False. Call it any time, also in a signal handler."""
