"""What every live source gives beyond a `Reader`: bounded waiting, an end on request, and the truth about lost packets."""

from __future__ import annotations

from typing import Final, NamedTuple

from dissect.source.packet import CaptureError, Reader

#: How long `LiveReader.step` may wait for packets, in milliseconds, unless told otherwise.
WAIT_MS: Final = 50


class Drops(NamedTuple):
    """Packets that passed on the wire and never came here, since the source was opened.

    ``kernel``: received, but the buffer between kernel and reader was full. ``interface``: lost before the kernel had them
    (the card's ``rx_missed_errors`` and ``rx_fifo_errors``). None means not known, or not known yet; it never means none.
    """

    kernel: int | None
    interface: int | None


class LiveError(CaptureError):
    """A live source cannot be opened: one line that says why, and in ``advice`` lines that say what to do about it."""

    def __init__(self, message: str, advice: tuple[str, ...] = ()) -> None:
        super().__init__(message)
        self.advice = advice


class UnavailableError(LiveError):
    """An engine is not there or may not capture; another one might."""


class LiveReader(Reader):
    """Packets of an interface, or of a pipe, as they come.

    `step` returns after about ``wait_ms`` at the latest, with packets or without, so that its caller can let the time pass
    for those who wait for an answer; False means that the source has ended. ``damage`` then says why, and is empty when it
    ended because `stop` was called. ``engine`` is ``dumpcap``, ``ring`` or ``pipe``.
    """

    def __init__(self, interface: str, engine: str, wait_ms: int) -> None:
        super().__init__()
        self.interface = interface
        self.engine = engine
        self.wait_ms = wait_ms

    @property
    def drops(self) -> Drops:
        """What was lost so far. May be asked at any time, also after the end."""
        return Drops(None, None)

    def stop(self) -> None:
        """Ask the source to end: `step` gives what it has, then False. May be called twice, and by a signal handler."""
