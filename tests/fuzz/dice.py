"""A target with random inputs, without a fuzzer: as fast as the installed build of the package (docs/fuzzing.md).

The corpus that a fuzzer learned from interpreted code is damaged and run again by the compiled package, which tries several
times as many inputs in the same time.

A long run consists of rounds. Each begins with its own random numbers, so rounds run in parallel, and a stopped run continues
after those noted in its file.
"""

from __future__ import annotations

import argparse
import json
import math
import random
import resource
import sys
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from typing import Final, NamedTuple

from tests.fuzz.failures import Failures, Target
from tests.fuzz.mutations import mutated
from tests.fuzz.turns import TURNS

#: Inputs between two looks at the clock.
_LOOK: Final = 50
#: Number of corpus entries kept during a run: they are as good as seeds, so that damage continues from damage.
_KEPT: Final = 4096
#: One of this many inputs becomes a source for others.
_ONE_IN: Final = 64
#: Inputs of a round.
ROUND: Final = 10_000


class Thrown(NamedTuple):
    """The result of a run: inputs, their CPU seconds, the longest one in seconds, kinds of failure, memory in MB."""

    executions: int
    cpu_s: float
    longest_s: float
    kinds: tuple[str, ...]
    memory: int

    def line(self, name: str, seed: int) -> str:
        """Return it in one line."""
        return (
            f"{name}: {self.executions} executions in {self.cpu_s:.0f} CPU s, {self.executions / max(self.cpu_s, 1e-9):.0f}/s; "
            f"longest {self.longest_s:.3f} s; RSS {self.memory} MB; {len(self.kinds)} kinds of failure; seed {seed}"
        )

    def joined(self, other: Thrown) -> Thrown:
        """Return the sum of both."""
        return Thrown(
            self.executions + other.executions,
            self.cpu_s + other.cpu_s,
            max(self.longest_s, other.longest_s),
            tuple(sorted({*self.kinds, *other.kinds})),
            max(self.memory, other.memory),
        )


NOTHING: Final = Thrown(0, 0.0, 0.0, (), 0)


def damaged(begun: Sequence[bytes], most: int, dice: random.Random) -> Iterator[bytes]:
    """Yield damaged versions of ``begun`` of at most ``most`` bytes, and damaged versions of these, without end."""
    pool = list(begun)
    fixed = len(pool)
    done = 0
    while True:
        octets = mutated(dice, dice.choice(pool), pool)[:most]
        yield octets
        done += 1
        if not done % _ONE_IN:
            if len(pool) < fixed + _KEPT:
                pool.append(octets)
            else:
                pool[fixed + dice.randrange(_KEPT)] = octets


def throw(
    name: str,
    target: Target,
    begun: Sequence[bytes],
    most: int,
    cpu_s: float,
    seed: int,
    artifacts: Path,
    number: int | None = None,
    size: int = ROUND,
) -> Thrown:
    """Run ``begun``, then damaged ones of them of at most ``most`` bytes, until ``cpu_s`` CPU seconds are over.

    With ``number`` it is that round of a long run: ``size`` inputs, ``begun`` themselves only in round 0. Failing inputs are
    kept in ``artifacts``, the first of each kind. The same ``begun``, ``seed`` and ``number`` give the same run.
    """
    fitting = [octets for octets in begun if len(octets) <= most] or [b""]
    inputs = damaged(fitting, most, random.Random(seed if number is None else f"{seed} {number}"))
    first = [] if number else fitting
    failures = Failures(name, target, artifacts)
    start = time.process_time()
    longest = 0.0
    done = 0
    while True:
        octets = first[done] if done < len(first) else next(inputs)
        before = time.process_time()
        failures(octets)
        longest = max(longest, time.process_time() - before)
        done += 1
        if done < len(first):
            continue
        if done >= size if number is not None else not done % _LOOK and time.process_time() - start >= cpu_s:
            break
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss >> 10
    return Thrown(done, time.process_time() - start, longest, tuple(sorted(failures.counts)), memory)


def corpus_of(folder: Path | None) -> list[bytes]:
    """Return the inputs that a fuzzer kept in ``folder``, in the order of their names; empty if there is no such folder."""
    if folder is None or not folder.is_dir():
        return []
    return [path.read_bytes() for path in sorted(folder.iterdir()) if path.is_file()]


class Notes:
    """The file with the finished rounds of a run, one JSON line each; without a path nothing is kept."""

    def __init__(self, path: Path | None, name: str, seed: int) -> None:
        self._path = path
        self._run = {"target": name, "seed": seed}

    def done(self) -> dict[int, Thrown]:
        """Return the finished rounds of this target and seed; ignore a line that was cut off when the run was stopped."""
        found = {}
        for line in self._path.read_text(encoding="utf-8").splitlines() if self._path and self._path.exists() else ():
            try:
                note = json.loads(line)
            except ValueError:
                continue
            if {key: note[key] for key in self._run} == self._run:
                executions, cpu_s, longest_s, kinds, memory = note["thrown"]
                found[note["round"]] = Thrown(executions, cpu_s, longest_s, tuple(kinds), memory)
        return found

    def add(self, number: int, thrown: Thrown) -> None:
        """Note a round."""
        if self._path is not None:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            with self._path.open("a", encoding="utf-8") as file:
                file.write(json.dumps({**self._run, "round": number, "thrown": thrown}) + "\n")


def rounds(
    name: str, count: int, seed: int, artifacts: Path, corpus: Path | None, jobs: int, notes: Notes, size: int = ROUND
) -> Thrown:
    """Run the rounds 0 to ``count`` that are not noted, ``jobs`` in parallel; return the sum of all, including noted ones."""
    done = notes.done()
    left = [number for number in range(count) if number not in done]
    made = partial(_run, name, 0.0, seed, artifacts, corpus, size)
    if jobs == 1:
        for number in left:
            done[number] = made(number)
            notes.add(number, done[number])
    else:
        with ProcessPoolExecutor(jobs) as pool:
            for number, thrown in zip(left, pool.map(made, left), strict=True):
                done[number] = thrown
                notes.add(number, thrown)
    total = NOTHING
    for number in range(count):
        total = total.joined(done[number])
    return total


def _run(
    name: str, cpu_s: float, seed: int, artifacts: Path, corpus: Path | None, size: int, number: int | None
) -> Thrown:
    from tests.fuzz.seeds import every
    from tests.fuzz.targets import TARGETS

    target, seeds, most = TARGETS[name]
    begun = [*seeds(every()), *corpus_of(corpus / name if corpus else None)]
    TURNS.one = True
    try:
        return throw(name, target, begun, most, cpu_s, seed, artifacts, number, size)
    finally:
        TURNS.one = False


def main(arguments: Sequence[str]) -> int:
    """Run in a separate process, in which the installed package is found first."""
    parser = argparse.ArgumentParser()
    parser.add_argument("target")
    parser.add_argument("--seconds", type=float, default=math.inf)
    parser.add_argument("--executions", type=int, default=0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--artifacts", type=Path, required=True)
    parser.add_argument("--corpus", type=Path)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--done", type=Path)
    options = parser.parse_args(arguments)
    name, seed = options.target, options.seed
    if options.executions:
        count = -(-options.executions // ROUND)
        notes = Notes(options.done, name, seed)
        thrown = rounds(name, count, seed, options.artifacts, options.corpus, options.jobs, notes)
    else:
        thrown = _run(name, options.seconds, seed, options.artifacts, options.corpus, ROUND, None)
    print(thrown.line(name, seed), flush=True)
    return 1 if thrown.kinds else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
