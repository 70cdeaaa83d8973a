"""Several interfaces as one source: each packet with the interface that captured it, in the order of their times.

Packets of two interfaces come in pieces, each piece in its order. So what came is held for `HOLD_NS`, in which the pieces of
the others come, and given out by time; what comes later than that keeps its place behind. An interface that ends does not end
the others.
"""

from __future__ import annotations

import heapq
import time
from collections.abc import Callable, Sequence
from typing import Final

from mypy_extensions import i64

from dissect.source.live.reader import Drops, LiveReader
from dissect.source.packet import PacketSink

#: How long packets are held: the ring gives a block after 50 ms at most, dumpcap what it has after a quarter of a second.
HOLD_NS: Final = {"ring": 150_000_000, "dumpcap": 500_000_000}
#: Octets of packets that are held at most; beyond, the oldest are given out at once.
MAX_HELD: Final = 64 << 20
#: What a held packet costs beside its octets.
_COST: Final = 200

#: A packet: time, order of arrival, reader, octets, length on the wire, link type.
_Held = tuple[int, int, LiveReader, bytes, int, int]


class _Shelf(PacketSink):
    """Takes the packets of one reader for `SeveralReader`."""

    def __init__(self, owner: SeveralReader, reader: LiveReader) -> None:
        self._owner = owner
        self._reader = reader

    def frame(self, time_ns: i64, buf: bytes, start: i64, end: i64, wire_length: i64, link_type: i64) -> None:
        self._owner.hold(int(time_ns), self._reader, bytes(buf[start:end]), int(wire_length), int(link_type))


class SeveralReader(LiveReader):
    """Reads ``readers``, each of an interface; ``interface`` is that of the packet being delivered."""

    def __init__(self, readers: Sequence[LiveReader], clock: Callable[[], int] = time.time_ns) -> None:
        super().__init__(
            readers[0].interface, "+".join(sorted({reader.engine for reader in readers})), readers[0].wait_ms
        )
        self.readers = list(readers)
        self._clock = clock
        self._shelves = {id(reader): _Shelf(self, reader) for reader in readers}
        self._going = list(readers)
        self._held: list[_Held] = []
        self._size = 0
        self._count = 0
        self._hold_ns = max([HOLD_NS.get(reader.engine, 0) for reader in readers])
        self._left = 0  # packets that were held when it was closed
        for reader in readers:
            reader.wait_ms = max(reader.wait_ms // len(readers), 1)

    @property
    def names(self) -> list[str]:
        """The interfaces, in the order in which they were given."""
        return [reader.interface for reader in self.readers]

    def hold(self, time_ns: int, reader: LiveReader, octets: bytes, wire_length: int, link_type: int) -> None:
        """Take a packet."""
        self._count += 1
        self._size += len(octets) + _COST
        heapq.heappush(self._held, (time_ns, self._count, reader, octets, wire_length, link_type))

    def step(self, sink: PacketSink) -> bool:
        """Read some of each interface, and deliver what was held long enough; return False when all have ended."""
        begun = self._clock()
        for reader in list(self._going):
            if not reader.step(self._shelves[id(reader)]):
                self._going.remove(reader)
                self._ended(reader)
        self.packets = sum([int(reader.packets) for reader in self.readers])
        self.octets = sum([int(reader.octets) for reader in self.readers])
        self._deliver(sink, begun - self._hold_ns if self._going else None)
        return bool(self._going)

    def _ended(self, reader: LiveReader) -> None:
        """Note that an interface has ended while others go on; when it was the last one, that is the end."""
        if reader.damage and self._going:
            self._outages.append((f"{reader.damage}; the other interfaces go on", False))
        notes = [f"{reader.interface}: {note}" for note in reader.notes]
        self.notes += [note for note in notes if note not in self.notes]
        self.rejected += reader.rejected
        self.damage = self.damage or reader.damage

    def _deliver(self, sink: PacketSink, until_ns: int | None) -> None:
        """Give out packets up to a time (None: all), and more where too much is held."""
        while self._held and (until_ns is None or self._held[0][0] <= until_ns or self._size > MAX_HELD):
            time_ns, _, reader, octets, wire_length, link_type = heapq.heappop(self._held)
            self._size -= len(octets) + _COST
            self.interface = reader.interface
            sink.frame(time_ns, octets, 0, len(octets), wire_length, link_type)

    # ---- what all of them are ---------------------------------------------------------------------------------------

    @property
    def drops(self) -> Drops:
        """What was lost on all of them; not known as long as one does not know it."""
        kernel, interface = [
            sum([one for one in column if one is not None]) if None not in column else None
            for column in zip(*[reader.drops for reader in self.readers], strict=True)
        ]
        return Drops(kernel + self._left if kernel is not None else None, interface)

    @property
    def drops_of(self) -> dict[str, Drops]:
        """What was lost on each."""
        return {reader.interface: reader.drops for reader in self.readers}

    @property
    def down_seconds(self) -> float:
        """How long interfaces were down, in all."""
        return sum([reader.down_seconds for reader in self.readers])

    def take_outages(self) -> list[tuple[str, bool]]:
        """Return what happened to the interfaces since the last call."""
        return [*[said for reader in self.readers for said in reader.take_outages()], *super().take_outages()]

    def stated_loss(self) -> str:
        """Return what the captures say themselves that they lost."""
        return "; ".join([f"{reader.interface}: {said}" for reader in self.readers if (said := reader.stated_loss())])

    def stop(self) -> None:
        """End all of them."""
        for reader in self.readers:
            reader.stop()

    def close(self) -> None:
        """Release all of them; packets that are held now were not delivered."""
        self._left += len(self._held)
        self._held.clear()
        for reader in self.readers:
            reader.close()
