"""The packets that passed last, bounded in octets, in number and in time."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from typing import Final

#: Octets of memory that a packet takes besides its content, counted with it.
PACKET_COST: Final = 400

#: Comments that one packet collects.
MAX_COMMENTS: Final = 64


class KeptPacket:
    """A packet with its number, kept until somebody wants it or its time is over. ``comments`` may still grow."""

    __slots__ = ("comments", "frame", "interface", "link_type", "octets", "time_ns", "wire_length")

    def __init__(
        self,
        frame: int,
        time_ns: int,
        octets: bytes,
        wire_length: int,
        link_type: int,
        interface: str,
        comments: list[str],
    ) -> None:
        self.frame = frame
        self.time_ns = time_ns
        self.octets = octets
        self.wire_length = wire_length
        self.link_type = link_type
        self.interface = interface
        self.comments = comments

    @property
    def size(self) -> int:
        """Octets of memory it counts for; its comments are few and short beside what bounds them."""
        return len(self.octets) + PACKET_COST

    def say(self, comment: str) -> None:
        """Add a comment, once, as long as there is room."""
        if comment not in self.comments and len(self.comments) < MAX_COMMENTS:
            self.comments.append(comment)


class RecentPackets:
    """Packets of the last ``most_ns`` (nanoseconds of capture time) and no more than ``most`` of them (0: any number).

    Only the latest ones are kept that have room in ``max_octets``, which has to be above 0 (ValueError). ``shortened`` counts
    packets that had to leave before their time, for want of room.
    """

    def __init__(self, max_octets: int, most_ns: int, most: int = 0) -> None:
        if max_octets <= 0:
            raise ValueError(f"{max_octets} bytes hold no packet")
        self.shortened = 0
        self.octets = 0
        self._max_octets = max_octets
        self._most_ns = most_ns
        self._most = most
        self._kept: deque[KeptPacket] = deque()

    def __len__(self) -> int:
        return len(self._kept)

    def __iter__(self) -> Iterator[KeptPacket]:
        return iter(self._kept)

    def add(self, packet: KeptPacket) -> None:
        """Add the packet that passes now; those whose time is over leave."""
        kept = self._kept
        kept.append(packet)
        self.octets += packet.size
        oldest_ns = packet.time_ns - self._most_ns
        while kept and (kept[0].time_ns < oldest_ns or (self._most and len(kept) > self._most)):
            self._leave()
        while self.octets > self._max_octets and kept:
            self._leave()
            self.shortened += 1

    def within(self, now_ns: int) -> list[KeptPacket]:
        """Return the packets whose time is not over at ``now_ns``, in order."""
        return [packet for packet in self._kept if packet.time_ns >= now_ns - self._most_ns]

    @property
    def last(self) -> KeptPacket | None:
        """The packet that passed last, None when there is none."""
        return self._kept[-1] if self._kept else None

    def find(self, frame: int) -> KeptPacket | None:
        """Return the packet with this number, None when it is not here. Numbers ascend."""
        kept = self._kept
        if not kept:
            return None
        # Numbers follow one another without gaps wherever every packet is added.
        index = frame - kept[0].frame
        if 0 <= index < len(kept) and kept[index].frame == frame:
            return kept[index]
        return None

    def clear(self) -> None:
        """Forget all."""
        self._kept.clear()
        self.octets = 0

    def _leave(self) -> None:
        self.octets -= self._kept.popleft().size
