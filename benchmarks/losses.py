"""Is what is told of a capture still true when packets are missing from it? ``python -m benchmarks.losses``.

Packets of made traffic are left out, one by one or in bursts, and the rest is analysed. Each pair of request and answer is held
against those of the whole traffic: it is wrong when its answer belongs to another request there. A pair of which both packets
were kept, and that is not told, is missed: mostly another segment of one of its PDUs was left out.
"""

from __future__ import annotations

import argparse
import sys
from itertools import islice
from random import Random
from typing import TYPE_CHECKING, Final, NamedTuple

from benchmarks.generate import parse_count
from benchmarks.tables import columns
from benchmarks.traffic import Traffic
from benchmarks.truth import Truth
from dissect.engine.observer import Observer
from dissect.engine.pipeline import Pipeline
from dissect.transactions.transaction import ANSWERED, Transaction

if TYPE_CHECKING:
    from collections.abc import Sequence

_ETHERNET = 1
#: Packets that go together, where they do.
_BURST: Final = (5, 40)
#: Who asked and who was asked, reference, packet of the request.
Key = tuple[str, str, int, int]
Packet = tuple[int, bytes]


class Verdict(NamedTuple):
    """Of one capture with gaps: packets kept, pairs told, pairs that are wrong, pairs that are not told."""

    kept: int
    pairs: int
    wrong: int
    missed: int


class _Pairs(Observer):
    """Keeps each pair: the packet of its answer, by its key. ``numbers`` gives packets their numbers in the whole traffic."""

    def __init__(self, numbers: Sequence[int]) -> None:
        super().__init__()
        self.found: dict[Key, int] = {}
        self._numbers = numbers

    def transaction(self, transaction: Transaction) -> None:
        """Take a transaction."""
        if transaction.outcome == ANSWERED:
            ends = transaction.connection.tcp.ends
            asked = self._numbers[int(transaction.request_frame) - 1]
            told = self._numbers[int(transaction.response_frame) - 1]
            asking, answering = ends[transaction.asked_by], ends[1 - transaction.asked_by]
            self.found[str(asking), str(answering), int(transaction.pdu_ref), asked] = told


def pairs(packets: Sequence[Packet], numbers: Sequence[int]) -> dict[Key, int]:
    """Return the pairs that are told of those packets whose ``numbers``, counted from 0, are given in their order."""
    observer = _Pairs(numbers)
    pipeline = Pipeline(observer)
    for number in numbers:
        time_ns, frame = packets[number]
        pipeline.frame(time_ns, frame, 0, len(frame), len(frame), _ETHERNET)
    pipeline.finish()
    return observer.found


def kept(count: int, rate: float, burst: bool, rng: Random) -> list[int]:
    """Return the numbers of the packets that are not lost, of ``count``: each is with the probability ``rate``."""
    numbers: list[int] = []
    mean = sum(_BURST) / 2 if burst else 1
    at = 0
    while at < count:
        if rng.random() < rate / (mean * (1 - rate) + rate):
            at += rng.randint(*_BURST) if burst else 1
        else:
            numbers.append(at)
            at += 1
    return numbers


def compare(whole: dict[Key, int], found: dict[Key, int], numbers: Sequence[int]) -> Verdict:
    """Hold the pairs ``found`` in the packets ``numbers`` against those of the ``whole`` traffic."""
    answers = {(*key[:3], told) for key, told in whole.items()}
    wrong = sum(1 for key, told in found.items() if key in whole and whole[key] != told and (*key[:3], told) in answers)
    there = set(numbers)
    missed = sum(1 for key, told in whole.items() if key not in found and key[3] in there and told in there)
    return Verdict(len(numbers), len(found), wrong, missed)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.losses", description=__doc__)
    parser.add_argument("--packets", type=parse_count, default=23_000, metavar="N", help="of the whole traffic")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--rates", type=float, nargs="+", default=[0.02, 0.1, 0.3], metavar="R", help="0 to 1")
    parser.add_argument("--rounds", type=int, default=3, metavar="N", help="of each rate, with other losses")
    options = parser.parse_args(arguments)
    if not all(0 < rate < 1 for rate in options.rates):
        parser.error("--rates: each is a share, more than 0 and less than 1")
    made = islice(Traffic(options.seed, Truth(), 50, grain_ns=1000, without=frozenset()).packets(), options.packets)
    packets = [(time_ns, frame) for time_ns, frame, _, _ in made]
    whole = pairs(packets, range(len(packets)))
    print(f"{len(packets):,} packets, {len(whole):,} pairs", file=sys.stderr)
    rows: list[tuple[str, ...]] = []
    for rate in options.rates:
        for burst in (False, True):
            verdicts: list[Verdict] = []
            for number in range(options.rounds):
                numbers = kept(len(packets), rate, burst, Random(f"{options.seed} {rate} {burst} {number}"))
                verdicts.append(compare(whole, pairs(packets, numbers), numbers))
            sums = [sum(column) for column in zip(*verdicts, strict=True)]
            rows.append((f"{rate:.0%}", "bursts" if burst else "single", *[f"{number:,}" for number in sums]))
    print(columns(("lost", "how", "packets kept", "pairs told", "wrong", "missed"), rows))
    return 0


if __name__ == "__main__":
    sys.exit(main())
