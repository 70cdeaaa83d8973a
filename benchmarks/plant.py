"""The synthetic plant: the requests of its programs, and the behaviour of the stacks that send them."""

from __future__ import annotations

from random import Random
from typing import Final

from benchmarks.pdus import REFUSED_SIZES, Item, Variables, tapes

#: (area, weight, sizes): mostly DB and flags, every other area now and then.
_AREAS: Final = (
    (0x84, 60, (0x01, 0x02, 0x02, 0x03, 0x04, 0x05, 0x06, 0x07, 0x08, 0x08, 0x08, 0x13)),
    (0x83, 14, (0x01, 0x01, 0x02, 0x04, 0x06, 0x08)),
    (0x81, 8, (0x01, 0x02, 0x04)),
    (0x82, 7, (0x01, 0x02, 0x04)),
    (0x1C, 2, (0x1C,)),
    (0x1D, 2, (0x1D,)),
    (0x80, 1, (0x02, 0x04)),
    (0x85, 1, (0x04, 0x07)),
    (0x86, 1, (0x02,)),
    (0x87, 1, (0x02,)),
    (0x03, 1, (0x02,)),
    (0x05, 1, (0x02,)),
    (0x06, 1, (0x04,)),
    (0x07, 1, (0x04,)),
)
#: Number of items of a request, with weights: the mean is near 3.7.
_READ_COUNTS: Final = ((1, 40), (2, 15), (3, 10), (4, 8), (5, 7), (6, 5), (8, 5), (10, 4), (14, 2), (18, 2), (20, 2))
_WRITE_COUNTS: Final = ((1, 80), (2, 12), (4, 6), (8, 2))
_LONGEST: Final = {0x01: 1, 0x02: 60, 0x03: 40, 0x1C: 4, 0x1D: 4}
#: Areas whose address counts elements, not bits.
_NUMBERED: Final = (0x1C, 0x1D)


class Manner:
    """The behaviour of a client stack: what it proposes, how it numbers, how many requests it keeps open.

    ``numbers`` names its PDU references: ``little`` and ``big`` count up in that byte order from ``first``; ``smallest``
    takes the smallest free number. ``together`` puts the open requests into one segment.
    """

    __slots__ = (
        "calling", "empties", "first", "name", "numbers", "open_jobs", "pdu_length", "together", "tpdu_numbers", "tpdu_size",
    )  # fmt: skip

    def __init__(
        self,
        name: str,
        numbers: str,
        first: int,
        open_jobs: int,
        pdu_length: int,
        *,
        calling: bytes = b"\x01\x00",
        tpdu_size: int = 0x0A,
        empties: bool = False,
        together: bool = False,
        tpdu_numbers: bool = False,
    ) -> None:
        self.name = name
        self.numbers = numbers
        self.first = first
        self.open_jobs = open_jobs
        self.pdu_length = pdu_length
        self.calling = calling
        self.tpdu_size = tpdu_size
        self.empties = empties
        self.together = together
        self.tpdu_numbers = tpdu_numbers


MANNERS: Final = (
    Manner("snap7", "little", 0, 1, 480),
    Manner("step7", "little", 2, 1, 480, empties=True),
    Manner("wincc", "smallest", 1, 3, 480, calling=b"\x02\x00", empties=True),
    Manner("libnodave", "big", 0xFFFF, 1, 240, tpdu_size=0x09),
    Manner("nodes7", "big", 0, 3, 960, together=True),
    Manner("plc4x", "big", 0, 2, 1024, tpdu_numbers=True),
)


def _weighted(rng: Random, table: tuple[tuple[int, int], ...]) -> int:
    return rng.choices([row[0] for row in table], [row[1] for row in table])[0]


class Plant:
    """Every distinct request of the plant, in pools by the PDU length that their answers need.

    ``reads[length]`` and ``writes`` together are a few hundred parameter blocks, which the stations repeat.
    """

    def __init__(self, seed: int) -> None:
        rng = Random(seed)
        self._rng = rng
        self.tapes = tapes(rng)
        self.reads = {240: self._pool(160, 240), 480: self._pool(120, 480), 960: self._pool(40, 960)}
        self.writes = [self._write() for _ in range(60)]

    def _pool(self, size: int, pdu_length: int) -> list[Variables]:
        return [self._read(pdu_length, awkward=number % 40 == 39) for number in range(size)]

    def _item(self, room: int, refusal: int = 0) -> Item:
        rng = self._rng
        area, _, sizes = rng.choices(_AREAS, [row[1] for row in _AREAS])[0]
        code = rng.choice(sizes)
        most = _LONGEST.get(code, 12)
        count = 1 if rng.random() < 0.6 else rng.randint(1, most)
        address = (
            rng.randrange(256)
            if area in _NUMBERED
            else rng.randrange(2000) * 8 + (rng.randrange(8) if code == 1 else 0)
        )
        item = Item(code, count, rng.randint(1, 400) if area in (0x84, 0x85) else 0, area, address, refusal)
        return item if item.answer_octets <= room else Item(0x02, 1, 0, 0x83, rng.randrange(200) * 8, refusal)

    def _read(self, pdu_length: int, *, awkward: bool) -> Variables:
        """Make a read whose request and answer fit ``pdu_length``; an awkward one has an item that every PLC refuses."""
        rng = self._rng
        count = min(_weighted(rng, _READ_COUNTS), (pdu_length - 12) // 12)
        room = pdu_length - 14
        items: list[Item] = []
        for number in range(count):
            # Each of the remaining items needs six octets at least.
            spare = room - 6 * (count - number - 1)
            items.append(self._item(spare))
            room -= items[-1].answer_octets
        if awkward:
            code = rng.choice(REFUSED_SIZES)
            refusal = rng.choice((0x0A, 0x05, 0x06))
            items[-1] = Item(code if refusal == 0x06 else 0x02, 1, 999, 0x84, 0, refusal)
        return Variables(0x04, items, self.tapes)

    def _write(self) -> Variables:
        rng = self._rng
        count = _weighted(rng, _WRITE_COUNTS)
        room = 240 - 12 - 12 * count
        items: list[Item] = []
        for number in range(count):
            items.append(self._item((room - 6 * (count - number - 1)) // 2))
            room -= items[-1].answer_octets
        return Variables(0x05, items, self.tapes)

    def polls(self, rng: Random, pdu_length: int) -> list[Variables]:
        """Return the requests that one station repeats."""
        fitting = [length for length in self.reads if length <= pdu_length]
        pool = self.reads[max(fitting)]
        return rng.sample(pool, rng.randint(6, 14))
