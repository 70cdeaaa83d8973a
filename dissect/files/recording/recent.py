"""`RecentPackets`: the latest packets, limited in octets, number and time."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from typing import Final

#: Estimated octets of memory of a packet besides its content.
PACKET_COST: Final = 400

#: Greatest number of comments on a packet.
MAX_COMMENTS: Final = 64


class KeptPacket:
    """A packet with its number, kept until it is written or too old. ``comments`` may still be added."""

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
        """The memory that it is counted with, in octets; comments are left out, because they are few and short."""
        return len(self.octets) + PACKET_COST

    def say(self, comment: str) -> None:
        """Add a comment, unless it is already there or there are too many."""
        if comment not in self.comments and len(self.comments) < MAX_COMMENTS:
            self.comments.append(comment)


class RecentPackets:
    """The packets of the last ``most_ns`` (nanoseconds of capture time), at most ``most`` of them (0: any number).

    Of these, the latest ones that fit into ``max_octets`` are kept; it must be above 0 (ValueError). ``shortened`` counts
    packets that were dropped early for lack of room.
    """

    def __init__(self, max_octets: int, most_ns: int, most: int = 0) -> None:
        if max_octets <= 0:
            raise ValueError(f"{max_octets} bytes are too few for one packet")
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
        """Add the latest packet, and drop packets that are too old."""
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
        """Return the packets that are not too old at ``now_ns``, in their order."""
        return [packet for packet in self._kept if packet.time_ns >= now_ns - self._most_ns]

    @property
    def last(self) -> KeptPacket | None:
        """The latest packet, None if there is none."""
        return self._kept[-1] if self._kept else None

    def find(self, frame: int) -> KeptPacket | None:
        """Return the packet with number ``frame``, None if it is not kept. Numbers ascend."""
        kept = self._kept
        if not kept:
            return None
        # Numbers have no gaps if every packet is added: try the place where it then is first.
        index = frame - kept[0].frame
        if 0 <= index < len(kept) and kept[index].frame == frame:
            return kept[index]
        return None

    def clear(self) -> None:
        """Forget all packets."""
        self._kept.clear()
        self.octets = 0

    def _leave(self) -> None:
        self.octets -= self._kept.popleft().size
