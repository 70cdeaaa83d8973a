"""Several interfaces as one source: each packet with the interface that captured it, in the order of their times.

Packets of two interfaces come in pieces, each piece in its order. So each piece is held for `HOLD_NS` after its arrival, while
the pieces of the other interfaces arrive, and delivered in order of time; packets that arrive later stay after the others. The
clocks of packets, which may be wrong or set back, decide only the order. An interface that ends does not end the others, and a
silent one does not keep a busy one waiting.
"""

from __future__ import annotations

import heapq
import time
from collections import Counter, deque
from collections.abc import Callable, Sequence
from typing import Final

from mypy_extensions import i64

from dissect.packets.source.live.reader import Drops, LiveReader, in_all
from dissect.packets.source.packet import PacketSink

#: How long packets are held: the ring delivers a block after 50 ms at most, dumpcap its packets after a quarter of a second.
HOLD_NS: Final = {"ring": 150_000_000, "dumpcap": 500_000_000}
#: At most this many octets of packets are held; beyond that, the oldest are delivered at once.
MAX_HELD: Final = 64 << 20
#: How long to sleep if no interface has packets, in seconds.
_REST_S: Final = 0.01
#: Memory of a held packet besides its octets.
_COST: Final = 200
#: At most this many arrivals are remembered: as many as packets can be held.
_MAX_ARRIVALS: Final = MAX_HELD // _COST

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

    def __init__(self, readers: Sequence[LiveReader], clock: Callable[[], int] = time.monotonic_ns) -> None:
        super().__init__(
            readers[0].interface, "+".join(sorted({reader.engine for reader in readers})), readers[0].wait_ms
        )
        self.readers = list(readers)
        self._clock = clock
        self._shelves = {id(reader): _Shelf(self, reader) for reader in readers}
        self._going = list(readers)
        self._held: list[_Held] = []
        self._arrivals: deque[tuple[int, int, int]] = deque()  # when, time and order of each that may still be held
        self._now = 0
        self._size = 0
        self._count = 0
        self._hold_ns = max([HOLD_NS.get(reader.engine, 0) for reader in readers])
        self._left: Counter[str] = Counter()  # packets of each interface that were still held when it was closed
        for reader in readers:
            reader.wait_ms = 0

    @property
    def names(self) -> list[str]:
        """The interfaces, in the order in which they were given."""
        return [reader.interface for reader in self.readers]

    def hold(self, time_ns: int, reader: LiveReader, octets: bytes, wire_length: int, link_type: int) -> None:
        """Take a packet."""
        self._count += 1
        self._size += len(octets) + _COST
        self._arrivals.append((self._now, time_ns, self._count))
        heapq.heappush(self._held, (time_ns, self._count, reader, octets, wire_length, link_type))

    def step(self, sink: PacketSink) -> bool:
        """Read some of each interface, and deliver what was held long enough; return False when all have ended."""
        until = time.monotonic() + self.wait_ms / 1000
        while not self._look() and self._going and time.monotonic() < until:
            time.sleep(_REST_S)
        self.packets = sum([int(reader.packets) for reader in self.readers])
        self.octets = sum([int(reader.octets) for reader in self.readers])
        self._deliver(sink)
        return bool(self._going)

    def _look(self) -> bool:
        """Read a piece from each interface that has one; return whether packets came."""
        self._now = self._clock()
        before = self._count
        for reader in list(self._going):
            if not reader.step(self._shelves[id(reader)]):
                self._going.remove(reader)
                self._ended(reader)
        return self._count > before

    def _ended(self, reader: LiveReader) -> None:
        """Note that an interface has ended while others continue; when it was the last one, that is the end."""
        if reader.damage and self._going:
            self._outages.append((f"{reader.damage}; the other interfaces go on", False))
        notes = [f"{reader.interface}: {note}" for note in reader.notes]
        self.notes += [note for note in notes if note not in self.notes]
        self.rejected += reader.rejected
        self.damage = self.damage or reader.damage

    def _deliver(self, sink: PacketSink) -> None:
        """Deliver the packets that were held long enough and all earlier ones; more if too much is held, and all at the end."""
        due = self._now - self._hold_ns
        while self._arrivals and (self._arrivals[0][0] <= due or len(self._arrivals) > _MAX_ARRIVALS):
            _, time_ns, count = self._arrivals.popleft()
            while self._held and self._held[0][:2] <= (time_ns, count):
                self._give(sink)
        while self._held and (self._size > MAX_HELD or not self._going):
            self._give(sink)

    def _give(self, sink: PacketSink) -> None:
        time_ns, _, reader, octets, wire_length, link_type = heapq.heappop(self._held)
        self._size -= len(octets) + _COST
        self.interface = reader.interface
        sink.frame(time_ns, octets, 0, len(octets), wire_length, link_type)

    # ---- what all of them are ---------------------------------------------------------------------------------------

    @property
    def drops(self) -> Drops:
        """The losses on all interfaces; unknown while they are unknown for one interface."""
        return in_all(self.drops_of.values())

    @property
    def drops_of(self) -> dict[str, Drops]:
        """The losses on each interface."""
        found = {}
        for reader in self.readers:
            kernel, interface = reader.drops
            left = self._left[reader.interface]
            found[reader.interface] = Drops(kernel + left if kernel is not None else None, interface)
        return found

    @property
    def down_seconds(self) -> float:
        """How long interfaces were down, in all."""
        return sum([reader.down_seconds for reader in self.readers])

    def take_outages(self) -> list[tuple[str, bool]]:
        """Return what happened to the interfaces since the last call."""
        return [*[said for reader in self.readers for said in reader.take_outages()], *super().take_outages()]

    def stated_loss(self) -> str:
        """Return in words the losses that the captures themselves report."""
        return "; ".join([f"{reader.interface}: {said}" for reader in self.readers if (said := reader.stated_loss())])

    def stop(self) -> None:
        """End all of them."""
        for reader in self.readers:
            reader.stop()

    def close(self) -> None:
        """Release all of them; packets that are held now were not delivered."""
        self._left.update([reader.interface for _, _, reader, *_ in self._held])
        self._held.clear()
        for reader in self.readers:
            reader.close()
