"""Checks whether the results for a capture stay true when packets are missing from it.

``python -m benchmarks.losses [FOLDER ...]``. Packets of synthetic traffic and of every capture below the folders (by default
those of the project and the public ones, in ``S7DISSECT_CORPUS`` or ``../shared/captures``) are left out, one by one or in
bursts, and the rest is analysed. The results are compared with those of the complete capture:

* each pair of request and answer: it is wrong if its answer belongs to another request there. A pair that is not reported
  although both of its packets were kept is missed: mostly another segment of one of its PDUs was left out;
* each statement that blames a device or a client (`benchmarks.blame`): it is untrue if the complete capture does not make it
  about that connection, or that request, and if it does not itself mention that something was not captured;
* each request that is reported as answered without a captured answer: untrue (an excuse) if it was never answered.

Exit code 1 when a bar is missed. Of 10,000 sure pairs at most 3 are wrong. For synthetic traffic and for the captures of each
folder, at most 5 statements blame wrongly (12 for the project's own, some of which were made to deceive: `_BLAMING_OWN`). With
2 % left out, at least 97 % of the pairs whose packets were kept are reported as sure. With the public captures a million
packets are analysed, in a quarter of a minute of CPU time.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections import Counter
from itertools import islice
from pathlib import Path
from random import Random
from typing import TYPE_CHECKING, Final

from benchmarks.generate import parse_count
from benchmarks.tables import columns
from benchmarks.told import Capture, Packet, Told, read
from benchmarks.traffic import Traffic
from benchmarks.truth import Truth as Made
from benchmarks.verdict import Truth, Verdict, compare
from dissect.packets.source.packet import CaptureError

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

_ETHERNET: Final = 1
_ROOT: Final = Path(__file__).resolve().parents[1]
#: Number of packets that are lost together in a burst.
_BURST: Final = (5, 40)
#: The limits: wrong pairs among the sure ones, untrue statements in all, and pairs that stay sure at `_RATE`.
_WRONG: Final = 3 / 10_000
_BLAMING: Final = 5
#: Connections that take over the sequence numbers of another, clocks that step back in the middle, and conversations so short
#: that a burst removes everything after a request: no later packet shows that an answer is missing. 11 in three rounds.
_BLAMING_OWN: Final = 12
_STAY: Final = 0.97
_RATE: Final = 0.02

HEADS: Final = (
    "lost", "how", "packets kept", "pairs told", "sure right", "sure WRONG", "likely right", "likely wrong", "not told",
    "stay sure", "untrue blame", "untrue excuse",
)  # fmt: skip


def kept(count: int, rate: float, burst: bool, rng: Random) -> list[int]:
    """Return the numbers of the packets that are kept; each of the ``count`` packets is lost with the probability ``rate``."""
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


def made(count: int, seed: int) -> Capture:
    """Return synthetic traffic with this many packets."""
    capture = Capture("made traffic")
    for time_ns, frame, _, _ in islice(Traffic(seed, Made(), 50, grain_ns=1000).packets(), count):
        capture.packets.append(Packet(time_ns, frame, len(frame), _ETHERNET))
    return capture


def captures(folder: Path) -> Iterator[Capture]:
    """Read every capture below a folder; other files are named on standard error."""
    for path in sorted(folder.rglob("*.pcap*")):
        try:
            yield read(path, str(path.relative_to(folder)))
        except CaptureError as error:
            print(error, file=sys.stderr)


def default_folders() -> list[Path]:
    """Return the folder of the project's captures, and that of the public ones if it exists."""
    shared = Path(os.environ.get("S7DISSECT_CORPUS") or _ROOT.parent / "shared" / "captures")
    return [folder for folder in (_ROOT / "captures", shared) if folder.is_dir()]


