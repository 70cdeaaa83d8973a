"""What a message needs around it to be understood alone: how its connection began, what was negotiated, how it ended."""

from __future__ import annotations

from collections import OrderedDict
from typing import Final

from dissect.recording.spans import Span

#: Connections remembered, and packets of each that opened or closed it above TCP.
MAX_CONNECTIONS: Final = 16_384
MAX_FRAMES: Final = 16


class Beginning:
    """``frames`` of TPDUs or IBH-NetLink packets that open or close; of the latest Setup its ``setup`` frames and spans."""

    __slots__ = ("frames", "setup", "spans")

    def __init__(self) -> None:
        self.frames: list[int] = []
        self.setup: list[int] = []
        self.spans: list[Span] = []


class ContextBook:
    """Beginnings by the number of their connection; of too many, those seen least lately are forgotten."""

    def __init__(self) -> None:
        self._known: OrderedDict[int, Beginning] = OrderedDict()

    def opened(self, number: int, frame: int) -> None:
        """Packet ``frame`` opens or closes connection ``number``."""
        beginning = self.of(number)
        if len(beginning.frames) < MAX_FRAMES:
            beginning.frames.append(frame)

    def negotiated(self, number: int, frames: list[int], spans: list[Span]) -> None:
        """A Setup communication took place in these packets."""
        beginning = self.of(number)
        beginning.setup = frames
        beginning.spans = spans

    def of(self, number: int) -> Beginning:
        """Return what is known of a connection."""
        beginning = self._known.get(number)
        if beginning is None:
            beginning = self._known[number] = Beginning()
            if len(self._known) > MAX_CONNECTIONS:
                self._known.popitem(last=False)
        else:
            self._known.move_to_end(number)
        return beginning
