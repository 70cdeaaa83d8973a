"""A target fed by the throw of dice, without a fuzzer: as fast as the build of the package that is there (docs/fuzzing.md).

What a fuzzer learned of interpreted code, its corpus, is damaged and run again by the compiled package, which does in the same
time several times as many inputs.
"""

from __future__ import annotations

import random
import resource
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Final, NamedTuple

from tests.fuzz.failures import Failures, Target
from tests.fuzz.mutations import mutated

#: Inputs between two looks at the clock.
_LOOK: Final = 50
#: Places of a corpus kept on the way: inputs that are as good as seeds, so that damage goes on from damage.
_KEPT: Final = 4096
#: One of so many inputs becomes one that others are made of.
_ONE_IN: Final = 64


class Thrown(NamedTuple):
    """What came of a run: inputs, the CPU seconds they took, the longest of them in seconds, kinds of failure."""

    executions: int
    cpu_s: float
    longest_s: float
    kinds: int

    def line(self, name: str, seed: int) -> str:
        """Return it in one line."""
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss >> 10
        return (
            f"{name}: {self.executions} executions in {self.cpu_s:.0f} CPU s, {self.executions / max(self.cpu_s, 1e-9):.0f}/s; "
            f"longest {self.longest_s:.3f} s; RSS {memory} MB; {self.kinds} kinds of failure; seed {seed}"
        )


def throw(
    name: str, target: Target, begun: Sequence[bytes], most: int, cpu_s: float, seed: int, artifacts: Path
) -> Thrown:
    """Run ``begun``, then damaged ones of them of at most ``most`` bytes, until ``cpu_s`` CPU seconds are over.

    What fails is kept in ``artifacts``, the first of each kind. The same ``begun`` and ``seed`` give the same inputs.
    """
    rng = random.Random(seed)
    pool = [octets for octets in begun if len(octets) <= most] or [b""]
    fixed = len(pool)
    failures = Failures(name, target, artifacts)
    start = time.process_time()
    longest = 0.0
    done = 0
    while True:
        octets = pool[done] if done < fixed else mutated(rng, rng.choice(pool), pool)[:most]
        before = time.process_time()
        failures(octets)
        longest = max(longest, time.process_time() - before)
        done += 1
        if done > fixed and not done % _ONE_IN:
            if len(pool) < fixed + _KEPT:
                pool.append(octets)
            else:
                pool[fixed + rng.randrange(_KEPT)] = octets
        if done >= fixed and not done % _LOOK and time.process_time() - start >= cpu_s:
            break
    return Thrown(done, time.process_time() - start, longest, len(failures.counts))


def corpus_of(folder: Path | None) -> list[bytes]:
    """Return the inputs that a fuzzer kept in ``folder``, in the order of their names; none where there is no such folder."""
    if folder is None or not folder.is_dir():
        return []
    return [path.read_bytes() for path in sorted(folder.iterdir()) if path.is_file()]


def main(arguments: Sequence[str]) -> int:
    """Run in a process of its own: target, CPU seconds, seed, folder of artifacts, and the corpus if there is one."""
    from tests.fuzz.seeds import every
    from tests.fuzz.targets import TARGETS

    name, cpu_s, seed, artifacts, *corpus = arguments
    target, seeds, most = TARGETS[name]
    begun = [*seeds(every()), *corpus_of(Path(corpus[0], name) if corpus else None)]
    thrown = throw(name, target, begun, most, float(cpu_s), int(seed), Path(artifacts))
    print(thrown.line(name, int(seed)), flush=True)
    return 1 if thrown.kinds else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