class Table:
    """The verdicts of captures, a row for each rate and manner."""

    def __init__(self, rates: Sequence[float], rounds: int, seed: int, blaming: int = _BLAMING) -> None:
        self.blaming = blaming  # this many untrue statements are allowed
        self.rows = {(rate, burst): Verdict() for rate in rates for burst in (False, True)}
        self.captures = 0
        self.packets = 0
        self.pairs = 0
        self._rounds = rounds
        self._seed = seed

    def take(self, capture: Capture) -> None:
        """Leave packets out of a capture, at each rate, in each manner and this many times."""
        count = len(capture.packets)
        truth = Truth(Told(capture, range(count)))
        self.captures += 1
        self.packets += count
        self.pairs += len(truth.pairs)
        for (rate, burst), row in self.rows.items():
            for number in range(self._rounds):
                rng = Random(f"{self._seed} {capture.name} {rate} {burst} {number}")
                numbers = kept(count, rate, burst, rng)
                row.add(compare(capture, truth, Told(capture, numbers), numbers))

    def text(self, what: str) -> str:
        """Return the table."""
        head = f"{what}: {self.captures:,} captures, {self.packets:,} packets, {self.pairs:,} pairs"
        lines = [
            (f"{rate:.0%}", "bursts" if burst else "single", *row.cells()) for (rate, burst), row in self.rows.items()
        ]
        return f"{head}\n{columns(HEADS, lines)}\n"


def judge(tables: Sequence[Table]) -> list[str]:
    """Return the bars that are missed, a sentence each."""
    everything = Verdict()
    at_rate = Verdict()
    missed: list[str] = []
    for table in tables:
        blaming = 0
        for (rate, _), row in table.rows.items():
            everything.add(row)
            blaming += row.blaming.total()
            if rate == _RATE:
                at_rate.add(row)
        if blaming > table.blaming:
            missed.append(f"{blaming:,} statements blame untruly, {table.blaming} may")
    if everything.sure_wrong > _WRONG:
        missed.append(f"{everything.sure_wrong * 10_000:.1f} of 10,000 sure pairs are wrong")
    if at_rate.of_kept and at_rate.stays < _STAY:
        missed.append(f"only {at_rate.stays:.2%} of the pairs stay sure where {_RATE:.0%} are lost")
    return missed


def print_blame(tables: Sequence[Table], details: bool) -> None:
    """Print the statements that blame: slugs, captures, and each case if wanted."""
    rows = [row for table in tables for row in table.rows.values()]
    for title, counters in (("slug", [row.blaming for row in rows]), ("capture", [row.where for row in rows])):
        total: Counter[str] = sum(counters, Counter())
        if total:
            print(
                columns((title, "untrue blame"), [(name, f"{count:,}") for name, count in total.most_common()]) + "\n"
            )
    if details:
        for table in tables:
            for (rate, burst), row in table.rows.items():
                for line in row.details:
                    print(f"{rate:.0%} {'bursts' if burst else 'single'}: {line}")


def _rate(text: str) -> float:
    rate = float(text)
    if not 0 < rate < 1:
        raise argparse.ArgumentTypeError(f"{text}: a share, more than 0 and less than 1")
    return rate


def _title(folder: Path | None) -> str:
    if folder is None:
        return "made traffic"
    return (
        "captures of the project"
        if folder.resolve() == _ROOT / "captures"
        else f"captures in {folder.parent.name}/{folder.name}"
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.losses", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folders", nargs="*", type=Path, metavar="FOLDER", help="captures below it are read")
    parser.add_argument("--packets", type=parse_count, default=23_000, metavar="N", help="of the made traffic")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--rates", type=_rate, nargs="+", default=[0.02, 0.1, 0.3], metavar="R", help="0 to 1")
    parser.add_argument("--rounds", type=int, default=3, metavar="N", help="of each rate, with other losses")
    parser.add_argument("--details", action="store_true", help="print each wrong pair and each untrue statement")
    options = parser.parse_args(arguments)
    tables: list[Table] = []
    own = _ROOT / "captures"
    for folder in (None, *(options.folders or default_folders())):
        blaming = _BLAMING_OWN if folder and folder.resolve() == own else _BLAMING
        table = Table(options.rates, options.rounds, options.seed, blaming)
        for capture in captures(folder) if folder else [made(options.packets, options.seed)]:
            table.take(capture)
        print(table.text(_title(folder)))
        tables.append(table)
    print_blame(tables, options.details)
    missed = judge(tables)
    print("\n".join([f"MISSED: {line}" for line in missed]) or "All bars are held.")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
