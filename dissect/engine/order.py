"""Where a run stands, finer than a packet: with it, what several runs over the same packets found can be put into one order.

Each of those runs reads every packet and analyses some of the connections (`Options.only`). A packet may end what waited on
other connections than its own, so its number alone does not say what came first. A stamp does: packet, then `phase`, then a
key that all runs agree on, because it is the number of an earlier packet. Two runs never have the same stamp; if they do,
nothing says what came first, and whoever merges them has to do without (docs/decisions/0015-processes-share-connections.md).
"""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

#: What is done with one packet, in this order. A connection that has to leave because there is no room, …
ROOM: Final = 0
#: … what waited too long: segments, then responses, then connections that are over; key: since which packet.
SEGMENTS: Final = 1
RESPONSES: Final = 2
OVER: Final = 3
#: A connection that has to leave because too many are open; key: the packet that opened it.
CROWDED: Final = 4
#: The packet itself …
PACKET: Final = 5
#: … and connections that it lets go; key: since which packet they are closed.
AFTERWARDS: Final = 6
#: The capture ends: connections that are over, then those that are open; key: the packet that closed or opened them.
CLOSED: Final = 7
OPEN: Final = 8

#: Bits of a stamp for the key, and for the phase.
_KEY: Final = 40
_PHASE: Final = 4


class Order:
    """The stamp of what happens, and the transactions that were begun at each.

    ``begun`` has a stamp for each transaction, in the order of their numbers. ``ended`` has two packets for each connection
    that closed: its first, and the one that closed it; ``left`` its first packet for each that had to leave. ``room`` is the
    most octets that were found to be kept, and ``tangled`` is True when a stamp came after a later one. `take` begins anew.
    """

    def __init__(self) -> None:
        self.begun: list[int] = []
        self.ended: list[int] = []
        self.left: list[int] = []
        self.room: i64 = 0
        self.tangled: bool = False
        self._frame: i64 = 0
        self._phase: i64 = PACKET
        self._key: i64 = 0
        self._count: i64 = 0

    @property
    def stamp(self) -> int:
        """Where the run stands; a later one is larger."""
        return (int(self._frame) << _PHASE | int(self._phase)) << _KEY | int(self._key)

    def packet(self, frame: i64, count: i64) -> None:
        """A packet comes; ``count`` transactions were begun before it."""
        if count != self._count:
            self._note(count)
        self._frame = frame
        self._phase = PACKET
        self._key = 0

    def at(self, phase: i64, key: i64, count: i64) -> None:
        """Something is done with the packet at hand; ``count`` transactions were begun before that."""
        if count != self._count:
            self._note(count)
            if phase < self._phase or (phase == self._phase and key < self._key):
                self.tangled = True
        self._phase = phase
        self._key = key

    def _note(self, count: i64) -> None:
        stamp = self.stamp
        while self._count < count:
            self._count += 1
            self.begun.append(stamp)

    def take(self, count: i64) -> tuple[list[int], list[int], list[int]]:
        """Return ``begun``, ``ended`` and ``left`` since the last call."""
        if count != self._count:
            self._note(count)
        found = (self.begun, self.ended, self.left)
        self.begun, self.ended, self.left = [], [], []
        return found
