"""The conversations of a synthetic plant, packet by packet, with the faults of real networks."""

from __future__ import annotations

from heapq import heappop, heappush
from random import Random
from typing import TYPE_CHECKING, Final

from benchmarks.connection import MS, US
from benchmarks.frames import Host, arp, udp
from benchmarks.plant import MANNERS, Plant
from benchmarks.station import Station

if TYPE_CHECKING:
    from collections.abc import Iterator

    from benchmarks.connection import Connection, RewritePlan
    from benchmarks.truth import Truth, Unit

#: 2024-03-04 05:06:07 UTC: where made captures begin.
EPOCH_NS: Final = 1_709_528_767_000_000_000

#: Possible mishaps of an exchange, each with its share of the exchanges.
MISHAPS: Final = (
    (0.010, "swapped"),
    (0.004, "duplicated"),
    (0.003, "retransmitted"),
    (0.003, "kept alive"),
    (0.0002, "lost"),
)
#: Packets further apart than this do not overtake one another on the way to the capture.
_DISORDER_NS: Final = MS
#: Number of exchanges after a loss without a further loss on the connection: two losses in a row have no single truth.
_QUIET: Final = 12


class Traffic:
    """Fifty (or more) stations polling their PLCs, merged into one stream of packets in order of time.

    The same ``seed`` gives the same octets. ``without`` names the `MISHAPS` left out. Times are multiples of ``grain_ns``, so
    that a µs file loses nothing.
    """

    def __init__(
        self, seed: int, truth: Truth, stations: int = 50, grain_ns: int = 1000, without: frozenset[str] = frozenset()
    ) -> None:
        self._mishaps = tuple(row for row in MISHAPS if row[1] not in without)
        self._rng = Random(seed)
        self._truth = truth
        self._grain_ns = grain_ns
        self._order = 0
        self._waiting: list[tuple[int, int, bytes, tuple[Unit, ...], bool]] = []
        plant = Plant(seed)
        rng = self._rng
        plcs = [Host(0x0A0A0100 + number, b"\x00\x1b\x1b") for number in range(max(1, stations * 3 // 5))]
        self._stations = [
            Station(
                Random(rng.getrandbits(64)),
                plant,
                truth,
                MANNERS[number % len(MANNERS)],
                Host(0x0A0A0A00 + number, ttl=128),
                plcs[number % len(plcs)],
                midstream=number % 10 == 7,
            )
            for number in range(stations)
        ]
        self._noise = Host(0x0A0A00FA)

    def packets(self) -> Iterator[tuple[int, bytes, tuple[Unit, ...], bool]]:
        """Yield (time in ns, frame, TPKTs that have octets in it, whether it is TCP without payload), without end."""
        rng = self._rng
        agenda = [(EPOCH_NS + rng.randrange(500 * MS), number) for number in range(len(self._stations))]
        agenda.append((EPOCH_NS, -1))
        agenda.sort()
        waiting = self._waiting
        while True:
            now, number = heappop(agenda)
            while waiting and waiting[0][0] < now:
                time_ns, _, frame, units, empty = heappop(waiting)
                yield time_ns, frame, units, empty
            if number < 0:
                self._background(now)
                heappush(agenda, (now + rng.randrange(10 * MS, 300 * MS), number))
                continue
            station = self._stations[number]
            connection, then, ordinary = station.act(now)
            drafts = connection.drafts
            if ordinary:
                then += self._mishap(station, connection)
            for draft in drafts:
                self._push(draft.time_ns, draft.build(), draft.units, not draft.payload)
            heappush(agenda, (then, number))

    def _background(self, now: int) -> None:
        if self._rng.random() < 0.7:
            frame = arp(self._noise, 0x0A0A0100 + self._rng.randrange(60))
        else:
            frame = udp(self._noise, 123, Host(0x0A0A0001), 123, b"\x23" + bytes(47))
        self._push(now, frame, (), False)

    def _push(self, time_ns: int, frame: bytes, units: tuple[Unit, ...], empty: bool) -> None:
        self._order += 1
        heappush(self._waiting, (time_ns - time_ns % self._grain_ns, self._order, frame, units, empty))

    def _mishap(self, station: Station, connection: Connection) -> int:
        """Perhaps apply a mishap to the drafts of an exchange; return how much later the next one must begin."""
        chance = self._rng.random()
        drafts = connection.drafts
        for share, name in self._mishaps:
            chance -= share
            if chance >= 0:
                continue
            match name:
                case "swapped":
                    delay = self._swap(drafts)
                case "duplicated":
                    delay = self._duplicate(drafts)
                case "retransmitted":
                    delay = self._retransmit(drafts)
                case "lost":
                    delay = self._lose(station, drafts)
                case _:
                    start = drafts[-1].time_ns + 2 * MS
                    delay = connection.keep_alive(start, self._rng.getrandbits(1)) - start + 3 * MS
            if delay >= 0:
                self._truth.happened(name)
            return max(delay, 0)
        return 0

    def _swap(self, drafts: list[RewritePlan]) -> int:
        """Capture a packet just after its follower instead of before it, in any direction, if they were close."""
        near = [at for at in range(len(drafts) - 1) if drafts[at + 1].time_ns - drafts[at].time_ns < _DISORDER_NS]
        if not near:
            return -1
        first = self._rng.choice(near)
        for draft in drafts:
            draft.build()
        drafts[first].time_ns = drafts[first + 1].time_ns + self._rng.randrange(1, 20) * US
        drafts[first], drafts[first + 1] = drafts[first + 1], drafts[first]
        return 0

    def _duplicate(self, drafts: list[RewritePlan]) -> int:
        """Deliver a packet twice, octet for octet, as a mirror of two ports does."""
        at = self._rng.randrange(len(drafts))
        copy = drafts[at].again(drafts[at].time_ns + self._rng.randrange(1, 6) * US)
        copy.frame = drafts[at].build()
        drafts.insert(at + 1, copy)
        return 0

    def _retransmit(self, drafts: list[RewritePlan]) -> int:
        """Send a segment again after a timeout, with a part of its neighbour if that is from the same side."""
        full = [at for at, draft in enumerate(drafts) if draft.payload]
        if not full:
            return -1
        at = self._rng.choice(full)
        draft = drafts[at]
        pause = self._rng.randrange(200 * MS, 300 * MS)
        copy = draft.again(draft.time_ns + pause)
        behind = at + 1
        if behind < len(drafts) and drafts[behind].sender is draft.sender and drafts[behind].payload:
            other = drafts[behind].payload
            copy.payload += other[: self._rng.randint(0, len(other))]
            copy.time_ns = drafts[behind].time_ns + pause
            behind += 1
        for later in drafts[behind:]:
            later.time_ns += pause
        drafts.insert(behind, copy)
        return pause

    def _lose(self, station: Station, drafts: list[RewritePlan]) -> int:
        """Let the capture miss a segment that the far end got."""
        full = [at for at, draft in enumerate(drafts) if draft.payload]
        if not full or station.since_loss < _QUIET:
            return -1
        station.since_loss = 0
        for draft in drafts:
            draft.build()
        gone = drafts.pop(self._rng.choice(full))
        self._truth.lost_segments += 1
        self._truth.lost_octets += len(gone.payload)
        return 0
