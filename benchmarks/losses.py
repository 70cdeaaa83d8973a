"""Is what is told of a capture still true when packets are missing from it? ``python -m benchmarks.losses [FOLDER ...]``.

Packets of made traffic and of every capture below the folders (by default those of the project and the public ones, in
``S7DISSECT_CORPUS`` or ``../shared/captures``) are left out, one by one or in bursts, and the rest is analysed. What is told of
it is held against what is told of the complete capture:

* each pair of request and answer: it is wrong when its answer belongs to another request there. A pair of which both packets
  were kept, and that is not told, is missed: mostly another segment of one of its PDUs was left out;
* each statement that blames a device or a client (`benchmarks.blame`): it is untrue when the complete capture does not say it
  of that connection, or of that request, and when it does not say itself that something was not captured.

Exit code 1 when a bar is missed: at most 3 of 10,000 sure pairs are wrong, at most 5 statements blame untruly, and of the pairs
whose packets were kept at least 97 % are told as sure where 2 % were left out. It takes about MINUTES.
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

from benchmarks.blame import BLAMES, NOT_ANSWERED, OF_A_CAPTURE, OF_A_PAIR, OF_A_REQUEST, OF_HOSTS, REASONS, names_loss
from benchmarks.generate import parse_count
from benchmarks.tables import columns
from benchmarks.told import Capture, Key, Packet, Pair, Statement, Told, Unanswered, read
from benchmarks.traffic import Traffic
from benchmarks.truth import Truth as Made
from dissect.source.packet import CaptureError
from dissect.transactions.transaction import CAPTURE_ENDED, LIKELY, SURE

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

_ETHERNET: Final = 1
_ROOT: Final = Path(__file__).resolve().parents[1]
#: Packets that go together, where they do.
_BURST: Final = (5, 40)
#: Octets by which PDUs of one reference are held for the same: header, parameters and some data of nearly all of them.
_BEGIN: Final = 64
#: The bars: wrong pairs among the sure ones, untrue statements in all, and pairs that stay sure at `_RATE`.
_WRONG: Final = 3 / 10_000
_BLAMING: Final = 5
_STAY: Final = 0.97
_RATE: Final = 0.02

RIGHT: Final = "right"
WRONG: Final = "wrong"
#: The complete capture itself is not sure.
OPEN: Final = "open"


class Truth:
    """What is told of a complete capture, to look things up in."""

    def __init__(self, told: Told) -> None:
        self.pairs = [pair for pair in told.pairs if pair.certainty == SURE]
        self._requests: dict[Key, list[Pair]] = {}
        self._answers: dict[Key, list[Pair]] = {}
        self._named: dict[tuple[str, str, int], list[Pair]] = {}
        self._unanswered: dict[Key, list[Unanswered]] = {}
        self._silent: set[tuple[str, str, int, bytes]] = set()
        self._statements: dict[tuple[str, ...], list[Statement]] = {}
        self._packets = {(pair.request.packet, pair.answer) for pair in told.pairs}
        for pair in told.pairs:
            self._requests.setdefault(pair.request, []).append(pair)
            self._answers.setdefault(pair.answered, []).append(pair)
            self._named.setdefault(pair.request[:3], []).append(pair)
        for one in told.unanswered:
            self._unanswered.setdefault(one.request, []).append(one)
            self._silent.add((*one.request[:3], one.octets[:_BEGIN]))
        for statement in told.statements:
            self._statements.setdefault(_where(statement), []).append(statement)

    def judge(self, pair: Pair) -> str:
        """Return whether a pair that is told of fewer packets is `RIGHT` or `WRONG`, or `OPEN`."""
        asked = self._requests.get(pair.request, [])
        told = self._answers.get(pair.answered, [])
        if any(other.certainty == LIKELY for other in (*asked, *told)):
            return OPEN
        if asked and told:
            same = [other for other in asked if other.answer == pair.answer]
            right = len(asked) == 1 or any(other.octets == pair.octets for other in same)
            return RIGHT if same and right else WRONG
        # One packet is not the last of a PDU there: TCP sent it again, or the last fragments of the PDU were left out.
        candidates = asked or told or self._named.get(pair.request[:3], [])
        return RIGHT if any(_begin_alike(pair, other) for other in candidates) else WRONG

    def has_reason(self, one: Unanswered) -> bool:
        """Return whether it is true that a request had no answer, and why."""
        found = self._unanswered.get(one.request)
        if found is None:
            return one.request not in self._requests and (*one.request[:3], one.octets[:_BEGIN]) in self._silent
        # Where a capture ends early, an ending that it does not show is no untruth.
        return one.reason == CAPTURE_ENDED or any(other.reason == one.reason for other in found)

    def says(self, statement: Statement) -> bool:
        """Return whether the complete capture says the same."""
        found = self._statements.get(_where(statement), [])
        if statement.slug in OF_A_CAPTURE:
            return any(other.detail == statement.detail for other in found)
        if statement.slug in OF_HOSTS:
            return bool(found)
        if statement.slug in OF_A_PAIR:
            return statement.packets in self._packets
        found = [other for other in found if other.first <= statement.last and statement.first <= other.last]
        if statement.slug in OF_A_REQUEST:
            packets = set(statement.packets)
            return any(packets & set(other.packets) or other.detail == statement.detail for other in found)
        return bool(found)

    def was_answered(self, statement: Statement) -> bool:
        """Return whether a request that a statement is about was answered."""
        return any(asked in statement.packets for asked, _ in self._packets)


def _where(statement: Statement) -> tuple[str, ...]:
    """Return the slug of a statement, and of whom it is true."""
    if statement.slug in OF_A_CAPTURE:
        return (statement.slug,)
    if statement.slug in OF_HOSTS:
        return (statement.slug, *[end.rpartition(":")[0] for end in statement.ends])
    return (statement.slug, *statement.ends)


def _begin_alike(one: Pair, other: Pair) -> bool:
    """Return whether the PDUs of two pairs begin with the same octets, as one that was captured in part does."""
    return all(mine[:_BEGIN] == theirs[:_BEGIN] for mine, theirs in zip(one.octets, other.octets, strict=True))


class Verdict:
    """What is told of captures from which packets are missing: how much of it is true.

    ``of_kept`` counts the pairs of the complete capture whose packets were both kept. ``details`` has a line for each sure pair
    that is wrong and each untrue statement, ``blaming`` the slugs of these, ``where`` the captures.
    """

    def __init__(self) -> None:
        self.kept = 0
        self.counts: Counter[tuple[str, str]] = Counter()
        self.of_kept = 0
        self.stay = 0
        self.missed = 0
        self.blaming: Counter[str] = Counter()
        self.where: Counter[str] = Counter()
        self.details: list[str] = []

    def add(self, other: Verdict) -> None:
        """Add what was found in another capture, or another time."""
        self.kept += other.kept
        self.counts += other.counts
        self.of_kept += other.of_kept
        self.stay += other.stay
        self.missed += other.missed
        self.blaming += other.blaming
        self.where += other.where
        self.details += other.details

    @property
    def told(self) -> int:
        """The pairs that are told."""
        return self.counts.total()

    @property
    def sure_wrong(self) -> float:
        """The share of wrong pairs among the sure ones."""
        right, wrong = self.counts[SURE, RIGHT], self.counts[SURE, WRONG]
        return wrong / max(1, right + wrong)

    @property
    def stays(self) -> float:
        """The share of pairs that are told as sure, of those whose packets were kept."""
        return self.stay / max(1, self.of_kept)

    def cells(self) -> tuple[str, ...]:
        """Return the texts of the line."""
        counts = self.counts
        numbers = (
            self.kept, self.told, counts[SURE, RIGHT], counts[SURE, WRONG], counts[LIKELY, RIGHT], counts[LIKELY, WRONG],
            self.missed,
        )  # fmt: skip
        return (*[f"{number:,}" for number in numbers], f"{self.stays:.2%}", f"{self.blaming.total():,}")


HEADS: Final = (
    "lost", "how", "packets kept", "pairs told", "sure right", "sure WRONG", "likely right", "likely wrong", "not told",
    "stay sure", "untrue blame",
)  # fmt: skip


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


def compare(name: str, truth: Truth, told: Told, numbers: Sequence[int]) -> Verdict:
    """Hold what is ``told`` of the packets ``numbers`` of a capture against the ``truth`` of all of them."""
    verdict = Verdict()
    verdict.kept = len(numbers)
    stay: set[Key] = set()
    for pair in told.pairs:
        judged = truth.judge(pair)
        verdict.counts[pair.certainty, judged] += 1
        if pair.certainty == SURE and judged == RIGHT:
            stay.add(pair.request)
        elif pair.certainty == SURE and judged == WRONG:
            key = pair.request
            what = f"reference 0x{key.reference:04x}, request {key.packet + 1}, answer {pair.answer + 1}"
            verdict.details.append(f"{name}: WRONG PAIR: {key.asking} to {key.answering}: {what}")
    there, found = set(numbers), {pair.request for pair in told.pairs}
    for pair in truth.pairs:
        if pair.request.packet in there and pair.answer in there:
            verdict.of_kept += 1
            verdict.stay += pair.request in stay
            verdict.missed += pair.request not in found
    for statement in blaming(truth, told):
        verdict.blaming[statement.slug] += 1
        verdict.where[name] += 1
        packets = ", ".join([str(packet + 1) for packet in statement.packets])
        ends = " and ".join(statement.ends)
        verdict.details.append(f"{name}: {statement.slug}: {ends}: packets {packets}: {statement.detail}")
    return verdict


def blaming(truth: Truth, told: Told) -> Iterator[Statement]:
    """Give each statement that blames and is not true; of a request without answer, with its reason as the slug."""
    for statement in told.statements:
        if statement.slug not in BLAMES or names_loss(statement.detail):
            continue
        if not truth.says(statement):
            yield statement
        elif statement.detail.endswith(NOT_ANSWERED) and truth.was_answered(statement):
            yield statement._replace(slug=statement.slug + NOT_ANSWERED)
    for one in told.unanswered:
        if one.missed and one.reason in REASONS and not truth.has_reason(one):
            key = one.request
            ends, packets = (key.asking, key.answering), (key.packet,)
            yield Statement(f"reason {one.reason}", ends, key.packet, key.packet, packets, one.function)


def made(count: int, seed: int) -> Capture:
    """Return made traffic of so many packets."""
    capture = Capture("made traffic")
    for time_ns, frame, _, _ in islice(Traffic(seed, Made(), 50, grain_ns=1000).packets(), count):
        capture.packets.append(Packet(time_ns, frame, len(frame), _ETHERNET))
    return capture


def captures(folders: Sequence[Path]) -> Iterator[Capture]:
    """Read every capture below the folders; a file that is none is named on standard error."""
    for folder in folders:
        for path in sorted(folder.rglob("*.pcap*")):
            try:
                yield read(path, str(path.relative_to(folder)))
            except CaptureError as error:
                print(error, file=sys.stderr)


def default_folders() -> list[Path]:
    """Return the folder of the project's captures and that of the public ones, where it is there."""
    shared = Path(os.environ.get("S7DISSECT_CORPUS") or _ROOT.parent / "shared" / "captures")
    return [folder for folder in (_ROOT / "captures", shared) if folder.is_dir()]


