"""Random damage, for runs without a fuzzer: the same seed always gives the same."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from random import Random
from typing import Final

_NUMBERS: Final = (0, 1, 2, 3, 4, 0x7F, 0x80, 0xFE, 0xFF)


def mutated(rng: Random, octets: bytes, others: Sequence[bytes]) -> bytes:
    """Return octets with one to four changes; ``others`` give pieces to put in."""
    made = bytearray(octets)
    for _ in range(rng.randint(1, 4)):
        at = rng.randrange(len(made) + 1)
        what = rng.randrange(8)
        if what < 3:
            made[at : at + 1] = bytes((rng.choice(_NUMBERS),))
        elif what == 3:
            made[at : at + 1] = bytes((rng.getrandbits(8),))
        elif what == 4:
            del made[at : at + rng.choice((1, 1, 2, 4, 30))]
        elif what == 5:
            made[at:at] = made[at : at + rng.choice((1, 4, 30, 200))]
        elif what == 6:
            other = rng.choice(others)
            start = rng.randrange(len(other) + 1)
            made[at:at] = other[start : start + rng.choice((2, 8, 60))]
        else:
            del made[at:]
    return bytes(made)


def mutations(seeds: Sequence[bytes], count: int, seed: int = 0) -> Iterator[bytes]:
    """Yield every seed, then ``count`` damaged ones."""
    yield from seeds
    rng = Random(seed)
    for _ in range(count):
        yield mutated(rng, rng.choice(seeds), seeds)
