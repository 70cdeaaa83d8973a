"""`RelayReader`: the relayed traffic as packets of a live source, for the pipeline and for capture files."""

from __future__ import annotations

import threading
from typing import Final

from dissect.online.proxy.packets import Conversation
from dissect.online.proxy.tap import CLOSED, GONE, OPENED, REFUSED, RESET, SENT, Passed, Tapped
from dissect.packets.source.live.reader import WAIT_MS, Drops, LiveReader
from dissect.packets.source.packet import PacketSink
from dissect.packets.tcp.link import ETHERNET

#: At most this many octets, and this many events, are taken in one step.
_STEP_OCTETS: Final = 262_144
_STEP_EVENTS: Final = 512


class RelayReader(LiveReader):
    """Makes Ethernet frames of the relayed traffic. ``link`` is the name of the interface in captures.

    It ends after `stop`, when all traffic before that is delivered. It does not end the relay; later events in the tap are
    dropped.
    """

    def __init__(self, tap: Tapped, link: str = "proxy", wait_ms: int = WAIT_MS) -> None:
        super().__init__(link, "proxy", wait_ms)
        self._tap = tap
        self._stopping = threading.Event()
        self._conversations: dict[int, Conversation] = {}

    @property
    def drops(self) -> Drops:
        """Events that were dropped because dissection was too slow count as the kernel's; an interface cannot lose any."""
        return Drops(self._tap.lost, None)

    def stop(self) -> None:
        """Ask the reader to end. May be called from a signal handler, and twice."""
        self._stopping.set()

    def close(self) -> None:
        """Take no further events."""
        self._stopping.set()
        self._tap.shut()
        self._conversations.clear()

    def step(self, sink: PacketSink) -> bool:
        """Deliver some packets, after waiting a moment for them; return False when it was stopped and none is left."""
        stopping = self._stopping.is_set()
        passed = self._tap.take(0 if stopping else self.wait_ms / 1000)
        if passed is None:
            return not stopping
        size = count = 0
        while passed is not None:
            size += len(passed.octets)
            count += 1
            for frame in self._frames(passed):
                self.packets += 1
                self.octets += len(frame)
                sink.frame(passed.time_ns, frame, 0, len(frame), len(frame), ETHERNET)
            passed = self._tap.take(0) if size < _STEP_OCTETS and count < _STEP_EVENTS else None
        return True

    def _frames(self, passed: Passed) -> list[bytes]:
        if passed.ends is not None:
            talk = Conversation(*passed.ends, number=passed.link)
            if passed.kind == OPENED:
                self._conversations[passed.link] = talk
                return talk.opened()
            return talk.refused() if passed.kind == REFUSED else talk.unanswered()
        talk = self._conversations[passed.link]
        if passed.skipped:
            talk.skipped(passed.side, passed.skipped)
        if passed.kind == SENT:
            return talk.sent(passed.side, passed.octets)
        if passed.kind == CLOSED:
            return talk.closed(passed.side)
        if passed.kind == RESET:
            return talk.reset(passed.side)
        if passed.kind == GONE:
            del self._conversations[passed.link]
            return []
        raise ValueError(f"{passed.kind}: not an event of a connection")