class Table:
    """The verdicts of captures, a row for each rate and manner."""

    def __init__(self, rates: Sequence[float], rounds: int, seed: int) -> None:
        self.rows = {(rate, burst): Verdict() for rate in rates for burst in (False, True)}
        self.captures = 0
        self.packets = 0
        self.pairs = 0
        self._rounds = rounds
        self._seed = seed

    def take(self, capture: Capture) -> None:
        """Leave packets out of a capture, at each rate, in each manner and so many times."""
        count = len(capture.packets)
        truth = Truth(Told(capture, range(count)))
        self.captures += 1
        self.packets += count
        self.pairs += len(truth.pairs)
        for (rate, burst), row in self.rows.items():
            for number in range(self._rounds):
                rng = Random(f"{self._seed} {capture.name} {rate} {burst} {number}")
                numbers = kept(count, rate, burst, rng)
                row.add(compare(capture.name, truth, Told(capture, numbers), numbers))

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
    for table in tables:
        for (rate, _), row in table.rows.items():
            everything.add(row)
            if rate == _RATE:
                at_rate.add(row)
    missed: list[str] = []
    if everything.sure_wrong > _WRONG:
        missed.append(f"{everything.sure_wrong * 10_000:.1f} of 10,000 sure pairs are wrong")
    if everything.blaming.total() > _BLAMING:
        missed.append(f"{everything.blaming.total():,} statements blame untruly")
    if at_rate.of_kept and at_rate.stays < _STAY:
        missed.append(f"only {at_rate.stays:.2%} of the pairs stay sure where {_RATE:.0%} are lost")
    return missed


def print_blame(tables: Sequence[Table], details: bool) -> None:
    """Print who blames: slugs, captures, and each case if that is wanted."""
    rows = [row for table in tables for row in table.rows.values()]
    for title, counters in (("slug", [row.blaming for row in rows]), ("capture", [row.where for row in rows])):
        total: Counter[str] = sum(counters, Counter())
        if total:
            print(columns((title, "untrue blame"), [(name, f"{count:,}") for name, count in total.most_common()]) + "\n")
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
    for title, found in (
        ("made traffic", iter([made(options.packets, options.seed)])),
        ("captures", captures(options.folders or default_folders())),
    ):
        table = Table(options.rates, options.rounds, options.seed)
        for capture in found:
            table.take(capture)
        print(table.text(title))
        tables.append(table)
    print_blame(tables, options.details)
    missed = judge(tables)
    print("\n".join([f"MISSED: {line}" for line in missed]) or "All bars are held.")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
